"""Pixels to metric trajectories: camera, detectors, tracker, trajectory tables with a sigma per fix."""
