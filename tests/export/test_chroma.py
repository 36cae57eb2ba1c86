"""Colours of an mp4 at every pixel."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from physgen.export.video import Format, Mp4Options, open_video


def _first_frame(folder: Path, chroma: int) -> tuple[str, np.ndarray]:
    """Write red stripes of one px, and return the layout and the frame that is read."""
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[:, ::2, 0] = 220
    mp4 = Mp4Options(chroma)
    with open_video(folder, Format.MP4, (64, 64), 30, mp4=mp4) as write:
        write(stripes)
    with av.open(str(folder / "video.mp4")) as file:
        frame = next(file.decode(video=0))
        return frame.format.name, frame.to_ndarray(format="rgb24")


@pytest.mark.parametrize(("chroma", "is_sharp"), [(420, False), (444, True)])
def test_full_colour_keeps_red_stripes(
    chroma: int, is_sharp: bool, tmp_path: Path
) -> None:
    layout, rgb = _first_frame(tmp_path, chroma)
    assert layout == f"yuv{chroma}p"
    red = rgb[..., 0].astype(int)
    difference = np.abs(np.diff(red, axis=1)).mean()
    assert bool(difference > 180) is is_sharp
