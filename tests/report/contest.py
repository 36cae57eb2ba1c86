"""A folder of methods and scenes: tiny clips of a ball, told apart by the colour of what is behind it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from physgen.export.video import Format, open_video
from physgen.maps import write_png

SIZE, FPS, FRAMES = (64, 48), 10, 8
SHADES = {"ours": 200, "drift": 140, "melt": 80}
"""Method -> the grey of its ground, so that a test can tell whose clip a page shows."""


def frame(method: str, scene: int, k: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """(H, W, 3): the ground says the method, the ball's row the scene, its column the time."""
    wide, high = size
    rgb = np.full((high, wide, 3), SHADES[method], np.uint8)
    at = int(wide * (k + 1) / (FRAMES + 1)), int(high * (scene + 1) / 4)
    cv2.circle(rgb, at, max(wide // 12, 3), (230, 60, 40), -1)
    return rgb


def write_clip(
    path: Path,
    method: str,
    scene: int = 0,
    *,
    frames: int = FRAMES,
    fps: float = FPS,
    size: tuple[int, int] = SIZE,
) -> Path:
    """As an MP4, or what the ending says."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open_video(
        path.parent, Format(path.suffix[1:]), size, fps, path.stem
    ) as write:
        for k in range(frames):
            write(frame(method, scene, k, size))
    return path


def contest(
    home: Path, scenes: tuple[str, ...] = ("pool", "shelf"), photos: bool = True
) -> Path:
    """`home` with a clip of every method for every scene; one of them in a folder, as physgen leaves it."""
    for method in SHADES:
        for k, scene in enumerate(scenes):
            flat = method != "ours"
            write_clip(
                home / method / (f"{scene}.mp4" if flat else f"{scene}/video.mp4"),
                method,
                k,
            )
    if photos:
        (home / "photos").mkdir()
        write_png(home / "photos" / f"{scenes[0]}.png", frame("ours", 0, 0))
        (home / "photos" / f"{scenes[0]}.txt").write_text(
            "the red ball rolls to the right\n", encoding="utf-8"
        )
    return home
