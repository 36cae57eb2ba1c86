"""Mattes: stages of white objects in the dark.

A matte is drawn like any other stage, so its light is the objects' coverage with soft
borders, supersampling, exposure, camera and size as in the frames.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from physgen.arrays import F32
from physgen.photometry import DistantLight, decode
from physgen.render.sprites import (
    Sprite,
)
from physgen.render.stage import Frame, Stage, three_channels

NO_LIGHT = DistantLight((0.0, 0.0, 1.0), 0.0, 1.0)
"""Even light from all directions, without shading."""


def matte_stage(stage: Stage) -> Stage:
    """Return a stage of the same objects in white, without shading and shadows.

    All else is dark, also objects of the photo that the scene leaves out.
    """
    return Stage(
        background=np.zeros_like(stage.background),
        sprites=list(map(_white, stage.sprites)),
        supersample=stage.supersample,
        scale=stage.scale,
    )


def _white(sprite: Sprite) -> Sprite:
    """Return a white sprite.

    A ball gets dark skin and white gloss, because its picture does not turn with it.
    """
    ball = sprite.ball
    if ball is not None:
        ball = replace(
            ball,
            skin=np.zeros_like(ball.skin),
            gloss=np.ones_like(ball.gloss),
            light=NO_LIGHT,
            lamp_weights=None,
            pattern=None,
            trust=1.0,
            fade=None,
        )
    white_sides = sprite.sides and replace(
        sprite.sides,
        colour=np.ones(3, np.float32),
        light=None,
        top=sprite.sides.top and sprite.sides.top.white_copy(),
    )
    return replace(
        sprite,
        light=three_channels(sprite.coverage),
        rest=None,
        halo=None,
        foot_halo=None,
        ball=ball,
        relief=None,
        gloss=None,
        sides=white_sides,
        wheels=(),
    )


def matte_coverage(frame: Frame) -> F32:
    """Return the coverage of all objects together, (H, W) 0..1, from a matte's
    frame.
    """
    return decode(frame.rgb[..., 0])
