"""What labels and the sound track of a clip are made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from physgen.export.labels import Clip, MomentQueue, starting_labels
from physgen.maps import Percepts
from physgen.report.record import RunRecord
from physgen.simulate.trajectory import Trajectory

if TYPE_CHECKING:
    from physgen.pipeline.stages import Film


def labelled_clip(
    film: Film, trajectory: Trajectory, record: RunRecord, maps: Percepts | None
) -> Clip:
    """Return what labels and sound are made of; `maps` are the photo's, if they are needed."""
    scene, compiled, shot = film.scene, film.compiled, film.shot(trajectory)
    labels = None if maps is None else maps.cut_out
    return Clip(
        scene.name,
        scene,
        compiled.world,
        trajectory,
        maps,
        scene.video_size,
        scene.render.fps,
        len(shot.order),
        shot,
        record.inputs,
        photo_ids=starting_labels(compiled.labels, labels, compiled.scenery),
    )


def open_queue(clip: Clip, fine: Trajectory, samples: Sequence[int]) -> MomentQueue:
    """Return a queue of frames; `fine` is the motion within exposures, `samples` the last of each frame."""
    return MomentQueue(clip.world, fine, samples, clip.shot)
