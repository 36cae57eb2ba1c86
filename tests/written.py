"""Scenes that a test writes out, as the pipeline has them."""

from __future__ import annotations

from pathlib import Path

from physgen import pipeline
from physgen.compile.compile import CompiledScene
from physgen.compile.world import World
from physgen.scene.scene import Scene


def loaded(folder: Path, text: str, *edits: str, variant: str | None = None) -> Scene:
    path = folder / "scene.yaml"
    path.write_text(text, encoding="utf-8")
    return pipeline.load(path, edits, variant)


def compiled(folder: Path, text: str, *edits: str) -> CompiledScene:
    scene = loaded(folder, text, *edits)
    return pipeline.compile(scene, pipeline.percepts(scene))


def world(folder: Path, text: str, *edits: str) -> World:
    return compiled(folder, text, *edits).world


def commented(text: str) -> tuple[str, list[str]]:
    """The text with a comment above every line that is no continuation, and behind some; and the lines put in."""
    lines, mine = [], []
    for number, line in enumerate(text.splitlines()):
        start = line.lstrip()
        if start and not start.startswith(("[", "#")):
            mine.append(" " * (len(line) - len(start)) + f"# mine: {number}")
            lines.append(mine[-1])
        lines.append(
            f"{line}  # and {number}"
            if start.startswith("label:") and "#" not in line
            else line
        )
    return "\n".join(lines) + "\n", mine
