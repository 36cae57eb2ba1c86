"""Highlighted scene files are the files, letter for letter; times add up; all is escaped."""

from __future__ import annotations

import html
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from physgen.report.html import highlight_lines, highlight_yaml, template
from physgen.report.page import provenance
from physgen.report.record import RunRecord, StageTime

ROOT = Path(__file__).resolve().parents[2]


def plain(text: str) -> str:
    return html.unescape(re.sub(r"</?span[^>]*>", "", str(highlight_yaml(text))))


def marked(text: str, kind: str) -> list[str]:
    return [
        html.unescape(m)
        for m in re.findall(rf'<span class="y-{kind}">(.*?)</span>', highlight_yaml(text), re.S)
    ]


@pytest.mark.parametrize(
    "path", sorted(ROOT.glob("scenes/*/*.yaml")), ids=lambda path: f"{path.parent.name}-{path.stem}"
)
def test_a_scene_without_its_tags_is_the_file(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert plain(text) == text
    assert "physgen" in marked(text, "key")
    assert len(marked(text, "comment")) == sum(
        bool(re.search(r"(^|\s)#", line)) for line in text.splitlines()
    )


@given(st.text(alphabet="ab1.-:#'\"[]{},\n |>&*!%@`\t\r~<é☃\\", max_size=60))
def test_no_text_loses_a_letter(text: str) -> None:
    assert plain(text) == text


@given(st.text(alphabet="ab1.-:#'\"[]{},\n |>&*!%@`\t~<é☃\\", max_size=60))
def test_line_by_line_no_letter_is_lost_either(text: str) -> None:
    bare = [html.unescape(re.sub(r"</?span[^>]*>", "", str(line))) for line in highlight_lines(text)]
    assert bare == text.removesuffix("\n").split("\n")
    assert all(str(line).count("<span") == str(line).count("</span>") for line in highlight_lines(text))


def test_words_are_what_yaml_says_they_are() -> None:
    text = """\
a: 12  # a comment: 3
'b c': "# no comment"
on: [true, ~, 1e3, .5, 0x1F, off, 1_0]
d: |
  several lines # no comment
  and more: 3
# the end
e: <script>
"""
    assert marked(text, "key") == ["a", "'b c'", "on", "d", "e"]
    assert marked(text, "number") == ["12", "1e3", ".5", "0x1F"]
    assert marked(text, "word") == ["true", "~"]
    assert marked(text, "comment") == ["# a comment: 3", "# the end"]
    assert marked(text, "string")[:3] == ['"# no comment"', "off", "1_0"]
    assert marked(text, "string")[4:6] == ["  several lines # no comment", "  and more: 3"]
    assert "<script>" not in highlight_yaml(text)


def record() -> RunRecord:
    made = RunRecord(scene="lesson", command=["physgen", "render", "a b.yaml", "--set", "x=<i>"])
    made.stages = {"load": StageTime(0.5, 0.4), "render": StageTime(1.5, 2.5), "report": StageTime(9.0, 9.0)}
    made.inputs, made.seeds, made.frames = {"<b>.yaml": "ab" * 32}, {"refine": 7}, ["x", "y"]
    made.overrides, made.refine = ["x=<i>", "y=2"], {"backend": "wan"}
    return made


def test_stages_fill_the_bar() -> None:
    found = provenance(record(), "a: 1\n")
    assert [(s.name, s.percent, s.begin) for s in found["stages"]] == [
        ("load", 25.0, 0.0),
        ("render", 75.0, 25.0),
    ]
    assert found["wall"] == "2.00"
    assert ("seed of refine", "7") in found["facts"]
    assert found["edits"] == ["x=<i>", "y=2"]
    nothing = provenance(RunRecord(scene="", command=[], seeds={"refine": 7}), "")
    assert not [name for name, _ in nothing["facts"] if name.startswith("seed")], "nobody refined"
    assert nothing["stages"] == []
    assert nothing["frames"] == ""


def test_the_page_says_what_is_needed_to_repeat_the_run() -> None:
    page = template("provenance.html.j2").render(
        provenance=provenance(record(), "e: <i>\n", "# as written\ne: <i>\n")
    )
    assert "<i>" not in page.replace('<i class="slice', "")
    assert "<b>.yaml" not in page
    words = html.unescape(re.sub(r"<[^>]*>", "", page))
    assert words.count("set by the command") == 1
    for said in (
        "physgen render 'a b.yaml' --set 'x=<i>'",
        "# as written",
        "ab" * 32,
        "render 1.50 s",
        "python",
        "numpy",
    ):
        assert said in words
