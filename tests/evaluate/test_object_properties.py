"""Masses and orders against hand-made numbers and scipy; tables and answers with every fault; who answers what."""

from __future__ import annotations

import json
from base64 import b64decode
from itertools import combinations
from math import log, pi
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import stats
from vlm_stub import BALL, Stub, said

from physgen.cli.main import main
from physgen.evaluate.objects import SHIPPED, Answer, Form, Item, Objects, read_answers, read_table
from physgen.evaluate.properties import ask, masses, order
from physgen.problems import InputError
from physgen.registry import Backends
from physgen.simulate.uncertainty_summary import wilson

TABLE = """\
title: two balls and a box
objects:
  ball: {label: steel ball, form: ball, size: [60], mass: 888}
  cork: {label: cork, form: turned, size: [44, 24], mass: 4}
  box: {label: cardboard box, form: box, size: [300, 200, 100]}
rankings:
  friction:
    - about: on wood
      source: somebody
      values: {ball: 0.3, cork: 0.6, box: 0.5}
"""
RIGHT = {
    "ball": Answer(888, 0.31, 0.5),
    "cork": Answer(4.0, 0.9, 0.5),
    "box": Answer(100, 0.32, 0.5),
}


def written(path: Path, text: str = TABLE) -> Path:
    path.write_text(text)
    return path


def as_json(path: Path, answers: dict[str, Answer]) -> Path:
    rows = [{"name": name, "mass": a.mass, "friction": a.friction} for name, a in answers.items()]
    return written(path, json.dumps({"answers": rows}))


def test_masses_as_the_definitions_say() -> None:
    pairs = [(100.0, 130.0), (50.0, 20.0), (8.0, 8.0), (1000.0, 1301.0)]
    score = masses(pairs)
    assert score is not None
    n = len(pairs)
    assert score.ade == pytest.approx(sum(abs(p - t) for t, p in pairs) / n)
    assert score.alde == pytest.approx(sum(abs(log(p) - log(t)) for t, p in pairs) / n)
    assert score.ape == pytest.approx(sum(abs(p - t) / t for t, p in pairs) / n)
    assert score.mnre == pytest.approx(sum(min(p / t, t / p) for t, p in pairs) / n)
    assert score.bias == pytest.approx(stats.gmean([p / t for t, p in pairs]))
    assert score.near == 2  # just 30 % off still counts, a little more does not
    assert masses([]) is None


@pytest.mark.parametrize(("hits", "count"), [(0, 5), (15, 20), (20, 20)])
def test_the_interval_is_wilsons(hits: int, count: int) -> None:
    found = stats.binomtest(hits, count).proportion_ci(method="wilson")
    assert wilson(hits, count) == pytest.approx((found.low, found.high), abs=1e-9)


def test_order_agrees_with_kendall() -> None:
    rng = np.random.default_rng(5)
    names = [f"x{k}" for k in range(9)]
    true, told = (dict(zip(names, rng.permutation(9).astype(float), strict=True)) for _ in range(2))
    found = order(true, told)
    tau = stats.kendalltau(list(true.values()), list(told.values())).statistic
    assert (2 * found.right - found.count) / found.count == pytest.approx(tau)
    assert len(found.wrong) == found.count - found.right
    assert order(true, true).right == found.count == 36
    assert order(true, dict.fromkeys(names, 0.5)).tied == 36
    assert order(dict.fromkeys(names, 0.5), told).count == 0  # what is truly equal is no pair


def test_the_shipped_table_is_a_test_and_no_source() -> None:
    table = read_table(SHIPPED)
    assert len(table.weighed) == 42
    sides = {Form.BALL: lambda s: pi / 6 * s[0] ** 3, Form.TURNED: lambda s: pi / 4 * s[0] * s[1] ** 2,
             Form.BOX: lambda s: s[0] * s[1] * s[2]}  # fmt: skip
    for item in table.weighed:
        assert item.mass is not None
        assert 0.02 < 1000 * item.mass / sides[item.form](item.size) < 5, item.name  # g/cm³ of its box
    knowledge = (SHIPPED.parents[1] / "materials.yaml").read_text()
    for word in ("YCB", "Calli", "OpenStax", "Factbook", "Transport Units"):
        assert word in SHIPPED.read_text()
        assert word not in knowledge
    pairs = {of: sum(1 for one in table.rankings if one.of == of for a, b in combinations(one.values.values(), 2)
             if a != b) for of in ("friction", "elasticity")}  # fmt: skip
    assert pairs == {"friction": 24, "elasticity": 36}


def test_size_is_told_by_the_scale() -> None:
    """A solid steel ball weighs its volume times 7.85 g/cm³, and eight times that at twice the size."""
    one, two = (Item(f"b{d}", "steel ball", Form.BALL, (d,), 1.0) for d in (60.0, 120.0))
    told = ask(Objects("", "", (one, two), ()), Backends(), True, lambda *_: None)
    assert told["b60.0"].mass == pytest.approx(7.85 * pi / 6 * 6**3, rel=0.01)
    assert told["b120.0"].mass == pytest.approx(8 * 7.85 * pi / 6 * 6**3, rel=0.01)
    hidden = ask(Objects("", "", (one, two), ()), Backends(), False, lambda *_: None)
    assert hidden["b60.0"].mass == hidden["b120.0"].mass


def test_a_photo_is_asked_about_where_there_is_one(tmp_path: Path) -> None:
    mask = np.zeros((60, 80), np.uint8)
    cv2.circle(mask, (40, 30), 20, 1, -1)
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((60, 80, 3), 128, np.uint8))
    row = "objects:\n  b: {label: steel ball, form: ball, size: [40], mass: 263, photo: photo.png, mask: mask.png}\n"
    table = read_table(written(tmp_path / "t.yaml", row))
    told = ask(table, Backends(), True, lambda *_: None)["b"].mass
    assert told == pytest.approx(7.85 * pi / 6 * 4**3, rel=0.1)  # 40 px are 40 mm
    cv2.imwrite(str(tmp_path / "mask.png"), mask[:-1])
    with pytest.raises(InputError, match="differs from the 80 x 60 px"):
        ask(table, Backends(), True, lambda *_: None)


def test_right_answers_are_right_and_turned_ones_are_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = written(tmp_path / "t.yaml")
    answers = as_json(tmp_path / "a.json", RIGHT)
    assert main(["evaluate", "properties", str(table), "--answers", str(answers), "--json"]) == 0
    mass, friction = json.loads(capsys.readouterr().out)["rows"]
    assert (mass["within_30"], mass["ade_g"], mass["mnre"]) == (2, 0, 1)
    assert (friction["pairs"], friction["right"]) == (3, 3)
    turned = {"ball": Answer(4, 0.9), "cork": Answer(888, 0.1), "box": Answer(1, 0.2)}
    as_json(answers, turned)
    assert main(["evaluate", "properties", str(table), "--answers", str(answers), "--json"]) == 0
    mass, friction = json.loads(capsys.readouterr().out)["rows"]
    assert (mass["within_30"], mass["mnre"]) == (0, pytest.approx(4 / 888))
    assert friction["right"] == 0


def test_the_backend_answers_saves_and_is_scored_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, saved, page = written(tmp_path / "t.yaml"), tmp_path / "new" / "a.json", tmp_path / "page"
    asked = ["evaluate", "properties", str(table)]
    assert main([*asked, "--save-answers", str(saved), "-o", str(page)]) == 0
    text = capsys.readouterr().out
    assert "The backend table gives 2 of 2 masses to within 30 %" in text
    assert "materials.yaml" in text  # what is independent is said
    first = json.loads((page / "result.json").read_text())
    assert (page / "index.html").read_text().count("data:image/svg+xml") == 2
    assert main([*asked, "--answers", str(saved), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"] == first["rows"]


def test_a_model_is_asked_one_by_one(
    vlm_stub: Stub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = written(tmp_path / "t.yaml")
    asked = ["evaluate", "properties", str(table), "--backend", "physics=vlm", "--json"]
    assert main(asked) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["by"] == "vlm"
    assert {one["mass"] for one in told["answers"].values()} == {BALL["mass"]}
    assert len(vlm_stub.requests) == 3
    assert any("steel ball" in said(body) and "0.06" in said(body) for body in vlm_stub.requests)
    assert main(asked) == 0
    assert len(vlm_stub.requests) == 3  # from the cache


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("objects:\n  a: {mass: heavy}\n", r"t.yaml:2:13: objects.a.mass: \"?heavy\"? is not grams above 0"),
        ("objects:\n  a: {mass: -3}\n", "is not grams above 0"),
        ("objects:\n  a: {mas: 3}\n", "did you mean mass"),
        ("objects:\n  a: {mass: 3, form: bal}\n", "is no form; did you mean ball"),
        ("objects:\n  a: {mass: 3, form: turned, size: [1]}\n", "is not 2 lengths in mm"),
        ("objects:\n  a: {mass: 3, photo: x.png}\n", "stands without a mask"),
        ("objects:\n  a: {label: apple}\n", "has nothing to compare answers with"),
        ("objects: {}\n", "has nothing to compare answers with"),
        ("objects:\n  a: {mass: 1}\nrankings: {friction: [{values: {a: 1, b: 2}}]}\n", '"b" is no object'),
        ("objects:\n  a: {mass: 1}\nrankings: {friction: [{values: {a: 1}}]}\n", "compares nothing"),
        ("objects:\n  a: {mass: 1}\nrankings: {colour: []}\n", "is not asked"),
        ("nouns: {}\n", "means nothing here"),
    ],
)
def test_faults_of_a_table(tmp_path: Path, text: str, wrong: str) -> None:
    with pytest.raises(InputError, match=wrong):
        read_table(written(tmp_path / "t.yaml", text))


def test_a_table_as_csv(tmp_path: Path) -> None:
    text = "name,label,form,size,mass,friction\na,steel ball,ball,60,888,0.3\nb,,box,30x20x10,,0.5\n"
    table = read_table(written(tmp_path / "t.csv", text))
    assert table.items[0] == Item("a", "steel ball", Form.BALL, (60.0,), 888.0)
    assert table.items[1].label == "b"
    assert dict(table.rankings[0].values) == {"a": 0.3, "b": 0.5}
    with pytest.raises(InputError, match=r"(?s)t.csv:2:1: .*not grams.*t.csv:3:1: .*two objects"):
        read_table(written(tmp_path / "t.csv", "name,mass\na,nan\na,3\n"))
    with pytest.raises(InputError, match="no column name"):
        read_table(written(tmp_path / "t.csv", "mass\n3\n"))
    with pytest.raises(InputError, match=r"t.csv:2:1: objects.a: .*p.png.* stands in no column"):
        read_table(written(tmp_path / "t.csv", "name,mass\na,3,p.png\n"))


def test_a_table_without_sizes_does_not_say_that_they_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for rows, words in (
        ("a,apple,,100\n", "its size is not given"),
        ("a,apple,70x60x60,100\nb,pear,,90\n", "given by the scale of the 1 that have one in the table"),
        ("a,apple,70x60x60,100\n", "its size is given by the scale."),
    ):
        table = written(tmp_path / "t.csv", f"name,label,size,mass\n{rows}")
        assert main(["evaluate", "properties", str(table)]) == 0
        assert words in " ".join(capsys.readouterr().out.split())


def test_masses_near_each_other_have_plain_numbers_on_their_axes(tmp_path: Path) -> None:
    table = written(tmp_path / "t.csv", "name,label,size,mass\na,apple,70x60x60,180\nb,pear,90x60x60,210\n")
    assert main(["evaluate", "properties", str(table), "-o", str(tmp_path / "page")]) == 0
    page = (tmp_path / "page" / "index.html").read_text()
    plot = b64decode(page.partition("data:image/svg+xml;base64,")[2].partition('"')[0]).decode()
    assert "mathdefault" not in plot


@pytest.mark.parametrize(
    ("name", "text", "wrong"),
    [
        ("a.json", "{", "is not JSON"),
        ("a.json", "[3]", "is no answer"),
        ("a.json", '{"ball": {"mass": 1}, "bull": {"mass": 1}}', "bull.* is no object.*did you mean ball"),
        ("a.json", '{"ball": {"mass": 1, "friction": 1}}', r"mass of cork is missing \(1 of 2\)"),
        ("a.json", '{"ball": {"mass": NaN}}', "is not grams above 0"),
        ("a.json", '{"ball": {"mass": 1e999}}', "is not grams above 0"),
        ("a.csv", "name,mass\nball,0\n", "a.csv:2:1: ball.mass: .*is not grams above 0"),
        ("a.csv", "mass\n1\n", "no column name"),
        ("a.csv", "name,mass\nball,3\nball,4\n", "answered twice"),
    ],
)
def test_faults_of_answers(tmp_path: Path, name: str, text: str, wrong: str) -> None:
    table = read_table(written(tmp_path / "t.yaml"))
    with pytest.raises(InputError, match=wrong):
        read_answers(written(tmp_path / name, text), table)


@pytest.mark.parametrize(
    ("flags", "wrong"),
    [
        (["--backend", "segment=classical"], "has no part in this"),
        (["--answers", "a.json", "--hide-size"], "has no meaning beside --answers"),
        (["nothing.yaml"], "cannot be read"),
    ],
)
def test_faults_of_flags(
    flags: list[str],
    wrong: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["evaluate", "properties", *flags]) == 2
    assert wrong in capsys.readouterr().err


def test_the_studio_is_asked_at_both_scales(bundled: Path, tmp_path: Path) -> None:
    from studio_properties import ask_photos

    truth = bundled.parent / "studio" / "truth" / "wall-ball" / "truth.json"
    home = tmp_path / "studio" / "truth" / "wall-ball"
    home.mkdir(parents=True)
    (home / "truth.json").write_text(truth.read_text())
    (tmp_path / "scenes").symlink_to(bundled)
    kinds = ask_photos(tmp_path / "studio" / "truth", Backends(), lambda *_: None)
    assert [(one.true.mass, one.count) for one in kinds] == [(58, 1), (56, 1)]
    assert all(one.scaled.mass == pytest.approx(57.7, rel=0.05) for one in kinds)
    (home / "truth.json").write_text("{}")
    with pytest.raises(InputError, match="is no truth of the studio"):
        ask_photos(tmp_path / "studio" / "truth", Backends(), lambda *_: None)
