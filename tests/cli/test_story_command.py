"""`--story` on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from physgen.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "scenes" / "bottle-book" / "scene.yaml"


def test_story_is_printed_as_yaml_and_kept_in_the_manifest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sentence = "the book knocks over the bottle"
    flags = ["--story", sentence, "-o", str(tmp_path), "--report", "none"]
    sparing = ["--set", "render.frames=2", "--set", "render.scale=0.2"]
    assert main(["render", str(SCENE), *flags, *sparing]) == 0
    errors = capsys.readouterr().err
    assert "the story happens: book touches bottle" in errors
    assert "to keep this motion, write" in errors
    manifest = json.loads((tmp_path / "bottle-book" / "manifest.json").read_text())
    assert any("forces=" in edit for edit in manifest["overrides"])
    assert sentence in manifest["command"]


@pytest.mark.parametrize("flag", ["--push=book=right", "--drop=book", "--kick=9,9"])
def test_story_and_push_exclude_each_other(
    flag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["render", str(SCENE), "--story", "push the book", flag]
    assert main([*arguments, "-o", str(tmp_path)]) == 2
    assert "cannot be combined" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("sentence", ["", "the zebra hits the bottle"])
def test_sentence_that_is_not_understood_renders_nothing(
    sentence: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert main(["render", str(SCENE), "--story", sentence, "-o", str(out)]) == 2
    assert not out.exists() or not list(out.iterdir())
