"""Trained weights -> the ONNX file that physgen ships: `python studio/segmentation/export.py out/segmentation/weights.pt`.

Weights are stored in 16 bits. OpenCV must give what torch gives, or nothing is written.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import warnings
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from network import Network
from onnx import numpy_helper

HERE = Path(__file__).resolve().parent
SHIPPED = HERE.parents[1] / "physgen/perceive/segment/segmentation.onnx"
CLOSE = 0.1
"""What 16-bit weights may change of a logit."""


def export(weights: Path, shipped: Path) -> float:
    """Write the file; returns the largest difference of a logit from torch's."""
    network = Network().eval()
    network.load_state_dict(torch.load(weights, map_location="cpu", weights_only=True))
    example = torch.randn(1, 3, 192, 256)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.onnx"
        free = {2: "height", 3: "width"}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            torch.onnx.export(
                network, (example,), str(path), dynamo=False, opset_version=13, input_names=["photo"],
                output_names=["seen"], dynamic_axes={"photo": free, "seen": free},
            )  # fmt: skip
        model = onnx.load(str(path))
        for held in model.graph.initializer:
            if held.data_type == onnx.TensorProto.FLOAT and len(held.dims) == 4:
                held.CopyFrom(
                    numpy_helper.from_array(numpy_helper.to_array(held).astype(np.float16), held.name)
                )
        onnx.save(model, str(path))
        theirs = cv2.dnn.readNetFromONNX(str(path))
        off = 0.0
        for size in ((192, 256), (256, 416)):
            x = torch.randn(1, 3, *size)
            theirs.setInput(x.numpy())
            with torch.inference_mode():
                off = float(np.maximum(off, np.abs(theirs.forward() - network(x).numpy()).max()))
        if not off <= CLOSE:  # nor NaN
            raise SystemExit(f"OpenCV's output is {off:.3f} from torch's; nothing written")
        shipped.write_bytes(path.read_bytes())
    return off


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weights", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=SHIPPED)
    args = parser.parse_args()
    if not args.weights.is_file():
        parser.error(f"{args.weights}: no such file; make it with train.py")
    off = export(args.weights, args.output)
    print(f"{args.output.stat().st_size / 1e6:.1f} MB, logits within {off:.4f} of torch's", file=sys.stderr)


if __name__ == "__main__":
    main()
