"""Pictures -> how well each proposal fits, learned from evidence: `python studio/segmentation/judge.py DIR... --drawn 160`.

What the network has not learned from: drawn pictures of other seeds, and the last of the rendered ones. Half of them
teach the judge, the others tell how often what it chooses is right.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from drawn import draw
from numpy.typing import NDArray
from picture import Picture
from torch import nn
from torch.nn import functional as F  # noqa: N812

from physgen.perceive.backends.segment_learned import choose
from physgen.perceive.learned import judge
from physgen.perceive.learned.candidates import Candidates, candidates
from physgen.perceive.learned.evidence import NAMES
from physgen.perceive.learned.network import see

SHIPPED = Path(judge.__file__).with_name(judge.JUDGE)
FIRST = 5_000_000
"""Seed of the first drawn picture: training's are far below."""
WIDTH = 40
"""Of the judge's two hidden layers."""
STEPS = 4000
RIGHT = 0.5
"""Intersection over union from which a proposal is right."""


@dataclass(frozen=True)
class Tried:
    """One picture's candidates and how well each fits the object that it fits best."""

    found: Candidates
    fit: NDArray[np.float64]


def fits(found: Candidates, picture: Picture) -> NDArray[np.float64]:
    """(n,) the best intersection over union of each candidate with an object; unsaid pixels are nobody's."""
    size = found.shape[::-1]
    labels = cv2.resize(picture.labels, size, interpolation=cv2.INTER_NEAREST).astype(np.int64)
    said = cv2.resize(picture.unsaid.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) == 0
    area = np.bincount(labels[said], minlength=int(labels.max()) + 1)
    best = []
    for one in found.proposals:
        left, top, right, bottom = one.box
        inside = labels[top:bottom, left:right][one.mask & said[top:bottom, left:right]]
        shared = np.bincount(inside, minlength=len(area))
        over = shared / np.maximum(len(inside) + area - shared, 1)
        best.append(float(over[1:].max(initial=0)))
    return np.array(best)


def tried(work: int | tuple[Path, str]) -> Tried:
    """A drawn picture of a seed, or one of a folder."""
    cv2.setNumThreads(1)
    picture = draw(work) if isinstance(work, int) else Picture.load(*work)
    found = candidates(picture.rgb, see(picture.rgb))
    return Tried(found, fits(found, picture))


def teach(some: Sequence[Tried], seed: int) -> dict[str, list]:
    """The judge's numbers, as `judge.json` holds them."""
    torch.manual_seed(seed)
    x = np.concatenate([one.found.evidence for one in some])
    y = np.concatenate([one.fit for one in some])
    mean, spread = x.mean(axis=0), x.std(axis=0) + 1e-6
    told = torch.tensor((x - mean) / spread, dtype=torch.float32)
    truth = torch.tensor(y, dtype=torch.float32)
    layers = [nn.Linear(x.shape[1], WIDTH), nn.Linear(WIDTH, WIDTH), nn.Linear(WIDTH, 1)]
    network = nn.Sequential(layers[0], nn.ReLU(), layers[1], nn.ReLU(), layers[2])
    optimizer = torch.optim.AdamW(network.parameters(), lr=3e-3, weight_decay=0.02)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
    weight = 0.3 + truth  # what hits anything is rare
    blur = torch.full((x.shape[1],), 0.03)
    blur[NAMES.index("log size")] = 1.0  # how large things are is the photographer's choice
    for step in range(STEPS):
        some_ = torch.randint(len(truth), (2048,))
        out = network(told[some_] + blur * torch.randn(2048, x.shape[1]))[:, 0]
        loss = F.binary_cross_entropy_with_logits(out, truth[some_], weight=weight[some_])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        if step % 1000 == 999:
            off = (torch.sigmoid(network(told)[:, 0]) - truth).abs().mean()
            print(
                f"judge: step {step + 1}, loss {loss.item():.4f}, mean error {off.item():.4f}",
                file=sys.stderr,
            )

    def short(values: NDArray[np.float64] | torch.Tensor) -> list:
        return np.round(np.asarray(values.tolist()), 5).tolist()

    return {
        "about": "how well a proposal fits an object, from evidence.NAMES; made by studio/segmentation/judge.py",
        "mean": short(mean),
        "spread": short(spread),
        "weights": [short(layer.weight.detach().T) for layer in layers],
        "biases": [short(layer.bias.detach()) for layer in layers],
        "fit": [0.0, 1.0],
        "right": [0.0, 1.0],
    }


def counted(some: Sequence[Tried]) -> tuple[list[float], list[float]]:
    """Expected fits of what is chosen, and the share that is right there, never falling (pool adjacent violators)."""
    pairs = []
    for one in some:
        fit = judge.expected(one.found.evidence)
        chosen = choose(one.found, fit)
        pairs += list(zip(fit[chosen].tolist(), (one.fit[chosen] >= RIGHT).tolist(), strict=True))
    pairs.sort()
    blocks: list[list[float]] = []  # sum of fits, of rights, count
    for bundle in np.array_split(np.array(pairs, float), max(1, min(24, len(pairs) // 25))):
        blocks.append([bundle[:, 0].sum(), bundle[:, 1].sum(), float(len(bundle))])
        while len(blocks) > 1 and blocks[-2][1] / blocks[-2][2] >= blocks[-1][1] / blocks[-1][2]:
            last = blocks.pop()
            blocks[-1] = [a + b for a, b in zip(blocks[-1], last, strict=True)]
    return (
        [round(fit / count, 4) for fit, _, count in blocks],
        [round((right + 0.5) / (count + 1), 4) for _, right, count in blocks],
    )


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "pictures", nargs="*", type=Path, help="folders of rendered pictures; the last --last are taken"
    )
    parser.add_argument("--last", type=int, default=100)
    parser.add_argument("--drawn", type=int, default=160)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=SHIPPED)
    args = parser.parse_args()
    work: list[int | tuple[Path, str]] = list(range(FIRST, FIRST + args.drawn))
    for folder in args.pictures:
        names = sorted(path.name.removesuffix(".labels.png") for path in folder.glob("*.labels.png"))
        work += [(folder, name) for name in names[-args.last :]]
    with multiprocessing.Pool(args.jobs) as pool:
        some = []
        for one in pool.imap(tried, work, chunksize=4):
            some.append(one)
            if len(some) % 25 == 0:
                print(f"{len(some)} of {len(work)} pictures", file=sys.stderr, flush=True)
    told = teach(some[::2], 0)
    args.output.write_text(json.dumps(told) + "\n")
    judge._judge.cache_clear()
    told["fit"], told["right"] = counted(some[1::2])
    args.output.write_text(json.dumps(told) + "\n")
    print(
        f"{len(NAMES)} numbers a proposal; right by expected fit: {list(zip(told['fit'], told['right'], strict=True))}",
        file=sys.stderr,
    )


if __name__ == "__main__":
    main()
