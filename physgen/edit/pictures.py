"""Pictures of a scene during editing: sprites, shadows, frames, the photo and masks."""

from __future__ import annotations

from dataclasses import replace
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World, photo_poses
from physgen.edit.live import Live, LiveScene
from physgen.messages import Message
from physgen.pipeline.stages import Recent, stage
from physgen.render.camera import exposure_times
from physgen.render.flat_drawing import flat_background
from physgen.render.frames import render_frames
from physgen.render.stage import Stage
from physgen.report.player import plate, shadows, sprites
from physgen.simulate.trajectory import Trajectory

Data = dict[str, Any]


class Pictures:
    """Pictures of one scene file during editing.

    The methods are thread-safe, and their own lock keeps them from blocking looks.
    """

    def __init__(self, live: Live) -> None:
        self._live = live
        self._lock = Lock()
        self._stages: Recent[Stage] = Recent(2)

    def look(self, key: str) -> Data | None:
        """Return the background and the sprites for a picture's key; None for a dropped
        key.

        `names`: the objects; `background` and `sprites` as in `report.cutouts`.
        """
        sight = self._live.sight(key)
        if sight is None:
            return None
        with self._lock:
            render_stage = self._stage(key, sight)
            background = plate(render_stage, range(len(render_stage.sprites)))
            names = [item.name for item in sight.scene.objects]
            return {
                "key": key,
                "names": names,
                "background": background,
                "sprites": sprites(render_stage),
                "shadows": [],
            }

    def shadows(self, key: str, motion: str) -> Data | None:
        """Return the shadows of every object for a motion, which is simulated to its
        end.

        None if the picture or the motion was dropped.
        """
        moving_scene = self._moving_scene(key, motion)
        if moving_scene is None:
            return None
        sight, trajectory, world = moving_scene
        with self._lock:
            render_stage = replace(self._stage(key, sight), starts=photo_poses(world))
            # The text may have changed between the picture and the motion, with another
            # set of objects.
            is_same_scene = len(trajectory.names) == len(sight.scene.objects)
            if is_same_scene:
                rows = shadows(
                    render_stage, trajectory, range(len(render_stage.sprites))
                )
            else:
                rows = []
            return {"key": key, "motion": motion, "shadows": rows}

    def frame(self, key: str, motion: str, number: int) -> bytes | None:
        """Render the photo at a frame of a motion as a PNG, as in the video.

        A number beyond the last frame selects the last. None if the picture or the
        motion was dropped.
        """
        moving_scene = self._moving_scene(key, motion)
        if moving_scene is None:
            return None
        sight, trajectory, world = moving_scene
        with self._lock:
            render_stage = replace(self._stage(key, sight), starts=photo_poses(world))
        blur = sight.scene.render.motion_blur
        at_frames = trajectory.resample(world.times)
        # Motion blur averages several samples within the exposure of a frame.
        exposure_moments, parts = exposure_times(at_frames, world, blur)
        if parts == 1:
            exposure_samples = at_frames
        else:
            exposure_samples = trajectory.resample(exposure_moments)
        first_sample = min(number, len(world.times) - 1) * parts
        sample_indices = range(first_sample, first_sample + parts)
        frame = next(
            render_frames(render_stage, exposure_samples, sample_indices, parts)
        )
        return _png(cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR))

    def _moving_scene(
        self, key: str, motion: str
    ) -> tuple[LiveScene, Trajectory, World] | None:
        """Return the scene of a picture and a motion, simulated to its end, in its
        world; None if the picture or the motion was dropped.
        """
        sight = self._live.sight(key)
        if sight is None:
            return None
        motion_and_world = self._live.full_motion(motion)
        if motion_and_world is None:
            return None
        return sight, *motion_and_world

    def _stage(self, key: str, sight: LiveScene) -> Stage:
        """Prepare the stage of a scene, with objects at the poses of the photo."""
        return self._stages.of(
            key, lambda: stage(sight.scene, sight.compiled_scene, sight.percepts)
        )


def photo_png(sight: LiveScene) -> bytes:
    """Encode the photo as a PNG; a scene without a photo has a plain background."""
    maps = sight.percepts
    if maps is None:
        rgb = flat_background(sight.compiled_scene.world, 1.0)
    else:
        rgb = maps.rgb
    return _png(cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2BGR))


def mask_png(sight: LiveScene, name: str) -> bytes:
    """Encode an object's mask as a grey PNG of the photo's size, 0 or 255.

    Raises EditError, InputError.
    """
    names = [item.name for item in sight.scene.objects]
    if name not in names:
        raise Message.NAME_UNKNOWN.impossible(name=name)
    return _png(
        np.where(
            sight.compiled_scene.labels == names.index(name) + 1,
            np.uint8(255),
            np.uint8(0),
        )
    )


def _png(picture: NDArray[Any]) -> bytes:
    """Encode a picture, (H, W) or (H, W, 3) BGR, as a PNG."""
    is_encoded, data = cv2.imencode(".png", picture)
    assert is_encoded
    return data.tobytes()
