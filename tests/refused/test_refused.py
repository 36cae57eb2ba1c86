"""Each wrong scene of cases/ -> the problems of the .txt file beside it: place, path, code.

A line of a .txt file is `place: path: code`, and `; fix` if the fix is computed from the scene. Sentences are those of
the templates: a sentence can be rewritten without a change here.
"""

from __future__ import annotations

import re
import shlex
import shutil
from itertools import pairwise
from pathlib import Path

import pytest

import physgen.scene
from physgen.messages import Message
from physgen.problems import InputError, Limit, Problem, by_place
from physgen.scene.load import OpenedScene

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
        opened = OpenedScene(path)
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


FILES = {
    "picture-for-scene": b"\x89PNG\r\n\x1a\n\xff",
    "zip-for-scene": b"PK\x03\x04\xff",
    "not-utf8": b"physgen: \xff",
}
"""Code of a problem -> the bytes of a file that is not a scene file."""


@pytest.mark.parametrize("code", FILES)
def test_other_files_are_named(code: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_bytes(FILES[code])
    with pytest.raises(InputError) as error:
        OpenedScene(path)
    assert [problem.code for problem in error.value.problems] == [code]


@pytest.mark.parametrize(
    ("name", "code"),
    [(".", "is-folder"), ("none.yaml", "no-such-file"), ("a\0b", "cannot-read")],
)
def test_paths_without_a_scene_are_named(
    name: str, code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as error:
        OpenedScene(Path(name))
    assert [problem.code for problem in error.value.problems] == [code]


ASSETS = {
    "outlines-unreadable": ("photo.assets", "outlines.json", "{"),
    "outline-missing": ("photo.assets", "outlines.json", '{"1": {}}'),
    "photo-changed": ("small.assets", "perceived.json", '{"objects": {"1": {}}}'),
}
"""Code of a problem -> a folder of maps, and a file in it with its text."""


@pytest.mark.parametrize("code", ASSETS)
def test_wrong_assets_are_named(code: str, tmp_path: Path) -> None:
    folder, name, text = ASSETS[code]
    shutil.copytree(CASES / folder, tmp_path / folder)
    shutil.copy(CASES / "photo.png", tmp_path)
    (tmp_path / folder / name).write_text(text, encoding="utf-8")
    scene = (
        f"physgen: 1\nimage: photo.png\nassets: {folder}\nobjects: {{a: {{mask: 1}}}}\n"
    )
    path = tmp_path / "scene.yaml"
    path.write_text(scene, encoding="utf-8")
    with pytest.raises(InputError) as error:
        OpenedScene(path).scene()
    assert [problem.code for problem in error.value.problems] == [code]


ELSEWHERE = {
    "extends-not-file": "a race: the file is another one between two looks",
    "file-empty": "of tables; scene-empty is the same sentence",
    "is-pipe": "test_hostile.py",
    "path-broken": "file systems that fail while a link is followed",
    "picture-turned": "tests/scene/test_scene_load.py",
    "too-many-groups": "test_hostile.py",
    "too-many-keys": "test_hostile.py: the limit of objects comes first",
    "too-many-problems": "test_hostile.py",
}
"""Codes of the package `scene` that no case has, with the test or the reason."""


def test_every_code_of_scenes_has_a_case() -> None:
    folder = Path(physgen.scene.__file__).parent
    used = set()
    for path in folder.glob("*.py"):
        names = re.findall(r"\bMessage\.([A-Z]\w+)", path.read_text(encoding="utf-8"))
        used |= {Message[name].code for name in names}
    used -= {code for code in used if code.startswith("editor-")}
    lines = "\n".join(path.read_text(encoding="utf-8") for path in CASES.glob("*.txt"))
    cases = set(re.findall(r": ([a-z0-9-]+)(?:;.*)?$", lines, re.MULTILINE))
    tested = (
        cases
        | FILES.keys()
        | ASSETS.keys()
        | {"is-folder", "no-such-file", "cannot-read"}
    )
    assert used - tested == ELSEWHERE.keys()
