"""Golden files, the clip now and what is asked -> whether it moves and looks as it did, and what has changed since."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physgen.compile.world import World
from physgen.golden.asking import Asked
from physgen.golden.causes import Causes, causes
from physgen.golden.drawn import Drawn, drawn
from physgen.golden.files import Golden
from physgen.golden.moved import Moved, moved, too_coarse
from physgen.golden.taking import Clip
from physgen.problems import InputError

EARLIER = 0.9
"""Of the time at which chaos shows, up to which comparing is advised."""


@dataclass(frozen=True)
class Foretold:
    """How long a motion can be foretold."""

    until: float | None
    """s: when runs a hair apart have parted by a pixel; None: never."""
    verdict: str


@dataclass(frozen=True)
class Verdict:
    """How a clip compares with its golden files."""

    scene: str
    """As the test names it."""
    golden: Golden
    clip: Clip
    asked: Asked
    moved: Moved | None
    """None: motion is not compared."""
    drawn: Drawn | None
    """None: frames are not."""
    unkept: tuple[str, ...]
    """What cannot be compared as it is asked, since it is not kept so: sentences."""
    causes: Causes
    foretold: Foretold | None
    """Worked out only where the same scene moves differently."""

    @property
    def right(self) -> bool:
        """Whether the clip is as it was."""
        return not self.unkept and all(part is None or part.agrees for part in (self.moved, self.drawn))

    @property
    def pixels_alone(self) -> bool:
        """Whether things move as they did, and look different."""
        return (
            self.moved is not None and self.moved.agrees and self.drawn is not None and not self.drawn.agrees
        )


def judged(scene: str, golden: Golden, clip: Clip, asked: Asked) -> Verdict:
    """Compare a clip with golden files; runs the scene's neighbours where the same scene moves differently."""
    unkept, moves, frames = [], None, None
    if asked.motion is not None:
        if golden.track is None:
            unkept.append("motion is to be compared, and is not kept")
        elif coarse := too_coarse(golden.track.units, asked.motion):
            unkept.append(f"motion cannot be compared: {coarse}")
        else:
            moves = moved(golden.track, clip.trajectory, asked.motion, asked.until)
    if asked.pixels is not None and clip.stills is not None:
        if golden.stills is None:
            unkept.append("frames are to be compared, and none are kept")
        else:
            frames = drawn(golden.stills, clip.stills, asked.pixels)
    since = causes(golden.made, clip.made)
    foretold = None
    if moves is not None and moves.strayed and not since.scene:
        foretold = _foretold(clip.world)
    return Verdict(scene, golden, clip, asked, moves, frames, tuple(unkept), since, foretold)


def _foretold(world: World) -> Foretold | None:
    """What the engine's own test of chaos says; None where it cannot be run."""
    from physgen.simulate.chaos import NUDGES, WILD, chaos

    try:
        found = chaos(world)
    except InputError:
        return None
    wild = found.distance[:, :NUDGES].max(axis=1) > WILD if found.distance.size else np.zeros(0, bool)
    until = float(found.parted[wild, :NUDGES].min()) if wild.any() else None
    return Foretold(until, found.verdict())
