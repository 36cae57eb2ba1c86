"""What stays at hand from clip to clip: less is done, and every clip is what it would be on its own."""

from __future__ import annotations

import json
import os
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.pipeline import Stages, stages

EDITS = (
    (),
    ("objects.ball.mass=900",),
    ("light.intensity=0.3", "light.direction=[-0.4, -0.6, 0.69]"),
    (
        "objects.ball.velocity=[0, -200]",
        "forces=[{object: crate, impulse: [3000, -9000]}]",
    ),
    ("objects.crate.layer=2",),
    ("world.gravity=[0, -300]",),
    ("world.gravity=[400, 0]",),
    ("objects.ball.shape.circle.radius=6",),
    ("objects.crate=",),
    ("render.relight=false",),
    ("render.shadows=false",),
    ("render.supersample=2",),
    ("render.motion_blur=0.5",),
    ("render.size=[40, 28]", "render.camera=[{time: 0, center: [30, 30], zoom: 1.5}]"),
    ("boundaries.floor.segment=[[-100, 50], [300, 44]]",),
    ("world.tilt=40", "world.backdrop=30"),
    ("objects.crate.shape={box: {center: [57, 35], size: [14, 14]}}",),
    (),
)


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each stage was run."""
    count: Counter[str] = Counter()

    def counted(name: str) -> None:
        real = getattr(stages, name)

        def run(*given: object, **more: object) -> object:
            count[name] += 1
            return real(*given, **more)

        monkeypatch.setattr(stages, name, run)

    for name in ("percepts", "stage", "simulate"):
        counted(name)
    return count


def clip(
    scene: Path, edits: tuple[str, ...], at_hand: Stages | None, cached: bool = False
) -> dict[str, object]:
    out = scene.parent / "out"
    folder = pipeline.render_scene(
        scene,
        out,
        overrides=edits,
        stages=at_hand,
        cached=cached,
        page=pipeline.Page.NONE,
    )
    told: dict[str, object] = json.loads((folder / "manifest.json").read_text())
    return told


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["pictured", "lesson"])
def test_every_clip_is_what_it_would_be_on_its_own(
    kind: str, request: pytest.FixtureRequest
) -> None:
    scene: Path = request.getfixturevalue(kind)
    at_hand = Stages()
    only = ("light", "world.tilt", "objects.ball.shape")
    fitting = [
        e
        for e in EDITS
        if kind == "pictured" or not any(edit.startswith(only) for edit in e)
    ]
    seen = set()
    for edits in fitting:
        told, alone = clip(scene, edits, at_hand), clip(scene, edits, None)
        for part in ("frames", "samples", "files"):
            assert told[part] == alone[part], edits
        seen.add((*told["frames"], *told["samples"]))  # type: ignore[misc]
    assert len(seen) > len(fitting) / 2  # the edits do something


def test_a_light_does_not_simulate_and_a_force_does_not_cut_out(
    pictured: Path, ran: Counter[str]
) -> None:
    at_hand = Stages()
    clip(pictured, (), at_hand)
    assert ran == {"percepts": 1, "stage": 1, "simulate": 1}
    clip(pictured, ("light.intensity=0.2",), at_hand)
    assert ran == {"percepts": 1, "stage": 2, "simulate": 1}
    for edit in (
        "objects.ball.mass=5",
        "objects.*.friction=0.9",
        "objects.ball.velocity=[9, 9]",
        "world.duration=0.3",
    ):
        clip(pictured, ("light.intensity=0.2", edit), at_hand)
    assert ran == {"percepts": 1, "stage": 2, "simulate": 5}
    clip(pictured, ("light.intensity=0.2", "world.duration=0.3"), at_hand)
    assert ran == {"percepts": 1, "stage": 2, "simulate": 5}


@pytest.mark.slow
def test_files_that_are_written_are_read_again(
    pictured: Path, ran: Counter[str]
) -> None:
    at_hand = Stages()
    before = clip(pictured, (), at_hand)
    photo = pictured.with_name("photo.png")
    brighter = np.clip(cv2.imread(str(photo)).astype(int) + 30, 0, 255).astype(np.uint8)
    cv2.imwrite(str(photo), brighter)
    painted = clip(pictured, (), at_hand)
    assert painted["frames"] != before["frames"]
    assert painted["inputs"] != before["inputs"]
    assert painted["frames"] == clip(pictured, (), None)["frames"]
    larger = cv2.resize(brighter, (160, 112))  # the photo, and what else is as large
    masks = cv2.imread(
        str(pictured.parent / "photo.assets" / "masks.png"), cv2.IMREAD_UNCHANGED
    )
    cv2.imwrite(str(photo), larger)
    cv2.imwrite(
        str(pictured.parent / "photo.assets" / "masks.png"),
        cv2.resize(masks, (160, 112), None, 0, 0, cv2.INTER_NEAREST),
    )
    assert clip(pictured, (), at_hand)["video"]["size"] == [160, 112]  # type: ignore[index]
    cv2.imwrite(str(photo), brighter)
    cv2.imwrite(str(pictured.parent / "photo.assets" / "masks.png"), masks)
    times = pictured.stat()
    pictured.write_text(pictured.read_text().replace("mass: 100", "mass: 101"))
    os.utime(pictured, ns=(times.st_atime_ns, times.st_mtime_ns))  # as rsync leaves it
    heavier = clip(pictured, (), at_hand)
    assert heavier["samples"] != before["samples"]
    normals = np.full((56, 80, 3), 128, np.uint8)
    normals[:, :, 0] = 255
    cv2.imwrite(str(pictured.parent / "photo.assets" / "normals.png"), normals)
    assert len(clip(pictured, (), at_hand)["inputs"]) == len(before["inputs"]) + 1  # type: ignore[arg-type]
    base = pictured.parent.with_name("base.yaml")
    base.write_text("physgen: 1\nworld: {duration: 0.1}\nsize: [32, 32]\nobjects: {}\n")
    over = pictured.with_name("over.yaml")
    over.write_text("extends: ../base.yaml\n")
    few = clip(over, (), at_hand)
    base.write_text(base.read_text().replace("0.1", "0.2"))
    assert len(clip(over, (), at_hand)["frames"]) == 2 * len(few["frames"])  # type: ignore[arg-type]
