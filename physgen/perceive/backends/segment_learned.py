"""Backend segment=learned: proposals from edges and a network, ranked by the network, selected jointly."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.shapes import fill_polygon
from physgen.perceive.inpaint.poisson import dilate
from physgen.perceive.roles import Doubt, Mask, Segment, Segments
from physgen.perceive.segment.candidates import (
    FEATURES,
    Candidates,
    candidates,
    confidence,
    expected_fit,
)
from physgen.perceive.segment.network import box_of, mask_in_box, run_network
from physgen.perceive.segment.proposals import Proposal, cut_out, doubt_about, overlap
from physgen.perceive.segment.selection import (
    SHARED,
    best_set,
    exclusions,
    search_edges,
)


@dataclass(frozen=True)
class LearnedConstants:
    """Constants of the selection, chosen on the studio's tune half and on the validation homes."""

    threshold: float = 0.65  # expected fit above which a proposal may be an object: half of such are right
    area_power: float = 0.5  # exponent of the area in a proposal's gain, which balances wholes against parts
    agreement: float = 0.5  # bonus of the selection by edges
    foreground: tuple[float, ...] = (
        0.3,
        0.6,
    )  # mean foreground from which that counts in part, in full
    doubtful: float = 0.1  # confidence from which a proposal is a doubtful object
    gap_penalty: float = 0.35  # of a selected proposal whose colours continue around it
    rarer: float = (
        3.0  # factor by which a colour may be rarer there and still count as continued
    )
    explained: tuple[float, ...] = (0.5, 0.8)
    """Share of such colours from which that counts in part, and in full."""
    movable: float = 0.5  # mean movability from which an object may be moved
    same: float = 0.5  # IoU below which what is cut out again is another object
    inside: float = (
        0.7  # share of a selected proposal in a whole from which it is one of its parts
    )
    better: float = 0.1  # fit by which each of them exceeds that of the whole, from which it does not
    doubts: int = 8  # doubtful objects at most
    set_size: int = 5  # round objects of one radius from which they are a set, as of balls or marbles
    round: float = (
        0.9  # share of its smallest enclosing circle from which an object is round
    )
    equal: float = (
        0.05  # of their median radius: half of a set's objects differ by less
    )
    room: tuple[float, float] = (0.7, 1.25)
    """Of a set's radius: the largest disc in a doubtful region, or about it between others, that is one more."""
    handle: tuple[float, float] = (
        0.4,
        0.5,
    )  # of what it holds up: width at most, length at least


LEARNED = LearnedConstants()


def learned() -> Segment:
    """The segmenter; it is deterministic and keeps no state."""
    return segment


def segment(rgb: NDArray[np.uint8]) -> Segments:
    """The movable objects of a photo (H, W, 3) uint8 sRGB, and doubtful ones."""
    with ThreadPoolExecutor(1) as beside:
        seen = beside.submit(run_network, rgb)
        by_edges = search_edges(rgb)
    found = candidates(by_edges, seen.result())
    expected = expected_fit(found.evidence)
    fit = worth(found, expected)
    best = choose(found, fit)
    # edges bound a gap as they bound an object: there their agreement says nothing
    fit[best] -= continued(rgb, found, best) * (
        LEARNED.gap_penalty + fit[best] - expected[best]
    )
    sure = joined(found, fit, best[fit[best] > LEARNED.threshold])
    fit[found.movable < LEARNED.movable] = 0
    sure = sure[fit[sure] > 0]
    some = [found.proposals[k] for k in sure.tolist()]
    objects = as_segments(rgb, some, fit[sure], confidence(fit[sure]), found.shape)
    objects = replace(objects, doubtful=doubts(found, fit, sure, rgb.shape[:2]))
    return with_handles(rgb, with_rest_of_set(objects))


def continued(
    rgb: NDArray[np.uint8], found: Candidates, best: NDArray[np.intp]
) -> NDArray[np.float64]:
    """(n,) 0..1: how surely selected candidates are gaps, through which the colours around them are seen."""
    some, shape = [found.proposals[k] for k in best.tolist()], found.shape
    if not some:
        return np.zeros(0)
    small = cv2.GaussianBlur(
        cv2.resize(rgb, shape[::-1], interpolation=cv2.INTER_AREA), (0, 0), 1.5
    )
    lightness, *hue = (
        part.astype(np.int64)
        for part in cv2.split(cv2.cvtColor(small, cv2.COLOR_RGB2LAB))
    )
    colour = (lightness // 16 * 32 + hue[0] // 8) * 32 + hue[1] // 8
    masks, shares = [one.on(shape) for one in some], []
    free = ~np.any(masks, axis=0)
    for one, mask in zip(some, masks, strict=True):
        reach, (left, top, right, bottom) = max(3, int(np.sqrt(one.area))), one.box
        ring = np.s_[
            max(0, top - reach) : bottom + reach, max(0, left - reach) : right + reach
        ]
        own, other = (
            np.bincount(c, minlength=2**14)
            for c in (colour[mask], colour[ring][free[ring]])
        )
        shares.append(
            np.minimum(
                own / own.sum(), LEARNED.rarer * other / max(other.sum(), 1)
            ).sum()
        )
    return np.asarray(np.interp(shares, LEARNED.explained, (0, 1)))


def with_rest_of_set(objects: Segments) -> Segments:
    """Where the objects are round and equal, balls of a set, doubtful regions with room for one more become that, and
    so do other objects wedged between them."""
    each = [
        round_radius(objects.labels == k) for k in range(1, len(objects.confidence) + 1)
    ]
    radii = [one for one in each if one]
    radius = float(np.median(radii)) if radii else 0.0
    uneven = [k for k, one in enumerate(each, 1) if one < LEARNED.room[0] * radius]
    if (
        len(radii) < LEARNED.set_size
        or np.median(np.abs(np.array(radii) - radius)) > LEARNED.equal * radius
    ):
        return objects
    labels, sure, rest = objects.labels.copy(), list(objects.confidence), []
    rows, columns = np.ogrid[: labels.shape[0], : labels.shape[1]]

    def one_more(k: int, free: Mask, places: Sequence[Mask]) -> bool:
        """Whether a disc of the set fits about `free` (H, W) into one of `places`; it becomes object k."""
        low, high = (part * radius for part in LEARNED.room)
        for place in places:
            padded = np.pad(place, 1).astype(np.uint8)
            depth = cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1] * free
            # in the open, a part as wide as the ball, say its band, tells where that is
            wide = (
                k <= len(each)
                and low
                <= cv2.minEnclosingCircle(np.argwhere(free).astype(np.int32))[1]
                <= high
            )
            if low <= depth.max() and (depth.max() <= high or wide):
                y, x = _center_of_room(places[-1], free, radius)
                disc = (np.hypot(columns - x, rows - y) <= radius) & places[-1]
                if np.count_nonzero(free & disc) > LEARNED.inside * np.count_nonzero(
                    free
                ):
                    labels[free], labels[disc] = 0, k
                    return True
        return False

    for k in uneven:
        own = labels == k
        one_more(k, own, [(labels == 0) | own])
    for doubt in objects.doubtful:
        free = fill_polygon(tuple(doubt.polygon), labels.shape[::-1]) & (labels == 0)
        # the region itself, or the gap between others that it lies in
        if one_more(len(sure) + 1, free, [free, labels == 0]):
            sure.append(doubt.confidence)
        else:
            rest.append(doubt)
    return left_to_right(Segments(labels, np.array(sure), rest))


def with_handles(rgb: NDArray[np.uint8], objects: Segments) -> Segments:
    """Objects below which something narrow goes on, as below the head of a spoon, are cut out again with it."""
    lab = cv2.cvtColor(
        cv2.GaussianBlur(rgb, (0, 0), 0.7).astype(np.float32) / 255, cv2.COLOR_RGB2LAB
    )
    labels = objects.labels.copy()
    for k in range(1, len(objects.confidence) + 1):
        own = labels == k
        left, top, right, low = box_of(own)
        long = max(10, round(LEARNED.handle[1] * (low - top)))
        if low + long <= len(own):
            x, part = int(np.median(np.nonzero(own[low - 1])[0])), own.copy()
            head = np.median(
                lab[max(low - 4, 0) : low, max(x - 1, 0) : x + 2], axis=(0, 1)
            )
            part[low:] = _handle(
                np.asarray(lab[low:]), head, labels[low:] == 0, x, right - left, long
            )
            whole = mask_in_box(rgb, box_of(part)).mask if part[low:].any() else own
            if np.count_nonzero(whole & part) > LEARNED.same * np.count_nonzero(
                whole | part
            ):
                labels[own & ~whole], labels[whole & (labels == 0)] = 0, k
    return replace(objects, labels=labels)


def _handle(
    lab: NDArray[np.float32],
    head: NDArray[np.float32],
    free: Mask,
    x: int,
    width: int,
    long: int,
) -> Mask:
    """(h, w): what goes on from column x of the first row, nearer in colour to that place than to either side of it;
    empty unless that is nearer to the `head` above, too, it is `long` px, and narrow for something `width` px wide."""
    away, like, none = np.arange(free.shape[1]) - x, free.copy(), np.zeros_like(free)
    neck = np.median(lab[1:4, max(x - 1, 0) : x + 2], axis=(0, 1))
    off = np.linalg.norm(lab - neck, axis=2)
    for side in (-away, away):
        beside = (side > width / 4) & (side < width)
        known = lab[:long, beside][free[:long, beside]]
        if 2 * len(known) <= long * np.count_nonzero(beside):
            return none
        side_colour = np.median(known, axis=0)
        if np.linalg.norm(neck - head) > np.linalg.norm(neck - side_colour):
            return none
        like &= off < np.linalg.norm(lab - side_colour, axis=2)
    like[:2, x] = free[:2, x]
    pieces = cv2.connectedComponents(like.astype(np.uint8), connectivity=4)[1]
    part = like & (pieces == pieces[0, x])
    widths = part.sum(axis=1)[part.any(axis=1)]
    return (
        part
        if len(widths) >= long
        and np.percentile(widths, 95) <= LEARNED.handle[0] * width
        else none
    )


def round_radius(mask: Mask) -> float:
    """px: the radius of a round mask (H, W), 0 of any other."""
    points = np.argwhere(mask)[:, ::-1].astype(np.float32)
    if not len(points):
        return 0.0
    _, around = cv2.minEnclosingCircle(points)
    return (
        float(np.sqrt(len(points) / np.pi))
        if len(points) > LEARNED.round * np.pi * around**2
        else 0.0
    )


def _center_of_room(place: Mask, free: Mask, radius: float) -> tuple[float, float]:
    """Row and column, near `free` (H, W), of the disc of which most lies in `place` (H, W); the middle of equals."""
    reach = int(np.ceil(radius))
    away = np.hypot(*np.ogrid[-reach : reach + 1, -reach : reach + 1])
    inside = cv2.filter2D(
        place.astype(np.float32),
        -1,
        (away <= radius).astype(np.float32),
        borderType=cv2.BORDER_CONSTANT,
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
    """Proposals on a grid of `shape` (h, w) as labels of the photo, left to right, each cut out again in its box.

    What is round stays so; what is not found again stays as it is. Of two with a common pixel the one with the better
    score gets it.
    """
    rising = np.argsort(scores, kind="stable")
    size = rgb.shape[0], rgb.shape[1]
    labels = np.zeros(size, np.uint16)
    scale = np.tile([rgb.shape[1] / shape[1], rgb.shape[0] / shape[0]], 2)
    for k, i in enumerate(rising.tolist(), 1):
        own = cv2.resize(proposals[i].on(shape).astype(np.uint8), size[::-1]) > 0
        found = mask_in_box(rgb, proposals[i].box * scale).mask
        other = np.count_nonzero(own & found) < LEARNED.same * np.count_nonzero(
            own | found
        )
        labels[
            own if other or (round_radius(own) and not round_radius(found)) else found
        ] = k
    for k in range(1, len(rising) + 1):
        if (
            piece := cut_out(labels == k, 0, 0, 1)
        ) is not None:  # without what a later one cut off
            labels[(labels == k) & ~piece.on(size)] = 0
    return left_to_right(Segments(labels, confidences[rising]))


def left_to_right(objects: Segments) -> Segments:
    """The same, ids from left to right by centroid; those without a pixel are left out."""
    labels = objects.labels
    count = np.bincount(labels.ravel(), minlength=len(objects.confidence) + 1)
    x = np.bincount(
        labels.ravel(), np.indices(labels.shape)[1].ravel(), len(count)
    ) / np.maximum(count, 1)
    order = 1 + np.argsort(x[1:], kind="stable")
    order = order[count[order] > 0]
    ids = np.zeros(len(count), np.uint16)
    ids[order] = np.arange(1, len(order) + 1)
    return replace(
        objects, labels=ids[labels], confidence=objects.confidence[order - 1]
    )


def worth(found: Candidates, fit: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,): expected fits (n,) with a bonus where edges selected the same and the network sees an object."""
    foreground = found.evidence[:, FEATURES.index("foreground")]
    share = np.interp(foreground, LEARNED.foreground, (0, 1))
    return fit + LEARNED.agreement * found.edges * share


def joined(
    found: Candidates, fit: NDArray[np.float64], best: NDArray[np.intp]
) -> NDArray[np.intp]:
    """The selected candidates, two or more parts of one whole replaced by it, the largest wholes first, unless each
    fits better; `fit` (n,) of a whole becomes at least its parts' mean."""
    area = np.array([one.area for one in found.proposals], np.float64)
    wholes = np.flatnonzero(found.whole)
    for whole in wholes[np.argsort(-area[wholes], kind="stable")].tolist():
        common = np.array(
            [overlap(found.proposals[whole], found.proposals[k]) for k in best.tolist()]
        )
        parts = common > LEARNED.inside * area[best]
        better = fit[best[parts]].min(initial=1.0) > fit[whole] + LEARNED.better
        if parts.sum() > 1 and not better:
            mean = float(np.average(fit[best[parts]], weights=area[best[parts]]))
            fit[whole] = max(float(fit[whole]), mean)
            best = np.append(best[~parts], whole)
    return best


def choose(
    found: Candidates, fit: NDArray[np.float64], least: float = LEARNED.threshold
) -> NDArray[np.intp]:
    """The candidates without overlap of the largest total gain, of a fit above the `least`."""
    pool = np.flatnonzero(fit > least)
    if not len(pool):
        return pool
    some: list[Proposal] = [found.proposals[k] for k in pool.tolist()]
    area = np.array([one.area for one in some], np.float64) / (
        found.shape[0] * found.shape[1]
    )
    gain = (fit[pool] - least) * area**LEARNED.area_power
    return pool[best_set(gain, exclusions(some))]


def doubts(
    found: Candidates,
    fit: NDArray[np.float64],
    sure: NDArray[np.intp],
    size: tuple[int, ...],
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
        if any(
            overlap(one, other) > SHARED * min(one.area, other.area) for other in taken
        ):
            continue
        taken.append(one)
        doubtful += doubt_about(one, float(right[k]), scale)
    return doubtful
