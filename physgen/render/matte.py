"""Stage -> its matte, a Stage of white things in the dark: drawn like any other, its light is the objects' coverage.

So coverage comes by the very path by which frames do, with soft borders, supersampling, exposure, camera and size, on
the processor and on a GPU: it is right by construction, and stays so whatever the path learns.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physgen.photometry import DistantLight, decode
from physgen.render.placing import thrice
from physgen.render.sprites import Sprite
from physgen.render.stage import Frame, Stage

F32 = NDArray[np.float32]

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


def coverage(frame: Frame) -> F32:
    """(H, W) 0..1 of all objects together: the linear light of a matte's frame."""
    return decode(frame.rgb[..., 0])
