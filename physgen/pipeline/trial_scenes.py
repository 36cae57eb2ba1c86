"""Scenes for trial simulations: a perceived scene without its maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physgen.scene.load import Opened
from physgen.scene.write import scene_text

if TYPE_CHECKING:
    from physgen.perceive.roles import PerceivedScene


def open_trial(photo_scene: PerceivedScene, *more: str) -> Opened:
    """A scene for trials, without maps, with `more` keys of objects. Raises InputError."""
    document = photo_scene.document
    height, width = photo_scene.percepts.labels.shape
    kept = (
        "shape",
        "solid",
        "mass",
        "friction",
        "elasticity",
        "rolling",
        "motion",
        "label",
        "facing",
        "wheels",
        "collision_group",
        "collides_with",
        *more,
    )
    heads = ("physgen", "world", "boundaries", "render")
    bare = {key: document[key] for key in heads if key in document} | {
        "size": [width, height],
        "objects": {
            name: {key: item[key] for key in kept if key in item}
            for name, item in document["objects"].items()
        },
    }
    return Opened("scene.yaml", text=scene_text(bare))
