"""Each wrong scene of cases/ -> exactly the messages of the .txt file beside it."""

from __future__ import annotations

import shlex
from itertools import pairwise
from pathlib import Path

import pytest

from physgen.problems import InputError, Problem, by_place
from physgen.scene.load import Opened

CASES = Path(__file__).parent / "cases"
NAMES = sorted(path.stem for path in CASES.glob("*.yaml"))


def messages(name: str) -> list[str]:
    """What `load` says of a case, `# flags: ...` on its first line being the flags of the command."""
    path = Path(f"{name}.yaml")
    first = path.read_text(encoding="utf-8").partition("\n")[0]
    flags = (
        shlex.split(first.removeprefix("# flags: "))
        if first.startswith("# flags: ")
        else []
    )
    overrides = [value for flag, value in pairwise(flags) if flag == "--set"]
    variant = flags[flags.index("--variant") + 1] if "--variant" in flags else None
    problems: list[Problem] = []
    try:
        opened = Opened(path)
        problems += opened.variant_problems
        opened.scene(overrides, variant)
    except InputError as error:
        problems += error.problems
    return [str(problem) for problem in by_place(dict.fromkeys(problems))]


def test_there_are_many() -> None:
    assert len(NAMES) >= 60


@pytest.mark.parametrize("name", NAMES)
def test_exact_messages(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(CASES)
    said = messages(name)
    assert said
    assert said == (CASES / f"{name}.txt").read_text(encoding="utf-8").splitlines()
    for message in said:
        assert "Traceback" not in message
        assert str(CASES.parent.parent) not in message
        assert message.isprintable()
