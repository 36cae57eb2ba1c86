"""What every format is: a writer that is handed a clip moment by moment; and the formats there are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Protocol

from physgen.export.motion import Moment
from physgen.export.truth import Clip
from physgen.problems import InputError
from physgen.scene.words import listed, nearest


class Writer(Protocol):
    """One format of one clip, written into a folder of its own."""

    def add(self, moment: Moment) -> None:
        """The next moment of the clip."""

    def close(self) -> None:
        """All were added: write what is told of all of them."""


@dataclass(frozen=True)
class Kind:
    """One format."""

    name: str
    maker: str
    """`module:function` that takes the folder, which is there and empty, and the `Clip`; raises InputError."""
    about: str
    maps: bool = False
    """It reads the photo's maps."""


KINDS = (
    Kind("frames", "frames:Frames", "the pictures, PNG"),
    Kind("flo", "flo:Flo", "optical flow, Middlebury .flo, with masks of what is hidden"),
    Kind("kitti", "kitti:Kitti", "optical flow, KITTI 16-bit PNG"),
    Kind("wheel", "wheel:Wheel", "optical flow to look at: the colour wheel"),
    Kind("events", "events:Events", "what happens: JSON, CSV, a sentence for each event and a caption"),
    Kind(
        "trajectory", "trajectory:Motions", "poses and velocities in px, video px and SI: CSV, Parquet, npz"
    ),
    Kind("conditioning", "conditioning:Conditioning", "what video models are conditioned on", maps=True),
    Kind("physics", "physics:Physics", "masses, coefficients and all that the motion follows from: JSON"),
)


def kinds(names: Sequence[str]) -> list[Kind]:
    """Those of `names`, each once. Raises InputError with every name that is none."""
    known = {kind.name: kind for kind in KINDS}
    problems = []
    for name in names:
        if name not in known:
            close = nearest(name, known)
            fix = f'did you mean "{close}"?' if close else f"write any of {listed(list(known))}"
            problems += InputError.of("--format", f'"{name}"', "is no format", fix).problems
    if problems:
        raise InputError(problems)
    return [known[name] for name in dict.fromkeys(names)]


@contextmanager
def written(chosen: Sequence[Kind], folder: Path, clip: Clip) -> Iterator[list[Writer]]:
    """Writers of the formats, each into `folder/<name>`; closed at the end unless something goes wrong."""
    writers: list[Writer] = []
    for kind in chosen:
        module, _, name = kind.maker.partition(":")
        home = folder / kind.name
        home.mkdir(parents=True)
        writers.append(getattr(import_module(f"physgen.export.{module}"), name)(home, clip))
    yield writers
    for writer in writers:
        writer.close()
