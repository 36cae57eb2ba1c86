"""Photo -> labels of movable objects: edges and a network propose, the network judges, a joint choice keeps the best."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.perceive.backends.segment_classical import told
from physgen.perceive.learned.candidates import Candidates, candidates
from physgen.perceive.learned.judge import confidence, expected
from physgen.perceive.learned.network import see
from physgen.perceive.proposals.choose import best_set, exclusions
from physgen.perceive.proposals.proposal import Proposal
from physgen.perceive.roles import Segment, Segments

THRESHOLD = 0.55
"""Expected fit below which a proposal is better left out."""
AREA_POWER = 0.5
"""The gain of a proposal grows with its area to this power: wholes against their parts."""


def learned() -> Segment:
    """The segmenter; it keeps nothing between photos and draws no random numbers."""
    return segment


def segment(rgb: NDArray[np.uint8]) -> Segments:
    """The movable objects of a photo (H, W, 3) uint8 sRGB."""
    found = candidates(rgb, see(rgb))
    fit = expected(found.evidence)
    chosen = choose(found, fit)
    some = [found.proposals[k] for k in chosen.tolist()]
    return told(rgb, some, fit[chosen], confidence(fit[chosen]), found.shape)


def choose(found: Candidates, fit: NDArray[np.float64]) -> NDArray[np.intp]:
    """The candidates without overlap whose expected fits gain the most together."""
    pool = np.flatnonzero(fit > THRESHOLD)
    if not len(pool):
        return pool
    some: list[Proposal] = [found.proposals[k] for k in pool.tolist()]
    area = np.array([one.area for one in some], np.float64) / (found.shape[0] * found.shape[1])
    gain = (fit[pool] - THRESHOLD) * area**AREA_POWER
    return pool[best_set(gain, fit[pool], exclusions(some))]
