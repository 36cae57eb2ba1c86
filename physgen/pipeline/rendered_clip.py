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

VIDEO_NAMES = ("video.mp4", "video.webp", "video.gif")
"""Videos of a clip, the best first."""


@dataclass(frozen=True)
class Clip:
    """A rendered clip; a notebook shows its video."""

    folder: Path

    @property
    def video(self) -> Path:
        """The video file. Raises FileNotFoundError if the clip has none."""
        for name in VIDEO_NAMES:
            if (self.folder / name).is_file():
                return self.folder / name
        raise FileNotFoundError(f"{self.folder} has no video")

    @property
    def report(self) -> Path | None:
        """The report's page, or None without one."""
        page = self.folder / "report.html"
        return page if page.is_file() else None

    @cached_property
    def frames(self) -> list[U8]:
        """(H, W, 3) sRGB of each frame, as the video file has them."""
        from physgen.videos import video_frames

        return [frame.rgb for frame in video_frames(self.video)]

    @cached_property
    def trajectory(self) -> Trajectory:
        """The motion: times (T,) s, poses (T, N, 3) px and rad, contacts."""
        return read_trajectory(self.folder / "trajectory.npz")

    def _repr_html_(self) -> str:
        """Return the video as a page shows it, in one piece."""
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
    """Render a scene as `render_scene`, with the same arguments, and return the clip. Raises InputError."""
    return Clip(render_scene(scene, out, options, **changes))
