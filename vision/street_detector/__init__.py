"""The detector for the demo's renderings: `street.onnx`, its card and its training."""

from pathlib import Path

MODEL = Path(__file__).with_name("street.onnx")
