"""`render --refine`: scene -> refined clip beside the unrefined one, with a model that is known exactly."""

from __future__ import annotations

import json
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from physgen import registry
from physgen.batch import run
from physgen.cli import main
from physgen.registry import Backend

SCENE = """\
physgen: 1
size: [96, 64]
world: {duration: 0.4}
objects:
  ball: {label: ball, shape: {circle: {center: [30, 20], radius: 9}}, velocity: [60, 0]}
  block: {label: wooden block, shape: {box: {center: [70, 50], size: [24, 20]}}, motion: static}
boundaries:
  floor: {segment: [[0, 60], [96, 60]]}
render: {fps: 20}
refine: {steps: 10, stop: 1}
"""


@pytest.fixture(autouse=True)
def _exact(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A row whose model is Gaussian, and one that fails."""
    more = (
        Backend("refine", "exact", "gaussian:made", "Gaussian data.", takes_setup=True),
        Backend("refine", "broken", "gaussian:broken", "Raises.", takes_setup=True),
    )
    monkeypatch.setattr(registry, "BACKENDS", (*registry.BACKENDS, *more))
    run._refiners.cache_clear()
    monkeypatch.chdir(tmp_path)
    Path("pair.yaml").write_text(SCENE, encoding="utf-8")


def rendered(*flags: str, code: int = 0) -> dict[str, object]:
    assert main.main(["render", "pair.yaml", *flags]) == code
    texts = [
        Path(f"out/pair/{name}.json").read_text(encoding="utf-8")
        for name in ("manifest", "timing")
    ]
    return json.loads(texts[0]) | json.loads(texts[1])


def frames(path: str) -> list[np.ndarray]:
    """What another reader sees."""
    with av.open(path) as file:
        return [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]


def test_the_folder_holds_both_clips_and_tells_how_it_was_made() -> None:
    plain = rendered()
    told = rendered(
        "--refine", "exact", "--set", "refine.strength=0.3", "--set", "refine.seed=7"
    )
    assert told["unrefined"] == plain["frames"]
    assert told["frames"] != plain["frames"]
    assert told["frames"][0] == plain["frames"][0]  # the photo
    assert told["samples"] == plain["samples"]
    refine = told["refine"]
    assert (refine["backend"], refine["revision"], refine["seed"]) == (
        "exact",
        "exact",
        7,
    )
    assert (refine["steps"], refine["steps_run"], refine["steps_fused"]) == (10, 3, 2)
    assert refine["prompt"] == "ball, wooden block"
    assert {"video.mp4", "unrefined.mp4"} <= set(told["files"])
    assert (
        len(frames("out/pair/video.mp4"))
        == len(frames("out/pair/unrefined.mp4"))
        == len(told["frames"])
    )
    assert (
        "refinement" in Path("out/pair/report.html").read_text(encoding="utf-8").lower()
    )


def test_locked_objects_keep_their_pixels() -> None:
    rendered("--refine", "exact", "--format", "png", "--set", "refine.lock=1")
    refined, plain = (
        [cv2.imread(str(file)) for file in sorted(Path("out/pair", name).iterdir())]
        for name in ("frames", "unrefined")
    )
    block = np.s_[42:58, 60:80]
    assert (refined[-1][block] == plain[-1][block]).all()
    assert np.abs(refined[-1].astype(int) - plain[-1])[:30, 60:].mean() > 2


def test_overlays_are_drawn_over_what_was_refined() -> None:
    plain = rendered("--refine", "exact")
    drawn = rendered("--refine", "exact", "--set", "render.overlay=[outlines]")
    assert len(drawn["frames"]) == len(plain["frames"])
    assert drawn["frames"] != plain["frames"]


def test_what_fails_leaves_the_clip_unrefined(
    capsys: pytest.CaptureFixture[str],
) -> None:
    told = rendered("--refine", "broken", code=2)
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 2
    assert (
        '--refine: "broken" failed (RuntimeError: no such luck); see what failed, or choose another backend'
        in said.err
    )
    assert "out/pair: warning: has the clip without refinement" in said.err
    assert told["frames"] == []
    assert "no such luck" in told["refine"]["failed"]
    assert "video.mp4" not in told["files"]
    assert len(frames("out/pair/unrefined.mp4")) == len(told["unrefined"])
    page = Path("out/pair/report.html").read_text(encoding="utf-8")
    assert "no such luck" in page
    assert 'src="unrefined.mp4"' in page


def test_a_scene_without_objects_is_refined_all_over() -> None:
    Path("empty.yaml").write_text(
        "physgen: 1\nsize: [64, 48]\nobjects: {}\nrefine: {backend: exact, steps: 4, stop: 1}\n"
    )
    assert main.main(["render", "empty.yaml", "--set", "world.duration=0.3"]) == 0
    told = json.loads(Path("out/empty/manifest.json").read_text(encoding="utf-8"))
    assert told["refine"]["prompt"] == ""
