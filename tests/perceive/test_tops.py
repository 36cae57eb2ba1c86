"""Tops of boxes, in photos that a pinhole camera takes of boxes on a table."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen.geometry.polygon import bounds
from physgen.perceive.backends.boundary_support import support
from physgen.perceive.photo_objects import fit_objects
from physgen.perceive.roles import Detections
from physgen.photometry import encode_u8
from physgen.scene.scene import View

W, H, FINE = 640, 480, 4
ROW = [(x, 0.024, 0.1, 0.05) for x in np.linspace(-0.16, 0.16, 5)]
"""Dominoes in m: the middle, width, height and depth."""
FAR, NEAR = ((1500.0, (0.0, 0.35, -1.6)), (900.0, (0.0, 0.25, -1.0)))
"""Focal length, px, and the place, m, of a camera that looks down by 8 degrees; fronts are at z = 0."""


class Camera:
    def __init__(
        self, focal: float, place: tuple[float, float, float], pitch: float = 8.0
    ) -> None:
        self.focal, self.place, self.pitch = focal, np.array(place), np.radians(pitch)

    def pixel(self, x: float, y: float, z: float) -> np.ndarray:
        x, y, z = np.array([x, y, z]) - self.place
        away = z * np.cos(self.pitch) - y * np.sin(self.pitch)
        up = z * np.sin(self.pitch) + y * np.cos(self.pitch)
        return np.array(
            [W / 2 - 0.5 + self.focal * x / away, H / 2 - 0.5 - self.focal * up / away]
        )

    def photo(self, boxes, top=(0.3, 0.3, 0.3), band: float = 0.0):
        """The photo and its label map; `band`: of the height, the upper part of fronts that is printed like tops."""
        light = np.full((H * FINE, W * FINE, 3), 0.12, np.float32)
        light[H * FINE // 2 :] = (0.2, 0.14, 0.1)
        ids = np.zeros(light.shape[:2], np.uint16)

        def fill(corners, colour, k):
            points = np.array([self.pixel(*corner) for corner in corners])
            points = np.rint(((points + 0.5) * FINE - 0.5) * 16).astype(np.int32)
            cv2.fillPoly(
                light, [points], tuple(float(part) for part in colour), shift=4
            )
            cv2.fillPoly(ids, [points], k, shift=4)

        for k, (x, wide, h, deep) in enumerate(boxes, 1):
            a, b = x - wide / 2, x + wide / 2
            side = b if b < self.place[0] else a if a > self.place[0] else None
            if side is not None:
                fill(
                    [(side, 0, 0), (side, h, 0), (side, h, deep), (side, 0, deep)],
                    (0.2, 0.2, 0.2),
                    k,
                )
            if h < self.place[1]:
                fill([(a, h, 0), (b, h, 0), (b, h, deep), (a, h, deep)], top, k)
            fill([(a, 0, 0), (b, 0, 0), (b, h, 0), (a, h, 0)], (0.5, 0.5, 0.5), k)
            low = h * (1 - band)
            fill(
                [(a, low, 0), (b, low, 0), (b, h, 0), (a, h, 0)],
                top if band else (0.5, 0.5, 0.5),
                k,
            )
        small = cv2.GaussianBlur(
            cv2.resize(light, (W, H), interpolation=cv2.INTER_AREA), (0, 0), 0.5
        )
        small += np.random.default_rng(0).normal(0, 0.004, small.shape)
        labels = np.zeros((H, W), np.uint16)
        for k in range(1, len(boxes) + 1):
            labels[
                cv2.resize(
                    (ids == k).astype(np.float32), (W, H), interpolation=cv2.INTER_AREA
                )
                >= 0.5
            ] = k
        return encode_u8(np.clip(small, 0, 1).astype(np.float32)), labels


def sections(rgb, labels, view=View.SIDE):
    """Top and bottom, px, of each outline, and the row of the floor."""
    objects = fit_objects(rgb, Detections(labels, "given", {}, {}))[0]
    guess = support()(rgb, labels, objects, view)
    found = [bounds(guess.outlines.get(t.id, t.outline)) for t in objects]
    floor = [wall.points[0][1] for wall in guess.walls if wall.name == "floor"]
    return np.array([(y0, y1) for _, y0, _, y1 in found]), floor


def rows(camera: Camera, box) -> tuple[float, float, float]:
    """Rows of the rear and the front edge of a box's top, and of its front's foot."""
    x, _, h, deep = box
    return tuple(float(camera.pixel(x, *at)[1]) for at in ((h, deep), (h, 0), (0, 0)))


@pytest.mark.slow
def test_of_many_boxes_edges_that_hardly_run_together_are_enough():
    """Far away: two of the nine would not tell."""
    camera = Camera(2600.0, (0.0, 0.55, -2.8))
    boxes = [(x, 0.016, 0.1, 0.05) for x in np.linspace(-0.1, 0.1, 9)]
    found, _ = sections(*camera.photo(boxes))
    rear, front, _ = rows(camera, boxes[0])
    assert found[:, 0] == pytest.approx((rear + front) / 2, abs=0.6)
    found, _ = sections(*camera.photo([boxes[3], boxes[5]]))
    assert found[:, 0] == pytest.approx(rear, abs=0.6)


@pytest.mark.parametrize("scale", [0.5, 0.7, 2.0])
def test_tops_are_found_in_photos_of_any_size(scale):
    camera = Camera(*NEAR)
    rgb, labels = camera.photo([(0.0, 0.12, 0.1, 0.08)])
    size = (round(W * scale), round(H * scale))
    small = cv2.resize(
        rgb, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    )
    mask = (
        cv2.resize(
            (labels > 0).astype(np.float32), size, interpolation=cv2.INTER_LINEAR
        )
        >= 0.5
    )
    found, _ = sections(small, mask.astype(np.uint16))
    rear, front, foot = (
        (row + 0.5) * scale - 0.5 for row in rows(camera, (0.0, 0.12, 0.1, 0.08))
    )
    half = (front - rear) / 2
    assert found[0] == pytest.approx(
        (front - half, foot - half), abs=0.6 * max(scale, 1)
    )


@pytest.mark.parametrize("top", [(0.3, 0.3, 0.3), (0.75, 0.75, 0.75)])
@pytest.mark.parametrize(
    ("lens", "boxes"),
    [(FAR, ROW), (NEAR, [(0.0, 0.12, 0.1, 0.08)])],
    ids=["row", "one"],
)
def test_what_moves_is_the_front_moved_up_by_half_of_the_top(lens, boxes, top):
    camera = Camera(*lens)
    found, (floor,) = sections(*camera.photo(boxes, top))
    rear, front, foot = rows(camera, boxes[0])
    half = (front - rear) / 2
    assert half > 2
    assert found[:, 0] == pytest.approx(front - half, abs=0.6)
    assert found[:, 1] == pytest.approx(foot - half, abs=0.6)
    assert floor == pytest.approx(foot - half, abs=0.6)


@pytest.mark.parametrize(
    ("lens", "boxes"),
    [(FAR, ROW), (NEAR, [(0.0, 0.12, 0.1, 0.08)])],
    ids=["row", "one"],
)
def test_a_band_printed_along_the_upper_rim_is_no_top(lens, boxes):
    focal, (x, _, z) = lens
    camera = Camera(focal, (x, 0.06, z), 0.0)
    found, _ = sections(*camera.photo(boxes, band=0.1))
    assert found[:, 0] == pytest.approx(camera.pixel(0, 0.1, 0)[1], abs=0.6)


def test_tops_of_another_hue_stay_part_of_what_they_are_printed_on():
    camera = Camera(*FAR)
    found, _ = sections(*camera.photo(ROW, (0.4, 0.2, 0.15)))
    assert found[:, 0] == pytest.approx(rows(camera, ROW[0])[0], abs=0.6)


@pytest.mark.parametrize("what", ["print", "arch", "lean"])
def test_no_top_is_where_the_strip_is_uneven_the_rim_round_or_a_side_askew(what):
    """Each has a top, but for that."""
    camera = Camera(*NEAR)
    rgb, labels = camera.photo([(0.0, 0.12, 0.1, 0.08)])
    x, y, width, _ = cv2.boundingRect((labels > 0).astype(np.uint8))
    if what == "print":
        rgb[y + 1 : y + 9, x + width // 2 :] = rgb[y + 40, x + width // 2]
    elif what == "lean":
        for row in range(y, H):
            rgb[row], labels[row] = (
                np.roll(part[row], (row - y) // 20, axis=0) for part in (rgb, labels)
            )
    else:
        for column in range(x, x + width):
            up = round(12 * (2 * (column - x) / width - 1) ** 2)
            rgb[y : y + up, column], labels[y : y + up, column] = rgb[0, 0], 0
    found, _ = sections(rgb, labels)
    assert found[0, 0] == pytest.approx(y - 0.5, abs=0.6)


def test_a_lid_is_no_top():
    """Narrower than its jar down to its own edge."""
    camera = Camera(900.0, (0.0, 0.06, -1.0), 0.0)
    rgb, labels = camera.photo([(0.0, 0.12, 0.1, 0.08)], band=0.1)
    x, y, width, _ = cv2.boundingRect((labels > 0).astype(np.uint8))
    for lid in (
        np.s_[y : y + 9, x : x + 8],
        np.s_[y : y + 9, x + width - 8 : x + width],
    ):
        rgb[lid], labels[lid] = rgb[0, 0], 0
    found, _ = sections(rgb, labels)
    assert found[0, 0] == pytest.approx(y - 0.5, abs=0.6)


def test_seen_from_above_no_strip_is_a_top():
    camera = Camera(*FAR)
    found, _ = sections(*camera.photo(ROW), View.TOP)
    assert found[:, 0] == pytest.approx(rows(camera, ROW[0])[0], abs=0.6)
