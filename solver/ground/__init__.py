"""Ground stage: how the ground answers a load."""
