"""Views -> what newer video models are conditioned on: coarse video, flow, masks, forces, depth and a prompt.

`conditioning.json` names every file with its unit. Files are numbered by frames, as the clip plays.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from shutil import copyfile
from typing import Any

import numpy as np

from physgen.export.depth import Depths
from physgen.export.events import ClipTimes, pace, story
from physgen.export.kitti import Ways
from physgen.export.motion import Moment
from physgen.export.pictures import save
from physgen.export.plain import write_json
from physgen.export.scale import Scale
from physgen.export.shoves import FARTHEST, FULL, NEAREST, WIDE, ZERO, Blobs, ForceMaps, shoves, told
from physgen.export.truth import Clip
from physgen.problems import InputError
from physgen.report.video import Format, open_video

DEEPEST = 65535


class Conditioning:
    """Frames of even sides, two at least."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        _check(clip)
        self._folder, self._clip = folder, clip
        self._maps = ForceMaps(clip.world, clip.trajectory.times, clip.size)
        self._blobs = Blobs(clip.world, ClipTimes(clip).frame, clip.count, clip.size)
        depth = None if clip.maps is None else clip.maps.depth
        self._depths = None if depth is None else clip.shared(Depths)
        for name in ("masks", "flow", "force", *(["depth"] if self._depths else [])):
            (folder / name).mkdir()
        self._idle: Path | None = None
        self._open = ExitStack()
        self._video, self._force = (
            self._open.enter_context(open_video(folder, Format.MP4, clip.size, clip.fps, name))
            for name in ("video", "force")
        )

    def add(self, moment: Moment) -> None:
        """One picture of each kind, and a flow to the next."""
        view, folder = moment.view, self._folder
        name = f"{view.index:05d}"
        self._video(view.rgb)
        if view.index == 0:
            (folder / "first.png").write_bytes(view.png)
        ids = view.ids if len(self._clip.names) > 255 else view.ids.astype(np.uint8)
        save(folder / "masks" / f"{name}.png", ids)
        if moment.forward is not None:
            (folder / "flow" / f"{name}.png").write_bytes(self._clip.shared(Ways).every(moment.forward))
        self._push(moment, folder / "force" / f"{name}.png")
        blobs = self._blobs.picture(view.index, view.poses, view.lens)
        self._force(np.repeat(blobs[..., None], 3, axis=2))
        if self._depths is not None:
            (folder / "depth" / f"{name}.png").write_bytes(self._depths.png(view))

    def _push(self, moment: Moment, path: Path) -> None:
        """Where nothing pushes, all maps are the same file."""
        view = moment.view
        idle = self._maps.idle(view.time)
        if idle and self._idle is not None:
            copyfile(self._idle, path)
            return
        save(path, self._maps.channels(view.time, view.poses, view.lens))
        self._idle = path if idle else self._idle

    def close(self) -> None:
        """The films are whole, and told of."""
        self._open.close()
        (self._folder / "prompt.txt").write_text(self._clip.shared(story).caption + "\n", encoding="utf-8")
        write_json(self._folder / "conditioning.json", self._about())

    def _about(self) -> dict[str, Any]:
        clip, reel = self._clip, ClipTimes(self._clip)
        times = clip.trajectory.times
        pushes = []
        for shove in shoves(clip.world):
            sample = min(int(np.searchsorted(times, shove.start - 1e-9)), len(times) - 1)
            x, y = shove.place(clip.trajectory.poses[sample, shove.body]).tolist()
            video = reel.seen((x, y), float(times[sample]))
            pushes.append(
                told(shove, clip.world) | {"frame": reel.frame(shove.start), "video_place": list(video)}
            )
        return {
            "version": 1,
            "clip": clip.name,
            "prompt": clip.shared(story).caption,
            "frames": clip.count,
            "size": list(clip.size),
            "fps": clip.fps,
            "seconds": clip.count / clip.fps,
            "slower": pace(clip),
            "scale": Scale.of(clip.scene).as_dict(),
            "files": self._files(),
            "objects": [
                {"id": k + 1, "name": name, "label": label}
                for k, (name, label) in enumerate(zip(clip.names, clip.labels, strict=True))
            ],
            "pushes": pushes,
            "lenses": [clip.shot.affine(float(times[sample])).tolist() for sample in clip.shot.order],
            "units": {
                "seconds": "of the clip as it plays",
                "slower": "s of the clip by s of the motion",
                "start, end": "s of the motion",
                "place": "px of the photo, where it acts at t = 0; it rides on the object",
                "video_place": "px of the video, in `frame`, where the push begins",
                "impulse": "g·px/s",
                "force": "g·px/s²",
                "turn": "g·px²/s, positive turns +x towards +y",
                "torque": "g·px²/s²",
                "lenses": "of each frame: px of the photo (x, y, 1) -> px of the video",
            },
        }

    def _files(self) -> dict[str, Any]:
        count = self._clip.count
        files: dict[str, Any] = {
            "video": {"path": "video.mp4", "is": "the coarse video, H.264 4:2:0, BT.709"},
            "first": {"path": "first.png", "is": "its first frame, 8-bit sRGB"},
            "prompt": {"path": "prompt.txt", "is": "what happens, UTF-8"},
            "masks": {
                "path": "masks/%05d.png",
                "count": count,
                "is": "ids of objects, 0 background; 8 bits, 16 with more than 255 objects",
            },
            "flow": {
                "path": "flow/%05d.png",
                "count": count - 1,
                "is": "from frame k to k + 1, px of the video, as KITTI has it: R = 64 u + 32768, G = 64 v + 32768, "
                "B = 1 where it counts; 16 bits",
            },
            "force": {
                "path": "force/%05d.png",
                "count": count,
                "is": "R, G: impulse to the right and down that pushes give from this frame's moment to the next "
                "sample's; B: turn, clockwise; 16 bits",
                "zero": ZERO,
                "code": FULL,
                "impulse_at_code": self._maps.most,
                "turn_at_code": self._maps.most_turn,
                "sigma": self._clip.size[0] / WIDE,
            },
            "blobs": {
                "path": "force.mp4",
                "is": "a blob for each push, as in Force Prompting: from where it acts straight on in its direction, "
                "from the frame it begins in to the last; the stronger, the farther",
                "sigma": self._clip.size[0] / WIDE,
                "nearest": NEAREST * self._clip.size[0],
                "farthest": FARTHEST * self._clip.size[0],
                "impulse_at_farthest": self._blobs.most,
            },
        }
        if self._depths is not None:
            low, high = self._depths.range
            files["depth"] = {
                "path": "depth/%05d.png",
                "count": count,
                "is": "depth in the photo's unit, larger is farther; 16 bits",
                "at_0": low,
                "at_65535": high,
            }
        return files


def _check(clip: Clip) -> None:
    """Raises InputError where there is nothing to condition on, or no film of it."""
    width, height = clip.size
    if clip.count < 2:
        fix = "write --frames 2 or more"
        raise InputError.of("--format conditioning", f"{clip.count} frame", "has no motion", fix)
    if width % 2 or height % 2:
        even = f"{width + width % 2}x{height + height % 2}"
        found, expected = f"{width} x {height} px", "has an odd side, which H.264 with 4:2:0 cannot hold"
        raise InputError.of("--format conditioning", found, expected, f"write --size {even}")
