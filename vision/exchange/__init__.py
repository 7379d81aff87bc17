"""Tracks in the formats of others: MOTChallenge text, OTVision tracks and reference points."""

from vision.exchange.mot import read_mot, write_mot
from vision.exchange.otvision import read_ottrk, read_reference_points

__all__ = ["read_mot", "read_ottrk", "read_reference_points", "write_mot"]
