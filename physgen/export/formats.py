"""The label formats: their registry, the checks of a request, and the writers of a
clip.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from physgen.export.coco import Coco
from physgen.export.davis import Davis, Frames
from physgen.export.events import Events
from physgen.export.flow import Flo
from physgen.export.kitti import Kitti
from physgen.export.labels import Clip, Writer
from physgen.export.layers import LayerFiles, ProResLayers, Vp9Layers
from physgen.export.maps import Depth, Normals
from physgen.export.mot import Mot
from physgen.export.physics import Physics
from physgen.export.tapvid import Tapvid
from physgen.export.trajectory import TrajectoryTables
from physgen.files import install
from physgen.maps import Percepts
from physgen.messages import Message, one_of
from physgen.problems import InputError, Place, Problem
from physgen.scene.scene import Scene


@dataclass(frozen=True)
class LabelFormat:
    """One row of the registry."""

    name: str
    maker: Callable[..., Writer]
    """Takes the empty folder and the `Clip`; raises InputError."""
    title: str
    needs: str = ""
    """The required map of the photo."""
    library: str = ""
    """A required optional module, from the extra `labels`."""
    max_objects: int | None = None
    """Maximum number of objects."""
    has_layers: bool = False
    """True if the writer needs frames in layers."""


FORMATS = (
    LabelFormat("frames", Frames, "the pictures, PNG"),
    LabelFormat(
        "flo", Flo, "optical flow, Middlebury .flo, with masks of hidden pixels"
    ),
    LabelFormat("kitti", Kitti, "optical flow, KITTI's 16-bit PNG"),
    LabelFormat("depth", Depth, "depth, 16-bit PNG", "depth"),
    LabelFormat("normals", Normals, "normals, 16-bit PNG", "normals"),
    LabelFormat(
        "coco",
        Coco,
        "masks, whole masks, boxes and tracks, COCO JSON",
        library="pycocotools",
    ),
    LabelFormat("davis", Davis, "masks, palette PNG as in DAVIS 2017", max_objects=254),
    LabelFormat("mot", Mot, "boxes and tracks, MOT Challenge text"),
    LabelFormat("tapvid", Tapvid, "tracks of 256 points as in TAP-Vid: npz"),
    LabelFormat("events", Events, "events: JSON"),
    LabelFormat(
        "trajectory",
        TrajectoryTables,
        "poses and velocities in px, video px and SI: CSV, npz",
    ),
    LabelFormat(
        "physics",
        Physics,
        "masses, coefficients and all other inputs of the motion: JSON",
    ),
    LabelFormat(
        "layers",
        LayerFiles,
        "layers for compositing: PNG of 16 bits, linear, premultiplied",
        has_layers=True,
    ),
    LabelFormat(
        "layers-prores",
        ProResLayers,
        "layers for compositing: ProRes 4444",
        has_layers=True,
    ),
    LabelFormat(
        "layers-vp9",
        Vp9Layers,
        "layers for compositing: VP9 with alpha",
        has_layers=True,
    ),
)
FLAG = "--format"


def choose_formats(names: Sequence[str], flag: str = FLAG) -> list[LabelFormat]:
    """Return the formats of `names`, without repetitions.

    Raise InputError with every unknown name and every missing library; `flag` is the
    flag of the names.
    """
    known = {row.name: row for row in FORMATS}
    problems: list[Problem] = []
    # All problems of a request are collected, so that the user sees them at once.
    for name in dict.fromkeys(names):
        row = known.get(name)
        if row is None:
            unknown = Message.UNKNOWN_FORMAT
            fix = one_of(name, list(known))
            problems.append(unknown.problem(Place(flag), "", f'"{name}"', fix=fix))
        elif row.library and find_spec(row.library) is None:
            missing, command = Message.LIBRARY_MISSING, install("labels")
            values = {"library": row.library, "install": command}
            problems.append(missing.problem(Place(flag), "", f'"{name}"', **values))
    if problems:
        raise InputError(problems)
    return [known[name] for name in dict.fromkeys(names)]


def check_fits(
    formats: Sequence[LabelFormat], scene: Scene, maps: Percepts | None
) -> None:
    """Raise InputError with every format that has too many objects or lacks its map."""
    problems = []
    for row in formats:
        problems += _count_problems(row, scene)
        problems += _map_problems(row, scene, maps)
    if problems:
        raise InputError(problems)


def _count_problems(row: LabelFormat, scene: Scene) -> list[Problem]:
    """Return the problem of too many objects."""
    count = len(scene.objects)
    if row.max_objects is None or count <= row.max_objects:
        return []
    found = f"{count:,} objects"
    problem = Message.TOO_MANY_FOR_FORMAT.problem(
        scene.place("objects"),
        "objects",
        found,
        format=row.name,
        most=row.max_objects,
    )
    return [problem]


def _map_problems(
    row: LabelFormat, scene: Scene, maps: Percepts | None
) -> list[Problem]:
    """Return the problem of a missing map."""
    if not row.needs:
        return []
    found = f'--format "{row.name}"'
    if maps is None:
        without, place = Message.FORMAT_WITHOUT_PHOTO, scene.place("size")
        return [without.problem(place, "", found, format=row.name)]
    if getattr(maps, row.needs) is not None:
        return []
    place = scene.place("assets")
    # `perceive` does not estimate depth by default.
    option = ""
    if row.needs == "depth":
        option = " --backend depth=NAME"
    problem = Message.FORMAT_WITHOUT_MAP.problem(
        place,
        "assets",
        found,
        map=row.needs,
        scene=place.file,
        option=option,
    )
    return [problem]


@contextmanager
def open_writers(
    formats: Sequence[LabelFormat], folder: Path, clip: Clip
) -> Iterator[list[Writer]]:
    """Yield writers of the formats, each for `folder/<name>`, and close them at the
    end. After an error they stay open.
    """
    writers: list[Writer] = []
    for row in formats:
        format_folder = folder / row.name
        format_folder.mkdir(parents=True)
        writers.append(row.maker(format_folder, clip))
    yield writers
    for writer in writers:
        writer.close()
