"""Interrogator stage: strain of the fiber becomes the strain rate of gauges."""
