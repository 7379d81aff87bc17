"""Trajectory stage: fixes of vehicles become smooth passes at the record's sample times."""

from solver.trajectory.passes import Pass, smooth_passes

__all__ = ["Pass", "smooth_passes"]
