"""Who is drawn over whom: what is hidden is told by how outlines would go on; what only touches is told nothing."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from physgen import pipeline
from physgen.cli.main import main
from physgen.perceive.occlusion import OcclusionOrder, drawing_layers, occlusion_orders

Labels = NDArray[np.uint16]
Y, X = np.mgrid[:160, :240]


def disc(x: float, y: float, r: float) -> NDArray[np.bool_]:
    return np.asarray((X - x) ** 2 + (Y - y) ** 2 <= r * r)


def box(x0: float, y0: float, x1: float, y1: float) -> NDArray[np.bool_]:
    return np.asarray((x0 <= X) & (x1 >= X) & (y0 <= Y) & (y1 >= Y))


def painted(*masks: NDArray[np.bool_]) -> Labels:
    """The first thing is painted first, the next over it."""
    labels = np.zeros(X.shape, np.uint16)
    for k, mask in enumerate(masks, 1):
        labels[mask] = k
    return labels


def told(labels: Labels) -> set[tuple[int, int]]:
    return {
        (one.front, one.back)
        for one in occlusion_orders(labels, np.unique(labels[labels > 0]).tolist())
    }


OVERLAPPING = {
    "a ball before a ball": (disc(90, 80, 34), disc(120, 92, 30)),
    "a wheel before a car": (box(60, 60, 180, 110), disc(90, 105, 20)),
    "a ball before the corner of a box": (box(60, 60, 140, 120), disc(140, 60, 24)),
    "a ball before the middle of a box": (box(60, 40, 160, 120), disc(110, 80, 20)),
    "a box before a ball": (disc(110, 60, 34), box(60, 66, 170, 110)),
    "a post before a plank": (box(30, 70, 210, 90), box(110, 40, 124, 130)),
}


@pytest.mark.parametrize("name", OVERLAPPING)
def test_what_is_painted_over_another_is_before_it(name: str) -> None:
    first, second = OVERLAPPING[name]
    assert told(painted(first, second)) == {(2, 1)}
    flipped = painted(first, second)[:, ::-1]
    assert told(np.ascontiguousarray(flipped)) == {(2, 1)}


@pytest.mark.parametrize(
    "masks",
    [
        (disc(80, 80, 30), disc(140, 80, 30)),
        (box(40, 60, 99, 120), disc(130, 90, 30)),
        (box(40, 60, 99, 120), box(100, 60, 160, 120)),
        (box(40, 80, 160, 120), box(80, 40, 120, 79)),
        (box(40, 80, 160, 120), disc(100, 49, 30)),
    ],
)
def test_what_only_touches_is_told_nothing(
    masks: tuple[NDArray[np.bool_], ...],
) -> None:
    assert told(painted(*masks)) == set()


def test_layers_rise_from_the_back() -> None:
    found = [
        OcclusionOrder(3, 2, 0.8),
        OcclusionOrder(2, 1, 0.7),
        OcclusionOrder(3, 1, 0.6),
    ]
    assert drawing_layers(found)[0] == {2: 1, 3: 2}


def test_a_ring_is_broken_where_it_is_least_sure() -> None:
    found = [
        OcclusionOrder(1, 2, 0.9),
        OcclusionOrder(2, 3, 0.6),
        OcclusionOrder(3, 1, 0.8),
    ]
    level, kept = drawing_layers(found)
    assert [(one.front, one.back) for one in kept] == [(1, 2), (3, 1)]
    assert level == {1: 1, 3: 2}


def test_what_a_person_set_stays_and_the_rest_follows() -> None:
    level, _ = drawing_layers(
        [OcclusionOrder(2, 1, 0.8), OcclusionOrder(3, 2, 0.8)], {2: 5}
    )
    assert level == {3: 6}


@pytest.fixture(scope="module")
def perceived(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tmp_path = tmp_path_factory.mktemp("perceived")
    labels = painted(box(60, 60, 180, 110), disc(90, 105, 20), disc(150, 105, 20))
    colours = np.array(
        [(190, 186, 176), (40, 60, 170), (170, 40, 40), (30, 120, 60)], np.uint8
    )
    cv2.imwrite(str(tmp_path / "photo.png"), colours[labels][..., ::-1])
    cv2.imwrite(str(tmp_path / "marked.png"), labels)
    path = tmp_path / "scene.yaml"
    options = ["--masks", str(tmp_path / "marked.png"), "-o", str(path)]
    assert main(["perceive", str(tmp_path / "photo.png"), *options]) == 0
    return tmp_path


@pytest.fixture
def scene(perceived: Path, tmp_path: Path) -> Path:
    shutil.copytree(perceived, tmp_path, dirs_exist_ok=True)
    return tmp_path / "scene.yaml"


def of(path: Path) -> dict[int, int]:
    pipeline.load(path)
    objects = yaml.safe_load(path.read_text())["objects"].values()
    return {one["mask"]: one["layer"] for one in objects if "layer" in one}


@pytest.mark.slow
def test_a_scene_tells_layers_with_who_said_so_and_why(scene: Path) -> None:
    assert of(scene) == {2: 1, 3: 1}
    text = scene.read_text()
    record = (scene.parent / "scene.assets" / "perceived.json").read_text()
    assert record.count('"layer": "outlines 0.') == 2
    assert text.count("it hides parts of") == 2


@pytest.mark.slow
@pytest.mark.parametrize(("edit", "after"), [
    (lambda wheel, car: wheel.update(layer=-2), {2: -2, 3: 1}),
    (lambda wheel, car: car.update(layer=4), {1: 4, 2: 5, 3: 5}),
])  # fmt: skip
def test_refreshing_keeps_the_layers_that_a_person_set(
    scene: Path, edit, after
) -> None:  # type: ignore[no-untyped-def]
    data = yaml.safe_load(scene.read_text())
    by_mask = {one["mask"]: one for one in data["objects"].values()}
    edit(by_mask[2], by_mask[1])
    scene.write_text(yaml.safe_dump(data, sort_keys=False))
    out = scene.with_name("again.yaml")
    assert main(["perceive", "--refresh", str(scene), "-o", str(out)]) == 0
    assert of(out) == after
