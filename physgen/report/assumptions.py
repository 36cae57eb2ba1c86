"""The line at the top of a report: the scale of lengths and speeds, and the doubtful
regions.
"""

from __future__ import annotations

from physgen.compile.world import World
from physgen.geometry.scale import is_assumed
from physgen.report.perception import doubt_text
from physgen.scene.scene import Scene
from physgen.text import listed, rounded

DIGITS = 2
"""Digits of a width in metres. Scales are hardly ever known better."""


def is_scaled(scene: Scene) -> bool:
    """Return whether the scene file states a scale, so that lengths can have metres."""
    return "world.pixels_per_meter" in scene.places


def assumptions(scene: Scene, world: World) -> list[str]:
    """Return sentences about the scale and the doubtful regions of a scene."""
    return [_scale_sentence(scene, world), *_doubt_sentences(scene)]


def _scale_sentence(scene: Scene, world: World) -> str:
    if not is_scaled(scene):
        return "No scale in the scene file: lengths are in px."
    scale = world.pixels_per_meter
    width = f"{rounded(world.size[0] / scale, DIGITS)} m wide"
    if scene.record.scale is not None and is_assumed(scale, max(world.size)):
        return f"Scale assumed: {width}; speeds follow."
    return f"Scale from the scene file: {width}."


def _doubt_sentences(scene: Scene) -> list[str]:
    doubtful = scene.document.get("doubtful") or {}
    if not doubtful:
        return []
    names = []
    for name, entry in doubtful.items():
        names.append(doubt_text(name, entry.get("confidence")))
    return [f"Perhaps objects, too: {listed(names, 'and')}."]
