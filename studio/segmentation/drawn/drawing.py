"""A seed -> a picture with its truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from picture import Picture, at_border

from .develop import develop
from .hand import Hand
from .layouts import LAYOUTS, Placer, furniture
from .light import lit
from .room import furnish
from .scene import Scene


@dataclass(frozen=True)
class Drawn:
    """A picture and the names of what it is made of."""

    picture: Picture
    layout: str
    view: str
    kinds: tuple[str, ...]
    """Of the things placed, hidden ones too."""
    distractors: tuple[str, ...]
    """What was printed, laid, hung or built in."""


def draw(seed: int, size: int = 256) -> Picture:
    """The picture of a seed, size x size pixels: the same bytes each time."""
    return draw_told(seed, size).picture


def draw_told(seed: int, size: int = 256) -> Drawn:
    """As `draw`, and what it is made of."""
    hand = Hand(seed)
    layout = hand.one_of(list(LAYOUTS), [share for _, share, _ in LAYOUTS.values()])
    lay, _, views = LAYOUTS[layout]
    view = hand.one_of(views)
    room = furnish(hand, view, size)
    scene = Scene(hand, room, lit(hand, room))
    placer = Placer(hand, room, scene)
    far = 0
    if room.horizon > 0 and hand.chance(0.2):
        for _ in range(hand.whole(1, 4)):
            placer.put(
                placer.kind(True),
                hand.between(0, size),
                room.horizon + 2,
                size * hand.between(0.2, 0.6),
                clear=None,
            )
        far = len(scene.items)
        placer.names.clear()
    furniture(placer)
    built = len(scene.items) > far
    lay(placer)
    rendered = scene.render(blurred=far)
    kept = {scene.kept[n] for n in rendered.outside if n in scene.kept}
    picture = Picture(
        rgb=develop(hand, rendered.light),
        labels=rendered.labels,
        unsaid=rendered.unsaid,
        normals=rendered.normals,
        known=np.ones((size, size), bool),
        shadow=rendered.shadow.astype(np.float32),
        depth_order=rendered.depth,
        truncated=tuple(n for n in at_border(rendered.labels) if n in kept),
    )
    distractors = [
        *room.drawn,
        *(["defocused things"] if far else []),
        *(["furniture"] if built else []),
        *(["reflection"] if room.mirror else []),
    ]
    return Drawn(picture, layout, view, tuple(placer.names), tuple(distractors))
