"""Run `render`: turn scenes into clips."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli.arguments import (
    FILE_SUFFIXES,
    VIDEO_SUFFIXES,
    Command,
    Parser,
    is_folder_name,
    refuse_settings,
    refuse_split_values,
)
from physgen.cli.clips import (
    add_clips,
    add_overlays,
    check_names,
    jobs_of,
    make_all,
    other_variants,
)
from physgen.cli.clusters import add_cluster, add_ship, check_cluster
from physgen.cli.output import print_problems
from physgen.files import check_writable
from physgen.messages import Message

if TYPE_CHECKING:
    from physgen.batch.run import Job


def render(options: argparse.Namespace) -> int:
    refuse_split_values(options.command_line, options.scenes)
    refuse_settings(options.scenes)
    check_cluster(options)
    options.output = options.output or ("out/preview" if options.preview else "out")
    video = video_file(options)
    refuse_stored_video(options, video)
    if video is not None:
        options.output = str(video.parent)
    # All jobs are checked before the first one starts: a wrong name must not appear
    # after hours.
    jobs = list(jobs_of(options))
    if video is None:
        check_names(jobs)
    else:
        jobs = [_video_job(jobs, video)]
    jobs = jobs[options.part or slice(None)]
    for path in options.scenes:
        print_problems(other_variants(path, options))
    gallery = options.part is None and video is None
    return make_all(jobs, len(jobs), options, gallery=gallery)


def refuse_stored_video(options: argparse.Namespace, video: Path | None) -> None:
    """Raise InputError for a store together with a video file."""
    if video is not None and options.ship is not None:
        raise Message.VIDEO_FOR_STORE.error("-o", f'"{video}"')


def video_file(options: argparse.Namespace) -> Path | None:
    """Return the video file of `-o`, or None for a folder. Set the format.

    Raise InputError for another kind of file, or if --format excludes the video.
    """
    path = Path(options.output)
    kind = path.suffix.lower()
    if is_folder_name(options.output) or kind not in FILE_SUFFIXES:
        return None
    if kind not in VIDEO_SUFFIXES:
        check_writable(path if path.is_file() else path.parent)
        raise Message.NOT_A_VIDEO_NAME.error(
            "-o", f'"{path}"', suffixes=", ".join(VIDEO_SUFFIXES)
        )
    name = kind.removeprefix(".")
    options.format = options.format or [name]
    if name not in options.format:
        formats = ",".join(options.format)
        raise Message.VIDEO_AND_FORMAT.error(
            "-o", f'"{path}"', formats=formats, name=name
        )
    return path


def _video_job(jobs: list[Job], video: Path) -> Job:
    """Return the only job, with the video's name for its clip. Raise InputError."""
    if len(jobs) > 1:
        raise Message.ONE_FILE_FOR_CLIPS.error("-o", f'"{video}"', count=len(jobs))
    (job,) = jobs
    return replace(job, options=replace(job.options, name=video.stem), video=video)


def add(parser: Parser) -> None:
    parser.add_argument("scenes", metavar="SCENE", nargs="+", help="a scene file")
    help_text = (
        "folder of the results, or the file of one video: clip.mp4, its report and "
        "data in clip/; default: out, or out/preview for previews"
    )
    parser.option("-o --output", "DIR or VIDEO", str, help_text)
    help_text = (
        "push an object: ball-1=right, ball-1=up-left, ball-1=30@2 m/s (degrees, 90 is down), in place of the push "
        "that perceive wrote; velocities that you wrote stay. May be repeated"
    )
    parser.option("--push", "NAME=DIRECTION", str, help_text, [], action="append")
    add_motion_flags(parser)
    add_clips(parser)
    add_cluster(parser)
    add_ship(parser)
    add_overlays(parser)


def add_motion_flags(parser: Parser) -> None:
    """Add the flags of motion, without --push."""
    help_text = "lift an object by its own height and let it fall; may be repeated"
    parser.option("--drop", "NAME", str, help_text, [], action="append")
    help_text = (
        "strike the object at a point of the photo (px, or e.g. 6 cm,4 cm); "
        "X,Y@SPEED sets the speed. May be repeated"
    )
    parser.option("--kick", "X,Y", str, help_text, [], action="append")
    help_text = 'find the push by which a sentence comes true: "the ball knocks over the bottle"'
    parser.option("--story", "SENTENCE", str, help_text)


RENDER = Command(
    "render",
    "Renders scenes to videos, reports and manifests.",
    "physgen render scene.yaml --push ball-1=right --format mp4,gif",
    add,
    render,
    is_order_free=True,
)
