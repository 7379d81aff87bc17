"""The embedded demo-grade detector for fixed cameras: `street.onnx`, its card and its training."""

from pathlib import Path

MODEL = Path(__file__).with_name("street.onnx")
