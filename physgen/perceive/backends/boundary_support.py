"""Backend boundary=support: view, floors and rails, inferred from the objects'
positions.

In a photo from the side, objects stand on each other or on common lines, and the
surface above such a line mostly differs from the one below. In a photo from above, the
same surface surrounds the objects, and no line explains their positions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.convex import overlap_depth
from physgen.geometry.polygon import Array, Disc, Outline, Region, Ring, bounds, cross
from physgen.maps import F32
from physgen.perceive.roles import (
    Boundary,
    BoundaryGuess,
    Labels,
    PhotoObject,
    Rgb,
    Wall,
)
from physgen.perceive.segment.network import run_network
from physgen.perceive.support.equilibrium import contacts
from physgen.perceive.support.ground_contact import (
    STEEP,
    Foot,
    Line,
    add_base,
    close_gaps_below,
    find_foot,
    fit_rectangles,
    floor_points,
    free_discs,
    group_feet,
    is_carried,
    level_feet,
    needs_base,
    split_group,
    stands_flat,
    touching_objects,
)
from physgen.perceive.support.supports import SOURCE, add_supports, free_parts
from physgen.perceive.support.view_classifier import view_chances
from physgen.perceive.support.viewpoint import guess_view
from physgen.perceive.working_size import working_size
from physgen.photometry import decode
from physgen.scene.scene import View
from physgen.text import counted

Groups = Sequence[tuple[Line, list[Foot]]]
Span = tuple[float, float]
Reach = Callable[[Line, Sequence[Foot]], Span | None]
"""Return the two ends of the floor under a group (columns), or None if unknown."""

FRICTION, ELASTICITY = 0.6, 0.4
GRIP = 1.25
"""Coefficient of friction divided by the slope of a resting object: at 1 it is about to
slip.
"""
ALIKE = 10.0
"""Largest CIE 1976 Lab distance between two strips of the same surface."""
FADED = 0.35
"""Largest contrast across the edge outside a floor's end, as a share of the contrast
inside.
"""
SURE_END = 6
"""Columns outside an end that must be visible."""
MOSTLY = 0.8
"""Least share of columns outside an end without the floor's surface."""
SHADE = 5.0
"""Largest ratio of luminances outside and inside that a shadow can explain."""
ROUNDING = 1e-3
"""Largest slope of a level foot."""


@dataclass(frozen=True)
class _RailLimits:
    """Limits of rails seen from above."""

    # Elasticity of a pool cushion: 0.6 to 0.9 (Mathavan et al. 2010).
    bounce: float = 0.75
    # Least contrast along most of a rail, CIE 1976 Lab.
    contrast: float = 3.0
    # px between an edge and the compared colours on both sides.
    apart: int = 3
    # Largest slope of a rail relative to the photo's side.
    askew: float = 0.04
    # Number of candidate slopes.
    slopes: int = 17
    # Number of columns with compared colours; more change nothing.
    columns: int = 256
    # Contrast relative to the sharpest edge from which an edge competes by its level.
    alike: float = 0.9
    # Width of the shadow of a rail on its table, as a share of the photo's longer side.
    shade: float = 0.015


@dataclass(frozen=True)
class _TopLimits:
    """Limits of visible box tops: strips of another shade along upper rims with
    converging sides.

    Lengths are shares of the box's height. Light is a logarithm. Printed strips do not
    become narrower upwards, and a lid's shade ends at its edge.
    """

    # px: least width of a box with a visible top, and a third of its least height.
    smallest: int = 12
    # Least height of a top.
    least: float = 0.02
    # Largest height of a top.
    most: float = 0.45
    # Ignored margin on either side, because edges are rounded, as a share of the width.
    inner: float = 0.2
    # Largest deviation of the upper rim and the front's sides from straight lines; at
    # least 1 px.
    straight: float = 0.01
    # Distance from an edge at which light is compared; at least 2 px.
    near: float = 0.02
    # Least change of light at the edge between top and front.
    step: float = 0.15
    # Largest spread of light on the top and on the front beside it, as a share of that
    # change.
    plain: float = 0.6
    # Largest difference between the changes of two colour channels.
    hue: float = 0.4
    # Least convergence of two tops. For more tops it is divided by the root of their
    # number; half of a top's own narrowing counts as well.
    close: float = 0.022
    # Linear light added before logarithms, so that dark levels become equal.
    dark: float = 0.003


RAIL, TOP = _RailLimits(), _TopLimits()


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
        view_guess, confidence, reason = view, 1.0, "as given"
    if view_guess is View.TOP or not len(objects):
        cushions = find_cushions(Photo(rgb, labels), objects)
        return BoundaryGuess(
            view_guess, confidence, reason, tuple(cushions), tilt=chances.tilt
        )
    supports = lay_floors(rgb, labels, objects)
    guess = BoundaryGuess(view_guess, confidence, reason, (), tilt=chances.tilt)
    return with_supports(guess, labels, supports)


def with_supports(
    guess: BoundaryGuess, labels: Labels, stood: SupportedObjects
) -> BoundaryGuess:
    """Return the guess with floors, and with supports for objects that would fall from
    them.
    """
    walls = [photo_bottom(labels), *stood.walls]
    walls, held_objects = add_supports(
        stood.objects, walls, stood.grip, FRICTION, ELASTICITY
    )
    return replace(
        guess,
        walls=tuple(walls),
        outlines=stood.outlines,
        held=held_objects,
        grip=stood.grip,
    )


def feet_groups(labels: Labels, objects: Sequence[PhotoObject]) -> Groups:
    """Return feet grouped by common lines, without objects that other objects carry."""
    feet = [
        find_foot(t)
        for t in objects
        if not t.cut and not is_carried(t, labels, objects)
    ]
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
    objects = [replace(t, outline=outlines.get(t.id, t.outline)) for t in objects]
    objects = middle_sections(rgb, labels, objects)
    outlines |= {t.id: t.outline for t in objects if t.top}
    groups = feet_groups(labels, objects)
    free = free_discs(objects)
    # Objects that do not fit the common line get lines of their own.
    groups = [part for line, group in groups for part in split_group(line, group, free)]
    for line, group in groups:
        outlines |= level_feet(line, group, free)
    objects = [replace(t, outline=outlines.get(t.id, t.outline)) for t in objects]
    # A box with a level foot gets a level rectangle.
    slanted_ids = {
        t.id for t in objects if t.id in outlines and abs(find_foot(t).slope) > ROUNDING
    }
    outlines |= {
        i: box for i, box in fit_rectangles(objects).items() if i not in slanted_ids
    }
    objects = [replace(t, outline=outlines.get(t.id, t.outline)) for t in objects]
    outlines |= flat_bases(objects, groups)
    objects = [replace(t, outline=outlines.get(t.id, t.outline)) for t in objects]
    # The later steps changed outlines, so the feet are found anew.
    current = {t.id: t for t in objects}
    groups = [
        (line, [find_foot(current[f.item.id]) for f in group]) for line, group in groups
    ]
    walls = _floors(
        Photo(rgb, labels), objects, groups, solid, 2 * line_tolerance(labels)
    )
    return SupportedObjects(objects, outlines, walls, _grip(objects, groups))


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
            others = [item.outline for item in objects if item.id != foot.item.id]
            if base and all(overlap_depth(base, other) == 0 for other in others):
                bases[foot.item.id] = base
    return bases


@dataclass(frozen=True)
class _Top:
    """A box with a visible top; lengths are shares of the box's height except
    `height`.
    """

    # The section half-way between front and back.
    section: Region
    # px from the front edge of the top to its rear edge.
    height: float
    # Column of the front edge's middle.
    middle: float
    # Distance by which the rear edge's middle lies to the right of it.
    shift: float
    # Difference between the lengths of the front and the rear edge.
    narrower: float


def middle_sections(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]
) -> list[PhotoObject]:
    """Return the objects, with middle sections as outlines of boxes with visible tops.

    Edges that recede from the camera converge. If they do not, the apparent tops may be
    printed.
    """
    level, touching = (
        np.log(decode(rgb) + np.float32(TOP.dark)),
        touching_objects(objects),
    )
    separate_objects = [
        t
        for t in objects
        if not (t.cut or isinstance(t.outline, Disc) or t.id in touching)
    ]
    tops = {
        t.id: top
        for t in separate_objects
        if (top := _seen_top(level, labels, t)) is not None
    }
    if not tops:
        return list(objects)
    middles, shifts, narrower = np.array(
        [(t.middle, t.shift, t.narrower) for t in tops.values()]
    ).T
    # Seen in perspective, the tops of a row shift towards a common vanishing point.
    slope = np.polyfit(middles, shifts, 1)[0] if np.ptp(middles) else 0.0
    row = -slope * np.ptp(middles) * (len(tops) / 2) ** 0.5
    if max(float(row), float(np.median(narrower)) / 2) < TOP.close:
        return list(objects)
    return [
        replace(t, outline=tops[t.id].section, top=tops[t.id].height)
        if t.id in tops
        else t
        for t in objects
    ]


def _seen_top(level: F32, labels: Labels, item: PhotoObject) -> _Top | None:
    """Return the visible top of an upright, rectangular mask, or None.

    A top is a strip of another shade along the upper rim. `level` (H, W, 3) is the
    logarithm of light.
    """
    x, y, last, low = (max(int(side), 0) for side in bounds(item.outline))
    mask = labels[y : low + 2, x : last + 2] == item.id
    x0, y0, width, height = np.add(
        cv2.boundingRect(mask.astype(np.uint8)), (x, y, 0, 0)
    ).tolist()
    lower, edge_margin = (
        slice(int(TOP.most * height), int(0.95 * height)),
        max(2, round(TOP.near * height)),
    )
    if min(width, height / 3) < TOP.smallest:
        return None
    box = np.s_[y0 : y0 + height, x0 : x0 + width]
    inside, light = labels[box] == item.id, level[box]
    # The sides of the front, measured in its lower part, must be straight lines.
    lefts, rights = inside.argmax(axis=1), width - inside[:, ::-1].argmax(axis=1)
    left, right = (float(np.median(side[lower])) for side in (lefts, rights))
    margin = TOP.inner * (right - left)
    inner = np.s_[:, int(left + margin) : int(right - margin) + 1]
    rims, feet = (
        inside[inner].argmax(axis=0),
        height - inside[::-1][inner].argmax(axis=0),
    )
    unevenness = max(
        np.ptp(np.percentile(line, (10, 90)))
        for line in (lefts[lower], rights[lower], rims, feet)
    )
    first, grey = int(np.median(rims)), light[inner].mean(axis=2)
    # The first rows of the mask are mixed with the background.
    rows = np.arange(first + edge_margin + 1, lower.start)
    if (
        unevenness > max(1, TOP.straight * height)
        or not len(rows)
        or not inside[inner][first + 1 : int(np.median(feet)) - 1].all()
    ):
        return None
    # The edge between top and front is the row with the largest change of light.
    steps = np.array(
        [
            grey[y + 1 : y + edge_margin].mean(axis=0)
            - grey[y - edge_margin : y - 1].mean(axis=0)
            for y in rows
        ]
    )
    usual = np.abs(np.median(steps, axis=1))
    edge, step = int(rows[usual.argmax()]), float(usual.max())
    # Both faces must be plain and of one hue, or the strip is a print.
    parts = (
        light[inner][first + 1 : edge - 1],
        light[inner][edge + edge_margin : 2 * (edge + edge_margin) - first],
    )
    spread = max(np.ptp(np.percentile(part.mean(axis=2), (10, 90))) for part in parts)
    hue = np.ptp(np.median(parts[1], axis=(0, 1)) - np.median(parts[0], axis=(0, 1)))
    if step < TOP.step or spread > TOP.plain * step or hue > TOP.hue:
        return None
    # Interpolate the edge's position within a pixel at half the change.
    profile = np.median(grey, axis=1)[edge - edge_margin : edge + edge_margin]
    rise = (profile - profile[: edge_margin - 1].mean()) / (
        profile[edge_margin + 1 :].mean() - profile[: edge_margin - 1].mean()
    )
    front = (
        edge
        - edge_margin
        + float(np.interp(0.5, np.maximum.accumulate(rise), np.arange(2 * edge_margin)))
    )
    top_height, front_rows = (
        front - first + 0.5,
        slice(edge, 2 * edge - first + 4 * edge_margin),
    )
    if top_height < max(3.0, TOP.least * height):
        return None
    # The sides of the top must converge towards the vanishing point.
    sums, widths = (
        ends[first:edge] - np.median(ends[front_rows])
        for ends in (lefts + rights, lefts - rights)
    )
    half_count = len(widths) // 2
    narrower = 2 * float(widths[:half_count].mean() - widths[half_count:].mean())
    xs, ys = (
        x0 + np.array([left, right]) - 0.5,
        y0 + np.array([front, np.median(feet) - 0.5]) - top_height / 2,
    )
    corners = np.array([(xs[k], ys[j]) for k, j in ((0, 0), (1, 0), (1, 1), (0, 1))])
    return _Top(
        Region((Ring(corners),)),
        top_height,
        *(np.array([xs.mean(), sums.mean(), narrower]) / height).tolist(),
    )


def _floors(
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
    lowest = {id(g): max(float(f.lowest[1]) for f in g[1]) for g in groups}
    groups = sorted(groups, key=lambda g: -lowest[id(g)])
    low = [
        g
        for g in groups
        if abs(g[0].slope) <= STEEP and lowest[id(g)] >= max(lowest.values()) - close
    ]
    ground = max(low, key=lambda g: len(g[1]))[1] if low else []
    walls: list[Wall] = []
    for line, group in groups:
        is_slope, is_ground = abs(line.slope) > STEEP, group is ground
        depth_span = solid(line, group) if solid else None
        source = "lowest points" if depth_span is None else "depth and lowest points"
        boxes = np.array([bounds(f.item.outline) for f in group])
        own_span = float(boxes[:, 0].min()), float(boxes[:, 2].max())
        visible_span = depth_span or photo.reach(line, group, is_ground)
        source = source if visible_span else SOURCE
        others = [t.outline for t in objects if all(t is not f.item for f in group)]
        chain = floor_points(line, group, visible_span or own_span)
        local_chain = floor_points(
            line, group, (2 * own_span[0] - own_span[1], 2 * own_span[1] - own_span[0])
        )
        # An object beside a ledge must not strike the ledge's end, so that such a ledge
        # is cut to its own width.
        if len(group) == 1 and not is_ground:
            middle = (own_span[0] + own_span[1]) / 2
            free_pieces = [
                part
                for part in free_parts(local_chain, others)
                if part[0][0] <= middle <= part[-1][0]
            ]
            blocked_ends = (
                sum(
                    part[k] != local_chain[k]
                    for part in free_pieces[:1]
                    for k in (0, -1)
                )
                if free_pieces
                else 2
            )

            if blocked_ends > (visible_span is not None):
                chain = floor_points(line, group, own_span)
        for part in free_parts(chain, others):
            feet = [
                f
                for f in group
                if part[0][0] <= f.right[0] and part[-1][0] >= f.left[0]
            ]
            if not feet:
                continue
            kind = "slope" if is_slope else "floor" if is_ground else "ledge"
            count = 1 + sum(w.name.split("-")[0] == kind for w in walls)
            name = kind if kind == "floor" and count == 1 else f"{kind}-{count}"
            friction = max(FRICTION, round(GRIP * abs(line.slope), 2))
            confidence = {1: 0.4, 2: 0.6}.get(len(feet), 0.8)
            reason = (
                "as steep as what its friction holds"
                if is_slope
                else f"under {counted(len(feet), 'object')}"
            )
            walls.append(
                Wall(
                    name, tuple(part), friction, ELASTICITY, confidence, source, reason
                )
            )
    return walls


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
        slope_objects = {
            k for k, t in enumerate(objects) if any(t is f.item for f in group)
        }
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


class Photo:
    """The colours of the background along lines."""

    def __init__(self, rgb: Rgb, labels: Labels) -> None:
        lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
        self.lab: F32 = np.asarray(lab, np.float32)
        self.labels = labels
        self.width = labels.shape[1]

    def strips(self, line: Line) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return Lab of each column (W, 3) in strips of 6 px below and above a line.

        Columns are NaN if objects or the border hide them.
        """
        columns = np.arange(self.width)
        level = np.round(line.slope * columns + line.height).astype(int)
        lower_strip, upper_strip = (self._strip(level + down) for down in (4, -10))
        return lower_strip, upper_strip

    def _strip(self, top: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the mean Lab (W, 3) of 6 rows below `top` (W,)."""
        height, width = self.labels.shape
        rows = top[None, :] + np.arange(6)[:, None]
        occlusion = (rows < 0) | (rows >= height)
        rows = np.clip(rows, 0, height - 1)
        occlusion = (
            occlusion | (self.labels[rows, np.arange(width)[None, :]] > 0)
        ).any(0)
        strip = np.asarray(
            self.lab[rows, np.arange(width)[None, :]].mean(0), np.float64
        )
        strip[occlusion] = np.nan
        return strip

    def reach(self, line: Line, group: Sequence[Foot], is_ground: bool) -> Span | None:
        """Return the two ends of the surface under a group, or None if the surface is
        hidden.

        The surface ends at a change of colour below its edge. The ground ends only if
        one surface fills both strips from there to the photo's side. A surface that
        reaches the photo's side continues outside it by the photo's width.
        """
        boxes = np.array([bounds(f.item.outline) for f in group])
        margin = 0.5 * float((boxes[:, 2] - boxes[:, 0]).max())
        first, last = float(boxes[:, 0].min()), float(boxes[:, 2].max())
        lower_strip, upper_strip = self.strips(line)
        span = slice(max(0, int(first - margin)), max(0, int(last + margin) + 2))
        steps = np.linalg.norm((lower_strip - upper_strip)[span], axis=1)
        is_visible = np.isfinite(steps).sum() >= 3
        floor_colour = np.nanmedian(lower_strip[span], 0) if is_visible else np.zeros(3)
        contrast = float(np.nanmedian(steps)) if is_visible else 0.0
        if not is_ground and contrast < ALIKE:
            return None
        # Without a visible end, the floor continues outside the photo.
        ends = [-float(self.width), 2.0 * self.width]
        is_uniform = np.linalg.norm(lower_strip - upper_strip, axis=1) < max(
            ALIKE, FADED * contrast
        )
        # Outside an object's own shadow the surface is lighter, with the same hue.
        lighter = _luminance(lower_strip) / _luminance(floor_colour)
        is_lighter = (
            (lighter > 1)
            & (lighter < SHADE)
            & (np.linalg.norm((lower_strip - floor_colour)[:, 1:], axis=1) < ALIKE)
        )
        height = float((boxes[:, 3] - boxes[:, 1]).max())
        inner = (
            min(float(f.left[0]) for f in group),
            max(float(f.right[0]) for f in group),
        )
        for k, (x, way) in enumerate(zip(inner, (-1, 1), strict=True)):
            columns = np.arange(
                round(np.clip(x, 0, self.width - 1)), -1 if way < 0 else self.width, way
            )
            columns = columns[np.isfinite(lower_strip[columns, 0]) & is_visible]
            is_different = (
                np.linalg.norm(lower_strip[columns] - floor_colour, axis=1)
                > 1.5 * ALIKE
            )
            shadow_end = is_different & is_lighter[columns]
            if shadow_end.any() and abs(columns[shadow_end.argmax()] - x) < height:
                is_different &= ~shadow_end
            # The end is the first column after which the surface no longer appears.
            for i in np.flatnonzero(is_different).tolist():
                remainder = (
                    is_different[i:] & is_uniform[columns[i:]]
                    if is_ground
                    else is_different[i : i + SURE_END]
                )
                if (
                    len(is_different) - i >= SURE_END
                    and is_different[i : i + SURE_END].all()
                    and remainder.mean() >= MOSTLY
                ):
                    ends[k] = float(columns[i]) - 0.5 * way
                    break
        return min(inner[0], ends[0]), max(inner[1], ends[1])


def _luminance(lab: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the relative luminance, 0.003..1, of CIE Lab `(..., 3)`."""
    return np.asarray(np.maximum((lab[..., 0] + 16) / 116, 0.14) ** 3)


def find_cushions(photo: Photo, objects: Sequence[PhotoObject]) -> list[Wall]:
    """Return the rails of a table seen from above.

    On each side the rail is the innermost straight edge outside all objects. There are
    none if fewer than two sides have an edge, because the table then continues outside
    the photo. Billiard balls always have rails: the photo's border replaces invisible
    ones.
    """
    if not objects:
        return []
    boxes = np.array([bounds(t.outline) for t in objects])
    height, width = photo.labels.shape
    free = (
        boxes[:, 1].min(),
        width - 1 - boxes[:, 2].max(),
        height - 1 - boxes[:, 3].max(),
        boxes[:, 0].min(),
    )
    rails = _find_rails(photo, free)
    if any("billiard" in t.label for t in objects):
        rails = [rail or (0.0, -0.5) for rail in rails]
    if sum(rail is not None for rail in rails) < 2:
        return []
    lines = []
    for turn, rail in enumerate(rails):
        slope, height_at_zero = rail or (0.0, -0.5)
        points = np.array([[0.0, height_at_zero], [1.0, height_at_zero + slope]])
        # rot90 turned the right side to the top; turn the points back.
        for back in range(turn, 0, -1):
            points = np.stack(
                [(height if back % 2 == 0 else width) - 1 - points[:, 1], points[:, 0]],
                1,
            )
        lines.append(points)
    corners = [_crossing(lines[k - 1], lines[k]) for k in range(4)]
    reason = "the table's rail"
    return [
        Wall(
            f"cushion-{k + 1}",
            (corners[k], corners[(k + 1) % 4]),
            0.2,
            RAIL.bounce,
            0.5,
            "edges",
            reason,
        )
        for k, rail in enumerate(rails)
        if rail is not None
    ]


def _find_rails(
    photo: Photo, free: Sequence[float]
) -> list[tuple[float, float] | None]:
    """Return slope and height of the rail on each side, turned to the top.

    A large photo is searched at reduced size.
    """
    size = working_size(photo.labels.shape)
    lab, scale = photo.lab, 1.0
    if size is not None:
        scale = max(photo.labels.shape) / max(size)
        lab = np.asarray(cv2.resize(lab, size, interpolation=cv2.INTER_AREA))
    rails: list[tuple[float, float] | None] = []
    for turn in range(4):
        rail = _rail(np.rot90(lab, turn), float(free[turn]) / scale)
        if rail is not None and scale > 1:
            slope, row = rail
            # Pixel centres lie at whole numbers, hence the offsets of one half.
            rail = slope, (row + 0.5 - 0.5 * slope) * scale - 0.5 + 0.5 * slope
        rails.append(rail)
    return rails


def _rail(lab: F32, free: float) -> tuple[float, float] | None:
    """Return slope, and height at x = 0, of the lowest straight edge above row `free`.

    The edge runs along the photo's top. Returns None if there is no edge.
    """
    height, width = lab.shape[:2]
    columns = np.arange(width // 5, width - width // 5, max(1, width // RAIL.columns))
    distance = RAIL.apart
    rows = np.arange(2 * distance, int(min(free, height / 2)) - distance)
    if len(rows) < 3:
        return None
    smooth_lab = cv2.blur(np.ascontiguousarray(lab), (1, distance))
    edges: list[tuple[float, float, float]] = []
    for slope in np.linspace(-RAIL.askew, RAIL.askew, RAIL.slopes):
        row_indices = rows[:, None] + np.rint(slope * (columns - width / 2)).astype(int)
        upper_colours, lower_colours = (
            smooth_lab[np.clip(row_indices + offset, 0, height - 1), columns]
            for offset in (-distance, distance)
        )
        change = lower_colours - upper_colours
        # Project the change of colour at each column on its median direction.
        way = np.median(change, axis=1)
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-6)
        # Most of the length of an edge must have the contrast.
        step = np.percentile(
            np.einsum("rcl,rl->rc", change, way), 100 * (1 - MOSTLY), axis=1
        )
        peaks = (step[1:-1] >= np.maximum(step[:-2], step[2:])) & (
            step[1:-1] >= RAIL.contrast
        )
        edges += [
            (float(step[k]), float(slope), float(rows[k]))
            for k in np.flatnonzero(peaks) + 1
        ]
    if not edges:
        return None
    # Among the innermost edges, prefer the most level of the sharp ones.
    innermost = max(row for _, _, row in edges)
    edges = [
        edge for edge in edges if edge[2] >= innermost - RAIL.shade * max(height, width)
    ]
    sharpest = max(edges)[0]
    _, slope, row = min(
        (e for e in edges if e[0] >= RAIL.alike * sharpest),
        key=lambda e: (abs(e[1]), -e[0]),
    )
    return slope, row - slope * width / 2


def _crossing(one: Array, other: Array) -> tuple[float, float]:
    """Return the crossing of two lines, each through two points (2, 2)."""
    (p, q), (a, b) = one, other
    share = cross(a - p, b - a) / cross(q - p, b - a)
    x, y = p + share * (q - p)
    return round(float(x), 2), round(float(y), 2)
