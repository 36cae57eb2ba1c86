"""Backend boundary=support: view, floors and rails from what the objects rest on.

From the side, objects stand on each other or on common lines, and the surface above
them mostly differs from the one below. From above, the same surface is on all sides of
objects, and no line explains where they lie.
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
"""From where to where the floor under a group reaches; None: unknown."""

FRICTION, ELASTICITY = 0.6, 0.4
# coefficient of friction over the slope that objects lie still on: at 1 they are about
# to slip
GRIP = 1.25
ALIKE = 10.0  # CIE 1976 Lab distance up to which two strips are the same surface
FADED = 0.35  # of the contrast across its edge within, at most, beyond a floor's end
SURE_END = 6  # columns beyond an end that must be seen
MOSTLY = 0.8  # of the columns beyond an end that are no longer the surface
# ratio of luminances beyond and within, up to which the darker one may be a shadow
SHADE = 5.0
ROUNDING = 1e-3  # slope of a foot below which it is level


@dataclass(frozen=True)
class _RailLimits:
    """Rails seen from above."""

    # elasticity: a pool cushion's 0.6 to 0.9 (Mathavan et al. 2010)
    bounce: float = 0.75
    contrast: float = 3.0  # CIE 1976 Lab, that most of its length has
    apart: int = 3  # px from an edge, on both sides, where colours are compared
    askew: float = 0.04  # slope up to which a rail is along the photo's side
    slopes: int = 17  # tried
    # evenly spread, in which colours are compared: more changes nothing
    columns: int = 256
    alike: float = 0.9  # of the sharpest edge, from which the most level one is taken
    # of the photo's longer side: width of the shadow that a rail casts on its table
    shade: float = 0.015


@dataclass(frozen=True)
class _TopLimits:
    """Which boxes show their tops: strips of another shade along upper rims, whose
    sides run together; as parts of the height of the box.

    Light is its logarithm. Prints are as wide above as below, lids above as far as
    their edge.
    """

    # px, width of a box whose top can be seen, and a third of its height
    smallest: int = 12
    least: float = 0.02  # height of a top
    most: float = 0.45
    inner: float = 0.2  # of the width, on either side, where edges are rounded
    # and 1 px at least, off straight lines, of the upper rim and the sides of the front
    straight: float = 0.01
    near: float = 0.02  # and 2 px at least, from an edge to where light is compared
    step: float = 0.15  # of light at the edge between top and front
    # of the step: spread of light on the top, and on the front beside it
    plain: float = 0.6
    hue: float = 0.4  # by which one colour may change more than another
    # by which the tops of two run together, of more by the root of their number less, or half of what one narrows by
    close: float = 0.022
    dark: float = 0.003  # of linear light, below which levels are alike


RAIL, TOP = _RailLimits(), _TopLimits()


def support() -> Boundary:
    """Return the backend `support`."""
    return _support


def _support(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject], view: View | None
) -> BoundaryGuess:
    chances = view_chances(run_network(rgb).features)
    if view is None:
        alone, upright = view_evidence(objects, feet_groups(labels, objects))
        found, sure, reason = guess_view(
            rgb, labels, run_network(rgb).normals, alone, upright, chances
        )
    else:
        found, sure, reason = view, 1.0, "as given"
    if found is View.TOP or not len(objects):
        cushions = find_cushions(Photo(rgb, labels), objects)
        return BoundaryGuess(found, sure, reason, tuple(cushions), tilt=chances.tilt)
    stood = lay_floors(rgb, labels, objects)
    guess = BoundaryGuess(found, sure, reason, (), tilt=chances.tilt)
    return with_supports(guess, labels, stood)


def with_supports(
    guess: BoundaryGuess, labels: Labels, stood: SupportedObjects
) -> BoundaryGuess:
    """Return the guess with floors, and with supports of what would fall from them."""
    walls = [photo_bottom(labels), *stood.walls]
    walls, held = add_supports(stood.objects, walls, stood.grip, FRICTION, ELASTICITY)
    return replace(
        guess,
        walls=tuple(walls),
        outlines=stood.outlines,
        held=held,
        grip=stood.grip,
    )


def feet_groups(labels: Labels, objects: Sequence[PhotoObject]) -> Groups:
    """Feet on common lines, of all objects that no other objects carry."""
    feet = [
        find_foot(t)
        for t in objects
        if not t.cut and not is_carried(t, labels, objects)
    ]
    return group_feet(feet, line_tolerance(labels))


def line_tolerance(labels: Labels) -> float:
    """px by which feet on one line may be off it."""
    return max(2.5, 0.012 * float(labels.shape[0]))


def view_evidence(objects: Sequence[PhotoObject], groups: Groups) -> tuple[int, int]:
    """Return the number of objects that share their line with none, and of those that
    stand upright.
    """
    count = sum(len(group) for _, group in groups)
    alone = sum(len(group) for _, group in groups if len(group) == 1 and count > 1)
    return alone, sum(stands_flat(find_foot(t)) for t in objects if not t.cut)


@dataclass(frozen=True)
class SupportedObjects:
    """Objects as they stand on the floors laid under them, seen from the side."""

    objects: Sequence[PhotoObject]
    outlines: Mapping[int, Outline]  # of those that stand better than their masks show
    walls: Sequence[Wall]
    grip: dict[int, float]  # least friction, by id


def lay_floors(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject], solid: Reach | None = None
) -> SupportedObjects:
    """Objects with level feet, and floors that touch them; `solid` tells their ends
    from depth where it can.
    """
    outlines = close_gaps_below(labels, objects)
    objects = [replace(t, outline=outlines.get(t.id, t.outline)) for t in objects]
    objects = middle_sections(rgb, labels, objects)
    outlines |= {t.id: t.outline for t in objects if t.top}
    groups = feet_groups(labels, objects)
    free = free_discs(objects)
    groups = [part for line, group in groups for part in split_group(line, group, free)]
    for line, group in groups:
        outlines |= level_feet(line, group, free)
    objects = [replace(t, outline=outlines.get(t.id, t.outline)) for t in objects]
    # a box stands level
    askew = {
        t.id for t in objects if t.id in outlines and abs(find_foot(t).slope) > ROUNDING
    }
    outlines |= {i: box for i, box in fit_rectangles(objects).items() if i not in askew}
    objects = [replace(t, outline=outlines.get(t.id, t.outline)) for t in objects]
    outlines |= flat_bases(objects, groups)
    objects = [replace(t, outline=outlines.get(t.id, t.outline)) for t in objects]
    now = {t.id: t for t in objects}
    groups = [
        (line, [find_foot(now[f.item.id]) for f in group]) for line, group in groups
    ]
    walls = _floors(
        Photo(rgb, labels), objects, groups, solid, 2 * line_tolerance(labels)
    )
    return SupportedObjects(objects, outlines, walls, _grip(objects, groups))


def flat_bases(objects: Sequence[PhotoObject], groups: Groups) -> dict[int, Outline]:
    """Return outlines with flat bases, by id, of objects that would tip over their
    feet.

    Only objects that touch no others get one: others may lean or lie on something.
    """
    touching = touching_objects(objects)
    now = {item.id: item for item in objects}
    bases: dict[int, Outline] = {}
    for line, group in groups:
        for foot in group:
            foot = find_foot(now[foot.item.id])
            is_alone = foot.item.id not in touching
            if not is_alone or abs(line.slope) > STEEP or not needs_base(foot):
                continue
            base = add_base(foot, line)
            others = [item.outline for item in objects if item.id != foot.item.id]
            if base and all(overlap_depth(base, other) == 0 for other in others):
                bases[foot.item.id] = base
    return bases


@dataclass(frozen=True)
class _Top:
    """A box whose top is seen; parts of the height of the box, but for `height`."""

    section: Region  # half-way from front to back
    height: float  # px, from the front edge of its top up to the rear edge
    middle: float  # column, of its front edge
    shift: float  # by which the middle of the rear edge lies to the right of that
    narrower: float  # by which the rear edge is shorter


def middle_sections(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]
) -> list[PhotoObject]:
    """Return the objects, boxes whose tops are seen with the section half-way from
    front to back as outline.

    Edges that lead away from the camera run together. Where they do not, what looks
    like tops may be printed.
    """
    level, touching = (
        np.log(decode(rgb) + np.float32(TOP.dark)),
        touching_objects(objects),
    )
    apart = [
        t
        for t in objects
        if not (t.cut or isinstance(t.outline, Disc) or t.id in touching)
    ]
    tops = {
        t.id: top for t in apart if (top := _seen_top(level, labels, t)) is not None
    }
    if not tops:
        return list(objects)
    middles, shifts, narrower = np.array(
        [(t.middle, t.shift, t.narrower) for t in tops.values()]
    ).T
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
    """Return the strip of another shade along the upper rim of a mask that else is an
    upright rectangle.

    `level` (H, W, 3) is the logarithm of light.
    """
    x, y, last, low = (max(int(side), 0) for side in bounds(item.outline))
    mask = labels[y : low + 2, x : last + 2] == item.id
    x0, y0, width, height = np.add(
        cv2.boundingRect(mask.astype(np.uint8)), (x, y, 0, 0)
    ).tolist()
    lower, near = (
        slice(int(TOP.most * height), int(0.95 * height)),
        max(2, round(TOP.near * height)),
    )
    if min(width, height / 3) < TOP.smallest:
        return None
    here = np.s_[y0 : y0 + height, x0 : x0 + width]
    own, light = labels[here] == item.id, level[here]
    lefts, rights = own.argmax(axis=1), width - own[:, ::-1].argmax(axis=1)
    left, right = (float(np.median(side[lower])) for side in (lefts, rights))
    off = TOP.inner * (right - left)
    inner = np.s_[:, int(left + off) : int(right - off) + 1]
    rims, feet = own[inner].argmax(axis=0), height - own[::-1][inner].argmax(axis=0)
    bent = max(
        np.ptp(np.percentile(line, (10, 90)))
        for line in (lefts[lower], rights[lower], rims, feet)
    )
    first, grey = int(np.median(rims)), light[inner].mean(axis=2)
    # the rim is mixed with what is behind
    rows = np.arange(first + near + 1, lower.start)
    if (
        bent > max(1, TOP.straight * height)
        or not len(rows)
        or not own[inner][first + 1 : int(np.median(feet)) - 1].all()
    ):
        return None
    steps = np.array(
        [
            grey[y + 1 : y + near].mean(axis=0) - grey[y - near : y - 1].mean(axis=0)
            for y in rows
        ]
    )
    usual = np.abs(np.median(steps, axis=1))
    edge, step = int(rows[usual.argmax()]), float(usual.max())
    parts = (
        light[inner][first + 1 : edge - 1],
        light[inner][edge + near : 2 * (edge + near) - first],
    )
    spread = max(np.ptp(np.percentile(part.mean(axis=2), (10, 90))) for part in parts)
    hue = np.ptp(np.median(parts[1], axis=(0, 1)) - np.median(parts[0], axis=(0, 1)))
    if step < TOP.step or spread > TOP.plain * step or hue > TOP.hue:
        return None
    profile = np.median(grey, axis=1)[edge - near : edge + near]
    rise = (profile - profile[: near - 1].mean()) / (
        profile[near + 1 :].mean() - profile[: near - 1].mean()
    )
    front = (
        edge
        - near
        + float(np.interp(0.5, np.maximum.accumulate(rise), np.arange(2 * near)))
    )
    up, below = front - first + 0.5, slice(edge, 2 * edge - first + 4 * near)
    if up < max(3.0, TOP.least * height):
        return None
    sums, widths = (
        all_[first:edge] - np.median(all_[below])
        for all_ in (lefts + rights, lefts - rights)
    )
    half = len(widths) // 2
    narrower = 2 * float(widths[:half].mean() - widths[half:].mean())
    xs, ys = (
        x0 + np.array([left, right]) - 0.5,
        y0 + np.array([front, np.median(feet) - 0.5]) - up / 2,
    )
    corners = np.array([(xs[k], ys[j]) for k, j in ((0, 0), (1, 0), (1, 1), (0, 1))])
    return _Top(
        Region((Ring(corners),)),
        up,
        *(np.array([xs.mean(), sums.mean(), narrower]) / height).tolist(),
    )


def _floors(
    photo: Photo,
    objects: Sequence[PhotoObject],
    groups: Groups,
    solid: Reach | None,
    close: float,
) -> list[Wall]:
    """Under every group of feet a wall, in pieces where it would enter an object.

    The floor is under the lowest group, or a larger one that is lower than `close` px
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
        sloped, is_ground = abs(line.slope) > STEEP, group is ground
        deep = solid(line, group) if solid else None
        source = "lowest points" if deep is None else "depth and lowest points"
        boxes = np.array([bounds(f.item.outline) for f in group])
        own = float(boxes[:, 0].min()), float(boxes[:, 2].max())
        seen = deep or photo.reach(line, group, is_ground)
        source = source if seen else SOURCE
        others = [t.outline for t in objects if all(t is not f.item for f in group)]
        chain = floor_points(line, group, seen or own)
        near = floor_points(line, group, (2 * own[0] - own[1], 2 * own[1] - own[0]))
        if len(group) == 1 and not is_ground:
            middle = (own[0] + own[1]) / 2
            kept = [
                part
                for part in free_parts(near, others)
                if part[0][0] <= middle <= part[-1][0]
            ]
            met = (
                sum(part[k] != near[k] for part in kept[:1] for k in (0, -1))
                if kept
                else 2
            )
            if met > (
                seen is not None
            ):  # what is beside it, or on both sides, does not strike the ledge's end
                chain = floor_points(line, group, own)
        for part in free_parts(chain, others):
            on = [
                f
                for f in group
                if part[0][0] <= f.right[0] and part[-1][0] >= f.left[0]
            ]
            if not on:
                continue
            kind = "slope" if sloped else "floor" if is_ground else "ledge"
            count = 1 + sum(w.name.split("-")[0] == kind for w in walls)
            name = kind if kind == "floor" and count == 1 else f"{kind}-{count}"
            friction = max(FRICTION, round(GRIP * abs(line.slope), 2))
            sure = {1: 0.4, 2: 0.6}.get(len(on), 0.8)
            why = (
                "as steep as what its friction holds"
                if sloped
                else f"under {counted(len(on), 'object')}"
            )
            walls.append(
                Wall(name, tuple(part), friction, ELASTICITY, sure, source, why)
            )
    return walls


def _grip(objects: Sequence[PhotoObject], groups: Groups) -> dict[int, float]:
    """Return the least friction of objects on a slope, and of all that lean or lie on
    them there.
    """
    pairs = {(c.body, c.other) for c in contacts([t.outline for t in objects], [])}
    grip: dict[int, float] = {}
    for line, group in groups:
        steepest = max([abs(line.slope), *(abs(f.slope) for f in group)])
        if steepest <= STEEP:
            continue
        reached = {k for k, t in enumerate(objects) if any(t is f.item for f in group)}
        for _ in objects:
            reached |= {k for pair in pairs if reached & set(pair) for k in pair}
        for k in reached:
            grip[objects[k].id] = max(
                grip.get(objects[k].id, 0.0), round(GRIP * steepest, 2)
            )
    return grip


def photo_bottom(labels: Labels) -> Wall:
    """Return the photo's bottom, and as far again to both sides; sides and top are
    open.
    """
    height, width = labels.shape
    points = ((-float(width), height - 0.5), (2.0 * width, height - 0.5))
    reason = "the photo's; sides and top are open"
    return Wall("bottom", points, FRICTION, ELASTICITY, 1.0, "photo", reason)


class Photo:
    """Colours of the background along lines."""

    def __init__(self, rgb: Rgb, labels: Labels) -> None:
        lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
        self.lab: F32 = np.asarray(lab, np.float32)
        self.labels = labels
        self.width = labels.shape[1]

    def strips(self, line: Line) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lab of each column `(W, 3)` below and above a line, 6 px high; NaN where
        objects or the border hide it.
        """
        columns = np.arange(self.width)
        level = np.round(line.slope * columns + line.height).astype(int)
        below, above = (self._strip(level + down) for down in (4, -10))
        return below, above

    def _strip(self, top: NDArray[np.int64]) -> NDArray[np.float64]:
        height, width = self.labels.shape
        rows = top[None, :] + np.arange(6)[:, None]
        hidden = (rows < 0) | (rows >= height)
        rows = np.clip(rows, 0, height - 1)
        hidden = (hidden | (self.labels[rows, np.arange(width)[None, :]] > 0)).any(0)
        strip = np.asarray(
            self.lab[rows, np.arange(width)[None, :]].mean(0), np.float64
        )
        strip[hidden] = np.nan
        return strip

    def reach(self, line: Line, group: Sequence[Foot], is_ground: bool) -> Span | None:
        """From where to where the surface under a group reaches; None where none is
        seen.

        It ends where the colour below its edge does. The ground ends only where one
        surface is above and below from there to the photo's side. What goes on at the
        photo's side goes on beyond it by the photo's width.
        """
        boxes = np.array([bounds(f.item.outline) for f in group])
        margin = 0.5 * float((boxes[:, 2] - boxes[:, 0]).max())
        first, last = float(boxes[:, 0].min()), float(boxes[:, 2].max())
        below, above = self.strips(line)
        there = slice(max(0, int(first - margin)), max(0, int(last + margin) + 2))
        steps = np.linalg.norm((below - above)[there], axis=1)
        seen = np.isfinite(steps).sum() >= 3
        under = np.nanmedian(below[there], 0) if seen else np.zeros(3)
        contrast = float(np.nanmedian(steps)) if seen else 0.0
        if not is_ground and contrast < ALIKE:
            return None
        ends = [-float(self.width), 2.0 * self.width]
        one = np.linalg.norm(below - above, axis=1) < max(ALIKE, FADED * contrast)
        # beyond an object's own shadow the surface is lighter, and of the same hue
        lighter = _luminance(below) / _luminance(under)
        shaded = (
            (lighter > 1)
            & (lighter < SHADE)
            & (np.linalg.norm((below - under)[:, 1:], axis=1) < ALIKE)
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
            columns = columns[np.isfinite(below[columns, 0]) & seen]
            gone = np.linalg.norm(below[columns] - under, axis=1) > 1.5 * ALIKE
            lit = gone & shaded[columns]
            if lit.any() and abs(columns[lit.argmax()] - x) < height:
                gone &= ~lit
            for i in np.flatnonzero(gone).tolist():
                beyond = (
                    gone[i:] & one[columns[i:]] if is_ground else gone[i : i + SURE_END]
                )
                if (
                    len(gone) - i >= SURE_END
                    and gone[i : i + SURE_END].all()
                    and beyond.mean() >= MOSTLY
                ):
                    ends[k] = float(columns[i]) - 0.5 * way
                    break
        return min(inner[0], ends[0]), max(inner[1], ends[1])


def _luminance(lab: NDArray[np.float64]) -> NDArray[np.float64]:
    """Relative luminance, 0..1, of CIE Lab `(..., 3)`; at least 0.003."""
    return np.asarray(np.maximum((lab[..., 0] + 16) / 116, 0.14) ** 3)


def find_cushions(photo: Photo, objects: Sequence[PhotoObject]) -> list[Wall]:
    """Rails of a table seen from above: on each side the innermost straight edge beyond
    all objects.

    None where fewer than two sides have one: the table goes on beyond the photo.
    Billiard balls have rails: where none is seen, the photo's border takes its place.
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
    found = _find_rails(photo, free)
    if any("billiard" in t.label for t in objects):
        found = [rail or (0.0, -0.5) for rail in found]
    if sum(rail is not None for rail in found) < 2:
        return []
    lines = []
    for turn, rail in enumerate(found):
        slope, at = rail or (0.0, -0.5)
        points = np.array([[0.0, at], [1.0, at + slope]])
        for back in range(turn, 0, -1):  # rot90 takes the right side to the top
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
        for k, rail in enumerate(found)
        if rail is not None
    ]


def _find_rails(
    photo: Photo, free: Sequence[float]
) -> list[tuple[float, float] | None]:
    """Slope and height of the rail on each side, turned to the top.

    Those of a large photo are found at reduced size.
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
            # centres of pixels lie at whole numbers
            rail = slope, (row + 0.5 - 0.5 * slope) * scale - 0.5 + 0.5 * slope
        rails.append(rail)
    return rails


def _rail(lab: F32, free: float) -> tuple[float, float] | None:
    """Slope, and height at x = 0, of the lowest straight edge along the photo's top
    above row `free`; None: no edge.
    """
    height, width = lab.shape[:2]
    across = np.arange(width // 5, width - width // 5, max(1, width // RAIL.columns))
    apart = RAIL.apart
    rows = np.arange(2 * apart, int(min(free, height / 2)) - apart)
    if len(rows) < 3:
        return None
    smooth = cv2.blur(np.ascontiguousarray(lab), (1, apart))
    edges: list[tuple[float, float, float]] = []
    for slope in np.linspace(-RAIL.askew, RAIL.askew, RAIL.slopes):
        at = rows[:, None] + np.rint(slope * (across - width / 2)).astype(int)
        above, below = (
            smooth[np.clip(at + off, 0, height - 1), across] for off in (-apart, apart)
        )
        change = below - above
        way = np.median(change, axis=1)
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-6)
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
    """Where two lines, each through two points (2, 2), cross."""
    (p, q), (a, b) = one, other
    share = cross(a - p, b - a) / cross(q - p, b - a)
    x, y = p + share * (q - p)
    return round(float(x), 2), round(float(y), 2)
