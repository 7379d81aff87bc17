"""How good tracks are, and whether they are good enough for the fiber."""

from vision.quality.report import write_report
from vision.quality.scores import Scores, score_tracks
from vision.quality.setting import Setting, read_settings

__all__ = ["Scores", "Setting", "read_settings", "score_tracks", "write_report"]
