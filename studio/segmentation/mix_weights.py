"""Mix trained weights with those of the given PicoDet: `python studio/segmentation/mix_weights.py out/segmentation/detector/detector.pt --given 0.4`.

A mean of the weights before and after further training keeps more of what the network
knew about photos of other kinds than either (Wortsman et al. 2022, arXiv:2109.01903).
The result is written beside the trained weights as detector-mixed.pt.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from coco import material
from detector import Detector
from given import load_given
from torch import Tensor


def mixed(trained: dict[str, Tensor], given_share: float) -> dict[str, Tensor]:
    """Return the weighted mean of trained weights and the given ones."""
    start = Detector()
    load_given(start, material() / "material/networks/picodet_s_416_coco.onnx")
    given = start.state_dict()
    return {name: torch.lerp(trained[name], given[name], given_share) for name in given}


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weights", type=Path)
    parser.add_argument(
        "--given", type=float, default=0.4, help="share of the given weights, 0 to 1"
    )
    args = parser.parse_args()
    if not args.weights.is_file():
        parser.error(f"{args.weights}: no such file; make it with train_detector.py")
    trained = torch.load(args.weights, map_location="cpu", weights_only=True)
    torch.save(mixed(trained, args.given), args.weights.with_name("detector-mixed.pt"))


if __name__ == "__main__":
    main()
