"""Tracks in the formats of others: MOTChallenge text, OTVision's tracks and detections."""

from vision.exchange.mot import read_mot, write_mot
from vision.exchange.otvision import read_otdet, read_ottrk

__all__ = ["read_mot", "read_otdet", "read_ottrk", "write_mot"]
