"""Noise: its level in quiet windows, and the law that whitens it."""
