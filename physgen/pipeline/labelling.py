"""The inputs of a clip's labels and of its sound track."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from physgen.export.labels import Clip, MomentQueue, starting_labels
from physgen.maps import Percepts
from physgen.report.record import RunRecord
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from physgen.pipeline.film import Film


def labelled_clip(
    film: Film, trajectory: Trajectory, record: RunRecord, maps: Percepts | None
) -> Clip:
    """Return the input of labels and sound; `maps` are the photo's maps, if needed."""
    scene = film.scene
    compiled_scene = film.compiled
    shot = film.shot(trajectory)
    labels = None
    # Labels need the masks of the photo; sound and tracks do without.
    if maps is not None:
        labels = maps.cut_out
    return Clip(
        scene.name,
        scene,
        compiled_scene.world,
        trajectory,
        maps,
        scene.video_size,
        scene.render.fps,
        len(shot.order),
        shot,
        record.inputs,
        photo_ids=starting_labels(
            compiled_scene.labels, labels, compiled_scene.scenery
        ),
    )


def open_queue(
    clip: Clip, fine_motion: Trajectory, samples: Sequence[int]
) -> MomentQueue:
    """Create a queue of frames.

    `fine_motion` is the motion within exposures, `samples` the last sample of each
    frame.
    """
    return MomentQueue(clip.world, fine_motion, samples, clip.shot)
