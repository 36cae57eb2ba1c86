"""Each wrong scene of cases/ -> the problems of the .txt file beside it: place, path, code.

A line of a .txt file is `place: path: code`, and `; fix` if the fix is computed from the scene. Sentences are those of
the templates: a sentence can be rewritten without a change here.
"""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from pathlib import Path

import pytest

from physgen.messages import Message
from physgen.problems import InputError, Limit, Problem, by_place
from physgen.scene.load import Opened

CASES = Path(__file__).parent / "cases"
NAMES = sorted(path.stem for path in CASES.glob("*.yaml"))
FIELD = re.compile(r"\\\{\w+(?:\\?![rs])?(?::[^}]*)?\\\}")
"""A field of a template, after `re.escape`."""


def problems_of(name: str) -> list[Problem]:
    """What `load` finds in a case; each line `# flags: ...` at its top is one command with these flags."""
    path = Path(f"{name}.yaml")
    lines = path.read_text(encoding="utf-8").splitlines()
    commands = [
        line.removeprefix("# flags: ") for line in lines if line.startswith("# flags: ")
    ]
    problems = []
    for flags in commands or [""]:
        problems += problems_with(path, shlex.split(flags))
    return problems


def problems_with(path: Path, flags: list[str]) -> list[Problem]:
    """What `load` finds in a file with the flags of one command."""
    overrides = [value for flag, value in pairwise(flags) if flag == "--set"]
    variant = flags[flags.index("--variant") + 1] if "--variant" in flags else None
    problems: list[Problem] = []
    try:
        opened = Opened(path)
        problems += opened.variant_problems
        opened.scene(overrides, variant)
    except InputError as error:
        problems += error.problems
    return by_place(dict.fromkeys(problems))


def line_of(problem: Problem) -> str:
    """Place, path and code of a problem, and its fix if that is computed."""
    parts = [str(problem.place)]
    if problem.variant:
        parts.append(f"variant {problem.variant}")
    if problem.path:
        parts.append(problem.path)
    parts.append(problem.code)
    line = ": ".join(parts)
    is_computed = template_of(problem)[1].startswith("{fix}")
    return f"{line}; {problem.fix}" if is_computed else line


def template_of(problem: Problem) -> tuple[str, str]:
    """The sentence and the fix of the template with the code of a problem."""
    for limit in Limit:
        if limit.code == problem.code:
            return limit.expected, f"{limit.fix}{{example}}"
    by_code = {message.code: message.value for message in Message}
    return by_code[problem.code]


def fits(text: str, template: str) -> bool:
    """Whether a text is the template, with any values in its fields."""
    plain = template.replace("{{", "\0").replace("}}", "\1")
    pattern = FIELD.sub(".*", re.escape(plain))
    pattern = pattern.replace("\0", r"\{").replace("\1", r"\}")
    return re.fullmatch(pattern, text, re.DOTALL) is not None


@pytest.mark.parametrize("name", NAMES)
def test_problems_have_code_and_place(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(CASES)
    problems = problems_of(name)
    lines = [line_of(problem) for problem in problems]
    assert lines == (CASES / f"{name}.txt").read_text(encoding="utf-8").splitlines()
    assert problems
    for problem in problems:
        expected, fix = template_of(problem)
        assert fits(problem.expected, expected), problem
        assert fits(problem.fix, fix), problem
        message = str(problem)
        assert "Traceback" not in message
        assert str(CASES.parent.parent) not in message
        assert message.isprintable()
