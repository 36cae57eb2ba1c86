"""Gradient -> discs: edge pixels vote for the centres they may surround, then circles are fitted to rims."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.proposals.gradient import Gradient
from physgen.perceive.proposals.proposal import Proposal, cut_out

Circles = NDArray[np.float64]
"""(n, 3): centre x, centre y, radius, px."""

ANGLES = np.arange(72) * 2 * np.pi / 72
RIM = np.stack([np.cos(ANGLES), np.sin(ANGLES), np.ones(72)], 1)
"""(72, 3): how far the rim moves out at each angle when x, y or the radius grows by 1."""
LEAST = 0.13
"""Of a rim, that must vote for a circle."""


def discs(gradient: Gradient, smallest: int, largest: int, most: int = 250) -> list[Proposal]:
    """The discs of an area within bounds (px) that the most of a rim supports, at most `most` of them."""
    height, width = gradient.strength.shape
    circles = fit(gradient, vote(gradient, np.sqrt(smallest / np.pi), np.sqrt(largest / np.pi), 4 * most))
    support = gradient.support(_across_rim(gradient, circles, np.linspace(0.97, 1.03, 5)).max(1)).mean(1)
    x, y = np.arange(width), np.arange(height)[:, None]
    kept: list[Proposal] = []
    seen = np.zeros((0, 3))
    for i in np.argsort(-support, kind="stable"):
        one = circles[i]
        off = np.abs(seen - one)
        double = (np.hypot(off[:, 0], off[:, 1]) < 0.12 * one[2]) & (off[:, 2] < 0.12 * one[2])
        if support[i] < 0.3 or len(kept) == most:
            break
        if double.any() or not (0 <= one[0] < width and 0 <= one[1] < height):
            continue
        seen = np.vstack([seen, one])
        left, top = (max(0, int(one[k] - one[2])) for k in (0, 1))
        right, bottom = (int(one[k] + one[2]) + 2 for k in (0, 1))
        mask = np.hypot(x[left:right] - one[0], y[top:bottom] - one[1]) <= one[2]
        proposal = cut_out(mask, left, top, smallest)
        if proposal is not None and proposal.area <= largest:
            kept.append(proposal)
    return kept


def vote(gradient: Gradient, smallest: float, largest: float, most: int) -> Circles:
    """Maxima of the Hough transform of edges along their normals, over centre and radius; best first."""
    height, width = gradient.strength.shape
    rows, columns = np.nonzero(gradient.ridge)
    strength, angle = gradient.strength[rows, columns], gradient.angle[rows, columns]
    weight = np.minimum(1, strength / (6 * gradient.noise + 1))
    radii = [smallest]
    while radii[-1] < largest:
        radii.append(1.07 * radii[-1] + 0.2)
    across, down = np.cos(angle), np.sin(angle)
    found = []
    here: Layer | None = None
    for level in range(len(radii) + 1):  # maxima over place, and over the next larger radius
        after = None
        if level < len(radii):
            votes = _votes((height, width), rows, columns, across, down, weight, radii[level])
            after = votes, np.asarray(cv2.dilate(votes, np.ones((5, 5), np.uint8)), np.float32)
        if here is not None:
            y, x = np.nonzero(here[0] > LEAST)
            most_near = np.max([layer[1][y, x] for layer in (here, after) if layer is not None], axis=0)
            top = here[0][y, x] >= most_near
            y, x = y[top], x[top]
            found.append(np.stack([x, y, np.full(len(x), radii[level - 1]), here[0][y, x]], 1))
        here = after
    every = np.concatenate(found).astype(np.float64)
    return every[np.argsort(-every[:, 3], kind="stable")[:most], :3]


Layer = tuple[NDArray[np.float32], NDArray[np.float32]]
"""(H, W) votes for a radius, and their greatest over 5 x 5 px."""


def _votes(
    shape: tuple[int, int],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    across: NDArray[np.float32],
    down: NDArray[np.float32],
    weight: NDArray[np.float32],
    radius: float,
) -> NDArray[np.float32]:
    """(H, W): how much of a rim of a radius edge pixels put about each pixel; 1: a whole rim of full weight."""
    height, width = shape
    votes = np.zeros(height * width)
    for side in (radius, -radius):
        x = np.rint(columns + side * across).astype(np.int64)
        y = np.rint(rows + side * down).astype(np.int64)
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        votes += np.bincount((y * width + x)[inside], weight[inside], height * width)
    sigma = max(0.8, 0.08 * radius)
    blurred = cv2.GaussianBlur(votes.reshape(height, width).astype(np.float32), (0, 0), sigma)
    return np.asarray(blurred * (sigma * sigma / radius), np.float32)


def fit(gradient: Gradient, circles: Circles) -> Circles:
    """Each circle moved to the strongest edges near its rim: robust least squares, three bands."""
    for band, steps in ((0.14, 15), (0.08, 13), (0.05, 11)):
        factor = np.linspace(1 - band, 1 + band, steps)
        edge = _across_rim(gradient, circles, factor)
        near = 1 - 0.5 * np.linspace(-1, 1, steps)[:, None] ** 2
        at = (edge / (edge + 8) * near).argmax(1)
        strength = np.take_along_axis(edge, at[:, None], 1)[:, 0]
        radius = circles[:, 2:]
        out = radius * (factor[at] - 1)  # (n, 72) px by which the rim should move
        weight = certain = np.minimum(strength, 5) * (strength > 2 * gradient.noise)
        for _ in range(3):
            normal = np.einsum("nt,ti,tj->nij", weight, RIM, RIM) + 1e-3 * np.eye(3)
            move = np.linalg.solve(normal, np.einsum("nt,nt,ti->ni", weight, out, RIM)[..., None])[..., 0]
            weight = certain / (1 + ((out - move @ RIM.T) / (0.025 * radius + 0.7)) ** 2)
        circles = circles + np.clip(move, -0.2 * radius, 0.2 * radius)
    return circles


def _across_rim(gradient: Gradient, circles: Circles, factor: NDArray[np.float64]) -> NDArray[np.float32]:
    """(n, k, 72): edge strength across the rim of each circle, its radius multiplied by each of k factors."""
    radius = (circles[:, 2:] * factor)[..., None]
    x = circles[:, 0, None, None] + radius * np.cos(ANGLES)
    y = circles[:, 1, None, None] + radius * np.sin(ANGLES)
    return gradient.across(x, y, ANGLES)
