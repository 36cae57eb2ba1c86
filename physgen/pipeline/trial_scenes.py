"""Scenes for trial simulations: a perceived scene without its maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physgen.scene.load import OpenedScene
from physgen.scene.write import scene_text

if TYPE_CHECKING:
    from physgen.perceive.roles import PerceivedScene


def open_trial(photo_scene: PerceivedScene, *more: str) -> OpenedScene:
    """Create a scene for trials, without maps. Raises InputError.

    `more` are keys of objects that are copied in addition to those of shape and matter.
    """
    document = photo_scene.document
    height, width = photo_scene.percepts.labels.shape
    object_keys = (
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
    sections = ("physgen", "world", "boundaries", "render")
    # Without maps and sources, a trial compiles in milliseconds.
    trial_document = {key: document[key] for key in sections if key in document} | {
        "size": [width, height],
        "objects": {
            name: {key: item[key] for key in object_keys if key in item}
            for name, item in document["objects"].items()
        },
    }
    return OpenedScene("scene.yaml", text=scene_text(trial_document))
