"""Load stage: vehicles become forces on the road."""
