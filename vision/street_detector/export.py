"""The network as an ONNX file that says what it is."""

import tempfile
import warnings
from pathlib import Path

import onnx
import torch

from vision.contract import writing
from vision.street_detector.model import CLASSES, INPUT, STRIDE, Decoded, StreetNet

OPSET = 17


def save_onnx(net: StreetNet, path: Path, threshold: float) -> None:
    """Write the network with in-graph peak extraction.

    Parameters
    ----------
    net : trained network
    path : file to write
    threshold : default score from which a detection is reported, kept in the metadata
    """
    picture = torch.zeros(1, 3, *INPUT)
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "raw.onnx"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # the new exporter needs onnxscript; this one does not
            torch.onnx.export(
                Decoded(net).eval(),
                (picture, picture),
                str(raw),
                dynamo=False,
                opset_version=OPSET,
                input_names=["frame", "background"],
                output_names=["detections"],
            )
        model = onnx.load_model(str(raw))
    onnx.helper.set_model_props(
        model,
        {
            "layout": "roadfiber-street",
            "names": str(dict(enumerate(CLASSES))),
            "imgsz": str(list(INPUT)),
            "stride": str(STRIDE),
            "threshold": str(threshold),
            "license": "MIT",
            "description": "roadfiber street detector: fixed camera, frame and background; demo-grade",
        },
    )
    onnx.checker.check_model(model)
    with writing(path) as part:
        onnx.save_model(model, str(part))
