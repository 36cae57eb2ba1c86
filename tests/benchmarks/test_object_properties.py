"""Masses and orders against hand-made numbers and scipy; tables with every fault; who answers what."""

from __future__ import annotations

import json
from itertools import combinations
from math import pi
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from vlm_stub import BALL, Stub, said

from physgen.cli.main import main as physgen
from physgen.evaluate.properties import (
    SHIPPED,
    Answer,
    Form,
    Item,
    Objects,
    Origin,
    ask,
    findings,
    masses,
    order,
    read_table,
)
from physgen.problems import InputError
from physgen.registry import Backends


def main(arguments: list[str]) -> int:
    return physgen(["evaluate", "properties", *arguments])


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


def test_masses_as_the_definitions_say() -> None:
    pairs = [(100.0, 130.0), (50.0, 20.0), (8.0, 8.0), (1000.0, 1301.0)]
    score = masses(pairs)
    assert score is not None
    n = len(pairs)
    assert score.ade == pytest.approx(sum(abs(p - t) for t, p in pairs) / n)
    assert score.near_count == 2  # just 30 % off still counts, a little more does not
    assert masses([]) is None


def test_order_agrees_with_kendall() -> None:
    rng = np.random.default_rng(5)
    names = [f"x{k}" for k in range(9)]
    true, told = (
        dict(zip(names, rng.permutation(9).astype(float), strict=True))
        for _ in range(2)
    )
    found = order(true, told)
    tau = stats.kendalltau(list(true.values()), list(told.values())).statistic
    assert (2 * found.right - found.count) / found.count == pytest.approx(tau)
    assert len(found.wrong_pairs) == found.count - found.right
    assert order(true, true).right == found.count == 36
    assert order(true, dict.fromkeys(names, 0.5)).ties == 36
    assert (
        order(dict.fromkeys(names, 0.5), told).count == 0
    )  # what is truly equal is no pair


def test_the_shipped_table_is_a_test_and_no_source() -> None:
    table = read_table(SHIPPED)
    assert len(table.items_with_mass) == 42
    sides = {Form.BALL: lambda s: pi / 6 * s[0] ** 3, Form.TURNED: lambda s: pi / 4 * s[0] * s[1] ** 2,
             Form.BOX: lambda s: s[0] * s[1] * s[2]}  # fmt: skip
    for item in table.items_with_mass:
        assert item.mass is not None
        assert 0.02 < 1000 * item.mass / sides[item.form](item.size) < 5, (
            item.name
        )  # g/cm³ of its box
    knowledge = (SHIPPED.parents[1] / "materials.yaml").read_text()
    for word in ("YCB", "Calli", "OpenStax", "Factbook", "Transport Units"):
        assert word in SHIPPED.read_text()
        assert word not in knowledge
    pairs = {"friction": 0, "elasticity": 0}
    for ranking in table.rankings:
        for a, b in combinations(ranking.values.values(), 2):
            pairs[ranking.coefficient] += a != b
    assert pairs == {"friction": 24, "elasticity": 36}


def test_size_is_told_by_the_scale() -> None:
    """A solid steel ball weighs its volume times 7.85 g/cm³, and eight times that at twice the size."""
    one, two = (
        Item(f"b{d}", "steel ball", Form.BALL, (d,), 1.0) for d in (60.0, 120.0)
    )
    told = ask(Objects("", "", (one, two), ()), Backends(), True, lambda *_: None)
    assert told["b60.0"].mass == pytest.approx(7.85 * pi / 6 * 6**3, rel=0.01)
    assert told["b120.0"].mass == pytest.approx(8 * 7.85 * pi / 6 * 6**3, rel=0.01)
    hidden = ask(Objects("", "", (one, two), ()), Backends(), False, lambda *_: None)
    assert hidden["b60.0"].mass == hidden["b120.0"].mass


def test_right_answers_are_right_and_turned_ones_are_not(tmp_path: Path) -> None:
    table, asked = read_table(written(tmp_path / "t.yaml")), Origin("table", True)
    mass, friction = findings(table, RIGHT, asked).rows
    assert (mass["within_30"], mass["ade_g"]) == (2, 0)
    assert (friction["pairs"], friction["right"]) == (3, 3)
    turned = {"ball": Answer(4, 0.9), "cork": Answer(888, 0.1), "box": Answer(1, 0.2)}
    mass, friction = findings(table, turned, asked).rows
    assert (mass["within_30"], mass["ade_g"]) == (0, 884)
    assert friction["right"] == 0


def test_the_backend_answers_on_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, page = written(tmp_path / "t.yaml"), tmp_path / "page"
    assert main([str(table), "-o", str(page)]) == 0
    text = capsys.readouterr().out
    assert "The backend table gives 2 of 2 masses to within 30 %" in text
    assert "materials.yaml" in text  # what is independent is said
    assert set(json.loads((page / "result.json").read_text())["answers"]) == {
        "ball",
        "cork",
        "box",
    }
    assert "steel ball" in (page / "index.html").read_text()


def test_a_model_is_asked_one_by_one(
    vlm_stub: Stub, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = written(tmp_path / "t.yaml")
    asked = [str(table), "--backend", "physics=vlm", "--json"]
    assert main(asked) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["by"] == "vlm"
    assert {one["mass"] for one in told["answers"].values()} == {BALL["mass"]}
    assert len(vlm_stub.requests) == 3
    assert any(
        "steel ball" in said(body) and "0.06" in said(body)
        for body in vlm_stub.requests
    )
    assert main(asked) == 0
    assert len(vlm_stub.requests) == 3  # from the cache


def test_faults_of_a_table_and_of_flags(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for text, wrong in (
        (
            "objects:\n  a: {mass: 3, form: turned, size: [1]}\n",
            "write 2 lengths in mm",
        ),
        ("objects: {}\n", "has nothing to compare answers with"),
        (
            "objects:\n  a: {mass: 1}\nrankings: {friction: [{values: {a: 1, b: 2}}]}\n",
            "are not two objects of the table or more",
        ),
    ):
        with pytest.raises(InputError, match=wrong):
            read_table(written(tmp_path / "t.yaml", text))
    assert main(["--backend", "segment=learned"]) == 2
    assert "is not used here" in capsys.readouterr().err


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
