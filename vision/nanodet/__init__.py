"""The detector that comes along for real streets, NanoDet-g: its file, card, license and conversion."""

from pathlib import Path

MODEL = Path(__file__).with_name("nanodet_g.onnx")
