"""The ground follows a corrected mask, as if perception had known it from the beginning; a person's walls stay."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from physgen import registry
from physgen.cli.main import main
from physgen.edit.corrections import correct
from physgen.edit.live import Live
from physgen.perceive.refresh import wall_distance
from physgen.pipeline import load
from physgen.simulate.trajectory import read_trajectory

SIDE = 256
NEAR = 2.0
"""px between a wall and itself: a mask that was drawn again differs by some."""
Perceive = Callable[..., Path]


def small(path: Path, how: int) -> np.ndarray:
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return np.asarray(cv2.resize(found, (SIDE, SIDE), interpolation=how))


@pytest.fixture(scope="module")
def perceive(tmp_path_factory: pytest.TempPathFactory, bundled: Path) -> Perceive:
    """A bundled photo, its true masks with the lower part of one object missing -> a scene; each made once."""
    made: dict[tuple[str, int | None], Path] = {}

    def seen(name: str, half: int | None) -> Path:
        if (name, half) not in made:
            folder = tmp_path_factory.mktemp(name)
            cv2.imwrite(str(folder / "photo.png"), small(bundled / name / "photo.png", cv2.INTER_AREA))
            masks = truth(bundled, name)
            if half is not None:
                masks[lower(masks == half)] = 0
            cv2.imwrite(str(folder / "given.png"), masks)
            flags = ["--masks", str(folder / "given.png"), "-o", str(folder / "scene.yaml")]
            assert main(["perceive", str(folder / "photo.png"), *flags]) == 0
            made[name, half] = folder
        return made[name, half]

    return seen


def truth(bundled: Path, name: str) -> np.ndarray:
    return small(bundled / name / "photo.assets" / "masks.png", cv2.INTER_NEAREST)


def lower(mask: np.ndarray) -> np.ndarray:
    """The lower third of a mask."""
    rows = np.flatnonzero(mask.any(axis=1))
    return mask & (np.arange(len(mask))[:, None] >= rows[0] + int(0.7 * len(rows)))


def mended(folder: Path, mask: np.ndarray, edit: Callable[[str], str] = lambda text: text) -> Any:
    """What the file says once a person painted what was missing of an object, whose rest the mask holds."""
    path = folder / "scene.yaml"
    path.write_text(edit(path.read_text(encoding="utf-8")), encoding="utf-8")
    live, text = Live(path), path.read_text(encoding="utf-8")
    labels = live.state(text).compiled.labels
    names = [item.name for item in load(path).objects]
    name = names[np.bincount(labels[mask], minlength=len(names) + 1)[1:].argmax()]
    ys, xs = np.nonzero(mask & (labels == 0))
    strokes = np.stack([xs, ys], axis=1).tolist()
    out = folder / "maps"
    made = correct(
        live, text, None, {"kind": "brush", "object": name, "strokes": strokes, "radius": 1.0}, out
    )
    return made.text


def walls(text: str) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(text)["boundaries"]
    return found


def farthest(one: dict[str, Any], other: dict[str, Any]) -> float:
    """px: of any wall of each from the nearest of the other."""
    return max(
        min(wall_distance(wall, mate) for mate in mates.values())
        for some, mates in ((one, other), (other, one))
        for wall in some.values()
    )


@pytest.mark.parametrize(("name", "half"), [("ramp", 1), ("ramp", 3), ("shelf", 3), ("shelf", 6)])
def test_the_ground_is_that_of_the_mended_mask(
    perceive: Perceive, bundled: Path, tmp_path: Path, name: str, half: int
) -> None:
    good = walls((perceive(name, None) / "scene.yaml").read_text())
    folder = Path(shutil.copytree(perceive(name, half), tmp_path / "scene"))
    bad = walls((folder / "scene.yaml").read_text())
    assert farthest(bad, good) > 5, "what stood on the missing part was held up by something else"
    now = walls(mended(folder, truth(bundled, name) == half))
    assert farthest(now, good) <= NEAR


def test_what_a_person_moved_or_took_out_stays_so(perceive: Perceive, bundled: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(perceive("shelf", 3), tmp_path / "scene"))
    before = walls((folder / "scene.yaml").read_text())
    moved, gone = {"segment": [[10, 20], [50, 20]]}, "wall-1"
    assert {"floor", gone} <= set(before)

    def edit(text: str) -> str:
        text = re.sub(
            r"\n  floor:.*?(?=\n  \w)", "\n  floor: {segment: [[10, 20], [50, 20]]}  # mine", text, flags=re.S
        )
        return re.sub(rf"\n  {gone}:.*?(?=\n  \w|\n[#\w])", "", text, flags=re.S)

    text = mended(folder, truth(bundled, "shelf") == 3, edit)
    assert "  floor: {segment: [[10, 20], [50, 20]]}  # mine\n" in text
    now = walls(text)
    assert now["floor"] == moved
    assert gone not in now
    assert any(wall_distance(wall, before["frame"]) == 0 for wall in now.values())


def test_a_scene_of_a_persons_own_walls_gets_no_others(
    perceive: Perceive, bundled: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(perceive("ramp", 1), tmp_path / "scene"))

    def edit(text: str) -> str:
        start, mine = text.partition("boundaries:")[::2]
        return start + "boundaries:" + re.sub(r"\n    from: .*", "", mine, count=0)

    before = walls(edit((folder / "scene.yaml").read_text()))
    assert walls(mended(folder, truth(bundled, "ramp") == 1, edit)) == before


def test_a_new_thing_in_mid_air_stands_still(perceive: Perceive, bundled: Path, tmp_path: Path) -> None:
    """As all does that is seen at rest: perception lays a ledge under it, and so does a correction."""
    folder = Path(shutil.copytree(perceive("ramp", None), tmp_path / "scene"))
    path = folder / "scene.yaml"
    live, text = Live(path), path.read_text(encoding="utf-8")
    drawn = {"kind": "polygon", "polygon": [[20, 20], [60, 20], [40, 60]], "object": None}
    made = correct(live, text, None, drawn, folder / "maps")
    assert made.made is not None
    path.write_text(made.text, encoding="utf-8")
    shutil.rmtree(folder / "scene.assets")
    (folder / "maps").rename(folder / "scene.assets")
    assert main(["simulate", str(path), "-o", str(folder / "t.npz")]) == 0
    run = read_trajectory(folder / "t.npz")
    poses = run.poses[:, run.names.index(made.made)]
    assert np.hypot(*(poses[-1, :2] - poses[0, :2])) < 2


@pytest.mark.parametrize(
    ("remark", "stays"),
    [
        ("nothing that is seen keeps it from falling, so it is held; dynamic lets it go", False),
        ("mine", True),
    ],
)
def test_what_was_held_is_let_go_once_something_holds_it(
    perceive: Perceive,
    bundled: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    remark: str,
    stays: bool,
) -> None:
    """Where perception said `static`, and no person. (A made-up role says what is held: the small mask is.)"""
    make, real = registry.make, registry.make("boundary")

    def said(rgb: Any, labels: Any, things: Any, view: Any) -> Any:
        small = {one.id for one in things if 0 < (mask & (labels == one.id)).sum() < 0.95 * mask.sum()}
        return replace(real(rgb, labels, things, view), held=frozenset(small))

    mask = truth(bundled, "ramp") == 1
    folder = Path(shutil.copytree(perceive("ramp", 1), tmp_path / "scene"))  # as it is really perceived
    monkeypatch.setattr("physgen.registry.make", lambda role: said if role == "boundary" else make(role))

    def edit(text: str) -> str:
        return re.sub(r"(?=\n    from:\n      mask)", f"\n    motion: static  # {remark}", text)

    text = mended(folder, mask, edit)
    (corrected,) = (one for one in yaml.safe_load(text)["objects"].values() if one["mask"] == 1)
    others = [one for one in yaml.safe_load(text)["objects"].values() if one["mask"] != 1]
    assert all(one["motion"] == "static" for one in others)
    assert (corrected.get("motion") == "static") is stays
    assert text.count(remark) == len(others) + stays
