"""`evaluate fid` on clips of a moving square: what differs is farther, formats do not matter, faults are told."""

from __future__ import annotations

import colorsys
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.picture_features import Bank
from physgen.cli import evaluate
from physgen.cli.main import main
from physgen.evaluate.clip_frames import Rule, sources
from physgen.evaluate.fid import picture_flow

SIDE, FRAMES = 64, 5


def texture(seed: int) -> np.ndarray:
    return (
        np.random.default_rng(seed)
        .integers(0, 255, (4, 4, 3))
        .astype(np.uint8)
        .repeat(4, 0)
        .repeat(4, 1)
    )


def clip(
    seed: int, speed: float, colour: int = 0, side: int = SIDE
) -> list[np.ndarray]:
    """A square that crosses a grey wall at `speed` px a frame, from a place that the seed chooses."""
    random = np.random.default_rng(seed)
    x, y = random.uniform(2, 12), random.uniform(8, 30)
    wall = np.full((SIDE, SIDE, 3), 110, np.uint8)
    wall[:, ::8] += 30
    frames = []
    for k in range(FRAMES):
        move = np.float64([[1, 0, x + k * speed], [0, 1, y]])
        square = cv2.warpAffine(
            texture(colour), move, (SIDE, SIDE), borderMode=cv2.BORDER_CONSTANT
        )
        there = cv2.warpAffine(np.full((16, 16), 1.0), move, (SIDE, SIDE))[..., None]
        frames.append(np.rint(wall * (1 - there) + square * there).astype(np.uint8))
    return [cv2.resize(f, (side, side), interpolation=cv2.INTER_AREA) for f in frames]


def save(frames: Sequence[np.ndarray], folder: Path) -> None:
    folder.mkdir(parents=True)
    for k, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"{k}.png"), frame[..., ::-1])


@pytest.fixture(autouse=True)
def bank(monkeypatch: pytest.MonkeyPatch) -> None:
    """Features without a model, where no file of the network is named: what is tested is all but these."""
    real = evaluate._features
    monkeypatch.setattr(
        evaluate,
        "_features",
        lambda file: Bank() if file == Path("bank") else real(file),
    )


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("clips")
    for k in range(12):
        save(clip(k, 2 + k % 3), root / "true" / str(k))
        save(clip(100 + k, 2 + k % 3), root / "alike" / str(k))
        save(clip(100 + k, 6 + k % 3), root / "fast" / str(k))
        save([clip(100 + k, 0)[0]] * FRAMES, root / "still" / str(k))
        save(clip(100 + k, 2 + k % 3, colour=1), root / "painted" / str(k))
    return root


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict:
    assert (
        main(["evaluate", "fid", "--inception", "bank", *map(str, arguments), "--json"])
        == 0
    )
    return json.loads(capsys.readouterr().out)


def asked(clips: Path, method: str, *more: object) -> list[str]:
    """The command that compares one folder with the true one."""
    more = ("--reference", clips / "true", "--inception", "bank", *more)
    return ["evaluate", "fid", str(clips / method), *map(str, more)]


def methods(root: Path, *names: str) -> list[str]:
    return [str(root / name) for name in names]


@pytest.mark.slow
def test_what_differs_is_farther(
    clips: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The paper's finding in small: what hardly moves looks right and moves wrong; other colours are seen in frames."""
    found = told(
        capsys, "--reference", clips / "true", "--size", SIDE, "--draws", 40,
        *methods(clips, "alike", "fast", "still", "painted"),
    )  # fmt: skip
    by_name = {row["method"]: row for row in found["rows"]}
    alike, fast, still, painted = (
        by_name[name] for name in ("alike", "fast", "still", "painted")
    )
    for row in (fast, still):
        assert row["motion_fid"] > 3 * alike["motion_fid"]
        assert row["motion_fid_95"][0] > alike["motion_fid_95"][1]
    assert painted["image_fid"] > 2 * max(alike["image_fid"], still["image_fid"])
    assert painted["motion_fid"] < fast["motion_fid"]
    for row in found["rows"]:
        for kind in ("image", "motion"):
            low, high = row[f"{kind}_fid_95"]
            assert 0 <= low <= row[f"{kind}_fid"] <= high
    assert found["features"] == "bank"
    assert (alike["clips"], alike["frames"], alike["pairs"]) == (12, 60, 48)


def test_a_flows_colours_are_those_of_the_wheel() -> None:
    moved = np.zeros((8, 8, 2), np.float32)
    moved[0] = (4, 0)
    moved[1] = (-2, 0)
    moved[2] = (40, 0)
    shown = picture_flow(moved, 4.0)
    hue, _, full = colorsys.rgb_to_hsv(*(shown[0, 0] / 255))
    assert min(hue, 1 - hue) < 0.02  # to the right is red
    assert full == pytest.approx(1, abs=0.01)
    left = colorsys.rgb_to_hsv(*(shown[1, 0] / 255))
    assert 0.45 < left[0] < 0.6  # to the left is cyan
    assert left[1] == pytest.approx(0.5, abs=0.05)
    assert np.array_equal(shown[2], shown[0])  # faster than full stays full
    assert (shown[4:] == 255).all()
    assert not np.array_equal(shown, picture_flow(moved, 8.0))  # speed is seen


@pytest.mark.slow
def test_formats_do_not_matter(
    clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Frames as physgen leaves them among other files, and videos: the same clips, the same distances."""
    from physgen.export.video import Format, open_video

    rendered, films = (tmp_path / name for name in ("rendered", "films"))
    for folder in (rendered, films):
        folder.mkdir()
    for k in range(12):
        frames = [
            cv2.imread(str(clips / "true" / str(k) / f"{i}.png"))[..., ::-1]
            for i in range(FRAMES)
        ]
        (rendered / f"scene-{k}").mkdir()
        (rendered / f"scene-{k}" / "poster.png").write_bytes(b"no picture of a clip")
        for folder, kind, file in (
            (rendered / f"scene-{k}", Format.PNG, "video"),
            (films, Format.MP4, str(k)),
        ):
            with open_video(folder, kind, (SIDE, SIDE), 10.0, file) as write:
                for frame in frames:
                    write(np.ascontiguousarray(frame))
    (rendered / "index.html").write_text("")
    (rendered / "index.files").mkdir()
    cv2.imwrite(
        str(rendered / "index.files" / "strip.png"), np.zeros((9, 99, 3), np.uint8)
    )
    found = told(
        capsys, "--reference", clips / "true", "--size", SIDE, "--draws", 0,
        *methods(clips, "painted"), rendered, films,
    )  # fmt: skip
    painted, same, filmed = found["rows"]
    for row in found["rows"]:
        assert (row["clips"], row["frames"]) == (12, 12 * FRAMES)
    assert (same["image_fid"], same["motion_fid"]) == pytest.approx((0, 0), abs=1e-9)
    assert (
        0 < filmed["image_fid"] < 0.1 * painted["image_fid"]
    )  # compressed, as videos are


def test_a_page(
    clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "page"
    more = ["--size", SIDE, "--draws", 20, "--frames", 3, "-o", out]
    assert main(asked(clips, "alike", *more)) == 0
    printed, page = capsys.readouterr().out, (out / "index.html").read_text()
    for text in (printed, page):
        assert "Image-FID: alike" in text
        assert "3 frames, evenly" in text
    assert json.loads((out / "result.json").read_text())["rows"][0]["frames"] == 36


def test_frames_are_taken_evenly_and_made_one_size(tmp_path: Path) -> None:
    wide = [np.full((20, 40, 3), 20 * k, np.uint8) for k in range(9)]
    for frame in wide:
        frame[:, :10] = 255
    save(wide, tmp_path / "wide")
    (source,) = sources([tmp_path / "wide"])
    chosen = list(Rule(10, 3).frames(source))
    assert [frame.shape for frame in chosen] == [(10, 20, 3)] * 3
    assert [int(frame[5, 15, 0]) for frame in chosen] == [0, 80, 160]
    assert [int(f[5, 15, 0]) for f in Rule(10).frames(replace(source, skip=7))] == [
        140,
        160,
    ]


def faults(root: Path) -> dict[str, tuple[list[str], list[str]]]:
    """Arguments, and what has to be said of them."""
    true, one = str(root / "true"), str(root / "true" / "0")
    for k in range(3):
        save([np.zeros((20, 40, 3), np.uint8)] * 3, root / "wide" / str(k))
        save([np.zeros((20, 20, 3), np.uint8)], root / "single" / str(k))
    save(
        [np.zeros((20, 20, 3), np.uint8), np.zeros((20, 22, 3), np.uint8)],
        root / "uneven" / "a",
    )
    save([np.zeros((20, 20, 3), np.uint8)], root / "lonely")
    (root / "hollow" / "sub").mkdir(parents=True)
    (root / "broken").mkdir()
    (root / "broken" / "x.mp4").write_bytes(b"this is no film" * 9)
    (root / "weights.pth").write_bytes(b"no archive")
    return {
        "absent": ([str(root / "nowhere")], ["no such file or folder"]),
        "two faults": ([str(root / "nowhere"), "--inception", "/nowhere.pt"], ["nowhere: no such", '"/nowhere.pt" no']),
        "hollow": ([str(root / "hollow")], ["has no clips"]),
        "broken": ([str(root / "broken")], ["x.mp4: is not a video that can be read"]),
        "uneven": ([str(root / "uneven")], ["22 x 20 px differs from the 20 x 20 px of the first frame"]),
        "shapes": ([str(root / "wide")], ["is 2 times as wide as high", "crop the clips to one shape"]),
        "lonely": ([str(root / "lonely")], ["lonely: 1 frame in 1 clip make fewer"]),
        "no motion": ([str(root / "single")], ["make fewer than two pictures of motion"]),
        "short": ([true, "--frames", "9"], ["5 frames are fewer than --frames 9; give --frames 5"]),
        "no script": ([true, "--inception", str(root / "weights.pth")], ["does not load as Inception"]),
        "both sides": ([str(root / "nowhere"), "--reference", str(root / "nowhere")], ["no such file or folder"]),
        "twice": ([one, one], ["0, 0 are equal names"]),
    }  # fmt: skip


def test_faults_are_told(
    clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "true").symlink_to(clips / "true")
    for name, (arguments, expected) in faults(tmp_path).items():
        out = tmp_path / "out"
        common = [
            "--reference",
            str(clips / "true"),
            "--size",
            str(SIDE),
            "--draws",
            "0",
            "-o",
            str(out),
        ]
        assert (
            main(["evaluate", "fid", "--inception", "bank", *arguments, *common]) == 2
        ), name
        printed = capsys.readouterr()
        for text in expected:
            assert text in printed.err, (name, printed.err)
        assert not printed.out, name
        assert not out.exists(), name


@pytest.mark.parametrize(
    ("network", "expected"),
    [
        ("Plain", "it does not take return_features"),
        ("Narrow", "2048)"),
        ("Blank", "gives numbers that are not finite"),
    ],
)
def test_a_script_that_is_another_network(
    clips: Path,
    tmp_path: Path,
    network: str,
    expected: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from tests.contract import tiny_judges

    file = tiny_judges.scripted(tmp_path / "other", getattr(tiny_judges, network))
    assert main(asked(clips, "true/0", "--inception", file, "--draws", 0)) == 2
    assert expected in capsys.readouterr().err


def test_a_persons_own_file_is_called_as_the_official_one_is(
    clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Few frames for 2048 features, and a side of one clip: warned of, and no number that is none."""
    from tests.contract import tiny_judges

    file = tiny_judges.scripted(tmp_path / "inception-2015-12-05")
    assert main(asked(clips, "fast/0", "--inception", file, "--json")) == 0
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert len(found["features_note"]["sha256"]) == 64
    assert found["settings"]["features_of_a_picture"] == 2048
    (row,) = found["rows"]
    assert row["motion_fid"] > 0
    assert row["motion_fid_95"] is None
    assert (
        "5 pictures are too few for 2048 features: the Fréchet distance is too large"
        in printed.err
    )
