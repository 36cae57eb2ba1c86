"""A changed view in the editor: objects stay where the photo shows them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen.edit.operations import SetOp
from physgen.edit.session import EditRequest, Session
from physgen.perceive.backends import boundary_support
from physgen.perceive.support.view_classifier import ViewChances
from physgen.problems import EditError
from physgen.scene.yaml_edit import mark_values
from physgen.simulate.engine import simulate

SIZE = (320, 240)
"""Width and height, px."""


def photographed(folder: Path, seed: int, view: str, more: str = "") -> Path:
    """A scene of five balls and a block at random places, with a photo and masks."""
    rng = np.random.default_rng(seed)
    labels = np.zeros(SIZE[::-1], np.uint8)
    for k in range(5):
        center = (40 + 55 * k, int(rng.integers(30, 200)))
        cv2.circle(labels, center, int(rng.integers(9, 16)), k + 1, -1)
    labels[215:235, 280:310] = 6
    shade = np.repeat(np.linspace(90, 170, SIZE[1])[:, None], SIZE[0], axis=1)
    photo = np.where(labels > 0, 30 * labels + 40, shade).astype(np.uint8)
    (folder / "maps").mkdir()
    cv2.imwrite(str(folder / "photo.png"), cv2.merge([photo] * 3))
    cv2.imwrite(str(folder / "maps" / "background.png"), cv2.merge([photo] * 3))
    cv2.imwrite(str(folder / "maps" / "masks.png"), labels)
    objects = "".join(f"  thing-{k}: {{mask: {k}, mass: 20}}\n" for k in range(1, 7))
    scene = folder / "scene.yaml"
    scene.write_text(
        "physgen: 1\nimage: photo.png\nassets: maps\n"
        f"world: {{view: {view}, pixels_per_meter: 600, duration: 2{more}}}\n"
        f"objects:\n{objects}"
    )
    return scene


def turned(scene: Path, view: str) -> tuple[Session, str]:
    """The session of a scene after its view was changed, and the text."""
    session = Session(scene)
    request = EditRequest(version=session.history.version)
    session.edit(request, [SetOp(set=["world", "view"], value=view)])
    return session, session.current_state.text


def displacements(session: Session) -> np.ndarray:
    """(N,) px by which objects move in 2 s."""
    world = session.live.state(session.current_state.text).compiled_scene.world
    poses = simulate(world, np.linspace(0, 2, 81)).poses[..., :2]
    return np.hypot(*np.moveaxis(poses - poses[:1], -1, 0)).max(axis=0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_objects_stay_in_changed_view(tmp_path: Path, seed: int) -> None:
    scene = photographed(tmp_path, seed, "top")
    session, text = turned(scene, "side")
    data = mark_values(text).data()
    assert data["world"]["view"] == "side"
    assert any("from" in wall for wall in data["boundaries"].values())
    assert displacements(session).max() < 1.5
    session.edit(
        EditRequest(version=session.history.version),
        [SetOp(set=["world", "view"], value="top")],
    )
    back = mark_values(session.current_state.text).data()
    assert back["world"]["table"] == {"friction": 0.2}
    assert "floor" not in back["boundaries"]
    assert displacements(session).max() < 1.5
    session.step(EditRequest(version=session.history.version), -1)
    session.step(EditRequest(version=session.history.version), -1)
    assert session.current_state.text == scene.read_text()


def test_gravity_of_side_view_leaves_table(tmp_path: Path) -> None:
    scene = photographed(tmp_path, 0, "side", ', gravity: [0, "9.8 m/s²"]')
    session, text = turned(scene, "top")
    assert "gravity" not in mark_values(text).data()["world"]
    assert displacements(session).max() < 1.5


def test_walls_of_user_stay_in_changed_view(tmp_path: Path) -> None:
    scene = photographed(tmp_path, 1, "top")
    wall = "  shelf: {segment: [[0, 120], [320, 120]]}  # mine\n"
    scene.write_text(scene.read_text() + "boundaries:\n" + wall)
    _, text = turned(scene, "side")
    assert wall in text


def test_view_of_drawn_scene_changes_alone(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "physgen: 1\nsize: [100, 100]\nworld: {view: top}\n"
        "objects:\n  ball: {shape: {circle: {center: [50, 50], radius: 9}}}\n"
    )
    _, text = turned(scene, "side")
    assert text == scene.read_text().replace("view: top", "view: side")


def test_impossible_edit_changes_no_view(tmp_path: Path) -> None:
    scene = photographed(tmp_path, 2, "top")
    session = Session(scene)
    request = EditRequest(version=session.history.version)
    with pytest.raises(EditError):
        session.edit(
            request,
            [
                SetOp(set=["world", "view"], value="side"),
                SetOp(set=["objects", "thing-1", "mask", "x", "y"], value=1),
            ],
        )
    assert session.current_state.text == scene.read_text()


def test_oblique_photo_gets_its_tilt_from_the_side(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chances = ViewChances(0.05, 0.9, 0.05, 0.1)
    monkeypatch.setattr(boundary_support, "view_chances", lambda features: chances)
    scene = photographed(tmp_path, 0, "top")
    session, text = turned(scene, "side")
    assert mark_values(text).data()["world"]["tilt"] == chances.tilt
    top = [SetOp(set=["world", "view"], value="top")]
    session.edit(EditRequest(version=session.history.version), top)
    assert "tilt" not in mark_values(session.current_state.text).data()["world"]
