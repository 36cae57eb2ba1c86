"""The label formats: their registry, the checks of a request, and the writers of a clip."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

from physgen.export.coco import Coco
from physgen.export.conditioning import Conditioning
from physgen.export.davis import Davis, YoutubeVos
from physgen.export.events import Events
from physgen.export.flow import Flo, Kitti, Wheel
from physgen.export.labels import Clip, Moment
from physgen.export.maps import Albedo, Depth, Normals, Shading
from physgen.export.mot import Mot, Mots
from physgen.export.order import Order
from physgen.export.physics import Physics
from physgen.export.tapvid import Tapvid
from physgen.export.trajectory import TrajectoryTables
from physgen.maps import Percepts
from physgen.problems import InputError, Problem
from physgen.scene.scene import Scene
from physgen.text import listed, nearest

# ----------------------------------------------------------------------
# Views -> frames/00000.png ..., as they are.


class Frames:
    """8-bit sRGB."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder = folder

    def add(self, moment: Moment) -> None:
        """One file a view."""
        (self._folder / f"{moment.view.index:05d}.png").write_bytes(moment.view.png)

    def close(self) -> None:
        """Nothing is left to be said."""


# ----------------------------------------------------------------------
# What every format is: a writer that is handed a clip moment by moment; and the formats there are.


class Writer(Protocol):
    """One format of one clip, written into a folder of its own."""

    def add(self, moment: Moment) -> None:
        """The next moment of the clip."""

    def close(self) -> None:
        """All were added: write what is told of all of them."""


@dataclass(frozen=True)
class LabelFormat:
    """One format."""

    name: str
    maker: Callable[..., Writer]
    """Takes the folder, which exists and is empty, the `Clip`, and `count` where there is one; raises InputError."""
    about: str
    maps: bool = False
    """It reads the photo's maps."""
    needs: str = ""
    """The map of the photo that it cannot do without."""
    library: str = ""
    """A module that it needs beyond those that are always there."""
    extra: str = "labels"
    """Brings the library."""
    most: int | None = None
    """Objects that it tells apart."""
    counted: str = ""
    """What a number behind its name sets, `tapvid:512`; empty: it takes none."""
    count: int | None = None
    """That number, which goes to the maker too; None: nobody asked."""


FORMATS = (
    LabelFormat("frames", Frames, "the pictures, PNG"),
    LabelFormat("flo", Flo, "optical flow, Middlebury .flo, with masks of what is hidden"),
    LabelFormat("kitti", Kitti, "optical flow, KITTI 16-bit PNG"),
    LabelFormat("wheel", Wheel, "optical flow to look at: the colour wheel"),
    LabelFormat("tapvid", Tapvid, "point tracks, TAP-Vid npz", counted="points"),
    LabelFormat("order", Order, "who is in front, PNG and JSON"),
    LabelFormat("depth", Depth, "depth, 16-bit PNG", True, "depth"),
    LabelFormat("normals", Normals, "normals, 16-bit PNG", True, "normals"),
    LabelFormat("albedo", Albedo, "albedo, linear, 16-bit PNG", True, "albedo"),
    LabelFormat("shading", Shading, "shading, linear, 16-bit PNG", True, "albedo"),
    LabelFormat("coco", Coco, "masks, whole masks, boxes and tracks, COCO JSON", library="pycocotools"),
    LabelFormat("davis", Davis, "masks, palette PNG as in DAVIS 2017", most=254),
    LabelFormat("youtubevos", YoutubeVos, "masks, palette PNG as in YouTube-VOS", most=254),
    LabelFormat("mot", Mot, "boxes and tracks, MOT Challenge text"),
    LabelFormat("mots", Mots, "masks and tracks, MOTS text", library="pycocotools", most=999),
    LabelFormat("events", Events, "what happens: JSON, CSV, a sentence for each event and a caption"),
    LabelFormat(
        "trajectory", TrajectoryTables, "poses and velocities in px, video px and SI: CSV, Parquet, npz"
    ),
    LabelFormat("conditioning", Conditioning, "what video models are conditioned on", maps=True),
    LabelFormat("physics", Physics, "masses, coefficients and all that the motion follows from: JSON"),
)


MAKERS = {"depth": " --backend depth=NAME"}
"""What `perceive` has to be told to make a map that it does not make by itself."""


FLAG = "--format"
MOST_COUNTED = 1_000_000
"""Of what a number behind a name sets."""


def chosen_formats(names: Sequence[str], flag: str = FLAG) -> list[LabelFormat]:
    """Those of `names`, each once, `tapvid:512` with its number.

    Raises InputError with every name that is none, or whose library is not there; `flag` is where they were written.
    """
    found: dict[str, LabelFormat] = {}
    problems: list[Problem] = []
    for name in dict.fromkeys(names):
        kind = _kind(name)
        if isinstance(kind, Wrong):
            problems += kind.of(flag, name)
            continue
        if kind.name in found:
            problems += Wrong(f"is {kind.name} once more", f'write it once, e.g. "{name}"').of(flag, name)
        elif kind.library and find_spec(kind.library) is None:
            fix = f'pip install "physgen[{kind.extra}]"'
            problems += Wrong(f"needs {kind.library}, which is not installed", fix).of(flag, name)
        found[kind.name] = kind
    if problems:
        raise InputError(problems)
    return list(found.values())


def check_names(names: Sequence[str], flag: str = FLAG) -> None:
    """Raises InputError with every name that is no format's, where nothing is to be written in them."""
    problems: list[Problem] = []
    for name in names:
        kind = _kind(name)
        if isinstance(kind, LabelFormat) and kind.count is not None:
            kind = Wrong("takes no number here", f'write "{kind.name}"')
        if isinstance(kind, Wrong):
            problems += kind.of(flag, name)
    if problems:
        raise InputError(problems)


@dataclass(frozen=True)
class Wrong:
    """Why a name is none of a format, and the fix."""

    expected: str
    fix: str

    def of(self, flag: str, name: str) -> Sequence[Problem]:
        """As it is told."""
        return InputError.of(flag, f'"{name}"', self.expected, self.fix).problems


def _kind(name: str) -> LabelFormat | Wrong:
    """Of a name, with its number."""
    known = {kind.name: kind for kind in FORMATS}
    plain, colon, number = name.partition(":")
    if plain not in known:
        close = nearest(plain, known)
        return Wrong(
            "is no format", f'did you mean "{close}"?' if close else f"write any of {listed(list(known))}"
        )
    kind = known[plain]
    if not colon:
        return kind
    if not kind.counted:
        return Wrong("takes no number", f'write "{plain}"')
    if not (number.isascii() and number.isdigit() and 1 <= int(number[:9]) <= MOST_COUNTED):
        return Wrong(
            f"has no number of {kind.counted} from 1 to {MOST_COUNTED:,}", f'write e.g. "{plain}:512"'
        )
    return replace(kind, count=int(number))


def check_fits(chosen: Sequence[LabelFormat], scene: Scene, maps: Percepts | None) -> None:
    """Raises InputError with every format that a scene has too many objects for, or not the map."""
    count, problems = len(scene.objects), []
    for kind in chosen:
        if kind.most is not None and count > kind.most:
            expected = f"are more than the format {kind.name} tells apart, which is {kind.most}"
            fix = "take coco, which has no limit, or leave objects out"
            place = scene.place("objects")
            problems.append(Problem(place, "objects", f"{count:,} objects", expected, fix))
        if kind.needs and (maps is None or getattr(maps, kind.needs) is None):
            problems.append(_lacking(kind, scene, maps))
    if problems:
        raise InputError(problems)


def _lacking(kind: LabelFormat, scene: Scene, maps: Percepts | None) -> Problem:
    """A map is missing, or all of them."""
    found = f'--format "{kind.name}"'
    if maps is None:
        expected, fix = "is made of a photo's maps, and there is no photo", f"leave {kind.name} out"
        return Problem(scene.place("size"), "", found, expected, fix)
    place = scene.place("assets")
    by = MAKERS.get(kind.needs, "")
    fix = f"have it made: physgen perceive --refresh {place.file}{by} -o NEW.yaml"
    return Problem(place, "assets", found, f"is made of {kind.needs}.png, which is not there", fix)


@contextmanager
def open_writers(chosen: Sequence[LabelFormat], folder: Path, clip: Clip) -> Iterator[list[Writer]]:
    """Writers of the formats, each into `folder/<name>`; closed at the end unless something goes wrong."""
    writers: list[Writer] = []
    for kind in chosen:
        home = folder / kind.name
        home.mkdir(parents=True)
        number = () if kind.count is None else (kind.count,)
        writers.append(kind.maker(home, clip, *number))
    yield writers
    for writer in writers:
        writer.close()
