"""A clip is rendered again: what differs is named, where it begins and by how much; and nothing else is."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.batch.verify import Outcome, Verdict, VerifyRequest, verify
from physgen.cli.main import main
from physgen.export.video import Format
from physgen.simulate.trajectory import read_trajectory

SCENE = """\
physgen: 1
image: photo.png
assets: photo.assets
world: {view: top, duration: 0.5}
objects:
  ball: {mask: 1, shape: {circle: {center: [20, 40], radius: 8}}, solid: sphere, mass: 100, velocity: [70, 0]}
  crate: {mask: 3, shape: {box: {center: [56, 40], size: [14, 16]}}, mass: 200, elasticity: 0.5}
  far: {mask: 2, shape: {circle: {center: [100, 20], radius: 7}}, solid: sphere, mass: 50, velocity: [9, 3]}
light: {direction: [0.3, -0.6, 0.74], intensity: 0.8, ambient: 0.4}
render: {fps: 24}
"""


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`scene.yaml`, its photo, and `out/` with its clip as frames and as a film."""
    home = tmp_path_factory.mktemp("studio") / "desk"
    home.mkdir()
    rng = np.random.default_rng(3)
    picture = rng.integers(90, 110, (64, 128, 3), dtype=np.uint8)
    masks = np.zeros((64, 128), np.uint16)
    y, x = np.mgrid[:64, :128]
    for k, (cx, cy, r) in enumerate(((20, 40, 8), (100, 20, 7)), 1):
        inside = np.hypot(x - cx, y - cy) <= r
        picture[inside] = np.clip(
            np.stack([60 + 9 * (x - cx), 150 + 6 * (y - cy), 200 + 0 * x], -1), 0, 255
        )[inside]
        masks[inside] = k
    masks[32:48, 49:63] = 3
    picture[32:48, 49:63] = (40, 90, 160)
    cv2.imwrite(str(home / "photo.png"), picture)
    (home / "photo.assets").mkdir()
    cv2.imwrite(str(home / "photo.assets" / "masks.png"), masks)
    cv2.imwrite(
        str(home / "photo.assets" / "coverage.png"),
        np.where(masks > 0, 255, 0).astype(np.uint8),
    )
    background = np.where(masks[..., None] > 0, np.uint8(100), picture)
    cv2.imwrite(str(home / "photo.assets" / "background.png"), background)
    (home / "scene.yaml").write_text(SCENE)
    pipeline.render_scene(
        home / "scene.yaml",
        home / "out",
        formats=[Format.MP4, Format.PNG],
        page=pipeline.Page.NONE,
    )
    return home


@pytest.fixture
def desk(studio: Path, tmp_path: Path) -> Path:
    """A copy of one's own."""
    return Path(shutil.copytree(studio, tmp_path / "desk"))


def edit(desk: Path, *changes: tuple[str, str]) -> None:
    path = desk / "scene.yaml"
    text = path.read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path.write_text(text)


def judged(desk: Path, **how: Any) -> Verdict:
    return verify(VerifyRequest(desk / "out" / "desk", **how))


def manifest(desk: Path) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(
        (desk / "out" / "desk" / "manifest.json").read_text()
    )
    return told


def rewrite(desk: Path, change: Callable[[dict[str, Any]], None]) -> None:
    told = manifest(desk)
    change(told)
    (desk / "out" / "desk" / "manifest.json").write_text(json.dumps(told))


def anew(desk: Path) -> Path:
    """The scene as it is now, rendered by the ordinary way elsewhere."""
    return pipeline.render_scene(
        desk / "scene.yaml",
        desk / "anew",
        formats=[Format.PNG],
        page=pipeline.Page.NONE,
        cached=False,
    )


def pictures(folder: Path) -> list[np.ndarray]:
    return [cv2.imread(str(path)) for path in sorted((folder / "frames").glob("*.png"))]


def state(folder: Path) -> dict[str, tuple[int, bytes]]:
    return {
        str(p): (p.stat().st_mtime_ns, p.read_bytes())
        for p in folder.rglob("*")
        if p.is_file()
    }


def test_a_clip_is_equal_to_itself_and_left_alone(desk: Path) -> None:
    before = state(desk)
    found = judged(desk)
    assert found.outcome is Outcome.EQUAL
    assert (found.motion, found.pictures, found.input_changes, found.file_changes) == (
        None,
        None,
        (),
        (),
    )
    assert (
        found.line()
        == f"{desk / 'out' / 'desk'}: equal: 12 samples, 12 frames, 14 files"
    )
    assert state(desk) == before
    assert manifest(desk)["source"] == "../../scene.yaml"


def test_a_mass_names_the_first_sample_and_those_who_touched(desk: Path) -> None:
    edit(desk, ("mass: 200", "mass: 300"))
    found = judged(desk)
    old, new = (
        read_trajectory(f / "trajectory.npz")
        for f in (desk / "out" / "desk", anew(desk))
    )
    names = list(old.names)
    differ = (old.poses != new.poses).any(axis=2) | (
        old.velocities != new.velocities
    ).any(axis=2)
    first = int(np.flatnonzero(differ.any(axis=1))[0])
    touch = old.contacts.touch_pairs.tolist().index(
        sorted([names.index("ball"), names.index("crate")])
    )
    begin = float(old.contacts.touch_times[touch, 0])
    assert found.outcome is Outcome.DIFFERS
    assert found.input_changes == ("scene.yaml has changed",)
    motion = found.motion
    assert motion is not None
    assert motion.sample == first > 1
    assert old.times[first - 1] < begin <= old.times[first] == motion.time
    gaps = np.hypot(*np.moveaxis(new.poses - old.poses, -1, 0)[:2]).max(axis=0)
    assert set(motion.objects) == {"ball", "crate"}
    assert motion.objects == pytest.approx(
        {name: gaps[names.index(name)] for name in motion.objects}
    )
    assert list(motion.objects.values()) == sorted(
        motion.objects.values(), reverse=True
    )
    shown = found.pictures
    assert shown is not None
    a, b = pictures(desk / "out" / "desk"), pictures(desk / "anew" / "desk")
    apart = [bool((x != y).any()) for x, y in zip(a, b, strict=True)]
    assert shown.frame == apart.index(True) >= first
    assert shown.differ == sum(apart)


def test_a_light_changes_pixels_and_no_motion(desk: Path) -> None:
    edit(desk, ("intensity: 0.8", "intensity: 0.5"))
    found = judged(desk)
    old, new = pictures(desk / "out" / "desk"), pictures(anew(desk))
    first = next(
        k for k, (x, y) in enumerate(zip(old, new, strict=True)) if (x != y).any()
    )
    assert first > 0  # the first frame is the photo, whatever the light
    assert (found.outcome, found.motion) == (Outcome.DIFFERS, None)
    assert found.pictures is not None
    assert found.pictures.frame == first


def test_damage_is_told_and_what_the_scene_makes_is_still_compared(desk: Path) -> None:
    film = desk / "out" / "desk" / "video.mp4"
    data = bytearray(film.read_bytes())
    data[len(data) // 2] ^= 1
    film.write_bytes(data)
    (desk / "out" / "desk" / "frames" / "00000.png").unlink()
    found = judged(desk)
    assert found.outcome is Outcome.DIFFERS
    assert found.file_changes == (
        "frames/00000.png is missing",
        "video.mp4 is not as it was written",
    )
    assert (found.motion, found.pictures) == (None, None)


def test_a_motion_that_was_lost_still_differs_from_a_sample_on(desk: Path) -> None:
    edit(desk, ("mass: 200", "mass: 300"))
    whole = judged(desk).motion
    (desk / "out" / "desk" / "trajectory.npz").write_bytes(b"PK\x03\x04 no archive")
    found = judged(desk)
    assert whole is not None
    assert found.motion is not None
    assert (found.motion.sample, found.motion.objects) == (whole.sample, {})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("fps: 24", "fps: 12"), "12 samples then, 6 now"),
        (("duration: 0.5", "duration: 0.75"), "12 frames then, 18 now"),
        (("fps: 24", "fps: 24, size: [64, 32]"), "frames from 0, 12 of 12"),
        (
            ("  far: {mask: 2, ", "  a-near: {mask: 2, "),
            "motion from sample 0 (0.000 s)",
        ),
    ],
)
def test_other_clips_are_compared_as_far_as_they_go(
    desk: Path, change: tuple[str, str], said: str
) -> None:
    edit(desk, change)
    found = judged(desk)
    assert found.outcome is Outcome.DIFFERS
    assert said in found.line()


def test_likely_causes_are_told(desk: Path) -> None:
    for path in (desk / "photo.png", desk / "photo.assets" / "background.png"):
        picture = cv2.imread(str(path))
        picture[60, 60] ^= 64
        cv2.imwrite(str(path), picture)
    rewrite(desk, lambda told: told["versions"].update(numpy="1.0"))
    rewrite(desk, lambda told: told["platform"].update(machine="abacus"))
    found = judged(desk)
    assert found.input_changes == (
        "photo.png has changed",
        "photo.assets/background.png has changed",
    )
    assert found.pictures is not None
    assert (found.motion, found.pictures.frame) == (None, 0)
    assert f"numpy is {np.__version__}, was 1.0, machine is" in found.line()
    (desk / "photo.png").unlink()
    missing = judged(desk)
    assert missing.outcome is Outcome.UNKNOWN
    assert 'image: "photo.png" does not exist' in missing.line()


def test_a_clip_that_was_refined_is_compared_as_it_was_drawn(desk: Path) -> None:
    folder = desk / "out" / "desk"
    shutil.move(folder / "video.mp4", folder / "unrefined.mp4")
    shutil.rmtree(folder / "frames")
    digest = hashlib.sha256((folder / "unrefined.mp4").read_bytes()).hexdigest()

    def refined(told: dict[str, Any]) -> None:
        told.update(
            refine={"backend": "animatediff"},
            unrefined=told["frames"],
            frames=["0" * 64] * 12,
        )
        told.update(files={"unrefined.mp4": digest})

    rewrite(desk, refined)
    found = judged(desk)
    assert found.line() == (
        f"{folder}: equal: 12 samples, 12 frames, 1 file; "
        "refinement was not run again: the clip as it was drawn is compared"
    )


def test_where_the_scene_is(desk: Path, tmp_path: Path) -> None:
    moved = tmp_path / "moved" / "clips"
    shutil.copytree(desk / "out", moved)
    found = verify(VerifyRequest(moved / "desk"))
    assert found.outcome is Outcome.UNKNOWN
    assert [str(p) for p in found.problems] == [
        f"{moved / 'desk' / '../../scene.yaml'}: does not exist; "
        "the clip or the scene was moved; name it with --scene FILE"
    ]
    assert (
        verify(VerifyRequest(moved / "desk", desk / "scene.yaml")).outcome
        is Outcome.EQUAL
    )
    rewrite(desk, lambda told: told.pop("source"))
    assert [str(p) for p in judged(desk).problems] == [
        f"{desk / 'out' / 'desk' / 'manifest.json'}: is damaged: it is not a manifest that can be read; "
        "render the scene again"
    ]


def test_a_manifest_of_nonsense_does_no_harm(desk: Path) -> None:
    rewrite(
        desk, lambda told: told["document"]["objects"]["ball"].update(mass=float("nan"))
    )
    rewrite(desk, lambda told: told["frames"].__setitem__(5, "0" * 64))
    rewrite(
        desk,
        lambda told: told["files"].update(
            {"../../scene.yaml": "0", "/etc/passwd": "0"}
        ),
    )
    found = judged(desk)
    assert found.file_changes == (
        "../../scene.yaml is not a file of the clip",
        "/etc/passwd is not a file of the clip",
    )
    with np.load(desk / "out" / "desk" / "trajectory.npz") as file:
        arrays = {**file, "names": file["names"][:1]}
    np.savez(desk / "out" / "desk" / "trajectory.npz", **arrays)
    edit(desk, ("mass: 200", "mass: 300"))
    assert (motion := judged(desk).motion) is not None
    assert motion.objects == {}


def test_a_tree_by_command(
    desk: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    tree = tmp_path / "tree"
    for name in ("b", "a2", "a10"):
        shutil.copytree(desk, tree / name)
    edit(tree / "a10", ("mass: 200", "mass: 300"))
    (tree / "pwa").mkdir()
    (tree / "pwa" / "manifest.json").write_text('{"name": "a web page"}')
    shutil.copytree(desk / "out", tree / ".hidden")
    assert main(["verify", str(tree)]) == 1
    alone = capsys.readouterr()
    lines = alone.out.splitlines()
    assert [line.split(": ")[:2] for line in lines] == [
        [str(tree / name / "out" / "desk"), outcome]
        for name, outcome in (("a2", "equal"), ("a10", "differs"), ("b", "equal"))
    ]
    assert alone.err == "3 clips: 2 equal, 1 differs\n"
    assert main(["verify", str(tree), str(tree / "b"), "--jobs", "2"]) == 1
    assert capsys.readouterr().out == alone.out
    (tree / "b" / "out" / "desk" / "manifest.json").write_text('{"manifest": 1, "samp')
    assert main(["verify", str(tree / "a2"), str(tree / "b"), "--json"]) == 2
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [item["outcome"] for item in told[:2]] == ["equal", "not verified"]
    assert (
        told[1]["problems"][0]["expected"]
        == "is damaged: it is not a manifest that can be read"
    )
    assert told[2] == {
        "clips": 2,
        "equal": 1,
        "differs": 0,
        "unknown": 1,
        "passed": False,
    }
    assert main(["verify", str(tree / "a2")]) == 0


def test_what_is_no_clip_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    assert main(["verify", str(tmp_path / "empty"), str(tmp_path / "none")]) == 2
    assert capsys.readouterr().err.splitlines() == [
        f"{tmp_path / 'empty'}: has no clip; name a folder that physgen rendered into, e.g. out",
        f"{tmp_path / 'none'}: is not a folder; name folders that were rendered into",
    ]
