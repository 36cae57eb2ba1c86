"""`perceive --push` and `--view`, alone and with `--refresh`, on a drawn photo."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.cli.main import main

pytestmark = pytest.mark.slow  # each test perceives a photo, some of them twice


WIDTH, HEIGHT = 320, 200


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """A box on a floor before a wall, and its mask beside it."""
    rows = np.mgrid[:HEIGHT, :WIDTH][0]
    rgb = np.where((rows < 150)[..., None], (90, 120, 160), (150, 100, 60))
    rgb = rgb.astype(np.uint8)
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    labels[110:160, 120:190] = 1
    rgb[labels > 0] = (60, 160, 220)
    cv2.imwrite(str(tmp_path / "photo.png"), rgb)
    cv2.imwrite(str(tmp_path / "masks.png"), labels)
    return tmp_path / "photo.png"


def perceive(photo: Path, *flags: str) -> int:
    masks = str(photo.with_name("masks.png"))
    scene = str(photo.with_name("scene.yaml"))
    return main(["perceive", str(photo), "--masks", masks, "-o", scene, *flags])


def velocities(path: Path) -> dict[str, tuple[float, ...]]:
    scene = pipeline.load(path)
    scale = scene.world.pixels_per_meter
    return {
        item.name: tuple(round(part / scale, 3) for part in item.velocity)
        for item in scene.objects
    }


def test_a_given_push_takes_the_place_of_the_chosen_one(
    photo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert perceive(photo, "--push", "block-1=left@0.4 m/s", "--view", "side") == 0
    scene = photo.with_name("scene.yaml")
    assert velocities(scene) == {"block-1": (-0.4, 0.0)}
    assert "block-1 is pushed to the left" in capsys.readouterr().err
    refresh = ["perceive", "--refresh", str(scene)]
    assert main([*refresh, "--push", "block-1=right@0.6 m/s"]) == 0
    assert velocities(scene) == {"block-1": (0.6, 0.0)}


def test_a_given_view_decides_and_refresh_turns_it(photo: Path) -> None:
    scene = photo.with_name("scene.yaml")
    assert perceive(photo, "--view", "top") == 0
    assert pipeline.load(scene).world.view.value == "top"
    assert main(["perceive", "--refresh", str(scene), "--view", "side"]) == 0
    turned = pipeline.load(scene)
    assert turned.world.view.value == "side"
    assert any(wall.name == "floor" for wall in turned.boundaries)
    assert any(any(item.velocity) for item in turned.objects)


@pytest.mark.parametrize(
    ("flags", "named"),
    [
        (["--push", "nobody=left"], "nobody"),
        (["--push", "block-1=sideways"], "sideways"),
        (["--push", "block-1=left", "--still"], "--still"),
        (["--view", "front"], "front"),
    ],
)
def test_wrong_pushes_and_views_write_nothing(
    photo: Path, flags: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = perceive(photo, *flags)
    except SystemExit as exit_:  # argparse ends by itself
        code = exit_.code if isinstance(exit_.code, int) else 1
    assert code == 2
    assert named in capsys.readouterr().err
    assert not photo.with_name("scene.yaml").exists()


def test_the_chosen_push_stays_and_lasts(photo: Path) -> None:
    assert perceive(photo, "--view", "side") == 0
    scene = pipeline.load(photo.with_name("scene.yaml"))
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    centers = pipeline.simulate(world).poses[:, 0, :2]
    assert np.ptp(centers[:, 0]) > 0.05 * WIDTH
    assert (np.abs(centers[-1] - (WIDTH / 2, 135)) < (WIDTH / 2 - 35, 20)).all()
    assert world.duration * scene.render.slow >= 2.49
