"""No pixel flashes although nothing passed it: bundled scenes and the paper's."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import flashes
import numpy as np
import pytest
from flashes import Flashes
from PIL import Image

from physgen.render.stage import Frame

MOST_CHANGED = 40
"""px that may change in frame 1 far from what moved and from its shadows."""
MOST_FLASHES = 4
"""px of all frames: the contact shadow of one domino of the paper's photo."""
NAMES = sorted(path.parent.name for path in flashes.ROOT.glob("scenes/*/scene.yaml"))


def _measure(name: str, folder: Path, *overrides: str) -> Flashes:
    ((_, path),) = flashes.scene_paths([name], folder)
    return flashes.measure(flashes.open_clip(path, overrides))


def _check(found: Flashes) -> None:
    assert found.flashes <= MOST_FLASHES, f"most in frame {found.worst[0]}"
    assert found.first[1] <= MOST_CHANGED


@pytest.mark.parametrize("name", ["cups", "seesaw"])
def test_first_frames_do_not_flash(name: str, tmp_path: Path) -> None:
    _check(_measure(name, tmp_path, "world.duration=0.1", "render.motion_blur=0"))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_bundled_scenes_do_not_flash(name: str, tmp_path: Path) -> None:
    _check(_measure(name, tmp_path))


@pytest.mark.slow
@pytest.mark.peer_scenes
@pytest.mark.parametrize("name", flashes.PEER_SCENES)
def test_scenes_of_the_paper_do_not_flash(name: str, tmp_path: Path) -> None:
    _check(_measure(name, tmp_path))


SCENE = """physgen: 1
image: photo.png
objects:
  ball: {shape: {circle: {center: [20, 20], radius: 6}}, velocity: [60, 0]}
world: {gravity: [0, 0], duration: 0.2}
"""


def test_a_light_that_goes_on_is_a_flash(tmp_path: Path) -> None:
    Image.new("RGB", (120, 80), (90, 100, 110)).save(tmp_path / "photo.png")
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    clip = flashes.open_clip(path)
    frames = list(clip.frames())
    lamp = np.s_[50:60, 90:110]
    for frame in frames[3:]:
        frame.rgb[lamp] += 30

    class Lamp(flashes.ClipFrames):
        def frames(self) -> Iterator[Frame]:
            return iter(frames)

    assert flashes.measure(clip).jumps == 0
    parts = clip.stage, clip.maps, clip.trajectory, clip.moments, clip.parts
    found = flashes.measure(Lamp(*parts))
    assert found.jumps == found.flashes == 200
    assert found.worst == (3, 200)
