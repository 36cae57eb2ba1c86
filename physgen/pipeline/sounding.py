"""Compute the sound track of a clip and write it beside the video."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import physgen.sound
from physgen import report
from physgen.pipeline.labelling import labelled_clip
from physgen.scene.scene import Play

if TYPE_CHECKING:
    from physgen.pipeline.film import Film
    from physgen.report.record import RunRecord
    from physgen.simulate.trajectory import Trajectory
    from physgen.sound.track import SoundTrack


def write_sound(
    film: Film, trajectory: Trajectory, folder: Path, record: RunRecord
) -> SoundTrack | None:
    """Write `sound.wav` and its captions `sound.vtt` into a folder; return the track.

    None if the scene asks for no sound, plays backwards or is silent.
    """
    render = film.scene.render
    if render.sound is None or render.play is Play.BACKWARD:
        return None
    with record.stage("sound", time.thread_time):
        clip = labelled_clip(film, trajectory, record, None)
        sound = physgen.sound.track.sound_track(clip, render.sound)
        if sound is None:
            return None
        # The photo is shown for some frames before the motion.
        sound = sound.add_silence(film.hold / render.fps)
        (folder / report.listening.WAV).write_bytes(sound.wav())
        (folder / report.listening.CAPTIONS).write_text(sound.vtt(), "utf-8")
    return sound
