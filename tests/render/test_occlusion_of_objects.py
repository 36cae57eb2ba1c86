"""Shadows that things throw on each other: rays followed by hand, and pictures that must come out the same."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from physgen.geometry.shadows import ShadowSetting, Silhouette
from physgen.photometry import DistantLight
from physgen.render import occlusion
from physgen.render.occlusion import occluders, occlusion_of

LIGHT = DistantLight((-0.6, -0.48, 0.64), 1.0, 0.25)


def setting(top: bool, light=LIGHT) -> ShadowSetting:
    return ShadowSetting(light, 0.5, top, 0.1, np.inf, (400, 400))


def ball(x, y, r) -> Silhouette:
    x0, y0, n = int(x - r - 3), int(y - r - 3), int(2 * r + 7)
    yy, xx = np.mgrid[:n, :n]
    cover = np.clip(r + 0.5 - np.hypot(xx + x0 - x, yy + y0 - y), 0, 1).astype(
        np.float32
    )
    return Silhouette(cover, (x0, y0), (x, y), r, 2 * r, None)


def slab(x0, y0, w, h, thick) -> Silhouette:
    cover = np.ones((h, w), np.float32)
    return Silhouette(cover, (x0, y0), (x0 + w / 2, y0 + h / 2), None, thick, None)


def hidden(point, what: Silhouette, top: bool) -> bool:
    """Whether the way from a point (x, y, towards the viewer) to the light meets a thing, in small steps."""
    for s in np.arange(0.5, 400, 0.5):
        x, y, z = point + s * np.array(LIGHT.direction)
        if what.radius is not None:
            middle = what.radius if top else 0.0
            if (x - what.center[0]) ** 2 + (y - what.center[1]) ** 2 + (
                z - middle
            ) ** 2 < what.radius**2:
                return True
        else:
            low, high = (
                (0, what.thickness)
                if top
                else (-what.thickness / 2, what.thickness / 2)
            )
            h, w = what.coverage.shape
            inside = 0 <= x - what.corner[0] < w and 0 <= y - what.corner[1] < h
            if inside and low < z < high:
                return True
    return False


@pytest.mark.parametrize("top", [True, False])
@pytest.mark.parametrize(
    "other", [ball(150, 160, 28), slab(120, 110, 30, 60, 90)], ids=["ball", "slab"]
)
def test_the_shadow_on_a_ball_is_where_rays_say(top, other) -> None:
    onto = ball(190, 190, 30)
    dark = occlusion_of(onto, [other], setting(top))
    assert dark is not None
    agree = total = 0
    for dy in range(-18, 19, 4):
        for dx in range(-18, 19, 4):
            up = np.sqrt(30.0**2 - dx * dx - dy * dy)
            point = np.array([190 + dx, 190 + dy, up + (30 if top else 0)])
            if np.dot([dx, dy, up], LIGHT.direction) < 6:
                continue  # its own dark side
            total += 1
            seen = dark[190 + dy - onto.corner[1], 190 + dx - onto.corner[0]] > 0.5
            agree += seen == hidden(point, other, top)
    assert total > 40
    assert agree >= 0.88 * total


def test_as_much_light_is_lost_as_comes_straight() -> None:
    """Deep in the shadow the ambient part is left, of all that a face turned to the viewer gets."""
    dark = occlusion_of(
        slab(100, 100, 40, 40, 10), [slab(40, 20, 100, 100, 200)], setting(True)
    )
    lit = 1 - 0.98 * 0.64 / (0.64 + 0.25)
    assert np.exp(-dark[5, 5]) == pytest.approx(lit, rel=0.02)


def test_things_of_one_height_throw_nothing_on_each_others_tops() -> None:
    assert not occluders(
        [slab(100, 100, 40, 40, 20), slab(60, 60, 39, 39, 20)], setting(True)
    )


def test_a_floor_darkens_the_underside_of_a_ball_that_lies_on_it() -> None:
    lies = replace(ball(100, 100, 30), floor=130.0)
    dark = occlusion_of(lies, [], setting(False))
    assert dark is not None
    assert dark[129 - lies.corner[1], 100 - lies.corner[0]] > 0.5
    assert dark[: 115 - lies.corner[1]].max() < 0.02
    assert occlusion_of(replace(lies, floor=160.0), [], setting(False)) is None
    assert occlusion_of(ball(100, 100, 30), [], setting(False)) is None


def test_the_shadow_on_what_leans_is_as_even_as_on_a_fine_grid(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The box of what leans is mostly empty: its size says nothing of how fine the grid has to be."""
    cover = cv2.warpAffine(
        np.ones((250, 42), np.float32),
        np.array([[0.7, 0.7, 4.0], [-0.7, 0.7, 34.0]]),
        (215, 215),
    )
    onto = Silhouette(cover, (100, 100), (205, 205), None, 80, None)
    other = slab(120, 60, 80, 120, 240)
    dark = occlusion_of(onto, [other], setting(False))
    monkeypatch.setattr(
        occlusion, "OCCLUSION", replace(occlusion.OCCLUSION, cells=1000)
    )
    fine = occlusion_of(onto, [other], setting(False))
    assert dark is not None
    assert fine is not None
    there = cover > 0.9
    assert fine[there].max() > 0.8
    assert np.abs(dark - fine)[there & (np.abs(fine - fine.max()) > 0.1)].mean() < 0.04
