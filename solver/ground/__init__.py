"""Ground stage: the response of the ground to a load."""
