"""Weights kept while training -> how well each sees the validation homes: `python studio/segmentation/growth.py FOLDER`.

Prints a line a file of `train.py -o FOLDER`: intersection over union of what is seen as object with what is, over all
pixels of all homes, and the share of the pixels of the objects' borders that are seen as border. No judge, no choice.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
import torch
from batches import targets
from network import BOUNDARY, FOREGROUND, MEAN, SPREAD, Network
from store import UNSAID

VALIDATION = Path(__file__).resolve().parent / "validation"
SIDE = 512
"""px, the longer side of the photos as they are looked at."""


def seen(network: Network, path: Path) -> tuple[int, int, int, int]:
    """Pixels that are and are seen as object, that are or are seen as it, border seen, border."""
    rgb = cv2.imread(str(path))[..., ::-1]
    scale = SIDE / max(rgb.shape[:2])
    height, width = (round(part * scale / 32) * 32 for part in rgb.shape[:2])
    x = (cv2.resize(rgb, (width, height)).astype(np.float32) - MEAN) / SPREAD
    with torch.inference_mode():
        out = network(torch.from_numpy(x.transpose(2, 0, 1)[None]))[0].numpy()
    ids = cv2.imread(str(path.with_suffix(".labels.png")), cv2.IMREAD_UNCHANGED)
    ids = cv2.resize(ids, (width // 2, height // 2), interpolation=cv2.INTER_NEAREST)
    labels = np.where(ids == 65535, UNSAID, ids).astype(np.uint8)
    on, border, _, _ = targets(labels)
    said = labels != UNSAID
    told, rim = (out[FOREGROUND] > 0) & said, out[BOUNDARY] > 0
    true, edge = (on > 0) & said, border > 0
    return (
        int((told & true).sum()),
        int((told | true).sum()),
        int((rim & edge).sum()),
        int(edge.sum()),
    )


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    files = sorted(
        parser.parse_args().folder.glob("weights*.pt"),
        key=lambda p: int("0" + "".join(filter(str.isdigit, p.stem))),
    )
    files = sorted(files, key=lambda p: p.stem == "weights")
    for file in files:
        network = Network().eval()
        network.load_state_dict(torch.load(file, map_location="cpu", weights_only=True))
        both, either, rim, edge = np.sum(
            [seen(network, p) for p in sorted(VALIDATION.glob("*.jpg"))], axis=0
        )
        print(f"| {file.stem} | {both / either:.3f} | {rim / edge:.3f} |", flush=True)


if __name__ == "__main__":
    main()
