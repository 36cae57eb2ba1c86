"""Stage -> its matte, a Stage of white things in the dark: drawn like any other, its light is the objects' coverage.

So coverage comes by the very path by which frames do, with soft borders, supersampling, exposure, camera and size, on
the processor and on a GPU: it is right by construction, and stays so whatever the path learns.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import overload

import numpy as np
from numpy.typing import NDArray

from physgen.photometry import DistantLight, decode
from physgen.render.placing import thrice
from physgen.render.sprites import Sprite
from physgen.render.stage import Frame, Stage

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]

NO_LIGHT = DistantLight((0.0, 0.0, 1.0), 0.0, 1.0)
"""Even, from all around: nothing is shaded."""


def matte(stage: Stage) -> Stage:
    """The same things, white without any shading, and nothing else: no photo, no boundaries, no shadows.

    Whatever is no object of the scene, things of the photo that the scene leaves out among it, is dark.
    """
    return Stage(
        background=np.zeros_like(stage.background),
        sprites=[_white(sprite) for sprite in stage.sprites],
        supersample=stage.supersample,
        scale=stage.scale,
    )


def _white(sprite: Sprite) -> Sprite:
    """A ball stays one, for its picture does not turn with it: of dark skin and white gloss all over."""
    ball = sprite.ball
    if ball is not None:
        ball = replace(
            ball,
            skin=np.zeros_like(ball.skin),
            gloss=np.ones_like(ball.gloss),
            light=NO_LIGHT,
            even=None,
            trust=1.0,
            fade=None,
        )
    return replace(sprite, light=thrice(sprite.coverage), rest=None, ball=ball, relief=None)


class Coverage(Sequence[F32]):
    """The coverage of frames one after the other, (H, W) 0..1 each: linear light of a matte's frames.

    Kept as the codes that were drawn, a byte a pixel; made floats when asked for.
    """

    def __init__(self, frames: Iterable[Frame]) -> None:
        """`frames` are those of a matte."""
        self._codes: list[U8] = [np.ascontiguousarray(frame.rgb[..., 0]) for frame in frames]

    @overload
    def __getitem__(self, index: int) -> F32: ...
    @overload
    def __getitem__(self, index: slice) -> list[F32]: ...
    def __getitem__(self, index: int | slice) -> F32 | list[F32]:
        if isinstance(index, slice):
            return [decode(codes) for codes in self._codes[index]]
        return decode(self._codes[index])

    def __len__(self) -> int:
        return len(self._codes)
