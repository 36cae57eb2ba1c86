"""The label formats: their registry, the checks of a request, and the writers of a clip."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

from physgen.export.coco import Coco
from physgen.export.davis import Davis, YoutubeVos
from physgen.export.events import Events
from physgen.export.flow import Flo, Kitti
from physgen.export.labels import Clip, Writer
from physgen.export.maps import Albedo, Depth, Normals, Shading
from physgen.export.mot import Mot, Mots
from physgen.export.order import Frames, Order
from physgen.export.physics import Physics
from physgen.export.tapvid import Tapvid
from physgen.export.trajectory import TrajectoryTables
from physgen.maps import Percepts
from physgen.problems import InputError, Problem
from physgen.scene.scene import Scene
from physgen.text import listed, nearest


@dataclass(frozen=True)
class LabelFormat:
    """One row of the registry."""

    name: str
    maker: Callable[..., Writer]
    """Takes the folder, which exists and is empty, the `Clip`, and `count` where there is one; raises InputError."""
    about: str
    maps: bool = False
    """It reads the photo's maps."""
    needs: str = ""
    """A map of the photo without which it cannot be made."""
    library: str = ""
    """An optional module that it needs, of the extra `labels`."""
    most: int | None = None
    """Objects that it can number."""
    counted: str = ""
    """What a number behind its name sets, as in `tapvid:512`; empty: it takes none."""
    count: int | None = None
    """That number; None: not given."""


FORMATS = (
    LabelFormat("frames", Frames, "the pictures, PNG"),
    LabelFormat("flo", Flo, "optical flow, Middlebury .flo, with masks of hidden pixels"),
    LabelFormat("kitti", Kitti, "optical flow, KITTI 16-bit PNG"),
    LabelFormat("tapvid", Tapvid, "point tracks, TAP-Vid npz", counted="points"),
    LabelFormat("order", Order, "occlusion order, PNG and JSON"),
    LabelFormat("depth", Depth, "depth, 16-bit PNG", True, "depth"),
    LabelFormat("normals", Normals, "normals, 16-bit PNG", True, "normals"),
    LabelFormat("albedo", Albedo, "albedo, linear, 16-bit PNG", True, "albedo"),
    LabelFormat("shading", Shading, "shading, linear, 16-bit PNG", True, "albedo"),
    LabelFormat("coco", Coco, "masks, whole masks, boxes and tracks, COCO JSON", library="pycocotools"),
    LabelFormat("davis", Davis, "masks, palette PNG as in DAVIS 2017", most=254),
    LabelFormat("youtubevos", YoutubeVos, "masks, palette PNG as in YouTube-VOS", most=254),
    LabelFormat("mot", Mot, "boxes and tracks, MOT Challenge text"),
    LabelFormat("mots", Mots, "masks and tracks, MOTS text", library="pycocotools", most=999),
    LabelFormat("events", Events, "events: JSON, CSV, a sentence for each and a caption"),
    LabelFormat("trajectory", TrajectoryTables, "poses and velocities in px, video px and SI: CSV, npz"),
    LabelFormat("physics", Physics, "masses, coefficients and all other inputs of the motion: JSON"),
)
REMOVED = {
    "wheel": 'draw the flow of "flo", e.g. with torchvision.utils.flow_to_image',
    "conditioning": 'write "flo,davis,depth,events,physics", which have the same; render makes the video',
}
"""Formats of the version before, with what to use in their place; for one version."""
PERCEIVE_OPTIONS = {"depth": " --backend depth=NAME"}
"""Options of `perceive` that make a map which it does not make by default."""
FLAG = "--format"
MOST_COUNTED = 1_000_000
"""Largest number behind a name."""


def chosen_formats(names: Sequence[str], flag: str = FLAG) -> list[LabelFormat]:
    """The formats of `names`, each once, `tapvid:512` with its number.

    Raises InputError with every unknown or repeated name, and every missing library; `flag` is where they were given.
    """
    found: dict[str, LabelFormat] = {}
    problems: list[Problem] = []
    for name in dict.fromkeys(names):
        kind, what, fix = _format(name)
        if kind is not None and kind.name in found:
            what, fix = f"is {kind.name} once more", f'write it once, e.g. "{name}"'
        elif kind is not None and kind.library and find_spec(kind.library) is None:
            what, fix = f"needs {kind.library}, which is not installed", 'pip install "physgen[labels]"'
        if what:
            problems += InputError.of(flag, f'"{name}"', what, fix).problems
        if kind is not None:
            found[kind.name] = kind
    if problems:
        raise InputError(problems)
    return list(found.values())


def check_names(names: Sequence[str], flag: str = FLAG) -> None:
    """Raises InputError with every name that is no format's, where nothing is to be written in them."""
    problems: list[Problem] = []
    for name in names:
        kind, what, fix = _format(name)
        if kind is not None and kind.count is not None:
            what, fix = "takes no number here", f'write "{kind.name}"'
        if what:
            problems += InputError.of(flag, f'"{name}"', what, fix).problems
    if problems:
        raise InputError(problems)


def _format(name: str) -> tuple[LabelFormat | None, str, str]:
    """The format of a name, with its number; or None, what is wrong, and the fix."""
    known = {kind.name: kind for kind in FORMATS}
    plain, colon, number = name.partition(":")
    kind = known.get(plain)
    if kind is None:
        if plain in REMOVED:
            return None, "was removed", REMOVED[plain]
        close = nearest(plain, known)
        fix = f'did you mean "{close}"?' if close else f"write any of {listed(list(known))}"
        return None, "is no format", fix
    if not colon:
        return kind, "", ""
    if not kind.counted:
        return None, "takes no number", f'write "{plain}"'
    if not (number.isascii() and number.isdigit() and 1 <= int(number[:9]) <= MOST_COUNTED):
        what = f"has no number of {kind.counted} from 1 to {MOST_COUNTED:,}"
        return None, what, f'write e.g. "{plain}:512"'
    return replace(kind, count=int(number)), "", ""


def check_fits(chosen: Sequence[LabelFormat], scene: Scene, maps: Percepts | None) -> None:
    """Raises InputError with every format that has too many objects in the scene, or lacks its map."""
    count, problems = len(scene.objects), []
    for kind in chosen:
        if kind.most is not None and count > kind.most:
            expected = f"are more than the format {kind.name} can number, which is {kind.most}"
            fix = "take coco, which has no limit, or leave objects out"
            problems.append(Problem(scene.place("objects"), "objects", f"{count:,} objects", expected, fix))
        found = f'--format "{kind.name}"'
        if kind.needs and maps is None:
            expected, fix = "is made of a photo's maps, and there is no photo", f"leave {kind.name} out"
            problems.append(Problem(scene.place("size"), "", found, expected, fix))
        elif kind.needs and getattr(maps, kind.needs) is None:
            place = scene.place("assets")
            option = PERCEIVE_OPTIONS.get(kind.needs, "")
            fix = f"have it made: physgen perceive --refresh {place.file}{option} -o NEW.yaml"
            expected = f"is made of {kind.needs}.png, which is not there"
            problems.append(Problem(place, "assets", found, expected, fix))
    if problems:
        raise InputError(problems)


@contextmanager
def open_writers(chosen: Sequence[LabelFormat], folder: Path, clip: Clip) -> Iterator[list[Writer]]:
    """Writers of the formats, each into `folder/<name>`; closed at the end unless there is an error."""
    writers: list[Writer] = []
    for kind in chosen:
        home = folder / kind.name
        home.mkdir(parents=True)
        number = () if kind.count is None else (kind.count,)
        writers.append(kind.maker(home, clip, *number))
    yield writers
    for writer in writers:
        writer.close()
