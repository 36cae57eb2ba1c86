"""Perceiving a scene's photo again: names, masks and prompts stay, new prompts take the place of what they cover."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from written import commented

from physgen import pipeline
from physgen.cli.main import main
from physgen.geometry.scale import slow_motion_comment
from physgen.maps import read_labels, write_png
from physgen.materials import kind
from physgen.perceive.backends import boundary_support
from physgen.perceive.refresh import rewritten
from physgen.pipeline.push_outcomes import ramp_of
from physgen.scene.scene import BoxPrompt, Circle, Scene
from physgen.scene.write import scene_text
from physgen.scene.yaml_edit import written_anew

pytestmark = pytest.mark.slow  # each test perceives a photo, some of them twice


CENTRES = {"ball-1": (60, 70), "ball-2": (150, 75), "ball-3": (240, 70)}
RADIUS = 30


@pytest.fixture(scope="module")
def perceived(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three balls on paper, masks given; the second one's mask is wrong: a bar through its middle."""
    tmp_path = tmp_path_factory.mktemp("perceived")
    y, x = np.mgrid[:140, :300]
    rgb = np.full((140, 300, 3), (190, 186, 176), np.uint8)
    labels = np.zeros((140, 300), np.uint8)
    for k, (cx, cy) in enumerate(CENTRES.values(), 1):
        inside = (x - cx) ** 2 + (y - cy) ** 2 <= RADIUS**2
        rgb[inside] = [(40, 60, 170), (170, 40, 40), (30, 120, 60)][k - 1]
        labels[inside] = k
    labels[labels == 2] = 0
    labels[45:105, 140:150] = 2
    rgb = cv2.GaussianBlur(rgb, (0, 0), 0.7)
    cv2.imwrite(str(tmp_path / "photo.png"), rgb[..., ::-1])
    cv2.imwrite(str(tmp_path / "marked.png"), labels)
    path = tmp_path / "scene.yaml"
    options = ["--masks", str(tmp_path / "marked.png"), "--label", "*=ball"]
    options += ["--view", "side"]
    assert (
        main(["perceive", str(tmp_path / "photo.png"), *options, "-o", str(path)]) == 0
    )
    return tmp_path


@pytest.fixture
def scene(perceived: Path, tmp_path: Path) -> Path:
    """A copy of `perceived` for one test."""
    shutil.copytree(perceived, tmp_path, dirs_exist_ok=True)
    return tmp_path / "scene.yaml"


def refreshed(scene: Path, *options: str) -> tuple[Scene, NDArray[np.uint16]]:
    out = scene.with_name("again.yaml")
    assert main(["perceive", "--refresh", str(scene), *options, "-o", str(out)]) == 0
    loaded = pipeline.load(out)
    assert loaded.assets is not None
    return loaded, read_labels(loaded.assets / "masks.png")


@pytest.mark.slow
def said(path: Path) -> dict:
    """A scene's data but for its assets, a folder of its own."""
    return {
        key: value
        for key, value in yaml.safe_load(path.read_text()).items()
        if key != "assets"
    }


def test_a_box_corrects_the_mask_that_it_covers_and_is_asked_again(scene: Path) -> None:
    before = pipeline.load(scene)
    named = {item.name: item for item in before.objects}
    assert set(named) == {"ball-1", "ball-2", "ball-3"}
    wrong = next(
        name
        for name, item in named.items()
        if not isinstance(item.shape.stored, Circle)
    )  # type: ignore[union-attr]
    x, y = CENTRES["ball-2"]
    box = (x - 33, y - 33, 66, 66)
    after, labels = refreshed(scene, "--box", ",".join(map(str, box)))
    assert [item.name for item in after.objects] == [
        item.name for item in before.objects
    ]
    now = {item.name: item for item in after.objects}
    assert now[wrong].prompt == BoxPrompt(tuple(map(float, box)))  # type: ignore[arg-type]
    assert now[wrong].label == "ball"
    rows, columns = np.mgrid[:140, :300]
    ball = (columns - x) ** 2 + (rows - y) ** 2 <= RADIUS**2
    found = labels == now[wrong].mask.id  # type: ignore[union-attr]
    assert (found & ball).sum() / (found | ball).sum() > 0.9
    for name in set(now) - {wrong}:
        assert now[name].prompt is None
        assert now[name].provenance["mask"] == named[name].provenance["mask"]
    again = scene.with_name("again.yaml").rename(scene.with_name("once.yaml"))
    refreshed(again)
    assert said(scene.with_name("again.yaml")) == said(again)


@pytest.mark.slow
def test_what_was_held_by_a_wrong_mask_moves_with_a_right_one(
    perceived: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A mask that reaches the photo's border is cut off by it, and held; by a box in the photo's middle it is not."""
    labels = np.zeros((140, 300), np.uint8)
    labels[45:, 135:165] = 1
    cv2.imwrite(str(tmp_path / "marked.png"), labels)
    path, (x, y) = tmp_path / "scene.yaml", CENTRES["ball-2"]
    options = [
        "--masks",
        str(tmp_path / "marked.png"),
        "--label",
        "*=ball",
        "-o",
        str(path),
    ]
    assert main(["perceive", str(perceived / "photo.png"), *options]) == 0
    [(name, held)] = yaml.safe_load(path.read_text())["objects"].items()
    assert held["motion"] == "static"
    box = ["--box", f"{x - 33},{y - 33},66,66"]
    still = tmp_path / "still.yaml"
    assert (
        main(["perceive", "--refresh", str(path), *box, "--still", "-o", str(still)])
        == 0
    )
    assert not any(any(one.velocity) for one in pipeline.load(still).objects)
    capsys.readouterr()
    assert main(["perceive", "--refresh", str(path), *box]) == 0
    now = yaml.safe_load(path.read_text())["objects"][name]
    assert "motion" not in now
    assert any(now["velocity"]), (
        "nothing moved before, and it is pushed as a new scene would push it"
    )
    assert "so it is held" not in path.read_text()
    (pushed,) = pipeline.load(path).objects
    assert np.hypot(*pushed.velocity) > 10
    assert "is pushed to the " in capsys.readouterr().err


def bar_and_ball(perceived: Path, tmp_path: Path, *options: str) -> Path:
    """The first ball and the bar through the second one, with guessed labels."""
    labels = read_labels(perceived / "marked.png")
    cv2.imwrite(
        str(tmp_path / "marked.png"), np.where(labels > 2, 0, labels).astype(np.uint8)
    )
    path = tmp_path / "scene.yaml"
    masks = ["--masks", str(tmp_path / "marked.png")]
    assert (
        main(
            [
                "perceive",
                str(perceived / "photo.png"),
                *masks,
                *options,
                "-o",
                str(path),
            ]
        )
        == 0
    )
    return path


def box_of(name: str) -> str:
    x, y = CENTRES[name]
    return f"{x - 33},{y - 33},66,66"


@pytest.mark.slow
def test_labels_follow_new_boxes_names_beat_patterns_and_both_reach_new_objects(
    perceived: Path, tmp_path: Path
) -> None:
    path = bar_and_ball(perceived, tmp_path)
    bar = next(item for item in pipeline.load(path).objects if item.name != "ball-1")
    assert bar.label != "ball"
    after, _ = refreshed(path, "--box", box_of("ball-2"))
    assert {item.name: item.label for item in after.objects} == {
        "ball-1": "ball",
        bar.name: "ball",
    }
    labels = ["--label", "ball-1=tennis ball", "--label", "*=billiard ball"]
    after, _ = refreshed(path, "--box", box_of("ball-3"), *labels)
    named = {item.name: item.label for item in after.objects}
    assert named == {
        "ball-1": "tennis ball",
        bar.name: "billiard ball",
        "billiard-ball-1": "billiard ball",
    }


@pytest.mark.slow
def test_what_is_pointed_at_and_would_fall_is_held(
    perceived: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """By a backend that finds the photo's bottom alone; what is in the scene already may have been let go."""
    path = bar_and_ball(perceived, tmp_path, "--label", "*=ball")
    path.write_text(path.read_text().replace("view: top", "view: side"))
    monkeypatch.setattr(
        boundary_support,
        "add_supports",
        lambda _, walls, *more: (walls[:1], frozenset()),
    )
    after, _ = refreshed(path, "--box", box_of("ball-3"))
    assert [item.motion.value for item in after.objects] == [
        "dynamic",
        "dynamic",
        "static",
    ]
    assert "held where they are: ball-3" in capsys.readouterr().err


def parts(text: str) -> dict[str, str]:
    """Lines of each object, and of the rest."""
    rest, *objects = re.split(r"^  (?=ball-\d:)", text, flags=re.M)
    last, _, after = objects[-1].partition("\nboundaries:")
    return {one[:6]: one for one in [*objects[:-1], last + "\n"]} | {
        "rest": rest + after
    }


def test_a_box_replaces_an_object_leaves_all_others_and_sums_up(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = next(
        item.name
        for item in pipeline.load(scene).objects
        if not isinstance(item.shape.stored, Circle)  # type: ignore[union-attr]
    )
    region = read_labels(scene.with_name("scene.assets") / "masks.png")
    region[60:90, 155:178] = 9  # a doubtful part of the ball whose mask is a bar
    write_png(scene.with_name("scene.assets") / "masks.png", region)
    scene.write_text(
        scene.read_text().rstrip()
        + "\ndoubtful:\n  maybe-1: {mask: 9, confidence: 0.3}\n"
    )
    before = parts(scene.read_text())
    x, y = CENTRES["ball-2"]
    capsys.readouterr()
    refreshed(scene, "--box", f"{x - 33},{y - 33},66,66")
    first, *more = capsys.readouterr().err.splitlines()
    assert first.startswith(f"{scene}: 3 objects, confidence ")
    assert "; suitability: " in first
    assert [line.split()[0] for line in more][:2] == ["objects", "scale"]
    after = parts(scene.with_name("again.yaml").read_text())
    assert after.keys() == before.keys()
    assert {name for name in before if after[name] != before[name]} == {wrong, "rest"}
    assert "  # pointed at 0." in after[wrong]
    assert "  # given 1, " not in after[wrong]
    assert "maybe-1" not in after["rest"], "it is part of the object now"


def test_comments_on_how_many_there_are_follow_a_new_box(scene: Path) -> None:
    x, y = CENTRES["ball-3"]
    before = scene.read_text()
    third = next(
        item.name
        for item in pipeline.load(scene).objects
        if item.shape.stored.center[0] > 200
    )  # type: ignore[union-attr]
    assert main(["remove", str(scene), third]) == 0
    two = scene.with_name("two.yaml")
    assert main(["perceive", "--refresh", str(scene), "-o", str(two)]) == 0
    assert "3 x ball" in before
    refreshed(two, "--box", f"{x - 33},{y - 33},66,66")
    text = scene.with_name("again.yaml").read_text()
    assert ", as the scene had them, and where you pointed, counted" in text
    assert "given, counted" not in text
    assert all(
        line.count("under ") + line.count("lowest points") <= 2
        for line in text.splitlines()
    )


def test_what_a_person_wrote_stays(scene: Path) -> None:
    document = yaml.safe_load(scene.read_text())
    del document["objects"]["ball-3"]
    document["world"]["pixels_per_meter"] = 640
    document["objects"]["ball-1"] |= {
        "label": "steel ball",
        "velocity": [120, 0],
        "mass": 77,
    }
    document["forces"] = [{"object": "ball-1", "impulse": [10, 0]}]
    document["render"] = {"frames": 5}
    scene.write_text(yaml.safe_dump(document))
    x, y = CENTRES["ball-2"]
    out = scene.with_name("again.yaml")
    assert (
        main(
            [
                "perceive",
                "--refresh",
                str(scene),
                "--box",
                f"{x - 33},{y - 33},66,66",
                "-o",
                str(out),
            ]
        )
        == 0
    )
    after = yaml.safe_load(out.read_text())
    steel = kind("steel ball").material
    surface = {
        "friction": steel.friction,
        "elasticity": steel.elasticity,
        "rolling": steel.rolling,
    }
    now = after["objects"]["ball-1"]
    assert "mass" not in pipeline.load(out).objects[0].provenance
    assert now == {**document["objects"]["ball-1"], **surface}
    assert list(after["objects"]) == ["ball-1", "ball-2"]
    assert (
        len(np.unique(read_labels(scene.with_name("again.assets") / "masks.png"))) == 4
    ), "to be filled"
    assert (after["forces"], after["render"]) == (
        document["forces"],
        document["render"],
    )
    assert after["world"] == document["world"]
    anew, before = after["objects"]["ball-2"], document["objects"]["ball-2"]
    assert anew["label"] == "ball"
    assert "shape" not in {**anew, **before}, "it lies in the assets"
    shapes = (
        json.loads((scene.parent / f"{n}.assets/outlines.json").read_text())
        for n in ("scene", "again")
    )
    assert len({json.dumps(one[str(anew["mask"])]["shape"]) for one in shapes}) == 2
    assert anew["mask"] == before["mask"]


@pytest.mark.slow
def test_doubts_stay_and_can_be_switched_on(scene: Path) -> None:
    first = scene.with_name("first.yaml")
    labels = read_labels(scene.parent / "scene.assets" / "masks.png")
    labels[5:25, 5:30] = 9
    write_png(scene.parent / "scene.assets" / "masks.png", labels)
    doubt = "doubtful:\n  maybe-3: {mask: 9, confidence: 0.2}\n"
    scene.write_text(scene.read_text() + doubt)
    refreshed(scene)
    text = scene.with_name("again.yaml").read_text()
    assert "  maybe-3: {mask: 9, confidence: 0.2}" in text
    moved = re.sub(r"doubtful:.*\n  (maybe-3.*\n)", "", text).replace(
        "boundaries:", doubt[10:] + "boundaries:", 1
    )
    scene.with_name("again.yaml").write_text(moved)
    assert (
        main(
            [
                "perceive",
                "--refresh",
                str(scene.with_name("again.yaml")),
                "-o",
                str(first),
            ]
        )
        == 0
    )
    on = yaml.safe_load(first.read_text())["objects"]["maybe-3"]
    assert on["mass"] > 0
    assert on["mask"] == 9
    assert "confidence" not in on
    entry = first.read_text().partition("\n  maybe-3:\n")[2].partition("boundaries:")[0]
    assert re.search(r"^    mask: 9  # doubtful 0\.2, \w", entry, re.M), (
        "as sure as it was"
    )
    assert re.search(r"^    mass: \S+  # g, ", entry, re.M)
    assert (
        "objects:  # 3 x ball, 1 x block, as the scene had them, counted"
        in first.read_text()
    )


@pytest.mark.slow
def test_a_label_edited_by_hand_brings_its_numbers_and_a_second_refresh_changes_nothing(
    scene: Path,
) -> None:
    before = yaml.safe_load(scene.read_text())
    document = yaml.safe_load(scene.read_text())
    document["objects"]["ball-1"]["label"] = "steel ball"
    document["objects"]["ball-3"]["from"] = {}
    document["objects"]["ball-3"]["label"] = "steel ball"
    scene.write_text(yaml.safe_dump(document))
    refreshed(scene)
    first = said(scene.with_name("again.yaml"))
    steel, rubber = kind("steel ball"), kind("ball")
    ball, was = first["objects"]["ball-1"], before["objects"]["ball-1"]
    assert ball["mass"] > 3 * was["mass"]
    assert (ball["friction"], was["friction"]) == (
        steel.material.friction,
        rubber.material.friction,
    )
    assert (
        first["objects"]["ball-3"] == document["objects"]["ball-3"]
    )  # nobody else said its numbers
    assert first["objects"]["ball-2"] == before["objects"]["ball-2"]
    again = scene.with_name("again.yaml").rename(scene.with_name("once.yaml"))
    refreshed(again)
    assert said(scene.with_name("again.yaml")) == first


@pytest.mark.parametrize(
    "edit",
    [
        ("    label: ball", "    label: steel ball"),  # another material
        (
            "    label: ball",
            "    label: billiard ball",
        ),  # of a known size, which gives the scale
        ("pixels_per_meter: 600", "pixels_per_meter: 300"),
        ("pixels_per_meter: 600", "pixels_per_meter: 3 px/cm"),
        ("    mass: ", "    label: steel ball\n    mass: 1"),
    ],
)
def test_a_changed_label_or_scale_counts_at_once_as_after_a_refresh(
    edit: tuple[str, str], scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = scene.read_text()
    if "steel ball\n" in edit[1]:  # a mass that the user sets, too, stays
        text = text.replace("    label: ball  # as you named it\n", "", 1).replace(
            "    label: ball\n", "", 1
        )
    scene.write_text(text.replace(*edit, 1))
    assert scene.read_text() != text
    assert main(["check", str(scene), "--strict"]) == 2
    said = capsys.readouterr().err
    assert "perceive --refresh writes them" in said
    by_labels = "is the scale by the changed labels, not the 600 px/m of this line"
    assert (by_labels in said) is ("billiard" in edit[1])
    at_once = pipeline.load(scene)
    after, _ = refreshed(scene)
    assert main(["check", str(scene.with_name("again.yaml")), "--strict"]) == 0
    assert at_once.world == after.world
    assert at_once.render == after.render
    for one, other in zip(at_once.objects, after.objects, strict=True):
        assert one.mass == pytest.approx(other.mass, rel=0.01), (
            "outlines have 0.01 px in the file"
        )
        for key in (
            "label",
            "friction",
            "elasticity",
            "rolling",
            "solid",
            "velocity",
            "provenance",
        ):
            assert getattr(one, key) == getattr(other, key), (one.name, key)


@pytest.mark.parametrize(
    "speed",
    [None, "0.2 m/s", "1 m/s"],
    ids=["as perceived", "pushed gently", "pushed harder"],
)
def test_a_perceived_clip_ends_at_rest_whatever_is_pushed(
    perceived: Path, speed: str | None
) -> None:
    edits = (
        []
        if speed is None
        else ["objects.*.velocity=[0, 0]", f"objects.ball-1.velocity=[{speed}, 0]"]
    )
    scene = pipeline.load(perceived / "scene.yaml", edits)
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    poses = pipeline.simulate(world).poses
    assert np.ptp(poses[..., :2], axis=0).max() > 5
    assert np.ptp(poses[-5:, :, :2], axis=0).max() < 1
    assert world.duration < 8


def test_what_a_model_judged_follows_a_label_and_no_scale(scene: Path) -> None:
    """A mass of `vlm` is that of the object that the label named; at another scale it is the same object."""
    record = scene.parent / "scene.assets" / "perceived.json"
    record.write_text(
        record.read_text().replace('"mass": "table 0.', '"mass": "vlm 0.')
    )
    before = pipeline.load(scene).objects
    assert all(item.provenance["mass"].startswith("vlm ") for item in before)
    larger = pipeline.load(scene, ["world.pixels_per_meter=300"]).objects
    assert [item.mass for item in larger] == [item.mass for item in before]
    scene.write_text(scene.read_text().replace("label: ball", "label: steel ball", 1))
    at_once, after = pipeline.load(scene).objects, refreshed(scene)[0].objects
    changed = [k for k, item in enumerate(at_once) if item.label == "steel ball"]
    assert changed != []
    for k, (one, other) in enumerate(zip(at_once, after, strict=True)):
        assert (one.mass > 3 * before[k].mass) is (k in changed)
        if k in changed:
            assert one.mass == pytest.approx(other.mass, rel=0.01)
            assert one.provenance == other.provenance


def test_masses_go_with_the_cube_of_the_scale_and_pushes_keep_their_pace(
    scene: Path,
) -> None:
    scene.write_text(scene.read_text().replace("label: ball", "label: steel ball"))
    large, small = (
        pipeline.load(scene, [f"world.pixels_per_meter={n}"]) for n in (300, 1200)
    )
    for one, other in zip(large.objects, small.objects, strict=True):
        if isinstance(one.shape.stored, Circle):  # type: ignore[union-attr]
            radius = one.shape.stored.radius / 3  # type: ignore[union-attr]
            assert one.mass == pytest.approx(7.85 * 4 / 3 * np.pi * radius**3, rel=0.01)
            assert one.mass == pytest.approx(64 * other.mass, rel=0.01)
        assert np.hypot(*other.velocity) == pytest.approx(
            2 * np.hypot(*one.velocity), rel=0.01
        )
    assert large.world.gravity[1] * 4 == pytest.approx(small.world.gravity[1])
    assert any(any(item.velocity) for item in small.objects)


def test_numbers_of_the_user_follow_neither_label_nor_scale(scene: Path) -> None:
    document = yaml.safe_load(scene.read_text())
    document["world"]["duration"] = 1.5
    own = {
        "mass": 77,
        "friction": 0.11,
        "elasticity": 0.22,
        "rolling": 0.03,
        "velocity": ["1 m/s", 0],
    }
    document["objects"]["ball-1"] |= own
    del document["objects"]["ball-3"]["mass"]
    scene.write_text(yaml.safe_dump(document))
    edits = ["objects.*.label=steel ball", "world.pixels_per_meter=250"]
    for path in (scene, scene.with_name("again.yaml")):
        changed = pipeline.load(path, edits)
        assert changed.world.duration == 1.5
        ball = changed.objects[0]
        assert {key: getattr(ball, key) for key in own} == {**own, "velocity": (250, 0)}
        assert changed.objects[2].mass is None
        assert changed.objects[1].friction == kind("steel ball").material.friction
        if path == scene:
            refreshed(scene)  # its record knows the user's numbers still


def test_what_an_override_or_a_file_on_top_says_does_not_follow(scene: Path) -> None:
    mass = yaml.safe_load(scene.read_text())["objects"]["ball-1"]["mass"]
    steel, scale = "objects.ball-1.label=steel ball", "world.pixels_per_meter=300"
    assert pipeline.load(scene, [steel, scale]).objects[0].mass != pytest.approx(mass)
    assert (
        pipeline.load(scene, [steel, scale, f"objects.ball-1.mass={mass}"])
        .objects[0]
        .mass
        == mass
    )
    top = scene.with_name("top.yaml")
    changed = f"objects: {{ball-1: {{label: steel ball, mass: {mass}}}}}"
    top.write_text(
        f"extends: {scene.name}\n{changed}\nworld: {{pixels_per_meter: 300}}\n"
    )
    assert pipeline.load(top).objects[0].mass == mass


@pytest.mark.slow
def test_labels_beside_a_refresh_keep_names_and_bring_the_scale(scene: Path) -> None:
    before = yaml.safe_load(scene.read_text())
    assert before["world"]["pixels_per_meter"] == 600
    refreshed(scene, "--label", "ball-1=billiard ball")
    after = said(scene.with_name("again.yaml"))
    assert list(after["objects"]) == list(before["objects"])
    ball = after["objects"]["ball-1"]
    assert (ball["label"], ball["mass"]) == ("billiard ball", 170)
    assert after["world"]["pixels_per_meter"] == pytest.approx(
        2 * RADIUS / 0.05715, rel=0.02
    )
    assert after["objects"]["ball-3"]["mass"] != before["objects"]["ball-3"]["mass"]
    again = scene.with_name("again.yaml").rename(scene.with_name("once.yaml"))
    refreshed(again)
    assert said(scene.with_name("again.yaml")) == after


@pytest.mark.slow
def test_a_scale_that_motions_were_made_for_stays(scene: Path) -> None:
    document = yaml.safe_load(scene.read_text())
    document["forces"] = [{"object": "ball-1", "impulse": [10, 0]}]
    scene.write_text(yaml.safe_dump(document))
    after, _ = refreshed(scene, "--label", "*=billiard ball")
    assert after.world.pixels_per_meter == 600
    (mass,) = {
        item.mass for item in after.objects if isinstance(item.shape.stored, Circle)
    }  # type: ignore[union-attr]
    assert mass > 500, "a ball of 10 cm: masses have the scene's scale"
    del document["forces"]
    for velocity, stays in (
        ([120, 0], True),
        (["20 cm/s", 0], False),
    ):  # which is 20 cm/s at any scale
        document["objects"]["ball-1"]["velocity"] = velocity
        scene.write_text(
            yaml.safe_dump(document).replace("label: ball", "label: billiard ball")
        )
        assert (pipeline.load(scene).world.pixels_per_meter == 600) is stays
        assert (refreshed(scene)[0].world.pixels_per_meter == 600) is stays


def test_a_scene_is_refreshed_in_place(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = scene.read_text()
    scene.write_text(before + "# mine\n")
    capsys.readouterr()
    assert main(["perceive", "--refresh", str(scene)]) == 0
    assert capsys.readouterr().out == f"{scene}\n"
    assert "# mine" in scene.read_text()
    assert [folder.name for folder in scene.parent.glob("*.assets")] == ["scene.assets"]
    masks = next(scene.parent.glob("*/masks.png"))
    masks.write_bytes(masks.read_bytes()[:80])
    assert main(["perceive", "--refresh", str(scene)]) == 2
    assert (
        f'"{masks.parent.name}/masks.png" is not a picture' in capsys.readouterr().err
    )


@pytest.mark.parametrize("again", [["--refresh"], []])
def test_the_scene_that_is_kept_shows_the_masks_that_it_had(
    again: list[str], scene: Path
) -> None:
    """A box gives the bar's object a ball's pixels; the scene of before still has the bar."""
    x, y = CENTRES["ball-2"]
    before = pipeline.percepts(pipeline.load(scene))
    options = (
        [*again, str(scene)]
        if again
        else [str(scene.with_name("photo.png")), "-o", str(scene)]
    )
    assert main(["perceive", *options, "--box", f"{x - 33},{y - 33},66,66"]) == 0
    kept = scene.with_name("scene.yaml~").rename(scene.with_name("kept.yaml"))
    assert before is not None
    for path, least, most in (
        (kept, 550, 650),
        (scene, 2500, 3000),
    ):  # px: 60 x 10, and pi 30^2 = 2827
        maps = pipeline.percepts(pipeline.load(path))
        assert maps is not None
        middle = maps.labels[y, x - 5]
        assert least < np.count_nonzero(maps.labels == middle) < most
        assert np.array_equal(maps.background, before.background) == (path == kept)


def test_no_new_scene_takes_the_assets_of_another(scene: Path) -> None:
    """After a refresh scene.yaml has its maps in scene-2.assets; a scene-2.yaml beside it gets other ones."""
    assert main(["perceive", "--refresh", str(scene), "--label", "ball-1=apple"]) == 0
    before = pipeline.percepts(pipeline.load(scene))
    other = ["perceive", str(scene.with_name("photo.png")), "--box", "20,20,80,80"]
    assert main([*other, "-o", str(scene.with_name("scene-2.yaml"))]) == 0
    after = pipeline.percepts(pipeline.load(scene))
    assert before is not None
    assert after is not None
    assert np.array_equal(before.labels, after.labels)


def test_a_scene_on_stdout_takes_no_assets_of_another(
    scene: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`> other.yaml` twice beside photo.yaml, which has the photo's name: its second run goes into its own maps."""
    monkeypatch.chdir(scene.parent)
    assert (
        main(["perceive", "photo.png", "--box", "20,20,80,80", "-o", "photo.yaml"]) == 0
    )
    before = pipeline.percepts(pipeline.load("photo.yaml"))
    other = Path("other.yaml")
    for box in ("110,30,80,90", "200,30,80,80"):
        other.write_text("")  # by the shell
        capsys.readouterr()
        assert main(["perceive", "photo.png", "--box", box]) == 0
        other.write_text(capsys.readouterr().out)
        assert main(["check", "photo.yaml", "other.yaml"]) == 0
        after = pipeline.percepts(pipeline.load("photo.yaml"))
        assert before is not None
        assert after is not None
        assert np.array_equal(before.labels, after.labels)
        assert "assets: photo-2.assets\n" in other.read_text()


def test_a_view_stays_as_sure_as_it_was_and_the_user_s_is_sure(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = scene.parent / "scene.assets" / "perceived.json"
    wrote = json.loads(record.read_text())
    wrote["world"]["view_from"] = "there are few cues 0.52"
    record.write_text(json.dumps(wrote))
    x, y = CENTRES["ball-2"]
    box = ["--box", f"{x - 33},{y - 33},66,66"]
    for _ in range(2):  # the record that is written is as true
        capsys.readouterr()
        assert main(["perceive", "--refresh", str(scene), *box]) == 0
        summed = capsys.readouterr().err
        assert "the view is uncertain" in summed
        assert "side: there are few cues (confidence 0.52)" in summed
        box = []
    scene.write_text(scene.read_text().replace("view: side", "view: top"))
    assert main(["perceive", "--refresh", str(scene)]) == 0
    summed = capsys.readouterr().err
    assert "view is uncertain" not in summed
    assert "top: as given (confidence 1)" in summed
    assert "  view: top  # side or top: as given (confidence 1)\n" in scene.read_text()


def test_a_boundary_with_more_points_is_laid_out_as_in_a_new_file() -> None:
    old, new = (
        {
            "boundaries": {
                "floor": {
                    "polyline": [[k + 0.25, 2 * k + 0.75] for k in range(n)],
                    "friction": 0.6,
                }
            }
        }
        for n in (2, 14)
    )
    assert written_anew(
        scene_text(old), ("boundaries", "floor"), new["boundaries"]["floor"]
    ) == scene_text(new)
    mine = "boundaries:\n  floor: {friction: 0.6,  # mine\n    polyline: [[0, 0], [1, 1]]}\n"
    assert (
        written_anew(mine, ("boundaries", "floor"), new["boundaries"]["floor"]) == mine
    )


def test_doubts_about_a_photo_outlive_a_refresh(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = scene.parent / "scene.assets" / "perceived.json"
    doubt = {
        "verdict": "doubtful",
        "reasons": ["12 % of the photo may be objects, too"],
    }
    record.write_text(
        json.dumps(json.loads(record.read_text()) | {"suitability": doubt})
    )
    assert main(["perceive", "--refresh", str(scene)]) == 0
    assert (
        "suitability: doubtful: 12 % of the photo may be objects, too"
        in capsys.readouterr().err
    )


@pytest.mark.slow
def test_a_small_thing_before_a_large_one(tmp_path: Path) -> None:
    """Boxes in either order; a refresh changes nothing; a box round the small one leaves the large one its name."""
    rgb = np.full((220, 300, 3), (200, 196, 188), np.uint8)
    rgb[30:190, 60:240] = (120, 80, 50)
    cv2.circle(rgb, (150, 140), 30, (40, 60, 190), -1)
    photo = tmp_path / "photo.png"
    cv2.imwrite(str(photo), cv2.GaussianBlur(rgb, (0, 0), 0.7)[..., ::-1])
    block, ball = ("--box", "54,24,192,172"), ("--box", "116,106,68,68")
    ones = [tmp_path / name for name in ("a.yaml", "b.yaml", "c.yaml")]
    assert main(["perceive", str(photo), *block, *ball, "-o", str(ones[0])]) == 0
    assert main(["perceive", str(photo), *ball, *block, "-o", str(ones[1])]) == 0
    counts = [
        np.bincount(
            read_labels(one.with_name(f"{one.stem}.assets") / "masks.png").ravel()
        )[1:]
        for one in ones[:2]
    ]
    assert sorted(counts[0].tolist()) == sorted(counts[1].tolist())
    assert min(counts[0]) > 2000
    assert main(["perceive", "--refresh", str(ones[0]), "-o", str(ones[2])]) == 0
    assert len(pipeline.load(ones[2]).objects) == 2
    assert main(["perceive", str(photo), *block, "-o", str(ones[0])]) == 0
    (large,) = pipeline.load(ones[0]).objects
    assert main(["perceive", "--refresh", str(ones[0]), *ball, "-o", str(ones[2])]) == 0
    assert large.name in {item.name for item in pipeline.load(ones[2]).objects}
    assert len(pipeline.load(ones[2]).objects) == 2
    assert main(["perceive", str(photo), *ball, *ball, "-o", str(ones[1])]) == 2


@pytest.mark.parametrize("flag", ["IMAGE", "--masks", "--side"])
def test_a_scene_tells_its_photo_and_its_masks(
    flag: str, scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = (
        ["photo.png"]
        if flag == "IMAGE"
        else [flag, "300" if flag == "--side" else "x.png"]
    )
    assert main(["perceive", "--refresh", str(scene), *more]) == 2
    assert f"leave {flag} or --refresh out" in capsys.readouterr().err


def test_neither_photo_nor_scene(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["perceive"]) == 2
    assert "--refresh SCENE" in capsys.readouterr().err
    bare = tmp_path / "bare.yaml"
    bare.write_text(
        "physgen: 1\nsize: [64, 48]\nobjects:\n  a: {shape: {circle: {center: [9, 9], radius: 3}}}\n"
    )
    assert (
        main(["perceive", "--refresh", str(bare), "-o", str(tmp_path / "b.yaml")]) == 2
    )
    assert "has no photo" in capsys.readouterr().err


def test_another_view_brings_what_holds_things_in_it_and_keeps_walls_set_by_hand(
    scene: Path,
) -> None:
    ramp = "  ramp: {segment: [[10, 20], [90, 40]], friction: 0.3, elasticity: 0.2}"
    text = scene.read_text()
    first = set(yaml.safe_load(text)["boundaries"])
    other = "top" if "view: side" in text else "side"
    lines = [
        re.sub(r"view: (side|top)", f"view: {other}", line)
        for line in text.splitlines()
    ]
    lines.insert(
        next(k for k, line in enumerate(lines) if line.startswith("boundaries:")) + 1,
        ramp,
    )
    scene.write_text("\n".join(lines) + "\n")
    after, _ = refreshed(scene)
    names = {wall.name for wall in after.boundaries}
    assert "ramp" in names
    assert after.world.view.value == other
    side = names if other == "side" else first
    top = names if other == "top" else first
    assert len(side - {"bottom", "ramp"}) > 0  # floors
    (push,) = [item.velocity for item in after.objects if any(item.velocity)]
    (before,) = re.findall(r"velocity: \[(-?[.\d]+) m/s", text)
    assert (push[1] != 0) == (other == "top"), f"a new push, not {before} m/s"
    assert (
        scene.with_name("again.yaml")
        .read_text()
        .count("the push that sets it off, to the")
        == 1
    )
    assert top == {"ramp"}


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_box_that_replaces_the_pushed_object_in_another_view(
    mirrored: bool, tmp_path: Path
) -> None:
    """A ball that was found as two pieces; the smaller one, which goes, was pushed."""
    y, x = np.mgrid[:140, :200]
    rgb = np.full((140, 200, 3), (190, 186, 176), np.uint8)
    rgb[(x - 100) ** 2 + (y - 75) ** 2 <= RADIUS**2] = (170, 40, 40)
    labels = np.zeros((140, 200), np.uint8)
    labels[50:98, 82:94], labels[80:98, 100:126] = 1, 2
    labels = labels[:, ::-1] if mirrored else labels
    cv2.imwrite(
        str(tmp_path / "photo.png"), cv2.GaussianBlur(rgb, (0, 0), 0.7)[..., ::-1]
    )
    cv2.imwrite(str(tmp_path / "marked.png"), labels)
    scene = tmp_path / "scene.yaml"
    options = ["--masks", str(tmp_path / "marked.png"), "-o", str(scene)]
    assert main(["perceive", str(tmp_path / "photo.png"), *options]) == 0
    other = {"side": "top", "top": "side"}
    scene.write_text(
        re.sub(
            "view: (side|top)",
            lambda found: f"view: {other[found[1]]}",
            scene.read_text(),
        )
    )
    (ball,) = refreshed(scene, "--box", "66,41,68,68")[0].objects
    assert any(ball.velocity), "pushed anew"


def two_blocks(folder: Path) -> Path:
    """Perceive a photo of two blocks on a floor and return its scene."""
    rgb, labels = (
        np.full((140, 300, 3), (190, 186, 176), np.uint8),
        np.zeros((140, 300), np.uint8),
    )
    for k, x in enumerate((60, 200), 1):
        labels[70:110, x : x + 24] = k
        rgb[labels == k] = (170, 40 * k, 40)
    rgb[110:] = (90, 60, 40)
    cv2.imwrite(str(folder / "photo.png"), rgb)
    cv2.imwrite(str(folder / "marked.png"), labels)
    path = folder / "scene.yaml"
    options = ["--masks", str(folder / "marked.png"), "-o", str(path)]
    assert main(["perceive", str(folder / "photo.png"), *options]) == 0
    return path


def with_walls_beside(scene: Path) -> str:
    """Return the text of such a scene with two walls right beside the pushed block."""
    (pushed,) = [item for item in pipeline.load(scene).objects if any(item.velocity)]
    left = 59 if pushed.name.endswith("1") else 199
    walls = "".join(
        f"  mine-{k}: {{segment: [[{left + 25 * k}, 20], [{left + 25 * k}, 109]], elasticity: 0}}\n"
        for k in (0, 1)
    )
    return scene.read_text().replace("boundaries:\n", f"boundaries:\n{walls}")


@pytest.mark.parametrize(
    ("blocked", "mine"), [(True, False), (False, False), (True, True)]
)
def test_a_push_that_moves_nothing_any_more_is_chosen_anew(
    blocked: bool, mine: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two walls that the user drew stand right beside what was pushed. A push that the user wrote stays."""
    path = two_blocks(tmp_path)
    (pushed,) = [item for item in pipeline.load(path).objects if any(item.velocity)]
    text = path.read_text()
    if blocked:
        text = with_walls_beside(path)
    if mine:
        text = re.sub(r"velocity: \[-?[\d.]+ m.*", "velocity: [123, 0]", text)
    path.write_text(text)
    capsys.readouterr()
    now, _ = refreshed(path)
    told = capsys.readouterr().err
    (moved,) = [item for item in now.objects if any(item.velocity)]
    if blocked and not mine:
        assert moved.name != pushed.name
        assert told.count("its push moves nothing now") == 1
        assert f"{moved.name} is pushed to the " in told
    else:
        assert moved.name == pushed.name
        assert moved.velocity == pytest.approx((123, 0) if mine else pushed.velocity)
        assert "moves nothing" not in told


@pytest.mark.slow
def test_a_new_push_of_a_refresh_has_its_own_playback(tmp_path: Path) -> None:
    """As in a new scene: the old slow motion and ramp belong to the old push."""
    path = two_blocks(tmp_path)
    text = with_walls_beside(path)
    data = yaml.safe_load(text)
    slow = data["render"]["slow"]
    path.write_text(text)
    refreshed(path)
    expected = yaml.safe_load((tmp_path / "again.yaml").read_text())
    assert expected["render"]["slow"] == slow, "the push of a block, as before"
    # As written for a longer motion.
    record_path = tmp_path / "scene.assets" / "perceived.json"
    comment = slow_motion_comment(slow)
    longer = slow_motion_comment(slow // 4)
    record_path.write_text(record_path.read_text().replace(comment, longer))
    text = text.replace(comment, longer).replace(f"slow: {slow}", f"slow: {slow // 4}")
    ramp = data["world"]["ramp"]
    path.write_text(text.replace(f"ramp: {ramp}", f"ramp: {ramp_of(slow // 4)} s"))
    refreshed(path)
    now = (tmp_path / "again.yaml").read_text()
    assert yaml.safe_load(now)["render"] == expected["render"]
    assert yaml.safe_load(now)["world"] == expected["world"]
    assert now.count("slowed down") == now.count(comment) == 1


@pytest.mark.slow
def test_playback_of_the_user_outlives_a_new_push(tmp_path: Path) -> None:
    path = two_blocks(tmp_path)
    text = re.sub("slow: [0-9]+", "slow: 3", with_walls_beside(path))
    path.write_text(re.sub("ramp: [0-9.]+ s", "ramp: 0.04 s", text))
    before = {item.name: item.velocity for item in pipeline.load(path).objects}
    now, _ = refreshed(path)
    assert before != {item.name: item.velocity for item in now.objects}
    assert now.document["render"]["slow"] == 3
    assert now.world.ramp == 0.04
    again = (tmp_path / "again.yaml").read_text()
    assert again.count("slowed down") == again.count(slow_motion_comment(3)) == 1


BUNDLED = sorted((Path(__file__).parents[2] / "scenes").glob("*/scene.yaml"))
HEAD = re.compile(r"# yaml-language-server|assets: |maps: ")
"""Lines that name the new maps."""


def test_a_refresh_keeps_the_user_s_lines_and_numbers(scene: Path) -> None:
    text = re.sub(
        r"(  ball-2:\n(?:.*\n)*?    mass: )\S+.*",
        r"\g<1>21 g  # weighed it",
        scene.read_text(),
        count=1,
    )
    scene.write_text(commented(text)[0])
    assert "mass" not in pipeline.load(scene).objects[1].provenance
    assert "mass" in pipeline.load(scene).objects[0].provenance
    refreshed(scene)
    before, after = (
        scene.read_text().splitlines(),
        scene.with_name("again.yaml").read_text().splitlines(),
    )
    mine = [line for line in before if "# mine" in line or "# weighed" in line]
    assert [line for line in after if line in mine] == mine
    assert not list(scene.parent.glob("again.assets/*~"))


def comments_of(text: str) -> list[str]:
    return sorted(
        line.partition("#")[2].strip() for line in text.splitlines() if "#" in line
    )


def test_comments_that_a_user_wrote_or_went_on_with_stay_and_perception_s_follow(
    scene: Path,
) -> None:
    """Of equal balls each says why it weighs what; a label and a mass of the user have no reason of perception."""
    text = scene.read_text()
    lines = [
        f"{line}, and mine {n}" if "  # " in line else line
        for n, line in enumerate(text.splitlines())
    ]
    scene.write_text(
        "\n".join(lines).replace("label: ball", "label: steel ball") + "\n"
    )
    refreshed(scene)
    mine = [words for words in comments_of("\n".join(lines)) if ", and mine" in words]
    after = comments_of(scene.with_name("again.yaml").read_text())
    assert mine == [words for words in after if ", and mine" in words]
    first, rest = text.split("  ball-2:")
    changed = re.sub(
        r"mass: \S+", "mass: 77 g", first.replace("label: ball", "label: glass ball")
    )
    scene.write_text(
        changed + "  ball-2:" + rest.replace("label: ball", "label: steel ball")
    )
    refreshed(scene)
    one, two, three = re.split(
        r"  ball-\d:", scene.with_name("again.yaml").read_text()
    )[1:]
    assert "    label: glass ball\n" in one
    assert "    mass: 77 g\n" in one
    for ball, name in ((one, "glass"), (two, "steel"), (three, "steel")):
        assert f"  # friction of {name}: " in ball
    assert (
        "objects:  # 2 x steel ball, 1 x glass ball, as the scene had them, counted"
        in (scene.with_name("again.yaml").read_text())
    )
    for ball in (two, three):
        mass, volume = (
            float(re.search(pattern, ball)[1])
            for pattern in (r"mass: (\S+)", r": ([\d.]+) cm³")
        )  # type: ignore[index]
        assert mass == pytest.approx(7.85 * volume, rel=0.02)


@pytest.mark.parametrize("spelled", ["170 g", "0.17 kg", "170.0", "1.7e+2"])
def test_a_number_spelled_otherwise_stays(spelled: str, scene: Path) -> None:
    """Also where it is the one that perception finds."""
    text = scene.read_text().replace("label: ball", "label: billiard ball")
    mine = f"mass: {spelled}"
    scene.write_text(re.sub(r"mass: \S+", mine, text))
    refreshed(scene)
    assert scene.with_name("again.yaml").read_text().count(mine) == 3
    assert [item.mass for item in pipeline.load(scene).objects] == [170, 170, 170]


def test_an_edited_label_invents_no_boundary(scene: Path) -> None:
    """Seen from above, billiard balls would have rails at the photo's border."""
    scene.write_text(scene.read_text().replace("view: side", "view: top"))
    assert refreshed(scene)[0].boundaries == ()
    top = scene.with_name("again.yaml").rename(scene.with_name("top.yaml"))
    top.write_text(
        top.read_text()
        .replace("label: ball", "label: billiard ball")
        .replace("again.", "top.")
    )
    scene.with_name("again.assets").rename(scene.with_name("top.assets"))
    top.write_text(re.sub(r"  table: .*\n", "", top.read_text()))
    assert refreshed(top)[0].boundaries == ()
    assert "table:" not in scene.with_name("again.yaml").read_text()


def test_what_was_taken_out_stays_out_of_the_picture(scene: Path) -> None:
    """After a first and a second refresh; the file of before has all objects still."""
    before = scene.read_text()
    y, x = np.mgrid[:140, :300]
    inside = (x - CENTRES["ball-3"][0]) ** 2 + (
        y - CENTRES["ball-3"][1]
    ) ** 2 <= RADIUS**2
    (third,) = (
        item.name
        for item in pipeline.load(scene).objects
        if isinstance(item.shape.stored, Circle) and item.shape.stored.center[0] > 200  # type: ignore[union-attr]
    )
    assert main(["remove", str(scene), third]) == 0
    for _ in range(2):
        assert main(["perceive", "--refresh", str(scene), "-o", str(scene)]) == 0
        made = pipeline.load(scene)
        maps = pipeline.percepts(made)
        assert maps is not None
        seen = maps.background[inside].astype(float)
        assert np.abs(seen - (190, 186, 176)).mean() < 6, "paper, and no ball"
        assert len(made.objects) == 2
    scene.write_text(before)
    assert len(pipeline.compile(pipeline.load(scene), maps).world.bodies) == 3


def test_boundaries_that_a_user_changed_or_took_out_stay_so(scene: Path) -> None:
    before = yaml.safe_load(scene.read_text())
    names = list(before["boundaries"])
    assert len(names) >= 3
    document = yaml.safe_load(scene.read_text())
    mine, gone = names[-2:]
    document["boundaries"][mine]["friction"] = 0.11
    del document["boundaries"][gone]
    scene.write_text(yaml.safe_dump(document))
    others = {**document["boundaries"]}
    x, y = CENTRES["ball-2"]
    for more in ((), ("--box", f"{x - 33},{y - 33},66,66")):
        refreshed(scene, *more)
        after = yaml.safe_load(scene.with_name("again.yaml").read_text())["boundaries"]
        assert after[mine] == document["boundaries"][mine]
        assert set(others) <= set(after) if more else after == others
        ends = [wall["segment"][0] for wall in after.values()]
        assert (
            min(
                np.hypot(*np.subtract(before["boundaries"][gone]["segment"][0], end))
                for end in ends
            )
            > 3
        )


@pytest.mark.slow
@pytest.mark.parametrize("bundled", BUNDLED, ids=lambda path: path.parent.name)
def test_a_refresh_changes_no_line_of_a_scene_written_by_hand(
    bundled: Path, tmp_path: Path
) -> None:
    scene = tmp_path / "scene.yaml"
    shutil.copytree(bundled.parent, tmp_path, dirs_exist_ok=True)
    scene.write_text(commented(bundled.read_text())[0])
    refreshed(scene)
    after = scene.with_name("again.yaml").read_text().splitlines()
    gone = [
        line
        for line in scene.read_text().splitlines()
        if line not in after and not HEAD.match(line)
    ]
    assert gone == []


@pytest.mark.slow
def test_refreshes_keep_the_copied_photo_and_touch_no_file_that_the_record_alone_names(
    perceived: Path, tmp_path: Path
) -> None:
    home, victim = tmp_path / "home", tmp_path / "victim"
    home.mkdir()
    victim.touch()
    scene = home / "scene.yaml"
    masks = ["--masks", str(perceived / "marked.png"), "--still"]
    assert (
        main(["perceive", str(perceived / "photo.png"), "-o", str(scene), *masks]) == 0
    )
    record = home / "scene.assets" / "perceived.json"
    written = json.loads(record.read_text())
    record.write_text(
        json.dumps(
            {**written, "files": written["files"] | {str(victim): 0, "../../victim": 0}}
        )
    )
    assert main(["rename", str(scene), "ball-1", "cue"]) == 0
    text = re.sub(
        r"(cue:(?:\n    .*)*?\n    mass: )\S+",
        r"\g<1>400 g",
        scene.read_text(),
        count=1,
    )
    assert "400 g" in text
    scene.write_text(text)
    for _ in range(2):
        assert main(["perceive", "--refresh", str(scene), "-o", str(scene)]) == 0
        assert main(["check", str(scene)]) == 0
    assert "400 g" in scene.read_text()
    copy = cv2.imread(str(home / "scene.assets" / "photo.png"))
    assert np.array_equal(copy, cv2.imread(str(perceived / "photo.png")))
    assert victim.exists()


def test_show_prints_what_the_scene_uses_and_how_sure_each_object_is(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene.write_text(
        scene.read_text().replace("mask: 2", "mask: 2\n    confidence: 0.27", 1)
    )
    capsys.readouterr()
    assert (
        main(["show", str(scene), "--json", "--set", "objects.ball-1.label=steel ball"])
        == 0
    )
    rows = json.loads(capsys.readouterr().out)["objects"]
    loaded = pipeline.load(scene, ["objects.ball-1.label=steel ball"])
    record = json.loads((scene.parent / "scene.assets" / "perceived.json").read_text())[
        "objects"
    ]
    for row, item in zip(rows, loaded.objects, strict=True):
        assert row["mass_g"] == pytest.approx(item.mass)
        sure = float(record[str(item.mask.id)]["from"]["mask"].split()[-1])  # type: ignore[union-attr]
        assert row["confidence"] == sure
    assert main(["show", str(scene)]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    column = head.index("confidence")
    assert [float(line[column:]) for line in lines] == [
        row["confidence"] for row in rows
    ]


def test_a_configuration_in_the_folder_is_named_and_not_read(
    scene: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(scene.parent)
    command = [
        "perceive",
        "photo.png",
        "--masks",
        "marked.png",
        "--still",
        "-o",
        "new.yaml",
    ]
    said = "physgen.toml: the one in this folder is not read; --config physgen.toml reads it\n"
    assert main(command) == 0
    assert said not in capsys.readouterr().err
    Path("physgen.toml").write_text('[backend]\nphysics = "nonsense"\n')
    assert main(command) == 0
    assert said in capsys.readouterr().err
    assert main([*command, "--config", "physgen.toml"]) == 2
    assert "nonsense" in (err := capsys.readouterr().err)
    assert said not in err


def test_new_keys_are_written_in_one_order() -> None:
    """Keys come as a set, whose order differs from run to run."""
    was = {"mask": 1, "label": "cup"}
    now = {"mass": 200, "friction": 0.4, "label": "mug", "from": {"mass": "table"}}
    keys = ["mass", "friction", "label"]
    merged = [list(rewritten(was, now, order)) for order in (keys, keys[::-1])]
    assert merged[0] == merged[1] == ["mask", "label", "friction", "mass", "from"]
