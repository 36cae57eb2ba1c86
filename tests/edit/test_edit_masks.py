"""Masks corrected on a photo whose truth is known: what follows from them follows, and every other byte stays."""

from __future__ import annotations

import difflib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from physgen.cli.main import main
from physgen.edit.corrections import CorrectionResult, correct
from physgen.edit.live import Live
from physgen.edit.masks import stroke
from physgen.edit.operations import apply_operations
from physgen.edit.pictures import mask_png
from physgen.geometry.polygon import Disc, Outline, mass_properties
from physgen.problems import EditError
from physgen.scene.load import OpenedScene
from physgen.scene.yaml_comments import without_comments

W, H = 240, 160
Y, X = np.mgrid[:H, :W]
DISC = (X - 70) ** 2 + (Y - 60) ** 2 <= 24**2
BLOCK = (np.abs(X - 170) <= 25) & (np.abs(Y - 100) <= 18)


def painted() -> tuple[np.ndarray, np.ndarray]:
    """A smooth background with fine grain, and the photo with a red disc and a blue block before it, RGB."""
    grain = np.random.default_rng(3).normal(0, 1.2, (H, W, 1))
    ground = np.stack([150 + 0.2 * X, 160 - 0.1 * Y, 140 + 0.1 * X], axis=2) + grain
    photo = ground.copy()
    photo[DISC] = (190, 40, 40)
    photo[BLOCK] = (40, 60, 180)
    return (np.clip(np.rint(part), 0, 255).astype(np.uint8) for part in (ground, photo))  # type: ignore[return-value]


@pytest.fixture(scope="module")
def perceived(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The photo perceived with masks of which one misses a quarter of its object."""
    folder = tmp_path_factory.mktemp("perceived")
    _, photo = painted()
    cv2.imwrite(str(folder / "photo.png"), photo[:, :, ::-1])
    masks = np.where(DISC & ~((X > 70) & (Y < 60)), 1, np.where(BLOCK, 2, 0)).astype(
        np.uint8
    )
    cv2.imwrite(str(folder / "given.png"), masks)
    flags = ["--masks", str(folder / "given.png"), "-o", str(folder / "scene.yaml")]
    assert main(["perceive", str(folder / "photo.png"), *flags]) == 0
    os.unlink(folder / "given.png")
    return folder


class Desk:
    """A scene under correction: its text and its maps, and what they were."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / "scene.yaml"
        self.live, self.text = Live(self.path), self.path.read_text()
        self.before = self.text

    def do(self, **op: Any) -> CorrectionResult:
        made = correct(self.live, self.text, op)
        self.before, self.text = self.text, made.text
        return made

    def outline(self, name: str) -> Outline:
        sight = self.live.state(self.text)
        return sight.compiled_scene.outlines[
            [item.name for item in sight.scene.objects].index(name)
        ]

    @property
    def maps(self) -> Path:
        return self.folder / yaml.safe_load(self.text)["assets"]

    @property
    def names(self) -> list[str]:
        return list(yaml.safe_load(self.text)["objects"])

    def entry(self, name: str) -> dict[str, Any]:
        return yaml.safe_load(self.text)["objects"][name]

    def mask(self, name: str) -> np.ndarray:
        data = mask_png(self.live.state(self.text), name)
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) == 255

    def map(self, name: str) -> np.ndarray:
        return cv2.imread(str(self.maps / f"{name}.png"), cv2.IMREAD_UNCHANGED)

    def changed_lines(self) -> list[str]:
        lines = difflib.unified_diff(
            self.before.split("\n"), self.text.split("\n"), n=0, lineterm=""
        )
        return [
            line
            for line in lines
            if line[:1] in "+-" and line[:3] not in ("+++", "---")
        ]


@pytest.fixture
def desk(perceived: Path, tmp_path: Path) -> Desk:
    return Desk(Path(shutil.copytree(perceived, tmp_path / "scene")))


@pytest.fixture(scope="module")
def refusing_desk(perceived: Path, tmp_path_factory: pytest.TempPathFactory) -> Desk:
    """Return a desk for operations that are refused: each leaves it as it was."""
    folder = tmp_path_factory.mktemp("refusing") / "scene"
    return Desk(Path(shutil.copytree(perceived, folder)))


def by_place(desk: Desk) -> tuple[str, str]:
    """The disc's and the block's names."""
    first, second = desk.names
    return (first, second) if desk.mask(first)[70, 60] else (second, first)


def iou(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {
        file.name: file.read_bytes()
        for file in sorted(folder.iterdir())
        if file.is_file()
    }


@pytest.mark.slow
def test_a_box_mends_a_mask_and_all_that_follows_from_it(desk: Desk) -> None:
    """Mask, shape, mass, coverage, what is behind, normals: of the disc, and of nothing else."""
    disc, block = by_place(desk)
    ground, _ = painted()
    assets = bytes_of(desk.folder / "scene.assets")
    old, was = (
        {
            name: desk.map(name)
            for name in ("background", "clean", "coverage", "masks", "normals")
            if desk.map(name) is not None
        },
        desk.entry(disc),
    )
    missing = DISC & (X > 72) & (Y < 58)
    off = np.abs(old["background"][:, :, ::-1].astype(int) - ground)
    assert off[missing].mean() > 40, (
        "the quarter that the mask misses still shows in the background"
    )

    made = desk.do(kind="box", box=[44, 34, 53, 53], object=None)

    assert disc in made.title
    assert made.new_name is None
    assert iou(desk.mask(disc), DISC) > 0.95
    assert np.array_equal(desk.mask(block), BLOCK)
    off = np.abs(desk.map("background")[:, :, ::-1].astype(int) - ground)
    assert off[DISC].mean() < 4, "nothing of it shows behind it any more"
    assert desk.map("coverage")[missing].min() > 127, (
        "soft at the border, and never more than half open"
    )
    now = desk.entry(disc)
    circle = desk.outline(disc)
    assert isinstance(circle, Disc)
    assert circle.center == pytest.approx([70, 60], abs=0.5)
    assert circle.radius == pytest.approx(24, abs=0.6)
    assert now["mass"] > was["mass"]
    assert now["prompt"] == {"box": [44, 34, 53, 53]}
    assert now["from"]["mask"].startswith("pointed at")
    normals = desk.map("normals")[:, :, ::-1].astype(float) - 128
    y, x = 60 - 12, 70 + 12
    assert normals[y, x, 0] > 25, "a ball looks to the right on its right"
    assert normals[y, x, 1] < -25
    assert (
        np.abs(
            np.hypot(np.hypot(normals[..., 0], normals[..., 1]), normals[..., 2]) - 127
        ).max()
        < 3
    )

    far = np.ones((H, W), bool)
    far[60 - 40 : 60 + 41, 70 - 40 : 70 + 41] = False
    for name, before in old.items():
        assert np.array_equal(desk.map(name)[far], before[far]), name
    assert bytes_of(desk.folder / "scene.assets") == assets, "the scene's own maps stay"
    lines = desk.text.split("\n")
    block_at = next(k for k, line in enumerate(lines) if line.startswith(f"  {block}:"))
    assert all(
        line[1:] not in lines[block_at : block_at + 3]
        for line in desk.changed_lines()
        if line[0] == "+"
    )
    assert desk.entry(block) == yaml.safe_load(desk.before)["objects"][block]


def test_a_stroke_without_end_is_refused_and_one_over_what_is_painted_costs_nothing(
    monkeypatch,
) -> None:
    far = [[float(x), 0.0] for x in range(20_000)]
    assert stroke(far, 2000.0, (64, 64)).all()
    monkeypatch.setattr("physgen.edit.masks.MAX_STROKE_WORK", 10_000)
    with pytest.raises(EditError, match="too long for its width"):
        stroke([[-35.0, -35.0]] * 200, 60.0, (64, 64))


@pytest.mark.slow
def test_a_point_finds_what_was_not_found(desk: Desk) -> None:
    """The block is forgotten; a point on it makes an object of it again, with a name, a mass and a mask of its own."""
    _, block = by_place(desk)
    start = desk.text.index(f"  {block}:")
    lines = desk.text[start:].split("\n")
    end = next(
        k for k, line in enumerate(lines[1:], 1) if line and not line.startswith("   ")
    )
    desk.text = desk.text[:start] + "\n".join(lines[end:])
    assert len(desk.names) == 1
    made = desk.do(kind="point", point=[170, 100], object=None)
    assert made.new_name is not None
    assert desk.names[-1] == made.new_name
    assert iou(desk.mask(made.new_name), BLOCK) > 0.95
    entry = desk.entry(made.new_name)
    assert entry["mass"] > 0
    assert entry["prompt"] == {"point": [170, 100]}
    assert desk.live.look(desk.text).motion is not None


@pytest.mark.slow
def test_brush_and_eraser_paint_exactly_what_they_touch(desk: Desk) -> None:
    """Pixels whose centre is within the radius of the line, by the distance to each of its points."""
    disc, block = by_place(desk)
    before = desk.mask(disc)
    desk.do(kind="brush", object=disc, strokes=[[75, 40], [90, 55]], radius=6)
    along = np.clip(((X - 75) + (Y - 40)) / 30, 0, 1) * 15  # the line has a slope of 1
    exact = np.hypot(X - 75 - along, Y - 40 - along) <= 6
    assert np.array_equal(desk.mask(disc), before | exact)
    area = mass_properties(desk.outline(disc)).area
    desk.do(kind="eraser", object=disc, strokes=[[75, 40], [90, 55]], radius=6)
    assert np.array_equal(desk.mask(disc), before & ~exact)
    assert mass_properties(desk.outline(disc)).area < area
    assert "mask" not in desk.entry(disc).get("from", {}), (
        "what a person drew, nobody guessed"
    )
    assert "prompt" not in desk.entry(disc)
    assert np.array_equal(desk.mask(block), BLOCK)
    assert desk.map("masks")[exact].max() == 0


@pytest.mark.slow
def test_a_mask_that_is_painted_over_another_takes_its_pixels(desk: Desk) -> None:
    disc, block = by_place(desk)
    desk.do(kind="brush", object=disc, strokes=[[150, 100]], radius=10)
    over = stroke([(150, 100)], 10, (W, H))
    assert not (desk.mask(block) & over).any()
    assert np.array_equal(desk.mask(block), BLOCK & ~over)
    with pytest.raises(EditError, match=f"no pixel would be left of {block}"):
        desk.do(kind="brush", object=disc, strokes=[[150, 100], [190, 100]], radius=60)


def hand_set(desk: Desk, name: str, mass: float) -> None:
    """A person's own number: it differs from what the record has."""
    entry = desk.entry(name)
    start = desk.text.index(f"  {name}:")
    text = desk.text[start:]
    desk.text = desk.text[:start] + text.replace(
        f"mass: {entry['mass']}", f"mass: {mass}", 1
    )
    assert desk.entry(name)["mass"] == mass


def test_merged_is_the_union_and_weighs_the_sum(desk: Desk) -> None:
    """Forces on the one that goes act on the other from now on; nothing is left that names it."""
    disc, block = by_place(desk)
    hand_set(desk, disc, 30)
    hand_set(desk, block, 12)
    union = desk.mask(disc) | desk.mask(block)
    push = f"forces:\n  - {{object: {block}, impulse: [100, 0]}}"
    desk.text += f"{push}\n"
    assert push in desk.text
    coverage = desk.map("coverage")
    desk.do(kind="merge", objects=[disc, block])
    assert desk.names == [disc]
    assert np.array_equal(desk.mask(disc), union)
    assert desk.entry(disc)["mass"] == 42
    assert yaml.safe_load(desk.text)["forces"] == [
        {"object": disc, "impulse": [100, 0]}
    ]
    assert block not in desk.text
    assert np.array_equal(desk.map("coverage"), coverage)


def test_what_named_the_one_names_the_other_once_they_are_merged(desk: Desk) -> None:
    """Wind, joints, the camera, and what variants say; the joint of the two with each other cannot be, and is told."""
    disc, block = by_place(desk)
    more = {
        "fields": {"wind": {"wind": [30, 0], "drag": 2, "objects": [block]},
                   "both": {"wind": [3, 0], "drag": 2, "objects": [disc, block]}},
        "joints": {"pin": {"objects": [block], "pivot": [170, 100]},
                   "rod": {"objects": [disc, block], "pivot": [120, 80]}},
        "render": {"slow": 4, "camera": {"follow": block, "zoom": 2}},
        "variants": {"fast": {f"objects.{block}.velocity": [90, 0], f"objects.{block}.mass": 3,
                              "world.duration": 2},
                     "held": {f"objects.{block}.motion": "static", f"objects.{disc}.motion": "dynamic"}},
    }  # fmt: skip
    desk.text = desk.text[: desk.text.index("render:")] + yaml.safe_dump(more)
    made = desk.do(kind="merge", objects=[disc, block])
    data = yaml.safe_load(desk.text)
    assert {name: told["objects"] for name, told in data["fields"].items()} == {
        "wind": [disc],
        "both": [disc],
    }
    assert {name: told["objects"] for name, told in data["joints"].items()} == {
        "pin": [disc]
    }
    assert data["render"]["camera"]["follow"] == disc
    assert data["variants"] == {
        "fast": {"world.duration": 2},
        "held": {f"objects.{disc}.motion": "dynamic"},
    }
    for left in (
        "joint rod",
        f"objects.{block}.velocity of fast",
        f"objects.{block}.motion of held",
    ):
        assert left in made.title
    assert desk.live.look(desk.text, "fast").motion is not None


def test_split_halves_sum_to_the_whole(desk: Desk) -> None:
    """Pixels, area and mass; each half on its side of the line; the background behind does not change."""
    _, block = by_place(desk)
    hand_set(desk, block, 20)
    behind = (desk.folder / "scene.assets" / "background.png").read_bytes()
    made = desk.do(kind="split", object=block, line=[[160, 0], [160, 10]])
    assert made.new_name == f"{block}-2"
    right, left = desk.mask(block), desk.mask(made.new_name)
    assert not (right & left).any()
    assert np.array_equal(right | left, BLOCK)
    assert X[left].max() <= 160 < X[right].min() + 1
    masses = [desk.entry(name)["mass"] for name in (block, made.new_name)]
    assert sum(masses) == pytest.approx(20, rel=1e-3)
    assert masses[1] / 20 == pytest.approx(left.sum() / BLOCK.sum(), rel=1e-3)
    assert (desk.maps / "background.png").read_bytes() == behind
    assert os.path.samefile(
        desk.maps / "background.png", desk.folder / "scene.assets" / "background.png"
    )
    with pytest.raises(EditError, match="fewer than"):
        desk.do(kind="split", object=block, line=[[230, 0], [230, 9]])


def test_a_label_that_is_typed_sets_the_numbers_that_nobody_set(desk: Desk) -> None:
    """As `perceive --refresh` does; a mass that a person set stays, and so does every map."""
    disc, block = by_place(desk)
    hand_set(desk, disc, 33)
    before = desk.entry(block)
    desk.do(kind="relabel", object=block, label="steel block")
    now = desk.entry(block)
    assert now["label"] == "steel block"
    assert now["mass"] > 3 * before["mass"]
    assert "steel" in desk.text
    desk.do(kind="relabel", object=disc, label="steel ball")
    assert desk.entry(disc)["mass"] == 33
    assert desk.entry(disc)["label"] == "steel ball"
    assert "label" not in desk.entry(disc)["from"]
    assert desk.maps.name == "scene.assets"


def test_what_perception_said_of_a_number_goes_when_a_person_sets_it(
    desk: Desk,
) -> None:
    """Its remark behind the mass, the label and the scale; every other line, and a person's own, stays."""
    disc, _ = by_place(desk)
    before = desk.text.split("\n")
    said = [line for line in before if "# g, table " in line]
    assert len(said) == 2
    assert any(
        "  # assumed: the photo's longer side is 0.5 m" in line for line in before
    )
    ops = [
        {"set": ["objects", disc, "mass"], "value": 33},
        {"set": ["objects", disc, "label"], "value": "steel ball"},
        {"set": ["world", "pixels_per_meter"], "value": 555},
    ]
    made = apply_operations(desk.text, ops).text
    ours = OpenedScene(desk.path).scene().record.comments
    after = without_comments(made, [op["set"] for op in ops], ours).split("\n")
    diff = [
        line
        for line in difflib.ndiff(made.split("\n"), after)
        if line[:2] in ("- ", "+ ")
    ]
    added = [line[2:] for line in diff if line[0] == "+"]
    assert added == ["  pixels_per_meter: 555", "    label: steel ball", "    mass: 33"]
    gone = [line[2:].strip() for line in diff if line[0] == "-"]
    for start in (
        "mass: 33  # g, table ",
        "label: steel ball  # ",
        "pixels_per_meter: 555  # assumed",
    ):
        assert [line for line in gone if line.startswith(start)], start
    assert len(gone) == 3
    mine = "\n".join(after).replace("    mass: 33", "    mass: 33  # g, weighed it")
    assert without_comments(mine, [["objects", disc, "mass"]], ours) == mine


def test_masks_in_the_file_become_pixels_where_they_are_painted(tmp_path: Path) -> None:
    """A scene of polygons without assets: it gets a folder of its own; who is not painted keeps the polygon."""
    _, photo = painted()
    cv2.imwrite(str(tmp_path / "photo.png"), photo[:, :, ::-1])
    (tmp_path / "scene.yaml").write_text(
        "physgen: 1\nimage: photo.png\nobjects:\n"
        "  disc: {mask: {polygon: [[50, 40], [90, 40], [90, 80], [50, 80]]}, density: 2}  # by hand\n"
        "  block: {mask: {polygon: [[146, 83], [194, 83], [194, 117], [146, 117]]}, mass: 5}\n"
    )
    desk = Desk(tmp_path)
    before = desk.mask("disc")
    area = desk.live.look(desk.text).derived_data["objects"]["disc"]["mass"] / 2  # type: ignore[index]
    desk.do(kind="brush", object="disc", strokes=[[90, 60]], radius=15)
    painted_ = stroke([(90, 60)], 15, (W, H))
    assert np.array_equal(desk.mask("disc"), before | painted_)
    data = yaml.safe_load(desk.text)
    assert data["assets"] == "scene.assets"
    assert data["objects"]["disc"] == {"mask": 1, "density": 2}
    assert "# by hand" in desk.text
    assert "polygon: [[146, 83]" in desk.text
    assert sorted(bytes_of(desk.maps)) == ["masks.png"]
    mass = desk.live.look(desk.text).derived_data["objects"]["disc"]["mass"]  # type: ignore[index]
    assert mass / 2 - area == pytest.approx((painted_ & ~before).sum(), rel=0.05), (
        "mass follows area"
    )
    desk.do(kind="eraser", object="block", strokes=[[146, 100]], radius=9)
    assert desk.map("masks").max() == 2
    assert yaml.safe_load(desk.text)["assets"] == "scene-2.assets"


@pytest.mark.slow
def test_a_scripted_way_moves_along_with_the_centre(desk: Desk) -> None:
    disc, _ = by_place(desk)
    x, y = desk.live.look(desk.text).derived_data["objects"][disc]["centre"]  # type: ignore[index]
    start = desk.text.index(f"  {disc}:")
    knots = (
        f"    motion: {{path: [[0, {x:.2f}, {y:.2f}], [1, {x + 40:.2f}, {y:.2f}]]}}\n"
    )
    at = desk.text.index("    mask:", start)
    desk.text = desk.text[:at] + knots + desk.text[at:]
    desk.do(kind="box", box=[44, 34, 53, 53], object=disc)
    path = desk.entry(disc)["motion"]["path"]
    assert path[0][1:] == pytest.approx([70, 60], abs=0.6)
    assert path[1][1] - path[0][1] == pytest.approx(40, abs=0.02)


@pytest.mark.parametrize(
    ("op", "why"),
    [
        ({"kind": "melt"}, "not known"),
        ({}, "not known"),
        ({"kind": "box", "box": [1, 2, 3]}, "box: .* at least 4 items"),
        ({"kind": "box", "box": [1, 2, float("nan"), 4]}, "box.2: .* finite"),
        ({"kind": "box", "box": [1, 2, 10**400, 4]}, "box.2: .* number"),
        (
            {"kind": "brush", "object": "DISC", "strokes": [[1, 1]], "radius": 10**400},
            "radius: .* number",
        ),
        ({"kind": "box", "box": [500, 500, 20, 20]}, "is outside the"),
        ({"kind": "point", "point": [1e9, 3]}, "point.0: .* less than"),
        ({"kind": "point", "point": [-5, 3]}, "outside the 240 x 160 photo"),
        ({"kind": "polygon", "polygon": [[1, 1], [2, 2]]}, "at least 3 items"),
        (
            {"kind": "polygon", "polygon": [[300, 1], [302, 2], [301, 5]]},
            "fewer than 12 px",
        ),
        (
            {"kind": "brush", "object": "nobody", "strokes": [[1, 1]], "radius": 3},
            "no object is called",
        ),
        (
            {"kind": "brush", "object": ["x"], "strokes": [[1, 1]], "radius": 3},
            "object: .* string",
        ),
        (
            {"kind": "brush", "object": "DISC", "strokes": [], "radius": 3},
            "at least 1 item",
        ),
        (
            {"kind": "brush", "object": "DISC", "strokes": [[1, 1]], "radius": 0},
            "radius: .* greater than 0",
        ),
        (
            {"kind": "brush", "object": "DISC", "strokes": [[60, 70]], "radius": 2},
            "changes nothing",
        ),
        (
            {"kind": "eraser", "object": "DISC", "strokes": [[70, 60]], "radius": 90},
            "fewer than 12 px",
        ),
        ({"kind": "merge", "objects": ["DISC", "DISC"]}, "named twice"),
        ({"kind": "merge", "objects": "DISC"}, "objects: .* list"),
        ({"kind": "split", "object": "DISC", "line": [[1, 1], [1, 1]]}, "is a point"),
        ({"kind": "relabel", "object": "DISC", "label": " "}, "label: .* pattern"),
    ],
)
def test_what_cannot_be_done_leaves_nothing_behind(
    refusing_desk: Desk, op: dict[str, Any], why: str
) -> None:
    desk = refusing_desk
    disc, _ = by_place(desk)
    named = {key: disc if value == "DISC" else value for key, value in op.items()}
    named |= {
        key: [disc if v == "DISC" else v for v in value]
        for key, value in op.items()
        if key == "objects" and isinstance(value, list)
    }
    files = sorted(desk.folder.iterdir())
    with pytest.raises(EditError, match=why) as told:
        desk.do(**named)
    assert told.value.fix
    assert sorted(desk.folder.iterdir()) == files
    assert desk.path.read_text() == desk.text == desk.before


def test_a_scene_without_a_photo_has_nothing_to_mask(
    copied: Callable[[str], Path],
) -> None:
    path = copied("physics/11-head-on")
    desk = Desk(path.parent)
    with pytest.raises(EditError, match="no photo"):
        desk.do(kind="box", box=[1, 1, 50, 50], object=None)
    desk.text = "physgen: [\n"
    with pytest.raises(EditError, match="has an error"):
        desk.do(kind="box", box=[1, 1, 50, 50], object=None)


@pytest.mark.slow
def test_what_perception_wrote_stays_so_after_masks_and_labels_are_corrected(
    desk: Desk,
) -> None:
    """Sources stay true: what follows from a corrected mask or label is perception's, and what a user set is not."""
    disc, block = by_place(desk)

    def sources(name: str) -> dict[str, str]:
        scene = desk.live.state(desk.text).scene
        return dict(
            next(item.provenance for item in scene.objects if item.name == name)
        )

    before = sources(disc)
    old = (desk.maps / "perceived.json").read_bytes()
    first = desk.maps
    desk.do(kind="box", box=[44, 34, 53, 53], object=None)
    after = sources(disc)
    assert after.keys() == before.keys()
    assert after["mask"].startswith("pointed at")
    assert (first / "perceived.json").read_bytes() == old, (
        "of the folder that an undo leads to"
    )
    for label in ("steel ball", "billiard ball", "cork ball"):
        desk.do(kind="relabel", object=disc, label=label)
        assert sources(disc).keys() == before.keys() - {"label"}, label
        mass = desk.live.state(desk.text).scene.document["objects"][disc]["mass"]
        assert desk.entry(disc)["mass"] == mass, "the file has the number that is used"
    desk.text = desk.text.replace(f"mass: {desk.entry(block)['mass']:g}", "mass: 4321")
    assert "mass" not in sources(block)
    desk.do(
        kind="eraser",
        object=block,
        strokes=[[float(X[BLOCK].min()), float(Y[BLOCK].min())]],
        radius=6.0,
    )
    assert "mass" not in sources(block)
    assert "friction" in sources(block)
