"""Scene -> warnings about a camera that cannot do what is written."""

from __future__ import annotations

from collections.abc import Iterator

from physgen.compile.assemble import Compiled
from physgen.compile.warning import warning
from physgen.framing import held, room
from physgen.problems import Problem
from physgen.scene.model import Scene, Sight

AWAY = 0.5
"""px by which a view may be moved without anyone seeing it."""


def filming(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """Views that would leave the photo, or that are reached when the clip is over."""
    for index, sight in enumerate(scene.render.camera):
        path = "render.camera"
        if f"{path}[{index}]" in scene.places:
            path += f"[{index}]"
        yield from _still(scene, sight, path)
        end = scene.world.duration
        if sight.time > end:
            expected = f"is after the end of the motion at {end:g} s: this view is never reached"
            fix = "make it earlier, or lengthen the duration"
            yield warning(scene, f"{path}.time", f"{sight.time:g}", expected, fix)


def _still(scene: Scene, sight: Sight, path: str) -> Iterator[Problem]:
    photo, video = scene.size, scene.video_size
    if sight.center is not None:
        x, y = held(sight.center, photo, video, sight.zoom)
        if max(abs(x - sight.center[0]), abs(y - sight.center[1])) > AWAY:
            found = f"[{sight.center[0]:g}, {sight.center[1]:g}]"
            expected = (
                f"is too near the photo's border for zoom {sight.zoom:g}: the view stops at [{x:g}, {y:g}]"
            )
            fix = "zoom in further, or move it there"
            yield warning(scene, f"{path}.center", found, expected, fix)
    elif sight.follow is not None:
        low, high = room(photo, video, sight.zoom)
        if max(high[0] - low[0], high[1] - low[1]) < 1:
            expected = f"has no effect: at zoom {sight.zoom:g} all of the photo is seen"
            yield warning(
                scene, f"{path}.follow", sight.follow, expected, "write zoom: 1.5 or more beside it"
            )
