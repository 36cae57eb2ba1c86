"""Compute the sound track of a clip and write it beside the video."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.export.video import I16
from physgen.pipeline.labelling import labelled_clip
from physgen.scene.scene import Play
from physgen.sound.track import sound_track

if TYPE_CHECKING:
    from physgen.pipeline.stages import Film
    from physgen.report.record import RunRecord
    from physgen.simulate.trajectory import Trajectory

SOUND_FILE = "sound.wav"
CAPTIONS_FILE = "sound.vtt"


def write_sound(
    film: Film, trajectory: Trajectory, folder: Path, record: RunRecord
) -> I16 | None:
    """Write `sound.wav` and its captions `sound.vtt` into a folder; return the samples (N, 2).

    None if the scene asks for no sound, plays backward or is silent.
    """
    render = film.scene.render
    if render.sound is None or render.play is Play.BACKWARD:
        return None
    with record.stage("sound", time.thread_time):
        clip = labelled_clip(film, trajectory, record, None)
        sound = sound_track(clip, render.sound)
        if sound is None:
            return None
        (folder / SOUND_FILE).write_bytes(sound.wav())
        (folder / CAPTIONS_FILE).write_text(sound.vtt(), "utf-8")
    return sound.samples
