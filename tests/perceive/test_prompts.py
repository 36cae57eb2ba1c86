"""Boxes and points on drawn pictures whose masks are known: loose boxes, boxes that cut, neighbours that touch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from physgen import pipeline
from physgen.cli.main import main
from physgen.maps import read_labels
from physgen.perceive.perceive import perceive
from physgen.perceive.roles import PromptedMask
from physgen.perceive.segment import prompts
from physgen.perceive.segment.prompts import (
    RULE,
    PromptFrame,
    Segmenter,
    check_prompts,
    from_prompts,
    segment_box,
)
from physgen.problems import InputError
from physgen.registry import Backends
from physgen.scene.scene import BoxPrompt, PointPrompt
from tests.perceive.lambertian import overlap

Photo = tuple[NDArray[np.uint8], NDArray[np.uint16]]
Sides = tuple[float, float, float, float]
GOOD = 0.85


def grainy(picture: NDArray[np.float32]) -> NDArray[np.uint8]:
    grain = np.random.default_rng(0).normal(0, 3, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.7) + grain, 0, 255).astype(
        np.uint8
    )


def balls() -> Photo:
    """A rack of shaded balls of one colour that touch."""
    rgb, labels = (
        np.full((260, 300, 3), (40, 110, 70), np.float32),
        np.zeros((260, 300), np.uint16),
    )
    y, x = np.mgrid[:260, :300]
    places = [
        (90 + 44 * i + 22 * (j % 2), 70 + 38 * j) for j in range(2) for i in range(2)
    ]
    for k, (cx, cy) in enumerate(places):
        u, v = (x - cx) / 22, (y - cy) / 22
        inside = u**2 + v**2 <= 1
        light = 0.35 + 0.65 * np.clip(
            -0.4 * u - 0.5 * v + 0.75 * np.sqrt(np.clip(1 - u**2 - v**2, 0, 1)), 0, 1
        )
        rgb[inside] = (np.array([205, 60, 50]) * light[..., None])[inside]
        labels[inside] = k + 1
    return grainy(rgb), labels


def crates() -> Photo:
    """Stacked boxes of nearly one colour, with dark joints."""
    rgb, labels = (
        np.full((260, 300, 3), (120, 140, 160), np.float32),
        np.zeros((260, 300), np.uint16),
    )
    for k, (x, y, w, h) in enumerate(
        [(60, 180, 70, 50), (130, 180, 90, 50), (100, 60, 70, 70), (90, 130, 60, 50)]
    ):
        rgb[y : y + h, x : x + w] = (100, 75, 50)
        rgb[y + 1 : y + h - 1, x + 1 : x + w - 1] = (200 - 4 * k, 150, 95 + 3 * k)
        labels[y : y + h, x : x + w] = k + 1
    return grainy(rgb), labels


def tight(mask: NDArray[np.bool_]) -> Sides:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return columns[0], rows[0], columns[-1] + 1 - columns[0], rows[-1] + 1 - rows[0]


def moved(box: Sides, by: Sides) -> Sides:
    x, y, w, h = box
    return (
        x - by[0] * w,
        y - by[1] * h,
        w * (1 + by[0] + by[2]),
        h * (1 + by[1] + by[3]),
    )


@pytest.mark.slow
@pytest.mark.parametrize("draw", [balls, crates])
@pytest.mark.parametrize(
    "by", [(0.1, 0.1, 0.1, 0.1), (0.1, -0.06, -0.06, 0.1)], ids=["loose", "off"]
)
def test_a_box_drawn_by_hand(draw: Callable[[], Photo], by: Sides) -> None:
    rgb, labels = draw()
    found = {
        k: overlap(segment_box(rgb, moved(tight(labels == k), by)).mask, labels == k)
        for k in range(1, labels.max() + 1)
    }
    assert min(found.values()) >= GOOD, found


@pytest.mark.slow
@pytest.mark.parametrize("draw", [balls, crates])
def test_a_point_in_the_middle(draw: Callable[[], Photo]) -> None:
    rgb, labels = draw()
    points = []
    for k in range(1, labels.max() + 1):
        x, y, w, h = tight(labels == k)
        points.append((x + w / 2, y + h / 2))
    found = from_prompts(rgb, [], points, Segmenter(Backends())).labels
    overlaps = [overlap(found == k, labels == k) for k in range(1, labels.max() + 1)]
    assert min(overlaps) >= GOOD, overlaps


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["plain", "noise"])
def test_a_box_or_point_on_nothing_shows_no_object_or_is_doubtful(kind: str) -> None:
    rgb = np.full((300, 400, 3), 120, np.uint8)
    if kind == "noise":
        rgb = np.random.default_rng(0).integers(0, 256, rgb.shape).astype(np.uint8)
    segment = Segmenter(Backends())
    for box in ((120, 90, 160, 120), (20, 180, 80, 90)):
        with pytest.raises(InputError, match="shows no object"):
            from_prompts(rgb, [box], [], segment)
    places = [(40, 30, 320, 240), (0, 0, 400, 300), (-5, -5, 410, 310)]
    for boxes, points in (*(([box], []) for box in places), ([], [(200, 150)])):
        try:
            found = from_prompts(rgb, boxes, points, segment)
        except InputError as error:
            assert "shows no object" in str(error)  # noqa: PT017
        else:
            assert perceive(rgb, found).suitability.reasons  # type: ignore[union-attr]


@pytest.mark.slow
def test_the_scene_says_where_a_person_pointed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rgb, labels = crates()
    photo, scene = tmp_path / "photo.png", tmp_path / "scene.yaml"
    cv2.imwrite(str(photo), rgb[..., ::-1])
    assert (
        main(
            [
                "perceive",
                str(photo),
                "--box",
                "95,55,80,80.5",
                "--point",
                "95,205",
                "-o",
                str(scene),
            ]
        )
        == 0
    )
    assert "nothing that stands out" not in capsys.readouterr().err
    found = {o.prompt for o in pipeline.load(scene).objects}
    assert found == {BoxPrompt((95, 55, 80, 80.5)), PointPrompt((95, 205))}
    assert (
        main(
            [
                "perceive",
                str(photo),
                "--box",
                "95,55,80,80.5",
                "--side",
                "150",
                "-o",
                str(scene),
            ]
        )
        == 0
    )
    (only,) = pipeline.load(scene).objects
    assert only.prompt == BoxPrompt(
        (47.5, 27.5, 40, 40.25)
    )  # px of the scene's own photo
    mask = read_labels(pipeline.load(scene).assets / "masks.png") > 0
    assert overlap(np.repeat(np.repeat(mask, 2, 0), 2, 1), labels == 3) > 0.8


def test_a_box_on_nothing_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rgb, _ = balls()
    rgb[:, :60] = rgb[0, 0]
    photo = tmp_path / "photo.png"
    cv2.imwrite(str(photo), rgb[..., ::-1])
    boxes = ["--box", "8,8,30,30", "--box", "68,48,44,44"]
    assert (
        main(["perceive", str(photo), *boxes, "-o", str(tmp_path / "none.yaml")]) == 2
    )
    said = capsys.readouterr().err.strip()
    assert said.startswith("--box 8,8,30,30: shows no object; ")
    assert "\n" not in said
    assert list(tmp_path.iterdir()) == [photo]


@pytest.mark.slow
def test_what_hardly_stands_out_is_not_pushed_and_not_good(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rgb, _ = balls()
    photo, scene = tmp_path / "photo.png", tmp_path / "scene.yaml"
    cv2.imwrite(str(photo), rgb[..., ::-1])
    certain = prompts.mask_in_box
    for sure in (0.9, RULE.weak_confidence - 0.03):

        def looked(
            rgb: NDArray[np.uint8], box: Sides, sure: float = sure
        ) -> PromptedMask:
            return replace(certain(rgb, box), confidence=sure)

        monkeypatch.setattr(prompts, "mask_in_box", looked)
        assert (
            main(["perceive", str(photo), "--box", "68,48,44,44", "-o", str(scene)])
            == 0
        )
        assert ("the marked object hardly stands out" in capsys.readouterr().err) == (
            sure < RULE.weak_confidence
        )
        assert any(any(item.velocity) for item in pipeline.load(scene).objects) == (
            sure >= RULE.weak_confidence
        )


@pytest.mark.slow
def test_points_on_one_object_are_told_apart_or_refused() -> None:
    rgb, _ = crates()
    segment = Segmenter(Backends())
    with pytest.raises(
        InputError, match="shows the same object as another box or point"
    ):
        from_prompts(rgb, [], [(95, 205), (95.3, 205)], segment)
    with pytest.raises(
        InputError, match="shows the same object as another box or point"
    ):
        from_prompts(rgb, [(60, 180, 70, 50)], [(95, 205), (97, 207)], segment)


PHOTO = PromptFrame(1280, 960)


@pytest.mark.parametrize(
    ("box", "numbers"),
    [
        ((900, 400, 1200, 900), "900,400,300,500"),  # corners; 820 px outside
        ((900, 400, 900, 300), "900,400,380,300"),  # no corners: its part on the photo
        ((-300, 100, 700, 500), "0,100,400,500"),
        ((900, 400, -100, -50), "800,350,100,50"),
        ((0.1, 0.2, 0.3, 0.4), "128,192,384,384"),
    ],
)
def test_wrong_box_is_answered_with_another(box: Sides, numbers: str) -> None:
    with pytest.raises(InputError) as error:
        check_prompts([box], [], PHOTO)
    (problem,) = error.value.problems
    assert numbers in problem.fix
    check_prompts([tuple(map(float, numbers.split(",")))], [], PHOTO)


@pytest.mark.parametrize(
    "box",
    [
        (-20, -20, 500, 500),
        (900, 400, 400, 580),
        (0, 0, 1280, 960),
        (1250, 930, 50, 50),
    ],
)
def test_loose_box_may_reach_out(box: Sides) -> None:
    check_prompts([box], [], PHOTO)


@pytest.mark.parametrize(
    ("point", "numbers"),
    [((0.5, 0.25), "640,240"), ((400, 1000), "1000,400"), ((1500, 1500), "1280")],
)
def test_wrong_point_is_answered(point: tuple[float, float], numbers: str) -> None:
    with pytest.raises(InputError) as error:
        check_prompts([], [point], PHOTO)
    assert numbers in str(error.value)
    check_prompts([], [(0, 0), (1279, 959)], PHOTO)


def test_last_pixel_stays_on_smaller_photo() -> None:
    rgb = np.zeros((400, 600, 3), np.uint8)
    ((x, y),) = PromptFrame(1500, 1000).points_in(rgb, [(1499, 999)])
    assert (round(x), round(y)) == (599, 399)


@pytest.mark.slow
def test_prompts_are_answered_in_pixels_of_the_given_photo(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A photo that is made smaller: messages and --refresh are in its own pixels."""
    rgb, labels = crates()
    height, width = (4 * side for side in labels.shape)
    photo, scene = tmp_path / "photo.png", tmp_path / "scene.yaml"
    cv2.imwrite(str(photo), np.repeat(np.repeat(rgb, 4, 0), 4, 1)[..., ::-1])
    make = ["perceive", str(photo), "--still", "--side", str(width // 4)]
    wrong = f"{width - 400},100,{width - 200},300"
    assert main([*make, "--box", wrong, "-o", str(scene)]) == 2
    said = capsys.readouterr().err
    assert f"--box {wrong}: reaches {width - 600} px" in said
    assert f"{width} x {height}" in said
    assert f"{width - 400},100,200,200" in said
    assert not scene.exists()
    box = "380,220,320,322"
    assert main([*make, "--box", box, "-o", str(scene)]) == 0
    (first,) = pipeline.load(scene).objects
    assert first.prompt == BoxPrompt((95, 55, 80, 80.5))
    capsys.readouterr()
    again = ["perceive", "--refresh", str(scene), "--still"]
    assert main([*again, "--box", wrong]) == 2
    assert f"reaches {width - 600} px" in capsys.readouterr().err
    assert main([*again, "--point", "380,820"]) == 0
    assert main([*again, "--point", f"{width},820"]) == 2, "the record stays"
    assert f"{width} x {height}" in capsys.readouterr().err
    prompts_now = [item.prompt for item in pipeline.load(scene).objects]
    assert BoxPrompt((95, 55, 80, 80.5)) in prompts_now
    (point,) = [one.point for one in prompts_now if isinstance(one, PointPrompt)]
    assert point == pytest.approx((95, 205), abs=0.5)


@pytest.mark.slow
def test_wrong_prompt_of_scene_names_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rgb, _ = crates()
    photo, scene = tmp_path / "photo.png", tmp_path / "scene.yaml"
    cv2.imwrite(str(photo), rgb[..., ::-1])
    box = ["--box", "95,55,80,80"]
    assert main(["perceive", str(photo), *box, "--still", "-o", str(scene)]) == 0
    text = scene.read_text().replace("[95.0, 55.0, 80.0, 80.0]", "[95, 55, 800, 80]")
    scene.write_text(text)
    line = text[: text.index("[95, 55, 800")].count("\n") + 1
    capsys.readouterr()
    assert main(["perceive", "--refresh", str(scene)]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert f"scene.yaml:{line}:" in said
    assert "objects.block-1.prompt.box: " in said
    assert scene.read_text() == text
