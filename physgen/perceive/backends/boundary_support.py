"""Backend boundary=support: view, floors and rails, inferred from the objects'
positions.

In a photo from the side, objects stand on each other or on common lines, and the
surface above such a line mostly differs from the one below. In a photo from above, the
same surface surrounds the objects, and no line explains their positions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from physgen.geometry.convex import overlap_depth
from physgen.geometry.polygon import Outline, bounds
from physgen.perceive.roles import (
    Boundary,
    BoundaryGuess,
    Labels,
    PhotoObject,
    Rgb,
    Wall,
)
from physgen.perceive.segment.network import run_network
from physgen.perceive.support.box_outlines import fit_rectangles, touching_objects
from physgen.perceive.support.box_tops import middle_sections
from physgen.perceive.support.cushions import find_cushions
from physgen.perceive.support.equilibrium import contacts
from physgen.perceive.support.flat_bases import add_base, needs_base
from physgen.perceive.support.floor_chains import Chain, floor_points
from physgen.perceive.support.floor_surface import Photo, Span
from physgen.perceive.support.ground_contact import (
    STEEP,
    Foot,
    Line,
    close_gaps_below,
    find_foot,
    group_feet,
    has_carriers,
)
from physgen.perceive.support.level_feet import (
    free_discs,
    level_feet,
    split_group,
    stands_flat,
)
from physgen.perceive.support.supports import SOURCE, add_supports, free_parts
from physgen.perceive.support.view_classifier import view_chances
from physgen.perceive.support.viewpoint import guess_view
from physgen.scene.scene import View
from physgen.text import counted

Groups = Sequence[tuple[Line, list[Foot]]]
Reach = Callable[[Line, Sequence[Foot]], Span | None]
"""Return the two ends of the floor under a group (columns), or None if unknown."""

FRICTION, ELASTICITY = 0.6, 0.4
GRIP = 1.25
"""Coefficient of friction divided by the slope of a resting object: at 1 it is about to
slip.
"""
ROUNDING = 1e-3
"""Largest slope of a level foot."""
FLOOR_CONFIDENCES = {1: 0.4, 2: 0.6}
"""Confidence of a floor by the number of objects on it."""
CONFIDENCE_OF_MANY = 0.8
"""Confidence of a floor under more objects."""


def support() -> Boundary:
    """Return the backend `support`."""
    return _support


def _support(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject], view: View | None
) -> BoundaryGuess:
    """Return the view and the boundaries: floors from the side, cushions from above."""
    chances = view_chances(run_network(rgb).features)
    if view is None:
        single_objects, upright = view_evidence(objects, feet_groups(labels, objects))
        view_guess, confidence, reason = guess_view(
            rgb, labels, run_network(rgb).normals, single_objects, upright, chances
        )
    else:
        view_guess = view
        confidence = 1.0
        reason = "as given"
    if view_guess is View.TOP or not len(objects):
        cushions = find_cushions(Photo(rgb, labels), objects)
        return BoundaryGuess(
            view_guess, confidence, reason, tuple(cushions), tilt=chances.tilt
        )
    supports = lay_floors(rgb, labels, objects)
    guess = BoundaryGuess(view_guess, confidence, reason, (), tilt=chances.tilt)
    return with_supports(guess, labels, supports)


def with_supports(
    guess: BoundaryGuess, labels: Labels, supports: SupportedObjects
) -> BoundaryGuess:
    """Return the guess with floors, and with supports for objects that would fall from
    them.
    """
    walls = [photo_bottom(labels), *supports.walls]
    walls, held_objects = add_supports(
        supports.objects, walls, supports.grip, FRICTION, ELASTICITY
    )
    return replace(
        guess,
        walls=tuple(walls),
        outlines=supports.outlines,
        held_ids=held_objects,
        grip=supports.grip,
    )


def feet_groups(labels: Labels, objects: Sequence[PhotoObject]) -> Groups:
    """Return feet grouped by common lines, without objects that other objects carry."""
    feet = []
    for t in objects:
        if not t.cut and not has_carriers(t, labels, objects):
            feet.append(find_foot(t))
    return group_feet(feet, line_tolerance(labels))


def line_tolerance(labels: Labels) -> float:
    """Return the largest distance of a foot from a common line, px."""
    return max(2.5, 0.012 * float(labels.shape[0]))


def view_evidence(objects: Sequence[PhotoObject], groups: Groups) -> tuple[int, int]:
    """Return the number of objects alone on their line and the number of upright
    objects.
    """
    count = sum(len(group) for _, group in groups)
    single_objects = sum(
        len(group) for _, group in groups if len(group) == 1 and count > 1
    )
    return single_objects, sum(stands_flat(find_foot(t)) for t in objects if not t.cut)


@dataclass(frozen=True)
class SupportedObjects:
    """Objects seen from the side, and the floors under them."""

    objects: Sequence[PhotoObject]
    # Corrected outlines by id, for objects that stand better than their masks.
    outlines: Mapping[int, Outline]
    walls: Sequence[Wall]
    # Least friction by id.
    grip: dict[int, float]


def lay_floors(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject], solid: Reach | None = None
) -> SupportedObjects:
    """Return objects with level feet, and floors that touch them.

    `solid` gives the ends of a floor from depth, if available.
    """
    outlines = close_gaps_below(labels, objects)
    objects = replace_outlines(objects, outlines)
    objects = middle_sections(rgb, labels, objects)
    outlines |= {t.id: t.outline for t in objects if t.top}
    groups = feet_groups(labels, objects)
    free = free_discs(objects)
    # Objects that do not fit the common line get lines of their own.
    groups = [part for line, group in groups for part in split_group(line, group, free)]
    for line, group in groups:
        outlines |= level_feet(line, group, free)
    objects = replace_outlines(objects, outlines)
    outlines |= _fit_level_rectangles(objects, outlines)
    objects = replace_outlines(objects, outlines)
    outlines |= flat_bases(objects, groups)
    objects = replace_outlines(objects, outlines)
    # The later steps changed outlines, so the feet are found anew.
    current = {t.id: t for t in objects}
    groups = [
        (line, [find_foot(current[f.item.id]) for f in group]) for line, group in groups
    ]
    photo = Photo(rgb, labels)
    walls = _lay_walls(photo, objects, groups, solid, 2 * line_tolerance(labels))
    return SupportedObjects(objects, outlines, walls, _grip(objects, groups))


def replace_outlines(
    objects: Sequence[PhotoObject], outlines: Mapping[int, Outline]
) -> list[PhotoObject]:
    """Return the objects with the outlines that are given by id."""
    return [replace(t, outline=outlines.get(t.id, t.outline)) for t in objects]


def _fit_level_rectangles(
    objects: Sequence[PhotoObject], outlines: Mapping[int, Outline]
) -> dict[int, Outline]:
    """Return rectangles, by id, of rectangular objects.

    A box with a level foot gets a level rectangle: an object with a corrected outline
    and a slanted foot gets none.
    """
    slanted_ids = set()
    for t in objects:
        if t.id in outlines and abs(find_foot(t).slope) > ROUNDING:
            slanted_ids.add(t.id)
    rectangles = fit_rectangles(objects)
    level_rectangles = {}
    for i, box in rectangles.items():
        if i not in slanted_ids:
            level_rectangles[i] = box
    return level_rectangles


def flat_bases(objects: Sequence[PhotoObject], groups: Groups) -> dict[int, Outline]:
    """Return outlines with flat bases, by id, of objects that would tip over on their
    feet.

    Only objects without contacts get a base: others may lean on something or lie on it.
    """
    touching = touching_objects(objects)
    current = {item.id: item for item in objects}
    bases: dict[int, Outline] = {}
    for line, group in groups:
        for foot in group:
            foot = find_foot(current[foot.item.id])
            is_separate = foot.item.id not in touching
            if not is_separate or abs(line.slope) > STEEP or not needs_base(foot):
                continue
            base = add_base(foot, line)
            others = []
            for item in objects:
                if item.id != foot.item.id:
                    others.append(item.outline)
            if base and all(overlap_depth(base, other) == 0 for other in others):
                bases[foot.item.id] = base
    return bases


@dataclass(frozen=True, eq=False)
class _Floor:
    """A wall under a group of feet, before it is cut into free pieces."""

    line: Line
    group: Sequence[Foot]
    is_ground: bool
    # Its ends, or None if they are not visible.
    visible_span: Span | None
    source: str

    @property
    def kind(self) -> str:
        """Return the first part of the wall's name."""
        if abs(self.line.slope) > STEEP:
            return "slope"
        if self.is_ground:
            return "floor"
        return "ledge"

    @property
    def own_span(self) -> Span:
        """Return the ends of the objects on it."""
        boxes = np.array([bounds(f.item.outline) for f in self.group])
        return float(boxes[:, 0].min()), float(boxes[:, 2].max())

    def chain(self, span: Span) -> Chain:
        """Return the chain of points between two ends."""
        return floor_points(self.line, self.group, span)

    def feet_on(self, part: Chain) -> list[Foot]:
        """Return the feet that stand on a piece."""
        first = part[0][0]
        last = part[-1][0]
        return [f for f in self.group if first <= f.right[0] and last >= f.left[0]]


def _lay_walls(
    photo: Photo,
    objects: Sequence[PhotoObject],
    groups: Groups,
    solid: Reach | None,
    close: float,
) -> list[Wall]:
    """Return a wall under every group of feet, in pieces if it would enter an object.

    The floor is under the lowest group, or under a larger group less than `close` px
    above it.
    """
    groups = sorted(groups, key=lambda g: -_lowest_foot(g[1]))
    ground = _find_ground(groups, close)
    walls: list[Wall] = []
    for line, group in groups:
        floor = _find_floor(photo, line, group, group is ground, solid)
        others = []
        for t in objects:
            if all(t is not f.item for f in group):
                others.append(t.outline)
        span = floor.visible_span or floor.own_span
        if _has_blocked_ends(floor, others):
            span = floor.own_span
        for part in free_parts(floor.chain(span), others):
            count = len(floor.feet_on(part))
            if count:
                walls.append(_make_wall(floor, part, count, walls))
    return walls


def _lowest_foot(group: Sequence[Foot]) -> float:
    """Return the largest y of the feet of a group, px."""
    return max(float(f.lowest[1]) for f in group)


def _find_ground(groups: Groups, close: float) -> list[Foot]:
    """Return the largest level group of those at most `close` px above the lowest."""
    lowest = max((_lowest_foot(group) for _, group in groups), default=0.0)
    low_groups = []
    for line, group in groups:
        if abs(line.slope) <= STEEP and _lowest_foot(group) >= lowest - close:
            low_groups.append(group)
    return max(low_groups, key=len, default=[])


def _find_floor(
    photo: Photo,
    line: Line,
    group: Sequence[Foot],
    is_ground: bool,
    solid: Reach | None,
) -> _Floor:
    """Return the floor under a group with its ends from depth or colours."""
    depth_span = None
    if solid:
        depth_span = solid(line, group)
    if depth_span is None:
        source = "lowest points"
    else:
        source = "depth and lowest points"
    visible_span = depth_span or photo.reach(line, group, is_ground)
    return _Floor(
        line, group, is_ground, visible_span, source if visible_span else SOURCE
    )


def _has_blocked_ends(floor: _Floor, others: Sequence[Outline]) -> bool:
    """Return whether other objects block the ends of a ledge under one object.

    An object beside a ledge must not strike the ledge's end, so that such a ledge is
    cut to its own width.
    """
    if len(floor.group) != 1 or floor.is_ground:
        return False
    first, last = floor.own_span
    chain = floor.chain((2 * first - last, 2 * last - first))
    middle = (first + last) / 2
    free_pieces = []
    for part in free_parts(chain, others):
        if part[0][0] <= middle <= part[-1][0]:
            free_pieces.append(part)
    blocked_ends = 2
    if free_pieces:
        piece = free_pieces[0]
        blocked_ends = sum(piece[k] != chain[k] for k in (0, -1))
    return blocked_ends > (floor.visible_span is not None)


def _make_wall(floor: _Floor, part: Chain, count: int, walls: Sequence[Wall]) -> Wall:
    """Return the wall of a piece under `count` objects, named after earlier `walls`."""
    kind = floor.kind
    number = 1 + sum(w.name.split("-")[0] == kind for w in walls)
    name = f"{kind}-{number}"
    if kind == "floor" and number == 1:
        name = kind
    reason = f"under {counted(count, 'object')}"
    if kind == "slope":
        reason = "as steep as what its friction holds"
    friction = max(FRICTION, round(GRIP * abs(floor.line.slope), 2))
    confidence = FLOOR_CONFIDENCES.get(count, CONFIDENCE_OF_MANY)
    return Wall(
        name, tuple(part), friction, ELASTICITY, confidence, floor.source, reason
    )


def _grip(objects: Sequence[PhotoObject], groups: Groups) -> dict[int, float]:
    """Return the least friction by id of objects on a slope, and of their neighbours.

    Neighbours lean on them or lie on them, directly or indirectly.
    """
    pairs = {(c.body, c.other) for c in contacts([t.outline for t in objects], [])}
    grip: dict[int, float] = {}
    for line, group in groups:
        steepest = max([abs(line.slope), *(abs(f.slope) for f in group)])
        if steepest <= STEEP:
            continue
        slope_objects = set()
        for k, t in enumerate(objects):
            if any(t is f.item for f in group):
                slope_objects.add(k)
        for _ in objects:
            slope_objects |= {
                k for pair in pairs if slope_objects & set(pair) for k in pair
            }
        for k in slope_objects:
            grip[objects[k].id] = max(
                grip.get(objects[k].id, 0.0), round(GRIP * steepest, 2)
            )
    return grip


def photo_bottom(labels: Labels) -> Wall:
    """Return the photo's bottom, extended by the photo's width on both sides.

    The sides and the top of the photo are open.
    """
    height, width = labels.shape
    points = ((-float(width), height - 0.5), (2.0 * width, height - 0.5))
    reason = "the photo's; sides and top are open"
    return Wall("bottom", points, FRICTION, ELASTICITY, 1.0, "photo", reason)
