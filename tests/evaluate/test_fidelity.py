"""`evaluate fidelity` as it is asked, and how it ends."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from physgen.cli.main import main
from physgen.evaluate import fidelity


@pytest.mark.parametrize(
    ("scenes", "said"),
    [(" , ", "names none"), ("curling,nope", "nope has no truth")],
)
def test_scenes_that_are_none(scenes: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["evaluate", "fidelity", "--scenes", scenes])
    except SystemExit as ended:
        code = int(str(ended.code))
    assert code == 2
    assert said in capsys.readouterr().err


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
    assert main(["evaluate", "fidelity", "--json"]) == code
    (bar,) = json.loads(capsys.readouterr().out)["bars"]
    assert (bar["found"], bar["bar"], bar["passed"]) == (f"{ahead:.2f} dB", "4 dB", code == 0)
    assert main(["evaluate", "fidelity"]) == code
    text = capsys.readouterr().out
    assert f"{ahead:.2f} dB, the bar is 4 dB: {state}" in text
    assert re.search(rf"^a +test +{20 + ahead:.2f} / - +20.00 / -$", text, re.M)


@pytest.mark.slow
def test_a_page_has_frames(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [{"scene": "curling", "half": "test", "way": "ours", "psnr_both": 28.4}]
    monkeypatch.setattr(fidelity, "evaluate", lambda *_: {"rows": rows, "means": [], "ahead": None})
    assert main(["evaluate", "fidelity", "--scenes", "curling", "-o", str(tmp_path / "page")]) == 0
    page = (tmp_path / "page" / "index.html").read_text()
    assert page.count("data:image/jpeg") == 1
    assert "curling, from above: paper, relit, ours, and the truth, at the same moments." in page


def test_scenes_of_no_half_have_no_bar(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [{"scene": "a", "half": "", "way": "ours", "psnr_both": None}]
    monkeypatch.setattr(fidelity, "evaluate", lambda *_: {"rows": rows, "means": [], "ahead": None})
    assert main(["evaluate", "fidelity"]) == 0
    assert "there is no bar" in capsys.readouterr().out
