"""Trajectory stage: fixes of vehicles become smooth passes at the record's sample times."""
