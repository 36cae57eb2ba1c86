"""Run `clip`: perceive photos and render clips in one process."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from physgen.cli.arguments import (
    WRONG_INPUT,
    Command,
    Parser,
    check_folder_name,
    refuse_split_values,
)
from physgen.cli.clips import add_clips, add_overlays, job_maker
from physgen.cli.clusters import add_cluster, add_ship, check_cluster
from physgen.cli.output import Bar, print_line, print_problems
from physgen.cli.perceive import (
    BEGIN,
    add_backend_choices,
    add_photo_flags,
    perceive_photo,
    perceive_photos,
    refuse_scenes,
)
from physgen.cli.render import (
    add_motion_flags,
    refuse_stored_video,
    render,
    video_file,
)
from physgen.messages import Message
from physgen.problems import Problem


def clip(options: argparse.Namespace) -> int:
    refuse_split_values(options.command_line, list(map(str, options.image)))
    refuse_scenes(options.image)
    output = options.output or ("out/preview" if options.preview else "out")
    options.output = output
    # A wrong flag of the clip is reported before the slow perception of the photo.
    check_cluster(options)
    video = video_file(options)
    refuse_stored_video(options, video)
    # The jobs are made later: this call only checks the flags.
    job_maker(options)
    if video is None:
        check_folder_name(output)
    elif len(options.image) > 1:
        value_text = f'"{output}"'
        raise Message.ONE_FILE_FOR_CLIPS.error(
            "-o", value_text, count=len(options.image)
        )
    scenes, problems = _perceive(options, video)
    if not options.json:
        for scene in scenes:
            print_line(str(scene))
    print_problems(problems)
    if not scenes:
        return WRONG_INPUT
    # The perception has set the output to that of a scene: set it back.
    options.scenes, options.output = list(map(str, scenes)), output
    # The scenes already contain these pushes.
    options.push, options.story = [], None
    code = render(options)
    if problems:
        return WRONG_INPUT
    return code


def _perceive(
    options: argparse.Namespace, video: Path | None
) -> tuple[Sequence[Path], Sequence[Problem]]:
    """Perceive the photos. Return the scenes beside the clips, and problems."""
    bar = Bar()
    if video is None:
        folder = Path(options.output)
    else:
        folder = video.parent
    with bar.ticking():
        bar.show(BEGIN, 0, 1)
        # Several photos share one load of the models.
        if len(options.image) > 1:
            options.output = folder
            result = perceive_photos(options, bar)
            scenes, problems = result.scenes, result.problems
        else:
            if video is None:
                name = options.image[0].stem
            else:
                name = video.stem
            options.output = folder / f"{name}.yaml"
            perceive_photo(options, bar)
            scenes, problems = [options.output], []
        bar.clear()
    return scenes, problems


def add(parser: Parser) -> None:
    parser.add_argument("image", metavar="IMAGE", type=Path, nargs="+", help="a photo")
    help_text = (
        "folder of the scenes and clips, or the file of one video, with its scene "
        "beside it; default: out, or out/preview for previews"
    )
    parser.option("-o --output", "DIR or VIDEO", str, help_text)
    add_photo_flags(parser)
    help_text = (
        "push this object in place of the one that perceive chooses: ball-1=right, "
        "ball-1=up-left@0.5 m/s; may be repeated"
    )
    parser.option(
        "--push", "NAME=DIRECTION[@SPEED]", str, help_text, [], action="append"
    )
    add_motion_flags(parser)
    add_backend_choices(parser)
    add_clips(parser)
    add_overlays(parser)
    add_cluster(parser)
    add_ship(parser)
    parser.set_defaults(refresh=None)


CLIP = Command(
    "clip",
    "Perceives photos and renders their clips, in one process.",
    "physgen clip photo.jpg -o out",
    add,
    clip,
    is_order_free=True,
)
