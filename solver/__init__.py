"""Trajectories and DAS to a fiber route: signal path, matched filter, fits, reports."""
