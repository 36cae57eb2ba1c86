"""The command `fidelity.py`: its bar, its exit codes and its strips of frames."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import fidelity
import pytest
from fidelity import main


def test_a_scene_without_truth_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--scenes", "curling,nope"]) == 2
    assert "nope has no truth" in capsys.readouterr().err


@pytest.mark.parametrize(("ahead", "code", "state"), [(0.89, 1, "MISSED"), (4.5, 0, "met")])
def test_its_bar_is_told_with_its_exit_code(
    ahead: float, code: int, state: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [
        {"scene": "a", "half": "test", "way": way, "psnr_both": level, "psnr_objects": level}
        for way, level in (("ours", 20 + ahead), ("paper, relit", 20.0))
    ]
    better = fidelity.ahead(fidelity.means(rows))
    assert better == pytest.approx(ahead)
    result = {"rows": rows, "means": fidelity.means(rows), "ahead": better}
    monkeypatch.setattr(fidelity, "evaluate", lambda *_: result)
    assert main(["--json"]) == code
    (bar,) = json.loads(capsys.readouterr().out)["bars"]
    assert (bar["found"], bar["bar"], bar["passed"]) == (f"{ahead:.2f} dB", "4 dB", code == 0)
    assert main([]) == code
    text = capsys.readouterr().out
    assert f"{ahead:.2f} dB, the bar is 4 dB: {state}" in text
    assert re.search(rf"^a +test +{20 + ahead:.2f} / - +20.00 / -$", text, re.M)


@pytest.mark.slow
def test_strips_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three rows of four frames, the lowest of them the truth's."""
    rows = [{"scene": "curling", "half": "test", "way": "ours", "psnr_both": 28.4}]
    monkeypatch.setattr(fidelity, "evaluate", lambda *_: {"rows": rows, "means": [], "ahead": None})
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
    monkeypatch.setattr(fidelity, "evaluate", lambda *_: {"rows": rows, "means": [], "ahead": None})
    assert main([]) == 0
    assert "there is no bar" in capsys.readouterr().out
