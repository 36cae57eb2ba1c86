"""All that is needed to repeat a run is on the page, escaped."""

from __future__ import annotations

import html
import re

from physgen.pipeline import RenderOptions
from physgen.pipeline.render_options import command_alone
from physgen.report.html import template
from physgen.report.page import provenance
from physgen.report.record import RunRecord


def record() -> RunRecord:
    made = RunRecord(
        scene="lesson", command=["physgen", "render", "a b.yaml", "--set", "x=<i>"]
    )
    made.inputs, made.seeds, made.frames = (
        {"<b>.yaml": "ab" * 32},
        {"refine": 7},
        ["x", "y"],
    )
    made.overrides, made.refine = ["x=<i>", "y=2"], {"backend": "animatediff"}
    return made


def test_facts_are_those_of_the_record() -> None:
    found = provenance(record(), "a: 1\n")
    assert ("seed of refine", "7") in found["facts"]
    assert found["edits"] == ["x=<i>", "y=2"]
    nothing = provenance(RunRecord(scene="", command=[], seeds={"refine": 7}), "")
    assert not [name for name, _ in nothing["facts"] if name.startswith("seed")], (
        "nobody refined"
    )
    assert nothing["frames"] == ""


def test_the_page_says_what_is_needed_to_repeat_the_run() -> None:
    page = template("provenance.html.j2").render(
        provenance=provenance(record(), "e: <i>\n", "# as written\ne: <i>\n")
    )
    assert "<i>" not in page
    assert "<b>.yaml" not in page
    words = html.unescape(re.sub(r"<[^>]*>", "", page))
    assert words.count("set by the command") == 1
    for said in (
        "physgen render 'a b.yaml' --set 'x=<i>'",
        "# as written",
        "ab" * 32,
        "python",
        "numpy",
    ):
        assert said in words


def test_the_command_is_of_this_clip_alone() -> None:
    made = record()
    made.command = [
        "physgen",
        "render",
        "a.yaml",
        "b.yaml",
        "--variant",
        "all",
        "--jobs",
        "8",
    ]
    made.clip_command = command_alone(
        "b.yaml",
        RenderOptions(overrides=("world.duration=1",), variant="fast", draws=8),
    )
    found = provenance(made, "a: 1\n")
    assert found["command"] == (
        "physgen render b.yaml --variant fast --set world.duration=1 --fan=8 --fan-seed=0"
    )
    options = RenderOptions(
        overrides=("refine.backend=animatediff", "a=1"),
        models=("--refine=animatediff:/weights", "--config=my.toml"),
    )
    assert command_alone("b.yaml", options) == [
        *(
            "physgen",
            "render",
            "b.yaml",
            "--set",
            "a=1",
            "--refine=animatediff:/weights",
            "--config=my.toml",
        )
    ]
    assert found["run"] == "physgen render a.yaml b.yaml --variant all --jobs 8"
