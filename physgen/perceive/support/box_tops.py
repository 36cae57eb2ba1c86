"""Visible tops of boxes: strips of another shade along upper rims with converging
sides.

The outline of such a box becomes its middle section, half-way between front and back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Disc, Region, Ring, bounds
from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, PhotoObject, Rgb
from physgen.perceive.support.box_outlines import touching_objects
from physgen.photometry import decode


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
    least_height: float = 0.02
    # px: least height of a top.
    least_rows: float = 3.0
    # Largest height of a top.
    largest_height: float = 0.45
    # Lower end of the rows at which the front is measured.
    front_end: float = 0.95
    # Ignored margin on either side, because edges are rounded, as a share of the width.
    inner: float = 0.2
    # Largest deviation of the upper rim and the front's sides from straight lines; at
    # least 1 px.
    deviation: float = 0.01
    # Distance from an edge at which light is compared; at least 2 px.
    edge_distance: float = 0.02
    # Least change of light at the edge between top and front.
    step: float = 0.15
    # Largest spread of light on the top and on the front beside it, as a share of that
    # change.
    spread: float = 0.6
    # Largest difference between the changes of two colour channels.
    hue: float = 0.4
    # Least convergence of two tops. For more tops it is divided by the root of their
    # number; half of a top's own narrowing counts as well.
    close: float = 0.022
    # Linear light added before logarithms, so that dark levels become equal.
    dark_level: float = 0.003


TOP = _TopLimits()


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
    narrowing: float


def middle_sections(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]
) -> list[PhotoObject]:
    """Return the objects, with middle sections as outlines of boxes with visible tops.

    Edges that recede from the camera converge. If they do not, the apparent tops may be
    printed.
    """
    tops = _find_tops(rgb, labels, objects)
    if not tops or _measure_convergence(list(tops.values())) < TOP.close:
        return list(objects)
    sections = []
    for t in objects:
        sections.append(
            replace(t, outline=tops[t.id].section, top=tops[t.id].height)
            if t.id in tops
            else t
        )
    return sections


def _find_tops(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]
) -> dict[int, _Top]:
    """Return the visible tops, by id, of objects that touch no other object."""
    light = np.log(decode(rgb) + np.float32(TOP.dark_level))
    touching = touching_objects(objects)
    tops: dict[int, _Top] = {}
    for item in objects:
        if item.cut or isinstance(item.outline, Disc) or item.id in touching:
            continue
        top = _find_top(light, labels, item)
        if top is not None:
            tops[item.id] = top
    return tops


def _measure_convergence(tops: Sequence[_Top]) -> float:
    """Return the convergence of the receding edges of tops."""
    middles, shifts, narrowings = np.array(
        [(t.middle, t.shift, t.narrowing) for t in tops]
    ).T
    # Seen in perspective, the tops of a row shift towards a common vanishing point.
    if np.ptp(middles):
        slope = np.polyfit(middles, shifts, 1)[0]
    else:
        slope = 0.0
    row = -slope * np.ptp(middles) * (len(tops) / 2) ** 0.5
    return max(float(row), float(np.median(narrowings)) / 2)


@dataclass(frozen=True, eq=False)
class _BoxView:
    """The mask of a box and its light, in the bounding rectangle of the mask; px."""

    # Column and row in the photo of the first pixel.
    corner: tuple[int, int]
    mask: Mask  # (h, w)
    light: F32  # (h, w, 3): logarithms

    @property
    def height(self) -> int:
        """Return the number of rows."""
        return len(self.mask)

    @property
    def edge_margin(self) -> int:
        """Return the distance from an edge at which light is compared."""
        return max(2, round(TOP.edge_distance * self.height))

    @property
    def lower_rows(self) -> slice:
        """Return the rows that show only the front."""
        start = int(TOP.largest_height * self.height)
        return slice(start, int(TOP.front_end * self.height))

    @cached_property
    def left_ends(self) -> NDArray[np.intp]:
        """Return the first column (h,) of the mask in each row."""
        return np.asarray(self.mask.argmax(axis=1))

    @cached_property
    def right_ends(self) -> NDArray[np.intp]:
        """Return the column (h,) after the last one of the mask in each row."""
        return np.asarray(self.mask.shape[1] - self.mask[:, ::-1].argmax(axis=1))

    @cached_property
    def sides(self) -> tuple[float, float]:
        """Return the columns of the left and the right side of the front."""
        left = np.median(self.left_ends[self.lower_rows])
        right = np.median(self.right_ends[self.lower_rows])
        return float(left), float(right)

    @cached_property
    def inner_columns(self) -> slice:
        """Return the columns without the rounded edges of the box."""
        left, right = self.sides
        margin = TOP.inner * (right - left)
        return slice(int(left + margin), int(right - margin) + 1)

    @cached_property
    def inner_mask(self) -> Mask:
        """Return the mask (h, n) in the inner columns."""
        return self.mask[:, self.inner_columns]

    @cached_property
    def inner_light(self) -> F32:
        """Return the light (h, n, 3) in the inner columns."""
        return self.light[:, self.inner_columns]

    @cached_property
    def grey(self) -> F32:
        """Return the mean (h, n) of the channels of the light in the inner columns."""
        return np.asarray(self.inner_light.mean(axis=2))

    @cached_property
    def rims(self) -> NDArray[np.intp]:
        """Return the first row (n,) of the mask in each inner column."""
        return np.asarray(self.inner_mask.argmax(axis=0))

    @cached_property
    def feet(self) -> NDArray[np.intp]:
        """Return the row (n,) after the last one of the mask in each inner column."""
        reversed_mask = self.mask[::-1][:, self.inner_columns]
        return np.asarray(self.height - reversed_mask.argmax(axis=0))

    @property
    def rim(self) -> int:
        """Return the row of the upper rim."""
        return int(np.median(self.rims))

    @property
    def foot(self) -> float:
        """Return the row below the box."""
        return float(np.median(self.feet))


def _find_top(light: F32, labels: Labels, item: PhotoObject) -> _Top | None:
    """Return the visible top of an upright, rectangular mask, or None.

    A top is a strip of another shade along the upper rim. `light` (H, W, 3) holds
    logarithms.
    """
    box = _crop_box(light, labels, item)
    if min(box.mask.shape[1], box.height / 3) < TOP.smallest:
        return None
    # The first rows of the mask are mixed with the background.
    rows = np.arange(box.rim + box.edge_margin + 1, box.lower_rows.start)
    if not len(rows) or not _is_rectangular(box):
        return None
    edge, step = _find_front_edge(box, rows)
    if step < TOP.step or not _has_plain_faces(box, edge, step):
        return None
    front = _interpolate_edge(box, edge)
    height = front - box.rim + 0.5
    if height < max(TOP.least_rows, TOP.least_height * box.height):
        return None
    return _build_top(box, edge, front)


def _crop_box(light: F32, labels: Labels, item: PhotoObject) -> _BoxView:
    """Return the mask of an object and its light in its bounding rectangle."""
    x, y, last, low = (max(int(side), 0) for side in bounds(item.outline))
    mask = labels[y : low + 2, x : last + 2] == item.id
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    x0 = x + left
    y0 = y + top
    window = np.s_[y0 : y0 + height, x0 : x0 + width]
    return _BoxView((x0, y0), labels[window] == item.id, light[window])


def _is_rectangular(box: _BoxView) -> bool:
    """Return whether the sides of a mask are straight and no hole is inside it."""
    # The sides of the front are measured in its lower part.
    lower_rows = box.lower_rows
    borders = (
        box.left_ends[lower_rows],
        box.right_ends[lower_rows],
        box.rims,
        box.feet,
    )
    deviation = max(np.ptp(np.percentile(border, (10, 90))) for border in borders)
    if deviation > max(1, TOP.deviation * box.height):
        return False
    return bool(box.inner_mask[box.rim + 1 : int(box.foot) - 1].all())


def _find_front_edge(
    box: _BoxView, rows: NDArray[np.signedinteger]
) -> tuple[int, float]:
    """Return the row with the largest change of light, and that change.

    The row is the edge between top and front.
    """
    grey = box.grey
    margin = box.edge_margin
    steps = np.array(
        [
            grey[y + 1 : y + margin].mean(axis=0)
            - grey[y - margin : y - 1].mean(axis=0)
            for y in rows
        ]
    )
    typical_steps = np.abs(np.median(steps, axis=1))
    return int(rows[typical_steps.argmax()]), float(typical_steps.max())


def _has_plain_faces(box: _BoxView, edge: int, step: float) -> bool:
    """Return whether top and front are plain and of one hue; otherwise the strip is a
    print.
    """
    light = box.inner_light
    rim = box.rim
    margin = box.edge_margin
    top = light[rim + 1 : edge - 1]
    front = light[edge + margin : 2 * (edge + margin) - rim]
    spread = max(
        np.ptp(np.percentile(face.mean(axis=2), (10, 90))) for face in (top, front)
    )
    hue = np.ptp(np.median(front, axis=(0, 1)) - np.median(top, axis=(0, 1)))
    return bool(spread <= TOP.spread * step and hue <= TOP.hue)


def _interpolate_edge(box: _BoxView, edge: int) -> float:
    """Return the edge's position within a pixel, at half the change of light."""
    margin = box.edge_margin
    profile = np.median(box.grey, axis=1)[edge - margin : edge + margin]
    top_light = profile[: margin - 1].mean()
    front_light = profile[margin + 1 :].mean()
    rise = (profile - top_light) / (front_light - top_light)
    rows = np.arange(2 * margin)
    return edge - margin + float(np.interp(0.5, np.maximum.accumulate(rise), rows))


def _build_top(box: _BoxView, edge: int, front: float) -> _Top:
    """Return the top between the upper rim and the edge at row `front`."""
    height = front - box.rim + 0.5
    # The sides of the top must converge towards the vanishing point.
    front_rows = slice(edge, 2 * edge - box.rim + 4 * box.edge_margin)

    def difference_from_front(values: NDArray[np.integer]) -> NDArray[np.float64]:
        top_values = values[box.rim : edge]
        return np.asarray(top_values - np.median(values[front_rows]))

    shifts = difference_from_front(box.left_ends + box.right_ends)
    widths = difference_from_front(box.left_ends - box.right_ends)
    middle_row = len(widths) // 2
    narrowing = 2 * float(widths[:middle_row].mean() - widths[middle_row:].mean())
    x0, y0 = box.corner
    xs = x0 + np.array(box.sides) - 0.5
    ys = y0 + np.array([front, box.foot - 0.5]) - height / 2
    corners = np.array([(xs[k], ys[j]) for k, j in ((0, 0), (1, 0), (1, 1), (0, 1))])
    shares = np.array([xs.mean(), shifts.mean(), narrowing]) / box.height
    return _Top(Region((Ring(corners),)), height, *shares.tolist())
