"""Vehicle detectors from ONNX files: `load_detector`, what it returns, and the layouts it knows."""

from vision.detectors.detections import Detections, Detector
from vision.detectors.layouts import LAYOUTS
from vision.detectors.onnx_detector import OnnxDetector, is_street, load_detector

__all__ = ["LAYOUTS", "Detections", "Detector", "OnnxDetector", "is_street", "load_detector"]
