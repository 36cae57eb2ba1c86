"""Trained weights -> the ONNX files that physgen ships: `python studio/segmentation/export.py out/segmentation/weights.pt`,
`cutout.pt` for the head that cuts out, or `detector.pt` for the detector.

Weights are stored in 16 bits. OpenCV must give what torch gives, or nothing is written.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from detector import BOX_NAMES, SCORE_NAMES, Detector
from detector import SIDE as DETECTOR_SIDE
from network import UP, Cutout, Network, load_exported
from onnx import numpy_helper
from torch import Tensor, nn

from physgen.perceive.segment.network import OUTPUTS, SIDE

SHIPPED = Path(__file__).resolve().parents[2] / "physgen/perceive/segment"
CLOSE = 0.1
"""What 16-bit weights may change of a logit."""


SCORE_TOLERANCE = 0.03
"""What 16-bit weights may change of a score of the detector, in 0..1."""


class _Seen(nn.Module):
    """All that is shipped of the network: its output, and what the head reads."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.network = network

    def forward(self, photo: Tensor) -> tuple[Tensor, ...]:
        levels = self.network.levels(photo)
        return self.network.out(levels[-1][:, : UP[-1]]), *levels


class _Cut(nn.Module):
    def __init__(self, head: Cutout) -> None:
        super().__init__()
        self.head = head

    def forward(
        self, a: Tensor, b: Tensor, c: Tensor, d: Tensor, e: Tensor, at_point: Tensor
    ) -> Tensor:
        return self.head([a, b, c, d, e], at_point)


def export(
    model: nn.Module,
    into: Sequence[str],
    out: Sequence[str],
    trials: Sequence[tuple[Tensor, ...]],
    path: Path,
    any_size: bool = False,
    tolerance: float = CLOSE,
) -> float:
    """Write the file; returns the largest difference of a logit, the first output, from torch's on the `trials`."""
    free = {name: {2: f"{name} height", 3: f"{name} width"} for name in (*into, *out)}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "network.onnx"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            torch.onnx.export(
                model, trials[0], str(file), dynamo=False, opset_version=13, input_names=list(into),
                output_names=list(out), dynamic_axes=free if any_size else None,
            )  # fmt: skip
        graph = onnx.load(str(file))
        kernels = {node.input[1] for node in graph.graph.node if node.op_type == "Conv"}
        for held in graph.graph.initializer:
            if held.name in kernels:
                held.CopyFrom(
                    numpy_helper.from_array(
                        numpy_helper.to_array(held).astype(np.float16), held.name
                    )
                )
        onnx.save(graph, str(file))
        theirs = cv2.dnn.readNetFromONNX(str(file))
        off = 0.0
        for trial in trials:
            for name, part in zip(into, trial, strict=True):
                theirs.setInput(part.numpy(), name)
            with torch.inference_mode():
                ours = model(*trial)
            ours = ours if isinstance(ours, Tensor) else ours[0]
            off = float(
                np.maximum(
                    off, np.abs(theirs.forward(list(out))[0] - ours.numpy()).max()
                )
            )
        if not off <= tolerance:  # nor NaN
            raise SystemExit(
                f"OpenCV's output is {off:.3f} from torch's; nothing written"
            )
        path.write_bytes(file.read_bytes())
    return off


def export_detector(weights: dict[str, Tensor], path: Path) -> float:
    """Write the detector's file; return the largest difference of a score of stride 8
    from torch's."""
    detector = Detector().eval()
    detector.load_state_dict(weights)
    generator = torch.Generator().manual_seed(0)
    photo = torch.randn(1, 3, DETECTOR_SIDE, DETECTOR_SIDE, generator=generator)
    names = [*SCORE_NAMES, *BOX_NAMES]
    return export(
        detector, ["photo"], names, [(photo,)], path, tolerance=SCORE_TOLERANCE
    )


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weights", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=SHIPPED, help="folder")
    args = parser.parse_args()
    if not args.weights.is_file():
        parser.error(
            f"{args.weights}: no such file; make it with train.py or cutout.py"
        )
    held = torch.load(args.weights, map_location="cpu", weights_only=True)
    network = Network().eval()
    if "backbone.stem.0.weight" in held:
        path = args.output / "detector.onnx"
        off = export_detector(held, path)
    elif "place" in held:
        path = args.output / "cutout.onnx"
        load_exported(
            network, SHIPPED / "segmentation.onnx", torch.zeros(1, 3, SIDE, SIDE)
        )
        head = Cutout(SIDE).eval()
        head.load_state_dict(held)
        with torch.no_grad():
            levels = network.levels(torch.randn(1, 3, SIDE, SIDE))
        trials = [
            (*levels, torch.full((1, 1, 1, 1), at_point)) for at_point in (0.0, 1.0)
        ]
        off = export(
            _Cut(head).eval(), [*OUTPUTS[1:], "at-point"], ["cut"], trials, path
        )
    else:
        path = args.output / "segmentation.onnx"
        network.load_state_dict(held)
        photos = [(torch.randn(1, 3, *size),) for size in ((192, 256), (256, 416))]
        off = export(
            _Seen(network).eval(), ["photo"], OUTPUTS, photos, path, any_size=True
        )
    print(
        f"{path.stat().st_size / 1e6:.1f} MB, the first output within {off:.4f} of torch's",
        file=sys.stderr,
    )


if __name__ == "__main__":
    main()
