"""Two people's changes of one text: both, or where they clash; git is the second opinion."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physgen.edit.document import merged

LINES = st.lists(st.sampled_from("abcdefgh"), min_size=4, max_size=14, unique=True)


def text(lines: list[str]) -> str:
    return "".join(f"{line}\n" for line in lines)


def by_git(folder: Path, base: str, mine: str, theirs: str) -> str | None:
    """What `git merge-file` makes of the three; None where they clash."""
    names = []
    for name, data in (("mine", mine), ("base", base), ("theirs", theirs)):
        (folder / name).write_text(data)
        names.append(str(folder / name))
    run = subprocess.run(
        ["git", "merge-file", "-p", "--quiet", *names], capture_output=True, text=True, check=False
    )
    return run.stdout if run.returncode == 0 else None


@st.composite
def edits(draw, lines: list[str], name: str) -> list[str]:
    """Some lines changed, taken away or added."""
    made = list(lines)
    for _ in range(draw(st.integers(0, 2))):
        at = draw(st.integers(0, max(len(made) - 1, 0)))
        kind = draw(st.sampled_from(["change", "take", "add"]))
        if kind == "add" or not made:
            made.insert(at, f"new {name}{draw(st.integers(0, 1))}")
        elif kind == "take":
            del made[at]
        else:
            made[at] = f"{made[at]} {name}"
    return made


@settings(max_examples=150)
@given(st.data())
def test_what_git_merges_is_merged_alike(tmp_path_factory, draw) -> None:
    lines = draw.draw(LINES)
    base = text(lines)
    mine, theirs = text(draw.draw(edits(lines, "m"))), text(draw.draw(edits(lines, "t")))
    made = merged(base, mine, theirs)
    assert made.text == by_git(tmp_path_factory.mktemp("git"), base, mine, theirs)
    assert (made.text is None) == bool(made.clashes)


@settings(max_examples=200)
@given(st.data())
def test_who_is_who_makes_no_difference(draw) -> None:
    lines = draw.draw(LINES)
    base, mine, theirs = text(lines), text(draw.draw(edits(lines, "m"))), text(draw.draw(edits(lines, "t")))
    one, other = merged(base, mine, theirs), merged(base, theirs, mine)
    assert one.text == other.text
    assert [(c["mine"], c["theirs"]) for c in one.clashes] == [
        (c["theirs"], c["mine"]) for c in other.clashes
    ]
    assert merged(base, mine, base).text == mine
    assert merged(base, mine, mine).text == mine


def test_a_clash_says_where_and_what() -> None:
    made = merged("a\nb\nc\nd\n", "a\nB1\nc\nd\n", "a\nB2\nc\nd\n")
    (clash,) = made.clashes
    assert clash == {"line": 2, "base": "b\n", "mine": "B1\n", "theirs": "B2\n"}


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_ends_of_lines_and_of_the_file_stay(end) -> None:
    base, mine, theirs = (
        end.join(lines)
        for lines in (["a", "b", "c", "d", "e"], ["A", "b", "c", "d", "e"], ["a", "b", "c", "d", "E"])
    )
    assert merged(base, mine, theirs).text == end.join(["A", "b", "c", "d", "E"])
