"""A clip on disk as a value, for scripts and notebooks."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

from physgen.maps import U8
from physgen.pipeline.clip import RenderOptions, render_scene
from physgen.simulate.trajectory import Trajectory, read_trajectory
from physgen.videos import video_frames

VIDEO_NAMES = ("video.mp4", "video.webp", "video.gif")
"""File names of videos, in order of preference."""


@dataclass(frozen=True)
class Clip:
    """A rendered clip; a notebook shows its video."""

    folder: Path

    @property
    def video(self) -> Path:
        """Return the video file. Raises FileNotFoundError if the clip has none."""
        for name in VIDEO_NAMES:
            if (self.folder / name).is_file():
                return self.folder / name
        raise FileNotFoundError(f"{self.folder} has no video")

    @property
    def report(self) -> Path | None:
        """Return the report's page; None if the clip has none."""
        page = self.folder / "report.html"
        if page.is_file():
            return page
        return None

    @cached_property
    def frames(self) -> list[U8]:
        """Decode the frames of the video file, (H, W, 3) sRGB each."""
        return [frame.rgb for frame in video_frames(self.video)]

    @cached_property
    def trajectory(self) -> Trajectory:
        """Read the motion: times (T,) s, poses (T, N, 3) px and rad, contacts."""
        return read_trajectory(self.folder / "trajectory.npz")

    def _repr_html_(self) -> str:
        """Return the video as HTML with the data in it, for notebooks."""
        kind = self.video.suffix.removeprefix(".")
        data = b64encode(self.video.read_bytes()).decode()
        name = escape(self.folder.name, quote=True)
        if kind == "mp4":
            source = f'src="data:video/mp4;base64,{data}"'
            return (
                f'<video controls loop autoplay muted title="{name}" {source}></video>'
            )
        return f'<img alt="{name}" src="data:image/{kind};base64,{data}">'


def render_clip(
    scene: str | Path,
    out: str | Path = "out",
    options: RenderOptions | None = None,
    **changes: Any,
) -> Clip:
    """Render a scene like `render_scene`, and return the clip. Raises InputError."""
    return Clip(render_scene(scene, out, options, **changes))
