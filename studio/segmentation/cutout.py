"""The head that cuts out the object in a box: `python studio/segmentation/cutout.py STORE=SHARE ... -o out/segmentation`.

It reads the maps of the shipped network, which stays as it is, of a crop around the box; photos of COCO teach it at
their own size, beside stores of other pictures, whose shares leave theirs. With --more the shipped head learns on, and
half of what that changes is kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from batches import developed
from coco import photos
from network import MEAN, SPREAD, Cutout, Network, load_exported
from numpy.typing import NDArray
from store import UNSAID, Store
from torch.nn import functional as F  # noqa: N812
from train import Run, Shares, ahead, arguments, learn, spawn

from physgen.perceive.segment.network import MARGIN, SIDE, crop

BATCH = 24
LEAST = 300
"""px of a picture: objects that teach."""
SLACK = 0.12
"""Of a box's sides: how far each is moved, by chance."""
POINTS = 0.5
"""Of the crops: around a point."""
SHARE = 0.25, 0.95
"""Of such a crop's side: the object's longer one, at least and at most."""
DEPTH = 0.4
"""Of an object's largest depth: where points lie."""
NOTHING, EMPTY, TRIES, CLEAR = 0.08, (0.06, 0.6), 8, 0.02
"""Share of the crops that show nothing, of their sides in the picture's shorter one, tries, and share that others may take."""
MORE = 0.3
"""Of the usual rate, where the shipped head learns on."""
SHIPPED = (
    Path(__file__).resolve().parents[2] / "physgen/perceive/segment/segmentation.onnx"
)


@dataclass(frozen=True)
class Lesson:
    """N crops and what is to be cut out of them."""

    x: NDArray[np.float32]  # (N, 3, SIDE, SIDE)
    truth: NDArray[
        np.float32
    ]  # (N, SIDE / 2, SIDE / 2): share of each pixel on the object
    weight: NDArray[np.float32]  # (N, SIDE / 2, SIDE / 2): 0 where nobody judges
    at_point: NDArray[np.float32]  # (N,): 1 where the crop is around a point


@dataclass(frozen=True)
class Example:
    """An object of a picture."""

    rgb: NDArray[np.uint8]
    labels: NDArray[np.uint8]
    id: int
    box: tuple[int, int, int, int]  # left, top, right, bottom px


def examples(rgb: NDArray[np.uint8], labels: NDArray[np.uint8]) -> Iterator[Example]:
    """The objects of a picture that are large enough."""
    for i in np.unique(labels).tolist():
        mask = labels == i
        if 0 < i < UNSAID and mask.sum() >= LEAST:
            x, y, w, h = cv2.boundingRect(mask.astype(np.uint8))
            yield Example(rgb, labels, i, (x, y, x + w, y + h))


def lesson(one: Example, rng: np.random.Generator) -> tuple[NDArray[np.float32], ...]:
    """A crop as another camera has it: around the object's box, each side of it a little off, or around a point on it."""
    sides = np.array(one.box, np.float64)
    length = np.array([sides[2] - sides[0], sides[3] - sides[1]] * 2)
    at_point = rng.random() < POINTS
    nothing = rng.random() < NOTHING and _empty(one.labels, at_point, rng)
    moved = sides + rng.uniform(-SLACK, SLACK, 4) * length
    if at_point:
        x, y = _click(one, rng)
        half = max(length) / np.exp(rng.uniform(*np.log(SHARE))) / (1 + 2 * MARGIN) / 2
        moved = np.array([x - half, y - half, x + half, y + half])
    elif rng.random() < 0.3:  # as a user draws it: loose all around
        moved = sides + SLACK * rng.uniform(0, 1.3) * length * [-1, -1, 1, 1]
    if nothing:
        moved = np.array(nothing)
    rgb = crop(one.rgb, moved, SIDE).astype(np.float32)
    half = SIDE // 2
    on = (
        np.zeros(one.labels.shape, np.uint8)
        if nothing
        else (one.labels == one.id).astype(np.uint8)
    )
    mask = crop(on * 255, moved, half, 0).astype(np.float32) / 255
    unsaid = (
        crop((one.labels == UNSAID).astype(np.uint8) * 255, moved, half, 0).astype(
            np.float32
        )
        / 255
    )
    box = np.zeros(one.labels.shape, np.uint8)
    box[one.box[1] : one.box[3], one.box[0] : one.box[2]] = 255
    inside = True if nothing else crop(box, moved, half, 0) > 0
    weight = 1 - unsaid * inside
    if rng.random() < 0.5:
        rgb, mask, weight = (
            np.ascontiguousarray(part[:, ::-1]) for part in (rgb, mask, weight)
        )
    x = (developed(rgb, rng).transpose(2, 0, 1) - np.float32(MEAN)) / np.float32(SPREAD)
    return x.astype(np.float32), mask, weight.astype(np.float32), np.float32(at_point)


def _empty(
    labels: NDArray[np.uint8], at_point: bool, rng: np.random.Generator
) -> tuple[float, ...] | None:
    """A box on nothing, or a square whose middle lies on nothing; None where none is met."""
    height, width = labels.shape
    for _ in range(TRIES):
        across, down = np.exp(rng.uniform(*np.log(EMPTY), 2)) * min(height, width)
        if at_point:
            down = across
        x, y = (
            rng.uniform(0, max(width - across, 1)),
            rng.uniform(0, max(height - down, 1)),
        )
        kept = 0.4 if at_point else 0.0
        part = labels[
            int(y + kept * down) : int(y + (1 - kept) * down) + 1,
            int(x + kept * across) : int(x + (1 - kept) * across) + 1,
        ]
        if (part > 0).mean() < CLEAR:
            return x, y, x + across, y + down
    return None


def _click(one: Example, rng: np.random.Generator) -> tuple[float, float]:
    """A point well inside the object, px."""
    left, top, right, bottom = one.box
    mask = (one.labels[top:bottom, left:right] == one.id).astype(np.uint8)
    depth = cv2.distanceTransform(np.pad(mask, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    rows, columns = np.nonzero(depth >= DEPTH * depth.max())
    k = int(rng.integers(len(rows)))
    return left + float(columns[k]), top + float(rows[k])


def lessons(
    sets: list[list[Example]], shares: list[float], size: int, seed: int
) -> Iterator[Lesson]:
    """Batches for ever, each example from a set with the probability of its share."""
    rng = np.random.default_rng(seed)
    while True:
        picked = []
        for _ in range(size):
            some = sets[int(rng.choice(len(sets), p=np.array(shares) / sum(shares)))]
            picked.append(lesson(some[int(rng.integers(len(some)))], rng))
        yield Lesson(*(np.stack(part) for part in zip(*picked, strict=True)))


def loss(out: torch.Tensor, batch: dict[str, torch.Tensor]) -> torch.Tensor:
    """Cross entropy and the lacking overlap (Dice), where somebody judges."""
    truth, weight = batch["truth"], batch["weight"]
    crossed = F.binary_cross_entropy_with_logits(out, truth, reduction="none") * weight
    sure = torch.sigmoid(out) * weight
    both, either = (sure * truth).sum((1, 2)), (sure + truth * weight).sum((1, 2))
    return crossed.sum() / weight.sum() + (1 - (2 * both + 20) / (either + 20)).mean()


def train(
    rank: int,
    jobs: int,
    stores: Shares,
    steps: int,
    seed: int,
    out: Path,
    device: str,
    more: bool,
) -> None:
    """Learn so many steps; `out` gets what `learn` writes, as cutout.pt."""
    run = Run(rank, jobs, steps, out, device, seed)
    where = run.begin()
    network, head = Network().eval(), Cutout(SIDE)
    blank = torch.zeros(1, 3, SIDE, SIDE)
    load_exported(network, SHIPPED, blank)
    if more:
        with torch.inference_mode():
            levels = network.levels(blank)
        load_exported(
            head, SHIPPED.with_name("cutout.onnx"), levels, torch.zeros(1, 1, 1, 1)
        )
    before = {name: part.clone() for name, part in head.state_dict().items()}
    network, head = network.to(where, memory_format=torch.channels_last), head.to(where)
    sets = [
        [
            one
            for _, rgb, labels in photos(validation=False)
            for one in examples(rgb, labels)
        ]
    ]
    for store in (Store.at(folder) for folder, _ in stores):
        pictures = (
            (np.array(store.rgb[k]), np.array(store.labels[k]))
            for k in np.flatnonzero(store.done)
        )
        sets.append([one for rgb, labels in pictures for one in examples(rgb, labels)])
    shares = [1 - sum(share for _, share in stores), *(share for _, share in stores)]

    def losses(batch: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        with torch.no_grad():
            levels = network.levels(
                batch["x"].contiguous(memory_format=torch.channels_last)
            )
        at_point = batch["at_point"][:, None, None, None]
        return {"cut": loss(head(levels, at_point), batch)}

    learn(
        run,
        head,
        [{"params": list(head.parameters()), "share": MORE if more else 1.0}],
        lambda step: ahead(
            lessons(sets, shares, BATCH // jobs, seed + 1000 * rank + step), where
        ),
        losses,
        "cutout",
    )
    if (
        more and rank == 0
    ):  # the mean of both is better than either (Wortsman et al. 2022, "Robust fine-tuning")
        after = torch.load(out / "cutout.pt", map_location="cpu", weights_only=True)
        torch.save(
            {name: (part + after[name]) / 2 for name, part in before.items()},
            out / "cutout.pt",
        )


if __name__ == "__main__":
    jobs, stores, args = arguments(__doc__, 5000, "--more")
    if sum(share for _, share in stores) >= 1:
        raise SystemExit(
            "shares of the stores: less than 1 in all, since COCO's photos have the rest"
        )
    spawn(
        train,
        jobs,
        (stores, args.steps, args.seed, args.output, args.device, args.more),
    )
