"""The sound of clips on pages: a section of the report, and the gallery's listening
page.
"""

from __future__ import annotations

import base64
import os
from collections.abc import Sequence
from dataclasses import dataclass
from html import unescape
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
import numpy as np

from physgen.arrays import U8
from physgen.files import write_atomic
from physgen.report.clips import Clip
from physgen.report.html import template, webp
from physgen.sound.synthesis import RATE
from physgen.sound.track import SoundTrack

WAV = "sound.wav"
CAPTIONS = "sound.vtt"
MARK = '<meta name="generator" content="physgen sound">'
"""Mark of our own pages."""


@dataclass(frozen=True)
class SpectrogramTuning:
    """The picture of a sound track."""

    window: int = 1024
    """Samples of each spectrum: 21 ms."""
    width: int = 960
    height: int = 160
    """Width and height, px."""
    top: float = 12_000.0
    """Frequency at the upper border, Hz."""
    depth: float = 75.0
    """Range from the loudest tone to black, dB."""
    quality: int = 70
    """Quality of WebP."""
    loudest: int = 12
    """Number of impacts in the table."""


TUNING = SpectrogramTuning()


def sound_section(track: SoundTrack) -> dict[str, Any]:
    """Return the variables of `sound.html.j2`."""
    loudest = sorted(track.captions, key=lambda caption: -caption.impulse)
    rows = sorted(loudest[: TUNING.loudest], key=lambda caption: caption.time)
    return {
        "file": WAV,
        "captions": text_track(track.vtt()),
        "count": len(track.captions),
        "seconds": len(track.samples) / RATE,
        "picture": webp(spectrogram(track), TUNING.quality),
        "top": round(TUNING.top / 1000),
        "rows": [
            {"time": row.time, "text": row.text, "impulse": row.impulse} for row in rows
        ],
    }


def text_track(vtt: str) -> str:
    """Return captions as a data URI: browsers do not read text tracks beside a page on
    disk.
    """
    data = base64.b64encode(vtt.encode("utf-8")).decode("ascii")
    return f"data:text/vtt;base64,{data}"


def spectrogram(track: SoundTrack) -> U8:
    """Return (H, W, 3) sRGB: time to the right, frequency upwards, in dB below the
    loudest tone.
    """
    heard = track.samples.astype(np.float32).mean(axis=1)
    # At least one window, for a very short track.
    heard = np.pad(heard, (0, TUNING.window))
    # Windows are so far apart that there is about one for each column of the picture.
    hop = max((len(heard) - TUNING.window) // TUNING.width, 1)
    parts = np.lib.stride_tricks.sliding_window_view(heard, TUNING.window)[::hop]
    # A window that falls to zero at both ends keeps a tone from spreading over all
    # frequencies.
    parts = parts * np.hanning(TUNING.window).astype(np.float32)
    power = np.abs(np.fft.rfft(parts, axis=1))
    bins = int(TUNING.top * TUNING.window / RATE)
    # Row 0 of a picture is at its top: put the highest frequency there.
    shown = power[:, :bins].T[::-1]
    # The small numbers avoid the logarithm of zero in silence.
    level = 20 * np.log10(shown / max(float(shown.max()), 1e-9) + 1e-9)
    codes = np.clip((level / TUNING.depth + 1) * 255, 0, 255).astype(np.uint8)
    size = (TUNING.width, TUNING.height)
    picture = cv2.resize(codes, size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.applyColorMap(picture, cv2.COLORMAP_MAGMA)[:, :, ::-1])


def sounds(clip: Clip) -> bool:
    """Return whether a clip was rendered with sound."""
    has_video = clip.film is not None and clip.film.suffix == ".mp4"
    return has_video and (clip.home / CAPTIONS).is_file()


def listening_page(index: Path) -> Path:
    """Return the file of the listening page beside a gallery."""
    return index.with_name(f"{index.stem}.listen.html")


def write_listening_page(clips: Sequence[Clip], index: Path, title: str) -> Path | None:
    """Write a listening page of all clips with sound beside a gallery. Return None
    without such clips.

    Keep a file of another program with this name, and write no page then.
    """
    page = listening_page(index)
    rows = []
    for clip in clips:
        if not sounds(clip) or clip.film is None:
            continue
        captions = clip.home / CAPTIONS
        vtt = captions.read_text("utf-8", "replace")
        video = os.path.relpath(clip.film, index.parent)
        rows.append(
            {
                "name": clip.name,
                "video": quote(Path(video).as_posix()),
                "captions": text_track(vtt),
                "lines": _caption_lines(vtt),
            }
        )
    # A page of the user with this name stays.
    if page.exists() and MARK not in page.read_text("utf-8", "replace"):
        return None
    if not rows:
        page.unlink(missing_ok=True)
        return None
    html = template("listen.html.j2").render(title=title, clips=rows, home=index.name)
    write_atomic(page, html.encode("utf-8"))
    return page


def _caption_lines(vtt: str) -> list[tuple[str, str]]:
    """Return time and text of each cue of a WebVTT file of physgen."""
    lines = []
    for cue in vtt.split("\n\n")[1:]:
        time, _, text = cue.strip().partition("\n")
        begin = time.partition(" ")[0]
        if text:
            lines.append((begin.removeprefix("00:"), unescape(text)))
    return lines
