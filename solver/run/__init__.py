"""Locate, and the run it returns: route, fit and report of a fiber, written whole and read back."""
