"""A box drawn around an object -> its mask: what edges, circles and colours propose in and about it, and the best.

A box is drawn by hand, so it is loose or cuts a little off: what is proposed is held to it softly. Touching neighbours
of one colour are told apart by edges and shape, things of many colours by the colours that the surroundings lack.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.learned.candidates import judged, rescaled
from physgen.perceive.learned.network import see
from physgen.perceive.learned.parts import guided, parts
from physgen.perceive.proposals.circles import discs
from physgen.perceive.proposals.company import company, iou
from physgen.perceive.proposals.gradient import colour_gradient, lab
from physgen.perceive.proposals.proposal import Proposal, cut_out, unions, variants
from physgen.perceive.proposals.regions import stable_regions
from physgen.perceive.proposals.score import looks
from physgen.perceive.proposals.tighten import tighten
from physgen.perceive.roles import Meant, Rgb

Floats = NDArray[np.float64]

SIDE = 100
"""px: geometric mean of the box's sides where it is looked at; smaller boxes are enlarged, up to `LARGEST` times."""
LARGEST = 3.0
MARGIN = 0.35
"""Of the box's sides, that are looked at around it; 8 px at least."""
REACH = 0.25
"""Of the box's sides: what leaves the box farther is not what was meant."""
AREAS = (0.12, 1.4)
"""Of the box, that a proposal may cover."""
SQUARE = 1.6
"""Times one side may be the other for discs to be looked for."""
KEPT = 12
"""Proposals whose variants are looked at."""

BAND = 0.02
"""How far the outline may move at last, in square roots of its area: little, its edges were looked at already."""

# Chosen on the studio's photos for tuning and on peers' photos, boxes 10 % loose and boxes with sides 10 % off.
LOOK, PART = 256, 40
"""px: the longer side of what the network looks at, and the smallest part it may propose on its grid."""

SLACK, FREE, SPREAD = 0.0, 0.09, 0.09
"""Of the box's sides: how far inside of it an object's side lies, the error that is forgiven, the scale of more."""
EDGES, COLOURS, COMPANY, JUDGED = 2.0, 0.25, 1.0, 1.0
"""Exponents: looks; likeness to what GrabCut finds; likeness to what else is proposed; what the network expects."""


def boxed(rgb: Rgb, box: tuple[int, int, int, int]) -> Meant:
    """The object in a box (left, top, right, bottom px, within the photo, the last two just outside)."""
    height, width = rgb.shape[:2]
    x0, y0, x1, y1 = box
    across, down = max(8, round(MARGIN * (x1 - x0))), max(8, round(MARGIN * (y1 - y0)))
    left, top = max(0, x0 - across), max(0, y0 - down)
    right, bottom = min(width, x1 + across), min(height, y1 + down)
    part = np.ascontiguousarray(rgb[top:bottom, left:right])
    scale = min(LARGEST, SIDE / float(np.sqrt((x1 - x0) * (y1 - y0))))
    size = max(8, round((right - left) * scale)), max(8, round((bottom - top) * scale))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    small = np.asarray(cv2.resize(part, size, interpolation=method), np.uint8)
    zoom = np.array([size[0] / (right - left), size[1] / (bottom - top)])
    corners = np.array([x0 - left, y0 - top, x1 - left, y1 - top]) * np.tile(zoom, 2)
    best = _best(small, corners)
    mask = np.zeros((height, width), np.bool_)
    if best is None:
        mask[y0:y1, x0:x1] = True
        return Meant(mask, 0.0)
    found, fit = best
    mask[top:bottom, left:right] = tighten(part, [found.on((size[1], size[0]))], BAND) > 0
    return Meant(mask, fit)


def _best(rgb: Rgb, box: Floats) -> tuple[Proposal, float] | None:
    """The object in a box (4,) px of a photo of working size, and how well it is expected to fit.

    None where nothing is proposed.
    """
    shape = rgb.shape[0], rgb.shape[1]
    across, down = box[2] - box[0], box[3] - box[1]
    smallest, largest = (max(20, round(part * across * down)) for part in AREAS)
    colour = lab(rgb)
    gradient = colour_gradient(colour)
    by_colour = _by_colour(rgb, box, smallest)
    found = stable_regions(colour, gradient, smallest, largest)
    if max(across / down, down / across) < SQUARE:
        found += discs(gradient, smallest, largest, 60)
    seen = see(rgb, (LOOK,))
    own = (rescaled(one, seen.foreground.shape, shape) for one in parts(seen, PART, seen.foreground.size))
    found += [one for one in own if one is not None and smallest <= one.area <= largest]
    found += guided(gradient, seen, smallest, largest)
    found = _near(found + by_colour, box)
    if not found:
        return None
    found += _near(unions(found, np.maximum(looks(found, colour, gradient).score, 0.5), largest), box)[:60]
    found.sort(key=lambda one: float(_misfit([one], box)[0]))
    found = found[:70]
    first = np.log(np.maximum(looks(found, colour, gradient).score, 0.05)) - _misfit(found, box)
    kept = np.argsort(-first, kind="stable")[:KEPT].tolist()
    chosen = [found[k] for k in kept]
    chosen += [one for one in _near(by_colour, box) if all(one is not other for other in chosen)]
    forms = _near([form for one in chosen for form in variants(one, shape)], box)
    worth = EDGES * np.log(np.maximum(looks(forms, colour, gradient).score, 0.02)) - _misfit(forms, box)
    if by_colour:
        alike = np.array([max(iou(form, other) for other in by_colour) for form in forms])
        worth += COLOURS * np.log(0.15 + alike)
    fit = judged(forms, seen, shape)
    worth += JUDGED * np.log(np.maximum(fit, 0.05))
    k = int((worth + COMPANY * company(forms, worth)).argmax())
    return forms[k], float(fit[k])


def _by_colour(rgb: Rgb, box: Floats, smallest: int) -> list[Proposal]:
    """What GrabCut (Rother, Kolmogorov, Blake 2004) makes of the box, and of the ellipse in it."""
    y, x = np.mgrid[: rgb.shape[0], : rgb.shape[1]]
    across, down = box[2] - box[0], box[3] - box[1]
    off_x = np.abs(x - (box[0] + box[2] - 1) / 2) / (across / 2)
    off_y = np.abs(y - (box[1] + box[3] - 1) / 2) / (down / 2)
    square, around = np.maximum(off_x, off_y), np.hypot(off_x, off_y)
    bgr = np.ascontiguousarray(rgb[:, :, ::-1])
    found = []
    none = np.zeros(square.shape, np.bool_)
    for outer, inner, core in (
        (square <= 1.0, square <= 1.0, none),
        (square <= 1.2, square < 0.84, around < 0.45),
        (square <= 1.2, around < 0.85, around < 0.5),
    ):
        state = np.where(outer, np.uint8(cv2.GC_PR_BGD), np.uint8(cv2.GC_BGD))
        state[inner] = cv2.GC_PR_FGD
        state[core] = cv2.GC_FGD
        if (state == cv2.GC_BGD).sum() < 16 or not inner.any():
            continue
        cv2.setRNGSeed(0)
        models = np.zeros((1, 65)), np.zeros((1, 65))
        cv2.grabCut(bgr, state, (0, 0, 1, 1), *models, 2, cv2.GC_INIT_WITH_MASK)
        one = cut_out(np.isin(state, (cv2.GC_FGD, cv2.GC_PR_FGD)), 0, 0, smallest, opening=1)
        if one is not None:
            found.append(one)
    return found


def _sides(found: Sequence[Proposal], box: Floats) -> Floats:
    """(n, 4): how far inside of the box each side lies, in sides of the box."""
    length = np.array([box[2] - box[0], box[3] - box[1]] * 2)
    inward = np.array([1, 1, -1, -1])
    corners = np.array([one.box for one in found], np.float64).reshape(-1, 4)
    return np.asarray((corners - box) * inward / length, np.float64)


def _misfit(found: Sequence[Proposal], box: Floats) -> Floats:
    """(n,): 0 for what fits the box as boxes are drawn, growing with the square of what is off."""
    off = np.maximum(0, np.abs(_sides(found, box) - SLACK) - FREE)
    return np.asarray((off**2).sum(1) / (2 * SPREAD**2), np.float64)


def _near(found: Sequence[Proposal], box: Floats) -> list[Proposal]:
    """Those that leave the box by no more than `REACH`."""
    return [one for one in found if _sides([one], box).min() > -REACH]
