"""Scene + label maps -> the walls, and which pixels of the photo show those that are masks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.compile.masks import covers_nothing, pixels, unreadable
from physgen.compile.pairs import surface
from physgen.compile.world import Wall
from physgen.outline.fit import clean
from physgen.outline.outline import Outline, Region
from physgen.outline.shared import fit_regions
from physgen.outline.touching import fit_outlines
from physgen.problems import InputError, Problem
from physgen.scene.model import Boundary, Scene

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
U16 = NDArray[np.uint16]


@dataclass(frozen=True)
class Fitted:
    """What the masks of objects and boundaries became, fitted together so that neighbours touch."""

    objects: dict[int, Outline]
    """By id in the objects' label map, those alone whose shape is fitted."""
    walls: dict[int, Region]
    """By index in `Scene.boundaries`, those alone that are masks."""
    scenery: Mask
    """(H, W): pixels that show a boundary and no object."""


def fit_masks(scene: Scene, labels: U16 | None, of_objects: U16, fitted: list[int]) -> Fitted:
    """Outlines of the objects `fitted` and of every boundary that is a mask. Raises InputError.

    A boundary shares its lines with what its mask touches. One whose mask lies across another's is fitted alone, as if
    nothing stood before it: a hole in the shape of the thing in front would be a trap around it.
    """
    together = of_objects.astype(np.int32)
    shared: dict[int, int] = {}
    alone: dict[int, Region] = {}
    scenery = np.zeros(of_objects.shape, bool)
    problems: list[Problem] = []
    for k, item in enumerate(scene.boundaries):
        if item.mask is None:
            continue
        mask = pixels(item.mask, scene.size, labels)
        if mask is None or not mask.any():
            why = unreadable if mask is None else covers_nothing
            problems.append(why(scene, f"boundaries.{item.name}", item))
            continue
        scenery |= mask
        if together[mask].any():
            alone[k] = fit_regions(clean(mask).astype(np.int64))[1]
        else:
            shared[k] = len(scene.objects) + 1 + k
            together[mask] = shared[k]
    if problems:
        raise InputError(problems)
    ids = [*fitted, *shared.values()]
    fits = fit_outlines(together, ids, never_discs=set(shared.values())) if ids else {}
    walls = {k: fit for k, i in shared.items() if isinstance(fit := fits[i], Region)} | alone
    return Fitted({i: fits[i] for i in fitted}, walls, scenery & (of_objects == 0))


def walls_of(scene: Scene, regions: dict[int, Region]) -> tuple[Wall, ...]:
    """The boundaries as chains; `regions` are those of masks, by index."""

    def chains(k: int, item: Boundary) -> tuple[Array, ...]:
        if k not in regions:
            return (np.array(item.points, np.float64),)
        rings = (points for ring in regions[k].rings for points in (ring.outer, *ring.holes))
        return tuple(np.concatenate([points, points[:1]]) for points in rings)

    return tuple(
        Wall(item.name, chains(k, item), surface(item.friction, item.elasticity, scene.world.combine))
        for k, item in enumerate(scene.boundaries)
    )
