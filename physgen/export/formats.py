"""The label formats: their registry, the checks of a request, and the writers of a clip."""

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
    """Takes the folder, which exists and is empty, and the `Clip`; raises InputError."""
    about: str
    needs: str = ""
    """The map of the photo that it is made of."""
    library: str = ""
    """An optional module that it needs, of the extra `labels`."""
    most: int | None = None  # objects that it can number
    in_layers: bool = False  # whether it takes frames apart


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
    LabelFormat("davis", Davis, "masks, palette PNG as in DAVIS 2017", most=254),
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
        in_layers=True,
    ),
    LabelFormat(
        "layers-prores",
        ProResLayers,
        "layers for compositing: ProRes 4444",
        in_layers=True,
    ),
    LabelFormat(
        "layers-vp9",
        Vp9Layers,
        "layers for compositing: VP9 with alpha",
        in_layers=True,
    ),
)
FLAG = "--format"


def chosen_formats(names: Sequence[str], flag: str = FLAG) -> list[LabelFormat]:
    """The formats of `names`, each once.

    Raises InputError with every unknown name and every missing library; `flag` is where they were given.
    """
    known = {kind.name: kind for kind in FORMATS}
    problems: list[Problem] = []
    for name in dict.fromkeys(names):
        kind = known.get(name)
        if kind is None:
            unknown, fix = Message.UNKNOWN_FORMAT, one_of(name, list(known))
            problems.append(unknown.problem(Place(flag), "", f'"{name}"', fix=fix))
        elif kind.library and find_spec(kind.library) is None:
            missing = Message.LIBRARY_MISSING
            values = {"library": kind.library, "install": install("labels")}
            problems.append(missing.problem(Place(flag), "", f'"{name}"', **values))
    if problems:
        raise InputError(problems)
    return [known[name] for name in dict.fromkeys(names)]


def check_fits(
    chosen: Sequence[LabelFormat], scene: Scene, maps: Percepts | None
) -> None:
    """Raises InputError with every format that has too many objects in the scene, or lacks its map."""
    count, problems = len(scene.objects), []
    for kind in chosen:
        if kind.most is not None and count > kind.most:
            place, found = scene.place("objects"), f"{count:,} objects"
            many, values = Message.TOO_MANY_FOR_FORMAT, (kind.name, kind.most)
            problem = many.problem(
                place, "objects", found, format=values[0], most=values[1]
            )
            problems.append(problem)
        found = f'--format "{kind.name}"'
        if kind.needs and maps is None:
            without, place = Message.FORMAT_WITHOUT_PHOTO, scene.place("size")
            problems.append(without.problem(place, "", found, format=kind.name))
        elif kind.needs and getattr(maps, kind.needs) is None:
            place = scene.place("assets")
            option = (
                " --backend depth=NAME" if kind.needs == "depth" else ""
            )  # not made by default
            problem = Message.FORMAT_WITHOUT_MAP.problem(
                place,
                "assets",
                found,
                map=kind.needs,
                scene=place.file,
                option=option,
            )
            problems.append(problem)
    if problems:
        raise InputError(problems)


@contextmanager
def open_writers(
    chosen: Sequence[LabelFormat], folder: Path, clip: Clip
) -> Iterator[list[Writer]]:
    """Writers of the formats, each into `folder/<name>`; closed at the end unless there is an error."""
    writers: list[Writer] = []
    for kind in chosen:
        home = folder / kind.name
        home.mkdir(parents=True)
        writers.append(kind.maker(home, clip))
    yield writers
    for writer in writers:
        writer.close()
