"""The head that cuts out the object in a box: `python studio/segmentation/cutout.py STORE=SHARE ... -o out/segmentation`.

The head reads maps of the shipped network, which stays as it is, of a crop around the
box. It learns from the labelled photos of PHYSGEN_MATERIAL (`cutout_photos.py`) at their
own size, and from stores of other pictures, each with its share of the crops. With
--more the shipped head learns on, and the mean of its weights before and after is
written. With --all-licences it learns from every photo of coco-minis, for comparison.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from batches import developed
from cutout_photos import (
    IMMOVABLE_SHARE,
    OUTLINE_SLACK,
    SET_SHARES,
    photo_objects,
)
from labelled_photos import OPEN_LICENCES, box_of
from network import MEAN, SPREAD, Cutout, Network, load_exported
from numpy.typing import NDArray
from store import UNSAID, Store
from torch.nn import functional as F  # noqa: N812
from train import Run, Shares, ahead, arguments, learn, spawn

from physgen.perceive.segment.network import MARGIN, SIDE, crop

BATCH = 16
"""Crops of a step."""
FRESH = 5
"""Crops of a step that are new. The others are random earlier ones, whose maps are
stored: on a processor the shipped network takes longer than the head learns."""
STORED = 1500
"""Earlier crops that are stored, 1 MB each."""
LEAST = 300
"""px of a picture: objects that teach."""
SLACK = 0.12
"""Of a box's sides: how far each is moved, by chance."""
POINTS = 0.4
"""Of the crops: around a point."""
SHARE = 0.25, 0.95
"""Of such a crop's side: the object's longer one, at least and at most."""
DEPTH = 0.4
"""Of an object's largest depth: where points lie."""
NOTHING, EMPTY, TRIES, CLEAR = 0.08, (0.06, 0.6), 8, 0.02
"""Share of the crops that show nothing, of their sides in the picture's shorter one, tries, and share that others may take."""
MORE = 0.4
"""Share of the usual rate with which the shipped head learns on."""
COARSE, COARSE_SIDES = 0.3, (40, 150)
"""Share of the crops that are shown as if enlarged, and their own side, px: boxes of
small objects are enlarged as much."""
OUTLINE_WEIGHT = 2.0
"""Added to the weight of pixels within a pixel of the outline: they decide the shape."""
THIN_WEIGHT = 4.0
"""Added to the weight of thin parts, and of thin gaps beside an object: stems, handles
and legs are few pixels, and what a mask leaves out stays behind when the object moves."""
THIN = 7
"""px of the output: parts are thin if a disc of this width does not fit in them."""
COMPLETE_SETS = frozenset({"coco", "trashnet-grabcut", "fruits-nuts", "class5"})
"""Sets without unlabelled objects, whose background may be shown as nothing."""
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
    is_complete: bool = True  # whether what is not labelled is no object


def examples(
    rgb: NDArray[np.uint8],
    labels: NDArray[np.uint8],
    ids: Sequence[int] | None = None,
    is_complete: bool = True,
    slack: int = 0,
) -> Iterator[Example]:
    """Yield the objects of a picture that are large enough, or those of some ids.

    The objects may reach beyond their labels by `slack` px.
    """
    for i in np.unique(labels).tolist() if ids is None else ids:
        mask = labels == i
        if 0 < i < UNSAID and mask.sum() >= LEAST:
            yield Example(rgb, labels, i, box_of(mask, slack), is_complete)


def photo_examples(
    licences: frozenset[int] | None,
) -> Iterator[tuple[list[Example], float]]:
    """Yield the objects of the labelled photos in groups, each with its share."""
    for name, share in SET_SHARES.items():
        movable: list[Example] = []
        fixed: list[Example] = []
        is_complete, slack = name in COMPLETE_SETS, OUTLINE_SLACK.get(name, 0)
        for rgb, labels, ids, other_ids in photo_objects(name, licences):
            movable += examples(rgb, labels, ids, is_complete, slack)
            fixed += examples(rgb, labels, other_ids, is_complete, slack)
        fixed_share = share * IMMOVABLE_SHARE / (1 + IMMOVABLE_SHARE)
        if not fixed:
            fixed_share = 0.0
        yield movable, share - fixed_share
        if fixed:
            yield fixed, fixed_share


def lesson(one: Example, rng: np.random.Generator) -> tuple[NDArray[np.float32], ...]:
    """A crop as another camera has it: around the object's box, each side of it a little off, or around a point on it."""
    sides = np.array(one.box, np.float64)
    length = np.array([sides[2] - sides[0], sides[3] - sides[1]] * 2)
    at_point = rng.random() < POINTS
    nothing = None
    if one.is_complete and rng.random() < NOTHING:
        nothing = _empty(one.labels, at_point, rng)
    moved = sides + rng.uniform(-SLACK, SLACK, 4) * length
    if at_point:
        x, y = _click(one, rng)
        half = max(length) / np.exp(rng.uniform(*np.log(SHARE))) / (1 + 2 * MARGIN) / 2
        moved = np.array([x - half, y - half, x + half, y + half])
    elif rng.random() < 0.3:  # as a user draws it: loose all around
        moved = sides + SLACK * rng.uniform(0, 1.3) * length * [-1, -1, 1, 1]
    if nothing:
        moved = np.array(nothing)
    rgb = crop(one.rgb, moved, SIDE)
    if rng.random() < COARSE:
        rgb = _coarse(rgb, rng)
    rgb = rgb.astype(np.float32)
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


def _coarse(rgb: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a crop with the detail of a smaller one."""
    side = int(rng.integers(*COARSE_SIDES))
    small = cv2.resize(rgb, (side, side), interpolation=cv2.INTER_AREA)
    size = rgb.shape[1::-1]
    return np.asarray(cv2.resize(small, size, interpolation=cv2.INTER_LINEAR))


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


def shape_weights(truth: torch.Tensor) -> torch.Tensor:
    """Return (N, h, w) weights of pixels: outlines and thin parts count more."""
    on = (truth >= 0.5).float()[:, None]

    def grow(mask: torch.Tensor, width: int) -> torch.Tensor:
        return F.max_pool2d(mask, width, 1, width // 2)

    def shrink(mask: torch.Tensor, width: int) -> torch.Tensor:
        return -grow(-mask, width)

    outline = grow(on, 3) - shrink(on, 3)
    opened = grow(shrink(on, THIN), THIN)
    closed = shrink(grow(on, THIN), THIN)
    # one pixel more than the opened shape: corners are not thin parts
    thin = on * (1 - grow(opened, 3)) + (1 - on) * shrink(closed, 3)
    return (1 + OUTLINE_WEIGHT * outline + THIN_WEIGHT * thin)[:, 0]


def loss(out: torch.Tensor, batch: dict[str, torch.Tensor]) -> torch.Tensor:
    """Return cross entropy plus lacking overlap (Dice), without unjudged pixels."""
    truth, weight = batch["truth"], batch["weight"]
    entropy = F.binary_cross_entropy_with_logits(out, truth, reduction="none")
    shares = weight * shape_weights(truth)
    crossed = (entropy * shares).sum() / shares.sum()
    chance = torch.sigmoid(out) * weight
    both = (chance * truth).sum((1, 2))
    either = (chance + truth * weight).sum((1, 2))
    lacking = 1 - (2 * both + 20) / (either + 20)
    return crossed + lacking.mean()


class Replay:
    """Maps and truths of the last crops, from which steps are filled up."""

    def __init__(self, seed: int) -> None:
        self.crops: list[tuple[torch.Tensor, ...]] = []
        self.rng = np.random.default_rng(seed)

    def filled(self, parts: Sequence[torch.Tensor], count: int) -> list[torch.Tensor]:
        """Return the parts of fresh crops (N, ...) with `count` random earlier crops."""
        # 16 bits are as good here: half of the memory
        fresh = [part.half() for part in parts]
        new = list(zip(*fresh, strict=True))
        picks = self.rng.integers(len(self.crops), size=count) if self.crops else []
        used = new + [self.crops[int(k)] for k in picks]
        self.crops = (self.crops + new)[-STORED:]
        return [torch.stack(part).float() for part in zip(*used, strict=True)]


def train(
    rank: int,
    jobs: int,
    stores: Shares,
    steps: int,
    seed: int,
    out: Path,
    device: str,
    more: bool,
    all_licences: bool,
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
    network, head = (
        one.to(where, memory_format=torch.channels_last) for one in (network, head)
    )
    groups = list(photo_examples(None if all_licences else OPEN_LICENCES))
    photo_share = 1 - sum(share for _, share in stores)
    sets = [group for group, _ in groups]
    shares = [share * photo_share for _, share in groups]
    for store in (Store.at(folder) for folder, _ in stores):
        pictures = (
            (np.array(store.rgb[k]), np.array(store.labels[k]))
            for k in np.flatnonzero(store.done)
        )
        sets.append([one for rgb, labels in pictures for one in examples(rgb, labels)])
    shares += [share for _, share in stores]

    replay = Replay(seed + rank)

    def losses(batch: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        with torch.no_grad():
            levels = network.levels(
                batch["x"].contiguous(memory_format=torch.channels_last)
            )
            fresh = [*levels, batch["at_point"], batch["truth"], batch["weight"]]
            *levels, at_point, truth, weight = replay.filled(
                fresh, (BATCH - FRESH) // jobs
            )
        levels = [one.contiguous(memory_format=torch.channels_last) for one in levels]
        out = head(levels, at_point[:, None, None, None])
        return {"cut": loss(out, {"truth": truth, "weight": weight})}

    learn(
        run,
        head,
        [{"params": list(head.parameters()), "share": MORE if more else 1.0}],
        lambda step: ahead(
            lessons(sets, shares, FRESH // jobs, seed + 1000 * rank + step), where
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
    jobs, stores, args = arguments(__doc__, 5000, "--more", "--all-licences")
    if sum(share for _, share in stores) >= 1:
        raise SystemExit(
            "shares of the stores: less than 1 in all, since the photos have the rest"
        )
    rest = (args.steps, args.seed, args.output, args.device)
    spawn(train, jobs, (stores, *rest, args.more, args.all_licences))
