"""What the numbers of masks mean, by their kind; how many and how large they must be."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from pytest import approx

from physgen.export.video import Format, open_video
from physgen.problems import InputError
from physgen.videos import Coverage, open_coverage, read_video

SIZE = (24, 16)
SOFT = np.zeros((16, 24), np.uint8)
SOFT[4:12, 4:12] = 255
SOFT[3, 4:12], SOFT[12, 4:12] = 128, 1
IDS = np.zeros((16, 24), np.uint8)
IDS[2:6, 2:6], IDS[8:12, 10:20] = 1, 7


@pytest.fixture
def video(tmp_path: Path) -> Path:
    (tmp_path / "video").mkdir()
    for k in range(3):
        Image.fromarray(np.full((16, 24, 3), 80 + k, np.uint8)).save(tmp_path / "video" / f"{k}.png")
    return tmp_path / "video"


def saved(folder: Path, *pictures: Image.Image, kind: str = "png", **how) -> Path:
    folder.mkdir()
    for k, picture in enumerate(pictures):
        picture.save(folder / f"{k}.{kind}", **how)
    return folder


def opened(masks: Path, video: Path) -> Coverage:
    return open_coverage(masks, read_video(video))


def told(masks: Path, video: Path) -> str:
    with pytest.raises(InputError) as error:
        opened(masks, video)
    [problem] = error.value.problems
    return str(problem)


def palette(colours: list[tuple[int, int, int]]) -> Image.Image:
    picture = Image.fromarray(IDS, "L").convert("P")
    picture.putdata(IDS.ravel().tolist())
    picture.putpalette([c for colour in colours for c in colour])
    return picture


GREY = Image.fromarray(SOFT)
EIGHT = [(0, 0, 0), *[(20 * k, 250 - 20 * k, 90) for k in range(1, 8)]]
KINDS = {
    "grey is coverage": (GREY, SOFT / 255),
    "grey in colour is coverage": (GREY.convert("RGB"), SOFT / 255),
    "black and white": (Image.fromarray(SOFT > 100), SOFT > 100),
    "grey that is opaque": (Image.merge("LA", [GREY, Image.new("L", SIZE, 255)]), SOFT / 255),
    "16 bits are ids": (Image.fromarray(IDS.astype(np.uint16) * 9), IDS > 0),
    "16 bits are ids up to the brightest": (Image.fromarray(IDS.astype(np.uint16) * 9000), IDS > 0),
    "a palette of colours": (palette(EIGHT), IDS > 0),
    "a palette whose ground is no black": (palette([(70, 0, 80), *EIGHT[1:]]), IDS > 0),
    "colours": (palette(EIGHT).convert("RGB"), IDS > 0),
}


@pytest.mark.parametrize(("picture", "wanted"), KINDS.values(), ids=KINDS)
def test_kinds_of_masks(picture: Image.Image, wanted, tmp_path: Path, video: Path) -> None:
    covered = opened(saved(tmp_path / "masks", *[picture] * 3), video)
    assert len(covered.frames) == 3
    for frame in covered.frames:
        assert frame.dtype == np.float32
        assert frame == approx(np.asarray(wanted, np.float32), abs=1e-6)


def test_one_picture_serves_all_frames(tmp_path: Path, video: Path) -> None:
    GREY.save(tmp_path / "mask.png")
    covered = opened(tmp_path / "mask.png", video)
    assert len(covered.frames) == 3
    assert all(frame == approx(SOFT / 255) for frame in covered.frames)


def test_masks_of_a_scene_fit_the_video_that_was_made_of_it(tmp_path: Path) -> None:
    """Sides of an MP4 are even; of 23 x 15 px, the last column and row are there twice."""
    with open_video(tmp_path, Format.MP4, (23, 15), 24) as put:
        for _ in range(3):
            put(np.full((15, 23, 3), 90, np.uint8))
    covered = opened(
        saved(tmp_path / "masks", *[Image.fromarray(SOFT[:15, :23])] * 3), tmp_path / "video.mp4"
    )
    assert covered.frames[1] == approx(np.pad(SOFT[:15, :23], ((0, 1), (0, 1)), mode="edge") / 255)


def test_masks_that_do_not_fit_are_told_by_name(tmp_path: Path, video: Path) -> None:
    small = Image.fromarray(np.ascontiguousarray(SOFT[:14]))
    path = saved(tmp_path / "masks", GREY, small, small)
    expected = "24 x 14 px differs from the video's 24 x 16 px; make masks the video's size"
    assert told(path, video) == f"{path / '1.png'}: {expected}"
    less = Image.fromarray(np.ascontiguousarray(np.pad(SOFT, ((0, 0), (0, 1)))))
    assert "25 x 16 px differs" in told(saved(tmp_path / "wide", less, less, less), video)
    less.save(tmp_path / "one.png")
    assert told(tmp_path / "one.png", video).startswith(f"{tmp_path / 'one.png'}: 25 x 16 px differs")


def test_too_few_masks_are_counted(tmp_path: Path, video: Path) -> None:
    path = saved(tmp_path / "masks", GREY)
    assert (
        told(path, video)
        == f"{path}: 1 mask for 3 frames; give one mask a frame, or name one picture for all frames"
    )


def test_our_own_maps_are_read(tmp_path: Path, video: Path) -> None:
    """masks.png has ids of 16 bits, coverage.png 8 bits of coverage."""
    cv2.imwrite(str(tmp_path / "masks.png"), IDS.astype(np.uint16))
    cv2.imwrite(str(tmp_path / "coverage.png"), SOFT)
    assert opened(tmp_path / "masks.png", video).frames[2] == approx((IDS > 0).astype(np.float32))
    assert opened(tmp_path / "coverage.png", video).frames[2] == approx(SOFT / 255)
