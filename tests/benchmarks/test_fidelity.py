"""The command `fidelity.py`: its bar, its exit codes and its strips of frames."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import pytest

from physgen.cli.main import main as physgen
from physgen.evaluate import fidelity


def main(arguments: list[str]) -> int:
    return physgen(["evaluate", "fidelity", *arguments])


def test_a_scene_without_truth_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--scenes", "curling,nope"]) == 2
    assert "nope has no truth" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("shadows", "objects", "code", "state"),
    [(0.89, 1.0, 1, "MISSED"), (3.2, -0.1, 1, "MISSED"), (3.2, 0.1, 0, "met")],
)
def test_its_bar_is_told_with_its_exit_code(
    shadows: float,
    objects: float,
    code: int,
    state: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows = [
        {
            "scene": "a",
            "half": "test",
            "way": way,
            "psnr_shadows": 20 + dark,
            "psnr_objects": 20 + bright,
        }
        for way, dark, bright in (
            ("ours", shadows, objects),
            ("paper, relit", 0.0, 0.0),
        )
    ]
    better = fidelity.ahead(fidelity.means(rows))
    assert better is not None
    assert (better.shadows, better.objects) == pytest.approx((shadows, objects))
    result = {"rows": rows, "means": fidelity.means(rows), "ahead": better}
    monkeypatch.setattr(fidelity, "evaluate", lambda *_: result)
    assert main(["--json"]) == code
    (bar,) = json.loads(capsys.readouterr().out)["bars"]
    asked = "3 dB on shadows, 0 on objects"
    assert (bar["found"], bar["bar"], bar["passed"]) == (str(better), asked, code == 0)
    assert main([]) == code
    text = capsys.readouterr().out
    assert f"{better}, the bar is {asked}: {state}" in text
    cell = f"{20 + objects:.2f} / {20 + shadows:.2f}"
    assert re.search(rf"^a +test +{cell} +20.00 / 20.00$", text, re.M)


@pytest.mark.slow
def test_strips_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three rows of four frames, the lowest of them the truth's."""
    rows = [{"scene": "curling", "half": "test", "way": "ours", "psnr_both": 28.4}]
    monkeypatch.setattr(
        fidelity, "evaluate", lambda *_: {"rows": rows, "means": [], "ahead": None}
    )
    assert main(["--scenes", "curling", "-o", str(tmp_path)]) == 0
    (truth,) = fidelity.truths(fidelity.TRUTH, ["curling"])
    (*_, (last, _)) = truth.frames()
    strips = cv2.imread(str(tmp_path / "curling.jpg"))[..., ::-1]
    height, width = last.shape[:2]
    assert strips.shape == (3 * height, 4 * width, 3)
    assert abs(strips[-height:, -width:].astype(float) - last).mean() < 3


def test_scenes_of_no_half_have_no_bar(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [{"scene": "a", "half": "", "way": "ours", "psnr_both": None}]
    monkeypatch.setattr(
        fidelity, "evaluate", lambda *_: {"rows": rows, "means": [], "ahead": None}
    )
    assert main([]) == 0
    assert "there is no bar" in capsys.readouterr().out
