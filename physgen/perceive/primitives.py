"""Label map -> outlines whose kind, circle or polygon, somebody has already chosen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from physgen.outline.circle import fit_circle
from physgen.outline.fit import clean, long_border
from physgen.outline.outline import Disc, Outline
from physgen.outline.shared import fit_regions
from physgen.outline.touching import fit_outlines


def outlines_of(labels: NDArray[np.uint16], circle: Mapping[int, bool]) -> dict[int, Outline]:
    """Outline by id of `labels` (H, W): a circle where `circle` says so, else polygons, however round.

    Neighbours are fitted together as far as their kind is the one that the fit would choose.
    """
    found: dict[int, Outline] = dict(fit_outlines(labels, list(circle)))
    for i, wanted in circle.items():
        if isinstance(found[i], Disc) != wanted:
            mask = clean(labels == i)
            found[i] = (
                fit_circle(mask, long_border(mask))[0] if wanted else fit_regions(mask.astype(np.int64))[1]
            )
    return found
