"""Which objects of a perceived scene suit a push, and which of them a hand may tip."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from physgen.perceive.summary import mask_confidence
from physgen.pipeline.push_outcomes import TRIAL
from physgen.pipeline.releases import RELEASE
from physgen.pipeline.verdicts import part_owners

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physgen.perceive.roles import PerceivedScene


def push_confidence(
    perceived_scene: PerceivedScene, names: Collection[str], least_confidence: float
) -> dict[str, float]:
    """Return the confidences of all objects for a push, 0 for those not in `names`.

    Confidences below `least_confidence` are raised to `least_confidence`.
    """
    objects = perceived_scene.document["objects"]
    confidence = dict.fromkeys(objects, 0.0)
    torn_names = part_owners(perceived_scene)
    for name in names:
        # An object whose parts may stay behind is pushed only for want of another.
        certainty = max(mask_confidence(objects[name]), least_confidence)
        if name in torn_names and certainty > TRIAL.confidence:
            certainty = max(certainty * RELEASE.torn_weight, TRIAL.confidence)
        confidence[name] = certainty
    return confidence


def round_ends(perceived_scene: PerceivedScene) -> set[tuple[str, str]]:
    """Return the names of objects with a round foot, and the side of the round end.

    Such an object stands on a hidden base.
    """
    ends = set()
    for name, item in perceived_scene.document["objects"].items():
        corners = item.get("shape", {}).get("polygon")
        if corners is None:
            continue
        mask = perceived_scene.percepts.labels == item["mask"]
        for side in _round_sides(mask, np.array(corners, np.float64)):
            ends.add((name, side))
    return ends


def _round_sides(mask: NDArray[np.bool_], corners: NDArray[np.float64]) -> list[str]:
    """Return the sides on which a mask ends above the foot of its polygon."""
    # The polygon of an object has a flat base; its mask shows whether the visible
    # corner is round.
    foot_row = float(corners[:, 1].max())
    height = float(np.ptp(corners[:, 1]))
    foot = corners[corners[:, 1] > foot_row - TRIAL.foot * height, 0]
    last_column = mask.shape[1] - 1
    end_columns = {
        "left": int(np.ceil(foot.min())),
        "right": int(np.floor(foot.max())),
    }
    sides = []
    for side, column in end_columns.items():
        rows = np.flatnonzero(mask[:, min(max(column, 0), last_column)])
        # A mask that ends above the foot at its corner has a round corner there.
        gap = foot_row - float(rows.max(initial=-1))
        if len(rows) and gap > TRIAL.round_foot * height:
            sides.append(side)
    return sides
