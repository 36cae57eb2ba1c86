"""A point on an object -> its mask: of what edges, circles and colour propose there, the best that the point is in."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.learned.candidates import judged, rescaled
from physgen.perceive.learned.network import see
from physgen.perceive.learned.parts import guided, parts
from physgen.perceive.proposals.circles import discs
from physgen.perceive.proposals.company import company
from physgen.perceive.proposals.gradient import Gradient, colour_gradient, lab
from physgen.perceive.proposals.proposal import Proposal, distinct, unions, variants
from physgen.perceive.proposals.regions import stable_regions
from physgen.perceive.proposals.score import looks
from physgen.perceive.proposals.tighten import tighten
from physgen.perceive.roles import Meant, Rgb

AREA = 512 * 512
"""px that are looked at; larger photos are reduced to it."""
SMALLEST, LARGEST = 0.0003, 0.22
"""Parts of the photo that an object may cover."""
KEPT = 25
"""Proposals whose variants are looked at."""
LEAST = 0.35
"""Of looks: a worse proposal is no object."""
BAND = 0.04
"""How far the outline may move at last, in square roots of its area."""

# Chosen on the studio's photos for tuning and on peers' photos.
EDGES, WIDE, DEEP, COMPANY, JUDGED = 2.0, 0.1, 2.0, 2.0, 1.0
"""Exponents: looks; area, as wholes are meant rather than their parts; how deep inside the point lies; likeness to
what else is proposed; what the network expects."""
PART = 14
"""px of the network's grid, of the smallest part that it may propose."""


@dataclass(frozen=True, eq=False)
class Proposed:
    """What a photo proposes, worked out once for all points."""

    rgb: Rgb
    colour: NDArray[np.float32]
    gradient: Gradient
    proposals: list[Proposal]
    fit: NDArray[np.float64]
    """(n,) 0..1: how well the network expects each to fit."""


def proposed(rgb: Rgb) -> Proposed:
    """Of a photo (H, W, 3)."""
    height, width = rgb.shape[:2]
    scale = min(1.0, (AREA / (height * width)) ** 0.5)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) if scale < 1 else rgb, np.uint8)
    colour = lab(small)
    gradient = colour_gradient(colour)
    smallest, largest = (max(12, round(part * size[0] * size[1])) for part in (SMALLEST, LARGEST))
    shape, seen = (size[1], size[0]), see(rgb)
    found = stable_regions(colour, gradient, smallest, largest) + discs(gradient, smallest, largest)
    own = (rescaled(one, seen.foreground.shape, shape) for one in parts(seen, PART, seen.foreground.size))
    found += [one for one in own if one is not None and smallest <= one.area <= largest]
    found = distinct(found + guided(gradient, seen, smallest, largest))
    found += distinct(unions(found, looks(found, colour, gradient).score, largest))
    return Proposed(rgb, colour, gradient, found, judged(found, seen, shape))


def pointed(known: Proposed, x: int, y: int) -> Meant | None:
    """The object at a pixel of the photo; None where nothing that is proposed there looks like one."""
    height, width = known.rgb.shape[:2]
    shape = known.colour.shape[0], known.colour.shape[1]
    at = (
        min(shape[1] - 1, int((x + 0.5) * shape[1] / width)),
        min(shape[0] - 1, int((y + 0.5) * shape[0] / height)),
    )
    some = [k for k, one in enumerate(known.proposals) if _depth(one, at) > 0]
    if not some:
        return None
    holding, expected = [known.proposals[k] for k in some], JUDGED * np.log(np.maximum(known.fit[some], 0.05))
    score = looks(holding, known.colour, known.gradient).score
    good = EDGES * np.log(np.maximum(score, 0.02)) + expected
    best = np.argsort(-good, kind="stable")[:KEPT].tolist()
    pairs = [(form, k) for k in best for form in variants(holding[k], shape) if _depth(form, at) > 0]
    forms, source = [form for form, _ in pairs], [k for _, k in pairs]
    if not forms:
        return None
    depth = np.array([_depth(form, at) for form in forms])
    score = looks(forms, known.colour, known.gradient).score
    area = np.log([form.area for form in forms])
    worth = (
        EDGES * np.log(np.maximum(score, 0.02))
        + WIDE * area
        + DEEP * np.log(np.maximum(depth, 0.05))
        + expected[source]
    )
    k = int((worth + COMPANY * company(forms, worth)).argmax())
    if score[k] < LEAST:
        return None
    mask = tighten(known.rgb, [forms[k].on(shape)], BAND) > 0
    return Meant(np.asarray(mask), float(known.fit[some][source[k]]))


def _depth(one: Proposal, at: tuple[int, int]) -> float:
    """How deep in a proposal a pixel of working size lies: 1 where it is deepest, 0 outside."""
    x, y = at[0] - one.x, at[1] - one.y
    if not (0 <= y < one.mask.shape[0] and 0 <= x < one.mask.shape[1] and one.mask[y, x]):
        return 0.0
    depth = cv2.distanceTransform(np.pad(one.mask, 1).astype(np.uint8), cv2.DIST_L2, 5)
    return float(depth[y + 1, x + 1] / depth.max())
