"""Backend segment=learned: proposals from edges and a network, ranked by the network, selected jointly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.shapes import fill_polygon
from physgen.perceive.inpaint.poisson import dilate
from physgen.perceive.roles import Doubt, Mask, Segment, Segments
from physgen.perceive.segment.candidates import FEATURES, Candidates, candidates, confidence, expected_fit
from physgen.perceive.segment.gradient import smoothed_lab
from physgen.perceive.segment.network import run_network
from physgen.perceive.segment.proposals import Proposal, doubt_about, overlap
from physgen.perceive.segment.selection import SHARED, background_likeness, best_set, exclusions, tighten


@dataclass(frozen=True)
class LearnedConstants:
    """Constants of the selection, chosen on the studio's tune half and on the validation homes."""

    threshold: float = 0.5
    """Expected fit below which a proposal is dropped."""
    area_power: float = 0.5
    """Exponent of the area in a proposal's gain, which balances wholes against their parts."""
    agreement: float = 0.5
    """Bonus of the selection by edges."""
    foreground: tuple[float, ...] = (0.3, 0.6)
    """Mean foreground from which the bonus counts in part, and in full."""
    best: float = 0.99
    """Highest fit with the bonus."""
    confident: float = 0.25
    """Confidence from which a proposal is an object."""
    doubtful: float = 0.1
    """Confidence from which a proposal is a doubtful object."""
    gap_penalty: float = 0.2
    """Of a selected proposal whose colours continue around it."""
    certain: float = 0.9
    """Fit from which that is not checked."""
    movable: float = 0.5
    """Mean movability from which an object may be moved: people, animals and furniture are none."""
    inside: float = 0.7
    """Share of a selected proposal in a whole from which it is one of its parts."""
    covered: float = 0.4
    """Share of a whole that its two or more parts cover, from which it replaces them."""
    doubts: int = 8
    """Doubtful objects at most."""
    set_size: int = 5
    """Round objects of one radius from which they are a set, as of balls or marbles."""
    round: float = 0.9
    """Share of its smallest enclosing circle from which an object is round."""
    equal: float = 0.05
    """Of their median radius: half of a set's objects differ by less."""
    room: tuple[float, float] = (0.8, 1.25)
    """Of a set's radius: the largest disc in a doubtful region, or about it between others, that is one more."""


LEARNED = LearnedConstants()


def learned() -> Segment:
    """The segmenter; it is deterministic and keeps no state."""
    return segment


def segment(rgb: NDArray[np.uint8]) -> Segments:
    """The movable objects of a photo (H, W, 3) uint8 sRGB, and doubtful ones."""
    found = candidates(rgb, run_network(rgb))
    fit = worth(found, expected_fit(found.evidence))
    best = choose(found, fit)
    fit[best] -= LEARNED.gap_penalty * gaps(rgb, found, fit, best)
    sure = joined(found, fit, best[confidence(fit[best]) >= LEARNED.confident])
    fit[found.movable < LEARNED.movable] = 0
    sure = sure[fit[sure] > 0]
    some = [found.proposals[k] for k in sure.tolist()]
    objects = as_segments(rgb, some, fit[sure], confidence(fit[sure]), found.shape)
    return with_rest_of_set(replace(objects, doubtful=doubts(found, fit, sure, rgb.shape[:2])))


def with_rest_of_set(objects: Segments) -> Segments:
    """Where the objects are round and equal, balls of a set, doubtful regions with room for one more become that."""
    radii = []
    for k in range(1, len(objects.confidence) + 1):
        points = np.argwhere(objects.labels == k)[:, ::-1].astype(np.float32)
        _, around = cv2.minEnclosingCircle(points)
        if len(points) > LEARNED.round * np.pi * around**2:
            radii.append(float(np.sqrt(len(points) / np.pi)))
    radius = float(np.median(radii)) if radii else 0.0
    if len(radii) < LEARNED.set_size or np.median(np.abs(np.array(radii) - radius)) > LEARNED.equal * radius:
        return objects
    labels, sure, rest = objects.labels.copy(), list(objects.confidence), []
    size = labels.shape[1], labels.shape[0]
    for doubt in objects.doubtful:
        free = fill_polygon(tuple(doubt.polygon), size) & (labels == 0)
        for place in (free, labels == 0):  # the region itself, or the gap between others that it lies in
            depth = (
                cv2.distanceTransform(np.pad(place, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1] * free
            )
            if LEARNED.room[0] * radius <= depth.max() <= LEARNED.room[1] * radius:
                rows, columns = np.ogrid[: size[1], : size[0]]
                y, x = _center_of_room(labels == 0, free, radius)
                sure.append(doubt.confidence)
                labels[(np.hypot(columns - x, rows - y) <= radius) & (labels == 0)] = len(sure)
                break
        else:
            rest.append(doubt)
    return left_to_right(Segments(labels, np.array(sure), rest))


def _center_of_room(place: Mask, free: Mask, radius: float) -> tuple[float, float]:
    """Row and column, near `free` (H, W), of the disc of which most lies in `place` (H, W); the middle of equals."""
    reach = int(np.ceil(radius))
    away = np.hypot(*np.ogrid[-reach : reach + 1, -reach : reach + 1])
    inside = cv2.filter2D(
        place.astype(np.float32), -1, (away <= radius).astype(np.float32), borderType=cv2.BORDER_CONSTANT
    )
    inside *= dilate(free, round(radius / 3))
    y, x = np.nonzero(inside >= inside.max() - 0.5)
    return float(y.mean()), float(x.mean())


def as_segments(
    rgb: NDArray[np.uint8],
    proposals: Sequence[Proposal],
    scores: NDArray[np.float64],
    confidences: NDArray[np.float64],
    shape: tuple[int, int],
) -> Segments:
    """Proposals on a grid of `shape` (h, w) as labels of the photo, their outlines fitted to its edges, left to right.

    Of two with a common pixel the one with the better score gets it.
    """
    rising = np.argsort(scores, kind="stable")
    labels = tighten(rgb, [proposals[i].on(shape) for i in rising.tolist()])
    return left_to_right(Segments(labels.astype(np.uint16), confidences[rising]))


def left_to_right(objects: Segments) -> Segments:
    """The same, ids from left to right by centroid; those without a pixel are left out."""
    labels = objects.labels
    count = np.bincount(labels.ravel(), minlength=len(objects.confidence) + 1)
    x = np.bincount(labels.ravel(), np.indices(labels.shape)[1].ravel(), len(count)) / np.maximum(count, 1)
    order = 1 + np.argsort(x[1:], kind="stable")
    order = order[count[order] > 0]
    ids = np.zeros(len(count), np.uint16)
    ids[order] = np.arange(1, len(order) + 1)
    return replace(objects, labels=ids[labels], confidence=objects.confidence[order - 1])


def worth(found: Candidates, fit: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) 0..1: expected fits (n,) with a bonus where edges selected the same and the network sees an object."""
    foreground = found.evidence[:, FEATURES.index("foreground")]
    share = np.clip(
        (foreground - LEARNED.foreground[0]) / (LEARNED.foreground[1] - LEARNED.foreground[0]), 0, 1
    )
    return np.minimum(fit + LEARNED.agreement * found.edges * share, LEARNED.best)


def joined(found: Candidates, fit: NDArray[np.float64], best: NDArray[np.intp]) -> NDArray[np.intp]:
    """The selected candidates, two or more parts of one whole replaced by it, the largest wholes first; `fit` (n,) of
    a whole becomes at least its parts' mean."""
    area = np.array([one.area for one in found.proposals], np.float64)
    wholes = np.flatnonzero(found.whole)
    for whole in wholes[np.argsort(-area[wholes], kind="stable")].tolist():
        common = np.array([overlap(found.proposals[whole], found.proposals[k]) for k in best.tolist()])
        parts = common > LEARNED.inside * area[best]
        if parts.sum() > 1 and common[parts].sum() > LEARNED.covered * area[whole]:
            mean = float(np.average(fit[best[parts]], weights=area[best[parts]]))
            fit[whole] = max(float(fit[whole]), mean)
            best = np.append(best[~parts], whole)
    return best


def gaps(
    rgb: NDArray[np.uint8], found: Candidates, fit: NDArray[np.float64], best: NDArray[np.intp]
) -> NDArray[np.float64]:
    """(n,) 0..1: how well the surrounding colours explain selected proposals as gaps; 0 for the most certain."""
    if not len(best):
        return np.zeros(0)
    size = found.shape[::-1]
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) if rgb.shape[:2] != found.shape else rgb
    some: list[Proposal] = [found.proposals[k] for k in best.tolist()]
    return background_likeness(
        some,
        np.ones(len(best), np.bool_),
        fit[best] < LEARNED.certain,
        smoothed_lab(np.asarray(small, np.uint8)),
    )


def choose(found: Candidates, fit: NDArray[np.float64]) -> NDArray[np.intp]:
    """The candidates without overlap of the largest total gain."""
    pool = np.flatnonzero(fit > LEARNED.threshold)
    if not len(pool):
        return pool
    some: list[Proposal] = [found.proposals[k] for k in pool.tolist()]
    area = np.array([one.area for one in some], np.float64) / (found.shape[0] * found.shape[1])
    gain = (fit[pool] - LEARNED.threshold) * area**LEARNED.area_power
    return pool[best_set(gain, exclusions(some))]


def doubts(
    found: Candidates, fit: NDArray[np.float64], sure: NDArray[np.intp], size: tuple[int, ...]
) -> list[Doubt]:
    """The best other candidates, mostly outside the selected ones, on a photo of `size` (H, W)."""
    scale = size[1] / found.shape[1], size[0] / found.shape[0]
    right = confidence(fit)
    taken = [found.proposals[k] for k in sure.tolist()]
    doubtful: list[Doubt] = []
    for k in np.argsort(-fit, kind="stable").tolist():
        if right[k] < LEARNED.doubtful or len(doubtful) == LEARNED.doubts:
            break
        one = found.proposals[k]
        if any(overlap(one, other) > SHARED * min(one.area, other.area) for other in taken):
            continue
        taken.append(one)
        doubtful += doubt_about(one, float(right[k]), scale)
    return doubtful
