"""How a fan is asked for, and that its page of figures is what the results say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from physgen.batch.run import Job
from physgen.cli.main import main
from physgen.pipeline import RenderOptions

SCENE = """\
physgen: 1
size: [64, 48]
world: {duration: 0.1}
objects:
  ball: {shape: {circle: {center: [30, 20], radius: 8}}, mass: 5, from: {mass: table 0.4}}
render: {frames: 2}
"""


def test_the_command_gives_a_table_of_so_many_draws(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.yaml").write_text(SCENE)
    command = [
        "render",
        str(tmp_path / "a.yaml"),
        "-o",
        str(tmp_path / "out"),
        "--report",
        "none",
    ]
    tables = []
    for flags in (["--fan", "3"], ["--fan", "5"], ["--fan", "3", "--fan-seed", "9"]):
        assert main([*command, *flags]) == 0
        tables.append((tmp_path / "out/a/fan.csv").read_text().splitlines())
    assert tables[1][:4] == tables[0], (
        "another fan is made anew, and its first draws are the same"
    )
    assert len(tables[1]) == 6
    assert tables[2][0] == tables[0][0]
    assert tables[2][1:] != tables[0][1:]
    assert (
        json.loads((tmp_path / "out/a/manifest.json").read_text())["fan"]["seed"] == 9
    )
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("count", ["1", "1001", "-3", "many"])
def test_a_fan_of_one_is_none(count: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["render", "scene.yaml", "--fan", count])
    assert left.value.code == 2
    assert "from 2 to 1000" in capsys.readouterr().err or count.startswith("-")


def test_another_fan_is_another_clip() -> None:
    def mark(**options: Any) -> str:
        return Job("a.yaml", RenderOptions(**options)).mark

    assert len({mark(), mark(draws=8), mark(draws=9), mark(draws=8, draw_seed=1)}) == 4
    assert mark(draw_seed=3) == mark(), "a seed of no draws is none"
