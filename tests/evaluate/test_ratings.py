"""What raters saved, read back, or refused with reasons; means, intervals and agreement against SciPy and nature."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats
from pytest import approx

from physgen.cli.main import main
from physgen.evaluate.ratings import (
    Answers,
    Draws,
    agreement,
    files_in,
    findings,
    means,
    read_answers,
)
from physgen.evaluate.study import Key, read_key
from physgen.problems import InputError

METHODS, SCENES = ("ours", "rude <b>&|"), ("pool", "shelf", "ramp")
CLIPS = {
    f"c{k + 1}": (m, s)
    for k, (m, s) in enumerate((m, s) for m in METHODS for s in SCENES)
}
KEY = Key("abc123", 0, METHODS, SCENES, CLIPS)


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "study.key.json"
    path.write_text(KEY.text(), encoding="utf-8")
    return path


def saved(
    path: Path, rater: str, scores: dict[str, tuple[Any, Any]], **more: Any
) -> Path:
    answers = {
        clip: {"physical": one, "photo": two} for clip, (one, two) in scores.items()
    }
    record = {
        "physgen-study-answers": 1, "study": "abc123", "rater": rater, "session": rater, "answers": answers,
    }  # fmt: skip
    path.write_text(json.dumps({**record, **more}), encoding="utf-8")
    return path


def all_of(one: int, two: int) -> dict[str, tuple[int, int]]:
    return dict.fromkeys(CLIPS, (one, two))


def read(*files: Path) -> Answers:
    return read_answers(files, KEY)


def refused(*files: Path) -> str:
    with pytest.raises(InputError) as error:
        read(*files)
    return str(error.value)


# ---- reading ---------------------------------------------------------------------------------------------------------


def test_scores_come_to_their_method_and_scene(tmp_path: Path, key: Path) -> None:
    """By a key that was written and read."""
    scores = {clip: (k, 6 - k) for k, clip in enumerate(list(CLIPS)[:5], 1)}
    found = read_answers([saved(tmp_path / "a.json", "Ada", scores)], read_key(key))
    assert found.scores["physical"].tolist() == [[[1, 2, 3], [4, 5, 0]]]
    assert found.scores["photo"].tolist() == [[[5, 4, 3], [2, 1, 0]]]


@pytest.mark.parametrize("score", [0, 6, 2.5, "4", True, float("nan"), [3]])
def test_a_score_is_one_to_five(tmp_path: Path, score: Any) -> None:
    text = refused(
        saved(tmp_path / "a.json", "Ada", {**all_of(3, 3), "c2": (3, score)})
    )
    assert text.startswith(f"{tmp_path}/a.json: answers.c2.photo: ")
    assert "is not a score from 1 to 5" in text


def test_all_problems_are_reported_at_once(tmp_path: Path) -> None:
    one = saved(tmp_path / "a.json", "Ada", {"c1": (9, 3), "c99": (1, 1)})
    two = saved(tmp_path / "b.json", "Bo", all_of(3, 3), study="other")
    (tmp_path / "c.json").write_text("{oops")
    (tmp_path / "d.json").write_text("[" * 100_000)
    (tmp_path / "e.json").write_text('{"physgen-study-answers": 2}')
    (tmp_path / "g.json").write_text(KEY.text())
    nameless = saved(tmp_path / "h.json", " ", all_of(3, 3))
    text = refused(one, two, *(tmp_path / f"{name}.json" for name in "cdefg"), nameless)
    for reason in (
        "a.json: answers.c1.physical: 9 is not a score", "a.json: answers.c99: is not a clip of this study",
        'b.json: "other" is another study than the key\'s "abc123"', "c.json: cannot be read as JSON",
        "d.json: cannot be read as JSON", "e.json: physgen-study-answers 2 is not a version", "f.json: no such file",
        "g.json: is not a rater's answers", "h.json: has no rater",
    ):  # fmt: skip
        assert reason in text


def test_the_last_file_of_a_person_counts(tmp_path: Path) -> None:
    early = saved(
        tmp_path / "a.json", "Ada", {"c1": (1, 1)}, saved="2024-05-01T10:00:00Z"
    )
    late = saved(
        tmp_path / "a (1).json", "Ada", all_of(4, 4), saved="2024-05-01T11:00:00Z"
    )
    for files in ((early, late), (late, early)):
        found = read(*files)
        assert len(found.raters) == 1
        assert (found.scores["physical"] == 4).all()
    assert len(files_in([tmp_path, late], tmp_path / "x")) == 2, (
        "the same file is read once"
    )


def test_one_name_for_two_people_is_refused(tmp_path: Path) -> None:
    one = saved(tmp_path / "a.json", "Ada", all_of(1, 1), session="1")
    two = saved(tmp_path / "b.json", "ada", all_of(5, 5), session="2")
    assert '"ada" has other answers in' in refused(one, two)


def test_a_changed_key_is_refused(key: Path) -> None:
    record = json.loads(KEY.text())
    for change in (
        {"clips": {}},
        {"methods": ["ours"]},
        {"seed": "x"},
        {"clips": {"c1": 3}},
    ):
        key.write_text(json.dumps({**record, **change}))
        with pytest.raises(InputError, match="is a key that was changed"):
            read_key(key)


# ---- findings --------------------------------------------------------------------------------------------------------


def test_missing_answers_make_no_number(tmp_path: Path) -> None:
    """The second method's photo-realism is not rated: None, and never NaN."""
    first = {
        clip: (4, 4 if method == "ours" else None)
        for clip, (method, _) in CLIPS.items()
    }
    files = [saved(tmp_path / f"{k}.json", f"r{k}", first) for k in range(3)]
    files.append(saved(tmp_path / "e.json", "Eve", {}))
    found = findings(read(*files))
    record = found.as_dict()  # raises on NaN
    assert "nan" not in json.dumps(record).lower()
    rude = next(row for row in record["rows"] if row["method"] != "ours")
    assert rude["photo"] == {
        "mean": None,
        "low": None,
        "high": None,
        "answers": 0,
        "counts": [0] * 5,
    }
    assert record["raters"] == 3, "Eve has no answers"
    assert any("9 of 36 are missing" in sentence for sentence in found.sentences)
    assert "has no answer to any question" in refused(files[-1])


def test_the_leader_is_named_and_few_raters_are_told(tmp_path: Path) -> None:
    better = {
        clip: (5 if method == "ours" else 2, 3) for clip, (method, _) in CLIPS.items()
    }
    found = findings(
        read(*(saved(tmp_path / f"{k}.json", f"r{k}", better) for k in range(3)))
    ).sentences
    assert found[0] == "physical-realism: ours scores highest, 5.00 [5.00, 5.00] of 5."
    assert "With fewer than 5 raters or videos" in found[-1]
    single = findings(read(saved(tmp_path / "b.json", "Ada", {"c1": (4, 3)})))
    assert single.sentences[0] == "physical-realism: ours scores highest, 4.00 of 5."
    assert single.rows[0]["physical"]["low"] is None, "one answer has no interval"
    assert single.as_dict()["agreement"]["physical"]["alpha"] is None, "of one rater"


def test_the_command_reads_answers(
    tmp_path: Path, key: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Means as written down by hand, best first; a page in which nothing runs."""
    (tmp_path / "answers").mkdir()
    for k in range(3):
        mine = {
            clip: (5 - (method != "ours") * k, 2) for clip, (method, _) in CLIPS.items()
        }
        saved(tmp_path / "answers" / f"{k}.json", f"rater {k}", mine)
    asked = ["evaluate", "study", str(tmp_path / "answers"), "--key", str(key)]
    assert main([*asked, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert [(row["method"], row["physical"]["mean"]) for row in record["rows"]] == [
        ("ours", 5),
        ("rude <b>&|", 4),
    ]
    assert record["rows"][1]["physical"]["counts"] == [0, 0, 3, 3, 3]
    assert main([*asked, "-o", str(tmp_path / "page")]) == 0
    assert "ours scores highest, 5.00 [5.00, 5.00] of 5" in capsys.readouterr().out
    assert "rude <b>" not in (tmp_path / "page" / "index.html").read_text()


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (["a.json"], "--key: is missing"),
        (["a.json", "--key", "a.json"], "is not the key of a study"),
        (
            ["a.json", "--key", "study.key.json", "--videos", "3"],
            "--videos: is not used to read answers",
        ),
        (["a.json", "--key", "study.key.json", "-o", "a.json"], "is a file"),
        (["empty", "--key", "study.key.json"], "has no answer"),
        (["empty"], "has no methods"),
        (["empty", "empty"], "is a second folder"),
        (["empty", "-o", "page.txt"], "is not a name for a page"),
    ],
)
def test_wrong_ways_to_ask(
    tmp_path: Path, key: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    more: list[str], reason: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    saved(tmp_path / "a.json", "Ada", all_of(3, 2))
    (tmp_path / "empty").mkdir()
    before = sorted(path.name for path in tmp_path.iterdir())
    assert main(["evaluate", "study", *more]) == 2
    assert reason in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == before


# ---- statistics ------------------------------------------------------------------------------------------------------


def test_with_one_rater_it_is_the_plain_bootstrap_over_videos() -> None:
    scores = np.random.default_rng(1).integers(1, 6, (1, 1, 15))
    theirs = scipy.stats.bootstrap(
        (scores[0, 0],), np.mean, n_resamples=20000, method="percentile", random_state=0
    )
    (ours,) = means(scores, Draws(1, 15))
    assert (ours.low, ours.high) == approx(tuple(theirs.confidence_interval), abs=0.07)


def test_it_is_as_wide_as_the_variances_of_raters_and_videos_say() -> None:
    """Of additive scores, the draws' variance is the sum of both plain ones (Owen 2007, theorem 3)."""
    random = np.random.default_rng(2)
    raters, videos = random.integers(0, 2, 12), random.integers(1, 4, 20)
    scores = (raters[:, None, None] + videos[None, None, :]).astype(np.int64)
    draws = Draws(12, 20)
    drawn = draws.sums(scores.astype(float)) / draws.sums(np.ones(scores.shape))
    assert drawn.var() == approx(raters.var() / 12 + videos.var() / 20, rel=0.06)


def test_it_holds_the_truth_as_often_as_it_says() -> None:
    """Raters and videos drawn from what they would be: 95 % or more of the intervals hold the mean of all."""
    random, held, studies = np.random.default_rng(5), 0, 120
    draws = Draws(14, 15)
    for _ in range(studies):
        raw = 3 + random.normal(0, 0.5, (14, 1, 1)) + random.normal(0, 0.5, (1, 1, 15))
        raw = raw + random.normal(0, 0.6, (14, 1, 15))
        found = means(np.clip(np.round(raw), 1, 5).astype(np.int64), draws)[0]
        assert found.low is not None
        assert found.high is not None
        held += found.low <= 3 <= found.high
    assert held / studies >= 0.90


AUTHORS = """\
1 2 3 3 2 1 4 1 2 . . .
1 2 3 3 2 2 4 1 2 5 . 3
. 3 3 3 2 3 4 2 2 5 1 .
1 2 3 3 2 4 4 1 2 5 1 .
"""
"""K. Krippendorff, Computing Krippendorff's Alpha-Reliability (2011), section D: four observers, twelve units."""


def test_agreement_is_as_its_author_computed_it() -> None:
    rows = [
        [0 if score == "." else int(score) for score in line.split()]
        for line in AUTHORS.splitlines()
    ]
    found = agreement(np.array(rows))
    assert found.mean == approx(0.815, abs=5e-4)
    assert found.low is not None
    assert found.low < 0.815


def test_equal_scores_agree_wholly_and_random_ones_not_at_all() -> None:
    random = np.random.default_rng(0)
    same = agreement(np.stack([random.integers(1, 6, 40)] * 3))
    assert (same.mean, same.low, same.high) == (1, 1, 1)
    dice = agreement(random.integers(1, 6, (4, 400)))
    assert dice.mean == approx(0, abs=0.05)
    assert dice.low is not None
    assert dice.high is not None
    assert dice.low < 0 < dice.high


@pytest.mark.parametrize(
    "scores",
    [[[3, 4, 5]], [[3, 3, 3], [3, 3, 3]], [[1, 2, 0], [0, 0, 3]], [[0, 0], [0, 0]]],
)
def test_where_it_has_no_meaning_it_has_no_value(scores: list[list[int]]) -> None:
    """One rater, the same everywhere, no clip twice, nothing at all."""
    assert agreement(np.array(scores)).mean is None
