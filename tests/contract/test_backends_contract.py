"""Every row of the table, run on one small photo: a backend is held to its role without being told."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np
import pytest

from physgen import registry
from physgen.geometry.polygon import Disc, Region, Ring
from physgen.perceive.roles import (
    BoundaryGuess,
    Category,
    LightGuess,
    Matter,
    Name,
    PhotoObject,
    Segments,
    Shadows,
)
from physgen.photometry import decode
from physgen.refine.denoiser import Denoiser, PromptSettings
from physgen.refine.fusion import Refinement, RefineSettings
from physgen.scene.scene import View

ROWS = [row for row in registry.BACKENDS if row.target]
"""All of them: a library that is missing fails here, and hides nothing."""
SIZE = 160, 120


def photo() -> tuple[np.ndarray, np.ndarray, list[PhotoObject]]:
    """A ball and a block on a table before a wall."""
    width, height = SIZE
    random = np.random.default_rng(1)
    rgb = np.empty((height, width, 3), np.float64)
    rgb[:90] = (90, 110, 140)
    rgb[90:] = (150, 110, 70)
    rgb += random.normal(0, 2, rgb.shape)
    labels = np.zeros((height, width), np.uint16)
    y, x = np.mgrid[:height, :width]
    disc = np.hypot(x - 45, y - 75) <= 20
    labels[disc] = 1
    z = np.sqrt(np.maximum(0, 1 - ((x - 45) ** 2 + (y - 75) ** 2) / 400))
    rgb[disc] = (np.array([200, 60, 40]) * (0.5 + 0.5 * z[..., None]))[disc]
    labels[55:95, 100:130] = 2
    rgb[55:95, 100:130] = (220, 200, 120)
    rgb = cv2.GaussianBlur(rgb, (0, 0), 0.7)
    corners = np.array([[99.5, 54.5], [129.5, 54.5], [129.5, 94.5], [99.5, 94.5]])
    things = [
        PhotoObject(1, Disc(np.array([45.0, 75.0]), 20.0), "ball"),
        PhotoObject(2, Region((Ring(corners),)), "wooden block"),
    ]
    return np.clip(rgb, 0, 255).astype(np.uint8), labels, things


def check_segment(run, rgb, labels, things):
    found = run(rgb)
    assert isinstance(found, Segments)
    assert found.labels.shape == rgb.shape[:2]
    assert found.labels.dtype == np.uint16
    assert set(np.unique(found.labels)) - {0} == set(
        range(1, len(found.confidence) + 1)
    )
    assert ((found.confidence >= 0) & (found.confidence <= 1)).all()
    across = [
        np.nonzero(found.labels == k)[1].mean()
        for k in range(1, len(found.confidence) + 1)
    ]
    assert across == sorted(across)  # left to right by centroid


def check_categories(run, rgb, labels, things):
    found = run(rgb)
    assert found
    assert all(isinstance(one, Category) and one.noun for one in found)
    assert len({one.noun for one in found}) == len(found)


def check_label(run, rgb, labels, things):
    names = run(rgb, labels, things)
    assert isinstance(names, Mapping)
    assert set(names) == {1, 2}
    for name in names.values():
        assert isinstance(name, Name)
        assert name.label
        assert 0 <= name.confidence <= 1


@pytest.fixture(scope="module")
def scenery():
    return photo()


def check_physics(run, rgb, labels, things):
    for scale in (None, 500.0):
        found = run(rgb, things, scale)
        assert set(found) == {1, 2}
        for matter in found.values():
            assert isinstance(matter, Matter)
            assert 0 < matter.mass < 1e6
            assert 0 <= matter.friction <= 10
            assert 0 <= matter.elasticity <= 1
            assert 0 <= matter.confidence <= 1
            assert matter.reason


def surfaces(rgb, labels, things):
    setting = registry.make("boundary")(rgb, labels, things, None)
    normals = registry.make("normals")(rgb, labels, things, setting)
    return normals, registry.make("intrinsic")(rgb, labels, normals)


def check_depth(run, rgb, labels, things):
    for seen in (
        rgb,
        np.zeros_like(rgb),
        *([rgb[:, :37]] if hasattr(run, "close") else []),
    ):
        depth = run(seen)
        assert depth.shape == seen.shape[:2]
        assert depth.dtype == np.float32
        assert np.isfinite(depth).all()
        assert depth.min() >= 0
    assert np.array_equal(run(rgb), run(rgb))


def check_normals(run, rgb, labels, things):
    for view in (View.SIDE, View.TOP):
        for seen in (things, []):
            setting = registry.make("boundary")(rgb, labels, seen, view)
            normals = run(rgb, labels if seen else np.zeros_like(labels), seen, setting)
            assert normals.shape == rgb.shape
            assert normals.dtype == np.float32
            assert np.linalg.norm(normals, axis=2) == pytest.approx(1, abs=1e-3)
            assert normals[..., 2].min() > -1e-3  # what is seen faces the viewer


def check_intrinsic(run, rgb, labels, things):
    normals = surfaces(rgb, labels, things)[0]
    found = run(rgb, labels, normals)
    assert found.albedo.shape == rgb.shape
    assert found.shading.shape == labels.shape
    assert found.albedo.dtype == found.shading.dtype == np.float32
    assert found.albedo.min() >= 0
    assert found.albedo.max() <= 1
    assert found.shading.min() >= 0
    both = found.albedo * found.shading[..., None]
    assert np.abs(both - decode(rgb)).mean() < 0.02  # together they are the photo
    for flat in (np.zeros_like(rgb), np.full_like(rgb, 255)):
        parted = run(flat, labels, normals)
        assert np.isfinite(parted.albedo).all()
        assert np.isfinite(parted.shading).all()


def check_light(run, rgb, labels, things):
    for seen in (things, []):
        guess = run(rgb, labels, seen, *surfaces(rgb, labels, seen))
        assert isinstance(guess, LightGuess)
        assert np.linalg.norm(guess.light.direction) == pytest.approx(1, abs=1e-5)
        assert guess.light.intensity >= 0
        assert guess.light.ambient >= 0
        assert 0 <= guess.confidence <= 1


def check_matte(run, rgb, labels, things):
    coverage = run(rgb, labels)
    assert coverage.shape == labels.shape
    assert coverage.dtype == np.float32
    assert coverage.min() >= 0
    assert coverage.max() <= 1
    inside = (labels > 0).astype(np.uint8)
    deep = cv2.distanceTransform(inside, cv2.DIST_L2, 5) > 4
    far = cv2.distanceTransform(1 - inside, cv2.DIST_L2, 5) > 5
    assert (coverage[deep] == 1).all()
    assert (coverage[far] == 0).all()
    assert np.array_equal(
        np.round(coverage * 255), (coverage * 255).round(3)
    )  # as 8 bits hold it
    assert (run(rgb, np.zeros_like(labels)) == 0).all()


def check_inpaint(run, rgb, labels, things):
    hole = cv2.dilate((labels > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    before = rgb.copy()
    filled = run(rgb, hole)
    assert filled.shape == rgb.shape
    assert filled.dtype == np.uint8
    assert np.array_equal(filled[~hole], rgb[~hole])
    assert np.array_equal(rgb, before)
    assert np.array_equal(run(rgb, np.zeros_like(hole)), rgb)
    assert run(rgb, np.ones_like(hole)).shape == rgb.shape
    assert np.array_equal(run(rgb, hole), filled)


def check_shadow(run, rgb, labels, things):
    coverage = (labels > 0).astype(np.float32)
    matter = registry.make("physics")(rgb, things, None)
    light = registry.make("light")(rgb, labels, things, *surfaces(rgb, labels, things))
    for view in (View.SIDE, View.TOP):
        setting = registry.make("boundary")(rgb, labels, things, view)
        found = run(rgb, coverage, labels, things, matter, setting, light)
        assert isinstance(found, Shadows)
        assert 0 <= found.confidence <= 1
        assert 0 <= found.softness <= 60
        assert 0 <= found.tilt <= 60
        assert np.linalg.norm(found.light.direction) == pytest.approx(1)
        assert found.clean_background is None or (
            found.clean_background.shape == rgb.shape
            and found.clean_background.dtype == np.uint8
        )
        assert (
            run(rgb, coverage, labels, [], matter, setting, light).clean_background
            is None
        )


def maps(rgb, labels):
    """Depth and normals of the photo: a table that runs back to a wall, things in front of it."""
    depth = np.repeat(
        np.interp(np.arange(labels.shape[0]), (89, 119), (2, 1))[:, None],
        labels.shape[1],
        axis=1,
    )
    normals = np.zeros((*labels.shape, 3), np.float32)
    normals[:90, :, 2] = normals[labels > 0, 2] = 1
    normals[90:, :, 1] = -1
    depth[labels > 0] = 1.8
    return {"depth": depth.astype(np.float32), "normals": normals, "scenery": None}


def check_boundary(run, rgb, labels, things):
    given = {
        key: value
        for key, value in maps(rgb, labels).items()
        if key in inspect.signature(run).parameters
    }
    for view in (None, View.SIDE, View.TOP):
        setting = run(rgb, labels, things, view, **given)
        assert isinstance(setting, BoundaryGuess)
        assert view is None or setting.view is view
        assert len({wall.name for wall in setting.walls}) == len(setting.walls)
        for wall in setting.walls:
            assert len(wall.points) >= 2
            assert np.isfinite(wall.points).all()
            assert wall.friction >= 0
            assert 0 <= wall.elasticity <= 1
    assert run(rgb, labels, [], None, **given).view in View


def check_refine(run, rgb, labels, things):
    assert isinstance(run, Denoiser)
    how = RefineSettings(
        0.5, 1, 4, 3, PromptSettings("a ball", "blur", None), 0.0, 1.0, 0
    )
    guidance = [np.ascontiguousarray(rgb[60:83, k : k + 37]) for k in range(3)]
    ball = [np.ones((23, 37), np.float32)] * 3
    whole = Refinement(
        run, replace(how, stop=0), (37, 23), 3, weight=lambda k, count: 0.0
    )
    for frame, refined in zip(guidance, whole.frames(guidance, ball), strict=True):
        assert np.array_equal(frame, refined)  # nothing of the model's own enters
    found = list(Refinement(run, how, (37, 23), 3).frames(guidance, ball))
    again = list(Refinement(run, how, (37, 23), 3).frames(guidance, ball))
    assert [frame.shape for frame in found] == [(23, 37, 3)] * 3
    assert np.array_equal(found, again)


CHECKS = {
    name.removeprefix("check_"): check
    for name, check in list(globals().items())
    if name.startswith("check_")
}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.role}-{row.name}")
def test_keeps_to_its_role(
    row: registry.Backend, scenery, tiny, request: pytest.FixtureRequest
):
    if row.name == "vlm":
        request.getfixturevalue("vlm_stub")
    known = (row.role, row.name) in tiny
    run = registry.make(
        row.role, row.name, tiny.setup(row.role, row.name) if known else None
    )
    if row.role in CHECKS:
        CHECKS[row.role](run, *scenery)
    else:
        assert callable(run)
    if known and row.weights:
        note = run.note()
        assert {"device", "dtype", "weights"} <= set(note)
        assert note["weights"] == str(tiny[row.role, row.name])
        json.dumps(note)  # it goes into the record
        run.close()


def test_every_role_has_a_check():
    from physgen.perceive.perception_run import ROLES

    assert {*ROLES, "refine"} == set(CHECKS) == set(registry.roles())
