"""Choices of a caller about one clip, and the command and the folder that follow from
them.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from physgen.export.video_formats import Format
from physgen.messages import Message
from physgen.scene.load import scene_name


class Page(Enum):
    """Whether `report.html` is written."""

    FULL = "full"
    NONE = "none"


@dataclass(frozen=True)
class RenderOptions:
    """Choices of a caller about one clip of a scene."""

    overrides: tuple[str, ...] = ()
    """`KEY=VALUE` texts, as for `--set`."""
    variant: str | None = None
    name: str | None = None
    """Name of the clip's folder; None: the names of the scene and its variant."""
    allow_outside: bool = False
    """Whether the scene may read files outside its folder."""
    formats: tuple[Format, ...] = (Format.MP4,)
    """Formats of the video; empty for no video."""
    command: tuple[str, ...] = ()
    """The command line for the manifest."""
    draws: int = 0
    """Number of simulations with uncertain values drawn at random."""
    draw_seed: int = 0
    cached: bool = True
    """Whether a complete clip with the same options is reused."""
    page: Page = Page.FULL
    sound: bool = True
    """Whether the clip has the sound track of its scene."""
    export: tuple[str, ...] = ()
    """Formats of ground truth, written to `truth/`, or to the clip's folder without a
    video.
    """
    models: tuple[str, ...] = ()
    """Command-line flags of the refinement model: `--refine=NAME:WEIGHTS`,
    `--config=FILE`.
    """
    mark: str = ""
    """Hash of all options and the code, for the manifest."""


def command_alone(path: str | Path, options: RenderOptions) -> list[str]:
    """Return the command to render exactly this clip."""
    formats = ",".join(video_format.value for video_format in options.formats)
    has_refine_flag = any(flag.startswith("--refine=") for flag in options.models)
    # The flag for the refinement model overrides an edit of the same key.
    edits = []
    for edit in options.overrides:
        if not (has_refine_flag and edit.startswith("refine.backend=")):
            edits.append(edit)
    command = ["physgen", "render", str(path)]
    if options.variant is not None:
        command += ["--variant", options.variant]
    for edit in edits:
        command += ["--set", edit]
    command += options.models
    if formats not in ("", "mp4"):
        command.append(f"--format={formats}")
    return command + _output_flags(options)


def _output_flags(options: RenderOptions) -> list[str]:
    """Return the flags for draws, labels and files outside the scene's folder."""
    flags = []
    if options.draws:
        flags += [f"--fan={options.draws}", f"--fan-seed={options.draw_seed}"]
    if options.export:
        flags.append(f"--export={','.join(options.export)}")
    if options.allow_outside:
        flags.append("--allow-outside")
    return flags


def output_name(path: str | Path, variant: str | None) -> str:
    """Return the name of a clip's folder: the names of the scene and its variant."""
    name = scene_name(Path(path))
    if not name.isprintable():
        raise Message.NAME_NOT_PRINTABLE.error(repr(str(path)))
    if variant is not None:
        return f"{name}-{variant}"
    return name
