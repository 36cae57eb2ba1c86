"""Pictures -> how well each proposal fits, learned from evidence: `python studio/segmentation/judge.py DIR... --drawn 160`.

What the network has not learned from: drawn pictures of other seeds, and rendered ones. A judge taught by one half of
them tells how often what is chosen in the other half is right, and the other way round; the shipped one learns from all.
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

from physgen.perceive.backends.segment_learned import choose, worth
from physgen.perceive.segment import candidates as judge
from physgen.perceive.segment.candidates import FEATURES, Candidates, candidates
from physgen.perceive.segment.network import run_network
from physgen.perceive.segment.selection import search_edges

SHIPPED = Path(judge.__file__).with_name(judge.JUDGE)
FIRST = 5_000_000
"""Seed of the first drawn picture: training's are far below."""
SIDE = 448
"""px of drawn pictures: as photos are, larger than training's, so that looks at them are no blurred ones."""
WIDTH = 40
"""Of the judge's two hidden layers."""
STEPS = 4000
RIGHT = 0.5
"""Intersection over union from which a proposal is right."""
COUNTED = 0.5
"""Expected fit from which chosen proposals are counted: those below the threshold of objects are doubtful regions."""


@dataclass(frozen=True)
class Tried:
    """One picture's candidates and how well each fits the object that it fits best."""

    found: Candidates
    fit: NDArray[np.float64]


def fits(found: Candidates, picture: Picture) -> NDArray[np.float64]:
    """(n,) the best intersection over union of each candidate with an object; unsaid pixels are nobody's."""
    size = found.shape[::-1]
    labels = cv2.resize(
        picture.labels, size, interpolation=cv2.INTER_NEAREST_EXACT
    ).astype(np.int64)
    said = (
        cv2.resize(
            picture.unsaid.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT
        )
        == 0
    )
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
    picture = draw(work, SIDE) if isinstance(work, int) else Picture.load(*work)
    found = candidates(search_edges(picture.rgb), run_network(picture.rgb))
    return Tried(found, fits(found, picture))


def teach(some: Sequence[Tried], seed: int) -> dict[str, list]:
    """The judge's numbers, as `judge.json` holds them."""
    torch.manual_seed(seed)
    x = np.concatenate([one.found.evidence for one in some])
    y = np.concatenate([one.fit for one in some])
    mean, spread = x.mean(axis=0), x.std(axis=0) + 1e-6
    told = torch.tensor((x - mean) / spread, dtype=torch.float32)
    truth = torch.tensor(y, dtype=torch.float32)
    layers = [
        nn.Linear(x.shape[1], WIDTH),
        nn.Linear(WIDTH, WIDTH),
        nn.Linear(WIDTH, 1),
    ]
    network = nn.Sequential(layers[0], nn.ReLU(), layers[1], nn.ReLU(), layers[2])
    optimizer = torch.optim.AdamW(network.parameters(), lr=3e-3, weight_decay=0.02)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
    weight = 0.3 + truth  # what hits anything is rare
    for step in range(STEPS):
        some_ = torch.randint(len(truth), (2048,))
        out = network(told[some_] + 0.03 * torch.randn(2048, x.shape[1]))[:, 0]
        loss = F.binary_cross_entropy_with_logits(
            out, truth[some_], weight=weight[some_]
        )
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


def judged(some: Sequence[Tried]) -> dict[str, list]:
    """The shipped numbers: a judge taught by all, and how often what judges of one half choose in the other is right."""
    pairs: list[tuple[float, bool]] = []
    for half in (0, 1):
        told = teach(some[half::2], half)
        numbers = {
            name: [np.array(part) for part in told[name]]
            if name in ("weights", "biases")
            else np.array(told[name])
            for name in ("mean", "spread", "weights", "biases")
        }
        for one in some[1 - half :: 2]:
            fit = worth(one.found, judge.expected_fit(one.found.evidence, numbers))
            chosen = choose(one.found, fit, COUNTED)
            pairs += list(
                zip(
                    fit[chosen].tolist(),
                    (one.fit[chosen] >= RIGHT).tolist(),
                    strict=True,
                )
            )
    fit, right = counted(pairs)
    return {**teach(some, 2), "fit": fit, "right": right}


def counted(pairs: list[tuple[float, bool]]) -> tuple[list[float], list[float]]:
    """What was said and whether it was right -> the share that is, never falling (pool adjacent violators); from 0."""
    pairs.sort()
    blocks: list[list[float]] = []  # sum of fits, of rights, count
    for bundle in np.array_split(
        np.array(pairs, float), max(1, min(24, len(pairs) // 25))
    ):
        blocks.append([bundle[:, 0].sum(), bundle[:, 1].sum(), float(len(bundle))])
        while (
            len(blocks) > 1
            and blocks[-2][1] / blocks[-2][2] >= blocks[-1][1] / blocks[-1][2]
        ):
            last = blocks.pop()
            blocks[-1] = [a + b for a, b in zip(blocks[-1], last, strict=True)]
    shares = np.maximum.accumulate(
        [(right + 0.5) / (count + 1) for _, right, count in blocks]
    )
    return (
        [0.0, *(round(float(fit / count), 4) for fit, _, count in blocks)],
        [0.0, *(round(float(share), 4) for share in shares)],
    )


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "pictures", nargs="*", type=Path, help="folders of rendered pictures"
    )
    parser.add_argument("--drawn", type=int, default=160)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=SHIPPED)
    args = parser.parse_args()
    work: list[int | tuple[Path, str]] = list(range(FIRST, FIRST + args.drawn))
    for folder in args.pictures:
        names = sorted(
            path.name.removesuffix(".labels.png")
            for path in folder.glob("*.labels.png")
        )
        work += [(folder, name) for name in names]
    if len(work) < 2:
        parser.error(
            "too few pictures to learn from and to count on; say --drawn N, or folders of homes/make.py"
        )
    with multiprocessing.Pool(args.jobs) as pool:
        some = []
        for one in pool.imap(tried, work, chunksize=4):
            some.append(one)
            if len(some) % 25 == 0:
                print(
                    f"{len(some)} of {len(work)} pictures", file=sys.stderr, flush=True
                )
    told = judged(some)
    args.output.write_text(json.dumps(told) + "\n")
    print(
        f"{len(FEATURES)} numbers a proposal; right by expected fit: {list(zip(told['fit'], told['right'], strict=True))}",
        file=sys.stderr,
    )


if __name__ == "__main__":
    main()
