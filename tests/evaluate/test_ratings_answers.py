"""What raters saved, read back: in scores, or in words that say what is wrong with which file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from physgen.cli.main import main
from physgen.evaluate.ratings import Answers, files_in, findings, read_answers
from physgen.evaluate.study import Key, read_key
from physgen.problems import InputError

CLIPS = {
    f"c{k + 1}": (method, scene)
    for k, (method, scene) in enumerate(
        (m, s) for m in ("ours", "rude <b>&|") for s in ("pool", "shelf", "ramp")
    )
}
KEY = Key("abc123", 0, ("ours", "rude <b>&|"), ("pool", "shelf", "ramp"), CLIPS)


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "study.key.json"
    path.write_text(KEY.text(), encoding="utf-8")
    return path


def saved(path: Path, rater: str, scores: dict[str, tuple[Any, Any]], **more: Any) -> Path:
    answers = {clip: {"physical": one, "photo": two} for clip, (one, two) in scores.items()}
    record = {
        "physgen-study-answers": 1,
        "study": "abc123",
        "rater": rater,
        "session": rater,
        "answers": answers,
    }
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


def test_scores_come_to_their_method_and_scene(tmp_path: Path, key: Path) -> None:
    """By a key that was written and read."""
    scores = {clip: (k, 6 - k) for k, clip in enumerate(list(CLIPS)[:5], 1)}
    found = read_answers([saved(tmp_path / "a.json", "Ada", scores)], read_key(key))
    assert found.scores["physical"].tolist() == [[[1, 2, 3], [4, 5, 0]]]
    assert found.scores["photo"].tolist() == [[[5, 4, 3], [2, 1, 0]]]


@pytest.mark.parametrize("score", [0, 6, -1, 2.5, "4", True, float("nan"), [3]])
def test_a_score_is_one_to_five(tmp_path: Path, score: Any) -> None:
    text = refused(saved(tmp_path / "a.json", "Ada", {**all_of(3, 3), "c2": (3, score)}))
    assert text.startswith(f"{tmp_path}/a.json: answers.c2.photo: ")
    assert "is no score from 1 to 5" in text


def test_everything_wrong_is_told_at_once(tmp_path: Path) -> None:
    one = saved(tmp_path / "a.json", " ", {"c1": (9, 3), "c99": (1, 1)})
    two = saved(tmp_path / "b.json", "Bo", all_of(3, 3), study="other")
    (tmp_path / "c.json").write_text("{oops")
    (tmp_path / "d.json").write_text("[" * 100_000)
    (tmp_path / "e.json").write_text('{"physgen-study-answers": 2}')
    files = [one, two, *(tmp_path / f"{name}.json" for name in "cdefg")]
    (tmp_path / "g.json").write_text(KEY.text())
    text = refused(*files)
    for said in (
        "a.json: rater: ", "a.json: answers.c1.physical: 9 is no score",
        "a.json: answers.c99: is no clip of this study",
        'b.json: "other" is another study than the key\'s "abc123"', "c.json: cannot be read as JSON (line 1)",
        "d.json: cannot be read as JSON", "e.json: physgen-study-answers 2 is of a form", "f.json: no such file",
        "g.json: is the key of a study, not answers",
    ):  # fmt: skip
        assert said in text


def test_who_saves_twice_counts_once_and_the_last_time(tmp_path: Path) -> None:
    early = saved(tmp_path / "a.json", "Ada", {"c1": (1, 1)}, saved="2024-05-01T10:00:00Z")
    late = saved(tmp_path / "a (1).json", "Ada", all_of(4, 4), saved="2024-05-01T11:00:00Z")
    for files in ((early, late), (late, early)):
        found = read(*files)
        assert len(found.raters) == 1
        assert (found.scores["physical"] == 4).all()
        assert found.notes == ("Ada saved more than once: a (1).json counts, a.json does not.",)
    assert len(files_in([tmp_path, late], tmp_path / "x")) == 2, "the same file is read once"


def test_one_name_for_two_people_is_refused(tmp_path: Path) -> None:
    one = saved(tmp_path / "a.json", "Ada", all_of(1, 1), session="1")
    two = saved(tmp_path / "b.json", "ada", all_of(5, 5), session="2")
    assert '"ada" has other answers in' in refused(one, two)


def test_missing_answers_are_told_and_make_no_number(tmp_path: Path) -> None:
    """Nobody rated the second method's photo-realism: a dash, None, and never NaN."""
    first = {clip: (4, 4 if method == "ours" else None) for clip, (method, _) in CLIPS.items()}
    files = [saved(tmp_path / f"{k}.json", f"r{k}", first) for k in range(3)]
    files.append(saved(tmp_path / "e.json", "Eve", {}))
    found = findings(read(*files))
    record = found.as_dict()  # raises on NaN
    assert "nan" not in json.dumps(record).lower()
    rude = next(row for row in record["rows"] if row["method"] != "ours")
    assert rude["photo"] == {"mean": None, "low": None, "high": None, "answers": 0, "counts": [0] * 5}
    assert "Eve answered nothing and is left out." in found.sentences
    assert any("9 of 36 are missing" in sentence for sentence in found.sentences)
    assert record["comparisons"]["photo"][0]["adjusted"] is None


def test_answers_that_say_nothing_are_no_result(tmp_path: Path) -> None:
    assert "holds no answer to any question" in refused(saved(tmp_path / "a.json", "Ada", {}))


def test_one_rater_alone_is_told_so(tmp_path: Path) -> None:
    found = findings(read(saved(tmp_path / "a.json", "Ada", all_of(3, 2))))
    assert any(sentence.startswith("One rater alone") for sentence in found.sentences)
    assert found.as_dict()["agreement"]["physical"]["alpha"] is None


def test_nobody_is_ahead_of_an_equal_or_surely_ahead_by_few_answers(tmp_path: Path) -> None:
    alike = findings(read(saved(tmp_path / "a.json", "Ada", all_of(4, 4)))).sentences
    assert alike[0] == "physical-realism: ours and rude <b>&| score alike, 4.00 of 5."
    better = {clip: (5 if method == "ours" else 2, 3) for clip, (method, _) in CLIPS.items()}
    few = findings(read(*(saved(tmp_path / f"{k}.json", f"r{k}", better) for k in range(3)))).sentences
    assert few[0].endswith("of 5, not surely more than rude <b>&| (p 0.250).")  # 2 of 8 patterns of signs
    clips = {f"c{k}": (method, f"s{k // 2}") for k, method in enumerate(("ours", "theirs") * 8)}
    key = Key("abc123", 0, ("ours", "theirs"), tuple(f"s{k}" for k in range(8)), clips)
    many = {clip: (5 if method == "ours" else 2, 3) for clip, (method, _) in clips.items()}
    files = [saved(tmp_path / f"{k}.json", f"r{k}", many) for k in range(8)]
    assert findings(read_answers(files, key)).sentences[0].endswith("[5.00, 5.00] of 5.")


def test_who_alone_was_rated_is_ahead_of_nobody(tmp_path: Path) -> None:
    one = {"c1": (4, 3), "c2": (2, 3), "c3": (3, None)}
    found = findings(read(saved(tmp_path / "a.json", "Ada", one)))
    assert found.sentences[0].startswith("physical-realism: ours alone was rated, 3.00 [2.")
    single = findings(read(saved(tmp_path / "b.json", "Ada", {"c1": (4, 3)})))
    assert single.sentences[0] == "physical-realism: ours alone was rated, 4.00 of 5."
    assert "highest" not in single.sentences[0]
    assert single.rows[0]["physical"]["low"] is None, "one answer has no interval"
    key = Key("abc123", 0, ("ours",), ("pool", "shelf"), {"c1": ("ours", "pool"), "c2": ("ours", "shelf")})
    solo = findings(read_answers([saved(tmp_path / "c.json", "Ada", {"c1": (4, 3), "c2": (4, 3)})], key))
    assert solo.sentences[0] == "physical-realism: ours 4.00 [4.00, 4.00] of 5."


def test_a_changed_key_is_refused(tmp_path: Path, key: Path) -> None:
    record = json.loads(KEY.text())
    for change in ({"clips": {}}, {"methods": ["ours"]}, {"seed": "x"}, {"clips": {"c1": 3}}):
        key.write_text(json.dumps({**record, **change}))
        with pytest.raises(InputError, match="is a key that was changed"):
            read_key(key)


# ---- the command -----------------------------------------------------------------------------------------------------


def test_the_command_reads_answers(tmp_path: Path, key: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Means as written down by hand, best first; a page with a figure a question, in which nothing runs."""
    (tmp_path / "answers").mkdir()
    for k in range(3):
        mine = {clip: (5 - (method != "ours") * k, 2) for clip, (method, _) in CLIPS.items()}
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
    told = capsys.readouterr().out
    assert "ours scores highest, 5.00 [5.00, 5.00] of 5" in told
    page = (tmp_path / "page" / "index.html").read_text()
    assert page.count('<img src="data:image/svg') == 2
    assert "rude <b>" not in page


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["a.json"], "--key: is missing"),
        (["."], "--key: is missing"),
        (["a.json", "--key", "a.json"], "holds answers: it is not the key"),
        (["a.json", "--key", "none.json"], "no such file"),
        (["a.json", "--key", "study.key.json", "--videos", "3"], "--videos: has no part in reading answers"),
        (["a.json", "--key", "study.key.json", "-o", "a.json"], "is a file"),
        (["empty", "--key", "study.key.json"], "holds no answers (*.json)"),
        (["empty"], "holds no methods"),
        (["empty", "empty"], "is a second folder"),
        (["empty", "-o", "page.txt"], "is no name for a page"),
    ],
)
def test_wrong_ways_to_ask(
    tmp_path: Path, key: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    more: list[str], said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    saved(tmp_path / "a.json", "Ada", all_of(3, 2))
    (tmp_path / "empty").mkdir()
    before = sorted(path.name for path in tmp_path.iterdir())
    assert main(["evaluate", "study", *more]) == 2
    assert said in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == before
