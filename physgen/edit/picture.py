"""Images that the page draws: the background, the objects and their shadows."""

from __future__ import annotations

from dataclasses import replace
from threading import Lock
from typing import Any

import cv2
import numpy as np

from physgen.compile.appearance import photo_poses
from physgen.compile.world import World
from physgen.edit.live import CompiledScene, Live
from physgen.pipeline.stages import Recent, stage
from physgen.render.stage import Stage
from physgen.report.player import plate, shadows, sprites
from physgen.simulate.trajectory import Trajectory

Data = dict[str, Any]


class Pictures:
    """Of one scene file while it is edited; its methods may be called from any thread and hold up no look."""

    def __init__(self, live: Live) -> None:
        self._live, self._lock = live, Lock()
        self._stages: Recent[Stage] = Recent(2)
        self._looks: Recent[Data] = Recent(3)
        self._shadows: Recent[Data] = Recent(6)

    def look(self, key: str) -> Data | None:
        """`names` of the bodies, `background` and `sprites` as `report.cutouts` has them; None: the key is gone."""
        sight = self._live.sight(key)
        if sight is None:
            return None
        with self._lock:
            return self._looks.of(key, lambda: self._look(key, sight))

    def shadows(self, key: str, motion: str) -> Data | None:
        """Shadows of every object for a motion, which is simulated to its end; None: one of the two is gone."""
        sight = self._live.sight(key)
        seen = None if sight is None else self._live.whole(motion)
        if sight is None or seen is None:
            return None
        with self._lock:
            rows = self._shadows.of((key, motion), lambda: self._thrown(key, sight, *seen))
        return {"key": key, "motion": motion, **rows}

    def _stage(self, key: str, sight: CompiledScene) -> Stage:
        """With the poses in which objects were cut out of the photo."""
        return self._stages.of(key, lambda: stage(sight.scene, sight.compiled, sight.percepts))

    def _look(self, key: str, sight: CompiledScene) -> Data:
        drawn = self._stage(key, sight)
        return {
            "key": key,
            "names": [item.name for item in sight.scene.objects],
            "background": plate(drawn, range(len(drawn.sprites))),
            "sprites": sprites(drawn),
            "shadows": [],
            "motion": None,
        }

    def _thrown(self, key: str, sight: CompiledScene, seen: Trajectory, world: World) -> Data:
        drawn = replace(self._stage(key, sight), starts=photo_poses(world))
        if len(seen.names) != len(sight.scene.objects):
            return {"shadows": []}
        return {"shadows": shadows(drawn, seen, range(len(drawn.sprites)))}


def photo_png(sight: CompiledScene) -> bytes:
    """PNG of the photo; a scene without one has a plain background."""
    from physgen.render.staging import flat_background

    maps = sight.percepts
    rgb = flat_background(sight.compiled.world, 1.0) if maps is None else maps.rgb
    done, data = cv2.imencode(".png", cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2BGR))
    assert done
    return data.tobytes()
