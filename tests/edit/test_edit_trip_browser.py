"""From a photo to a saved scene in a browser: perceived, pushed, cut, named, saved; then read by the core alone."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from desk import seated

from physgen.cli.main import main
from physgen.pipeline import load

pytestmark = pytest.mark.slow

SMALL = 256
"""px of the photo's side: the trip of the recording, quicker."""


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Those of the recording."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    import editor_trip

    return editor_trip


def test_from_a_photo_to_a_saved_scene(
    browser: Any,
    killable: Callable[..., Any],
    steps: Any,
    tmp_path: Path,
    bundled: Path,
) -> None:
    """Poses that the page played are those of `physgen simulate` of what was saved, bit for bit."""
    photo = cv2.imread(str(steps.PHOTO))
    cv2.imwrite(
        str(tmp_path / "photo.png"),
        cv2.resize(photo, (SMALL, SMALL), interpolation=cv2.INTER_AREA),
    )
    served = killable(tmp_path / "photo.png")
    scene = tmp_path / "photo.yaml"
    with seated(browser, served.address) as desk:
        found = set(served.look()["scene"]["objects"])
        steps.trip(desk, scale=SMALL / photo.shape[1])
        assert desk.errors == []
        motion = whole(desk)
        page = {
            body["name"]: {
                key: np.frombuffer(base64.b64decode(body[key]), "<f8")
                for key in ("x", "y", "a")
            }
            for body in motion["bodies"]
        }
    things = {item.name: item for item in load(scene).objects}
    new = set(things) - found
    cubes = [item for item in things.values() if item.label == "wooden cube"]
    assert len(cubes) == 2
    assert new <= {item.name for item in cubes}  # none if both were found at once
    car = max(
        things.values(), key=lambda item: item.velocity[0]
    )  # perceive pushes another one
    assert car.velocity[0] > 50
    assert car.velocity[1] == pytest.approx(0, abs=car.velocity[0] / 20)
    # each cube is one of the studio's, which it rendered
    truth = cv2.imread(
        str(steps.PHOTO.parent / "photo.assets" / "masks.png"), cv2.IMREAD_UNCHANGED
    )
    truth = cv2.resize(truth, (SMALL, SMALL), interpolation=cv2.INTER_NEAREST)
    mine = cv2.imread(str(load(scene).assets / "masks.png"), cv2.IMREAD_UNCHANGED)
    for cube in cubes:
        best = max(
            ((mine == cube.mask.id) & (truth == k)).sum()
            / ((mine == cube.mask.id) | (truth == k)).sum()
            for k in range(1, int(truth.max()) + 1)
        )
        assert best > 0.85, cube.name
    # the core, which knows of no page
    assert main(["simulate", str(scene), "-o", str(tmp_path / "t.npz")]) == 0
    with np.load(tmp_path / "t.npz") as run:
        for k, name in enumerate(run["names"].tolist()):
            told = np.stack([page[name]["x"], page[name]["y"], page[name]["a"]], axis=1)
            assert (told[motion["frames"]] == run["poses"][:, k]).all(), name


def whole(desk: Any) -> Any:
    """The motion of the state that the page shows, once all of it is simulated."""
    found = {"done": False}
    while not found["done"]:
        found = desk.page.evaluate(
            "async () => { const key = window.editor.state.motion.key;"
            " return window.editor.request('GET', `/api/motion/${key}?from=0`); }"
        )
    return found
