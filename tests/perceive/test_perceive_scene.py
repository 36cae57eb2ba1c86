from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen.maps import read_labels
from physgen.perceive import naming
from physgen.perceive.perceive import KnownFacts, perceive
from physgen.perceive.photo_objects import fit_objects
from physgen.perceive.roles import (
    BoundaryGuess,
    Detections,
    PerceivedScene,
    Segments,
    Suitability,
)
from physgen.perceive.scene_files import write_scene
from physgen.perceive.segment.prompts import (
    Segmenter,
    from_masks,
    from_prompts,
    segment_point,
)
from physgen.perceive.summary import summary
from physgen.photometry import DistantLight
from physgen.photos import read_image
from physgen.problems import InputError
from physgen.registry import Backends
from physgen.scene.load import load
from physgen.scene.scene import Auto, Box, Circle, Motion, Solid, View
from tests.perceive.lambertian import (
    ball,
    beyond_halos,
    overlap,
    rendered,
    setting,
    towards,
)


def desk() -> tuple[np.ndarray, np.ndarray]:
    """A ball and two blocks on a table, and a block that the photo's border cuts off."""
    height, width = 150, 220
    rgb = np.full((height, width, 3), (110, 130, 160), np.float32)
    rgb[110:] = (140, 100, 70)
    labels = np.zeros((height, width), np.uint16)
    y, x = np.mgrid[:height, :width]
    labels[np.hypot(x - 40, y - 99) <= 20] = 7
    labels[80:120, 90:110] = 300
    labels[90:120, 150:190] = 2
    labels[70:120, 205:] = 65535
    for i, colour in (
        (7, (200, 40, 40)),
        (300, (220, 200, 90)),
        (2, (60, 140, 60)),
        (65535, (240, 240, 240)),
    ):
        rgb[labels == i] = colour
    rgb = cv2.GaussianBlur(rgb, (0, 0), 0.6) + np.random.default_rng(0).normal(
        0, 2, rgb.shape
    )
    return np.clip(rgb, 0, 255).astype(np.uint8), labels


STAGES: list[str] = []


@pytest.fixture(scope="module")
def seen() -> PerceivedScene:
    """The desk, perceived with its masks."""
    rgb, labels = desk()
    return perceive(
        rgb,
        from_masks(labels),
        progress=lambda stage, done, total: STAGES.append(stage),
    )


def test_a_photo_becomes_a_valid_scene(seen: PerceivedScene, tmp_path: Path):
    assert STAGES == [
        "label",
        "physics",
        "boundary",
        "normals",
        "intrinsic",
        "light",
        "shadow",
        "inpaint",
    ]
    cv2.imwrite(str(tmp_path / "photo.png"), seen.percepts.rgb[..., ::-1])
    write_scene(seen, tmp_path / "photo.png", "photo", tmp_path / "scene.yaml")
    scene = load(tmp_path / "scene.yaml")
    assert scene.world.view is View.SIDE
    assert scene.world.gravity == (0, pytest.approx(9.8 * scene.world.pixels_per_meter))
    assert [o.name for o in scene.objects] == [
        "ball-1",
        "block-1",
        "block-2",
        "block-3",
    ]
    ball, first, _, last = scene.objects
    assert isinstance(ball.shape, Auto)
    assert isinstance(ball.shape.stored, Circle)
    assert ball.shape.stored.center == pytest.approx((40, 99), abs=0.3)
    assert ball.shape.stored.radius == pytest.approx(20, abs=0.4)
    assert ball.solid is Solid.SPHERE
    assert isinstance(first.shape, Auto)
    assert isinstance(first.shape.stored, Box)
    assert last.motion is Motion.STATIC
    assert ball.motion is Motion.DYNAMIC
    assert ball.provenance["mask"] == "given 1"
    assert ball.provenance["mass"].startswith("table 0.")
    assert [b.name for b in scene.boundaries] == ["bottom", "floor"]
    text = (tmp_path / "scene.yaml").read_text()
    assert "cut off by the photo's border" in text
    assert "velocity: [0, 0]" in text
    first, *more = summary(seen)
    assert first.startswith(f"{len(scene.objects)} objects, confidence ")
    assert [line.split()[0] for line in more] == [
        "objects",
        "scale",
        "view",
        "support",
        "motion",
    ]
    assert all(
        item.name in more[3] for item in scene.objects if item.motion is Motion.STATIC
    )
    regions = {"cup-2": {"mask": 7}}  # the user's: no object
    assert summary(replace(seen, document=seen.document | {"doubtful": regions})) == [
        first,
        *more,
    ]
    regions |= {"maybe-3": {"mask": 8, "confidence": 0.3}}
    *_, doubt = summary(replace(seen, document=seen.document | {"doubtful": regions}))
    assert (
        "1 region may be an object, too: to use one, move maybe-3 to objects" in doubt
    )


def test_a_good_photo_of_an_unsure_object_says_where_to_look(seen: PerceivedScene):
    objects = seen.document["objects"]
    torn = objects["block-2"] | {
        "from": objects["block-2"]["from"] | {"mask": "learned 0.6"}
    }
    unsure = seen.document | {"objects": objects | {"block-2": torn}}
    for reasons, told in (
        ((), "good, but look at block-2"),
        (("outdoors",), "doubtful: outdoors"),
    ):
        made = replace(seen, document=unsure, suitability=Suitability(reasons))
        assert summary(made)[0].endswith(f"; suitability: {told}")
    assert summary(replace(seen, suitability=Suitability(())))[0].endswith(
        "; suitability: good"
    )


def test_percepts_agree_with_each_other(seen: PerceivedScene):
    (rgb, labels), percepts = desk(), seen.percepts
    assert np.array_equal(percepts.rgb, rgb)
    assert np.array_equal(percepts.labels, labels)
    assert percepts.background is not None
    far = beyond_halos(percepts.coverage)
    assert np.array_equal(percepts.background[far], rgb[far])
    assert (percepts.coverage[labels == 7] > 0).all()


@pytest.mark.slow
def test_the_photo_without_masks_is_segmented(bundled: Path):
    rgb = read_image(bundled / "dominoes" / "photo.png")
    truth = read_labels(bundled / "dominoes" / "photo.assets" / "masks.png")
    found = perceive(rgb)
    assert abs(len(found.document["objects"]) - len(np.unique(truth)) + 1) <= 1
    assert all(
        o["from"]["mask"].startswith("learned ")
        for o in found.document["objects"].values()
    )
    assert found.document["world"]["view"] == "side"


def test_the_bundled_billiards_are_seen_from_above(bundled: Path):
    rgb = read_image(bundled / "billiards" / "photo.png")
    labels = read_labels(bundled / "billiards" / "photo.assets" / "masks.png")
    small = cv2.resize(rgb, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    found = perceive(small, from_masks(np.ascontiguousarray(labels[::2, ::2])))
    assert found.document["world"]["view"] == "top"


@pytest.mark.slow
def test_told_things_win():
    rgb, labels = desk()
    view = BoundaryGuess(View.TOP, 1.0, "as given", ())
    found = perceive(
        rgb, from_masks(labels, {7: "tennis ball"}), facts=KnownFacts(view, 600)
    )
    assert found.document["world"]["view"] == "top"
    assert found.document["world"]["table"] == {"friction": 0.2}
    assert found.document["boundaries"] == {}
    assert found.document["world"]["pixels_per_meter"] == 600
    ball = found.document["objects"]["tennis-ball-1"]
    assert (ball["mass"], ball["from"]["label"]) == (57.7, "given 1")


@pytest.mark.slow
def test_objects_are_renamed_by_name_id_and_pattern():
    rgb, labels = desk()
    labels[5, 5] = 9  # a speck is no object
    renames = [
        "ball-1=apple",
        "2=book",
        "block-*=wooden block",
    ]  # what is named itself is no block
    found = perceive(rgb, from_masks(labels), renames=renames)
    assert "1 specks" in found.comments["objects"]
    objects = found.document["objects"]
    assert [o["label"] for o in objects.values()] == [
        "apple",
        "wooden block",
        "book",
        "wooden block",
    ]
    assert next(iter(objects)) == "apple-1"
    assert "label" not in objects["apple-1"]["from"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("up", "view", "relit"),
    [(-0.6, View.SIDE, True), (0.6, View.SIDE, False), (0.6, View.TOP, True)],
)
def test_a_light_from_below_relights_nothing(up: float, view: View, relit: bool):
    """From above, down the photo is no more below than up."""
    normals, labels, _ = ball()
    light = DistantLight(towards(0.5, up, 0.6), 0.9, 0.15)
    rgb = rendered(
        normals, np.full((*labels.shape, 3), (0.8, 0.3, 0.2), np.float32), light
    )
    document = perceive(
        rgb, from_masks(labels), facts=KnownFacts(setting(view))
    ).document
    assert document["light"]["direction"][1] * up > 0
    assert document["render"].get("relight", True) is relit


@pytest.mark.parametrize(
    ("rename", "message"),
    [
        (
            "bal-1=apple",
            '--label: "bal-1=apple" matches no object; did you mean "ball-1"?',
        ),
        (
            "zebra=apple",
            '--label: "zebra=apple" matches no object; the objects are ball-1, block-1',
        ),
        ("ball-1", '--label: "ball-1" is not NAME=TEXT'),
    ],
)
def test_wrong_renames(rename: str, message: str):
    rgb, labels = desk()
    with pytest.raises(InputError) as error:
        perceive(rgb, from_masks(labels), renames=[rename])
    assert str(error.value).startswith(message)


def test_masks_of_another_size_or_of_nothing():
    rgb, labels = desk()
    with pytest.raises(
        InputError, match="220 x 149 px differs from the photo's 220 x 150 px"
    ):
        perceive(rgb, from_masks(labels[:-1]))
    with pytest.raises(InputError, match="shows no object; mark them"):
        perceive(rgb, from_masks(np.zeros_like(labels)))


@pytest.mark.slow
def test_a_point_finds_what_is_of_one_colour():
    rgb, labels = desk()
    assert overlap(segment_point(rgb, (100, 95), None).mask, labels == 300) > 0.85
    whole = np.where(labels == 300, np.uint16(1), np.uint16(0))
    found = segment_point(rgb, (100, 95), Segments(whole, np.array([0.9])))
    assert np.array_equal(found.mask, labels == 300)
    assert found.confidence == 0.9


@pytest.mark.slow
def test_prompts_are_numbered_and_collected():
    rgb, _ = desk()

    segment = Segmenter(Backends())
    found = from_prompts(rgb, [(15, 74, 50, 50)], [(100, 95)], segment)
    assert set(np.unique(found.labels)) == {0, 1, 2}
    with pytest.raises(InputError) as error:
        from_prompts(rgb, [(500, 0, 5, 5)], [(-3, 4), (5, 5)], segment)
    assert [str(p).split(":")[0] for p in error.value.problems] == [
        "--box 500,0,5,5",
        "--point -3,4",
        "--point 5,5",
    ]


def test_slugs_make_valid_names():
    for label in ("Ball", "8 ball", "été à la plage", "", "---", "x" * 200, "a\nb"):
        assert naming.slug(label)[0].isalpha()
        assert len(naming.slug(label)) <= 60


@pytest.mark.slow
def test_a_label_renames_its_object_alone(seen: PerceivedScene) -> None:
    rgb, labels = desk()
    plain = list(seen.document["objects"])
    found = perceive(rgb, from_masks(labels), renames=[f"{plain[1]}=steel ball"])
    assert list(found.document["objects"]) == [plain[0], "steel-ball-1", *plain[2:]]
    (warning,) = found.warnings
    assert str(warning).startswith(
        f"--label: warning: {plain[1]} is steel-ball-1 in the scene"
    )
    assert seen.warnings == ()


@pytest.mark.parametrize(("source", "held"), [("learned", True), ("given", False)])
def test_a_found_mask_that_ends_just_before_the_border_is_cut(
    source: str, held: bool
) -> None:
    """Networks leave some pixels out beside the border; circles and given masks that end there are whole."""
    rgb = np.full((400, 500, 3), 120, np.uint8)
    labels = np.zeros((400, 500), np.uint16)
    labels[4:200, 100:180] = 1
    y, x = np.mgrid[:400, :500]
    labels[np.hypot(x - 474, y - 200) <= 22] = 2
    rgb[labels > 0] = (200, 90, 60)
    rgb[:4, 100:180] = (200, 90, 60)  # the object reaches the border, its mask does not
    items, _ = fit_objects(rgb, Detections(labels, source, {1: 0.9, 2: 0.9}, {}))
    assert [item.cut for item in items] == [held, False]


@pytest.mark.parametrize(("beyond", "is_cut"), [(1, False), (30, True)])
def test_the_flank_of_a_plate_at_the_border_is_whole(beyond: int, is_cut: bool) -> None:
    """A plate that ends 1 px outside the photo can move; one that is cut off cannot."""
    rgb = np.full((300, 300, 3), 90, np.uint8)
    y, x = np.mgrid[:300, :300]
    plate = ((x - 180 - beyond) / 120) ** 2 + ((y - 150) / 100) ** 2 <= 1
    rgb[plate] = 220
    labels = plate.astype(np.uint16)
    assert labels[:, -1].any()
    (item,), _ = fit_objects(rgb, Detections(labels, "learned", {1: 0.9}, {}))
    assert item.cut is is_cut


def test_an_object_with_a_narrow_tip_near_the_border_is_whole() -> None:
    rgb = np.full((400, 500, 3), 120, np.uint8)
    rgb[:, ::2] = 60
    labels = np.zeros((400, 500), np.uint16)
    labels[60:260, 100:300] = 1
    labels[4:60, 180:220] = 1
    (item,), _ = fit_objects(rgb, Detections(labels, "learned", {1: 0.9}, {}))
    assert not item.cut
