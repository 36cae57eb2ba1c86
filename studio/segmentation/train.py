"""Stored pictures -> weights: `python studio/segmentation/train.py --minutes 60 -o out/segmentation`; CPU or GPU, seeds fixed."""

from __future__ import annotations

import argparse
import copy
import json
import math
import queue
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch
from batches import Batch, batches
from network import BOUNDARY, FOREGROUND, NORMALS, PAIRS, SHADOW, Network
from store import Store
from torch import Tensor
from torch.nn import functional as F

BATCH = 16
RATE = 3e-3
"""Of learning, at most."""
AHEAD = 12
"""Batches that wait."""


def losses(out: Tensor, batch: dict[str, Tensor]) -> dict[str, Tensor]:
    """What the network has wrong, by part; each about 1 at the start."""
    said, weight = batch["said"], batch["weight"]
    on = batch["foreground"]

    def crossed(channel: Tensor, truth: Tensor, share: Tensor) -> Tensor:
        return (F.binary_cross_entropy_with_logits(channel, truth, reduction="none") * share).sum() / share.sum().clamp(min=1)

    foreground = out[:, FOREGROUND]
    sure = torch.sigmoid(foreground) * said
    dice = 1 - (2 * (sure * on).sum((1, 2)) + 20) / (sure.sum((1, 2)) + on.sum((1, 2)) + 20)
    asked = batch["asked"]
    normals = (out[:, NORMALS] - batch["normals"]).abs().sum(1)
    known = (batch["normals"].abs().sum(1) > 0).float() * (0.2 + on)
    return {
        "foreground": crossed(foreground, on, said * weight * (1 + 1.5 * batch["boundary"])) + 0.5 * dice.mean(),
        "boundary": crossed(out[:, BOUNDARY], batch["boundary"], said * (1 + 3 * batch["boundary"])),
        "pairs": 1.5 * crossed(out[:, PAIRS], batch["pairs"], asked * weight[:, None]),
        "normals": 0.2 * (normals * known).sum() / known.sum().clamp(min=1),
        "shadow": 0.4 * crossed(out[:, SHADOW], batch["shadow"], said),
    }


def ahead(source: Iterator[Batch], device: torch.device) -> Iterator[dict[str, Tensor]]:
    """The batches, made by a thread while the network learns."""
    line: queue.Queue[dict[str, Tensor]] = queue.Queue(AHEAD)

    def work() -> None:
        cv2.setNumThreads(1)
        for batch in source:
            line.put({name: torch.from_numpy(part) for name, part in vars(batch).items()})

    threading.Thread(target=work, daemon=True).start()
    while True:
        yield {name: part.to(device) for name, part in line.get().items()}


def train(stores: list[Store], shares: list[float], minutes: float, seed: int, out: Path, device: str) -> None:
    """Learn for so many minutes; `out` gets weights.pt (the mean of the last steps') and log.json."""
    torch.manual_seed(seed)
    where = torch.device(device)
    network = Network().to(where, memory_format=torch.channels_last)
    mean = copy.deepcopy(network).eval()
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=0.02)
    source = ahead(batches(stores, shares, BATCH, seed), where)
    log: list[dict[str, float]] = []
    running: dict[str, float] = {}
    out.mkdir(parents=True, exist_ok=True)
    started, step, marks = time.monotonic(), 0, [minutes * k / 6 for k in range(1, 7)]
    print(f"{sum(p.numel() for p in network.parameters()):,} parameters", flush=True)
    while (passed := (time.monotonic() - started) / 60) < minutes:
        rate = RATE * min(1, (step + 1) / 150) * (0.5 + 0.5 * math.cos(math.pi * passed / minutes) + 0.004)
        for group in optimizer.param_groups:
            group["lr"] = rate
        batch = next(source)
        parts = losses(network(batch["x"].contiguous(memory_format=torch.channels_last)), batch)
        optimizer.zero_grad()
        sum(parts.values(), torch.zeros((), device=where)).backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimizer.step()
        step += 1
        keep = min(0.995, 1 - 1 / (step / 5 + 2))
        with torch.no_grad():
            for ours, theirs in zip(mean.state_dict().values(), network.state_dict().values(), strict=True):
                if ours.dtype.is_floating_point:
                    ours.lerp_(theirs, 1 - keep)
                else:
                    ours.copy_(theirs)
        for name, part in ((name, part.detach()) for name, part in parts.items()):
            running[name] = 0.98 * running.get(name, float(part)) + 0.02 * float(part)
        if step % 50 == 0:
            log.append({"step": step, "minutes": round(passed, 2), **{k: round(v, 4) for k, v in running.items()}})
            print(json.dumps(log[-1]), flush=True)
            (out / "log.json").write_text(json.dumps(log, indent=1))
        if marks and passed > marks[0]:
            torch.save(mean.state_dict(), out / f"after-{marks.pop(0):.0f}.pt")
    torch.save(mean.state_dict(), out / "weights.pt")


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stores", nargs="+", help="FOLDER or FOLDER=SHARE of stored pictures")
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/segmentation"))
    args = parser.parse_args()
    named = [text.partition("=") for text in args.stores]
    np.random.seed(args.seed)
    train(
        [Store.at(Path(folder)) for folder, _, _ in named],
        [float(share or 1) for _, _, share in named],
        args.minutes, args.seed, args.output, args.device,
    )  # fmt: skip


if __name__ == "__main__":
    main()
