"""Inputs for conditioned video models: coarse video, flow, masks, force maps, depth and a prompt."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from shutil import copyfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.export.events import ClipTimes, pace, story
from physgen.export.files import write_json, write_png
from physgen.export.flow import KittiEncoder
from physgen.export.labels import Clip, Moment, Scale
from physgen.export.maps import DepthViews
from physgen.export.video import Format, open_video
from physgen.geometry.polygon import rotation
from physgen.problems import InputError
from physgen.scene.scene import Load, Motion

# ----------------------------------------------------------------------
# World and camera -> maps of the pushes in each frame, for models that are told of forces.
#
# Pushes are those of the scene; and since a still photo shows no motion, what moves when the clip starts is
# told as the
# impulse that would set it moving so.

Array = NDArray[np.float64]
F32 = NDArray[np.float32]

WIDE = 36
"""Widths of the picture by standard deviations of a blob: that of Force Prompting, 20 px of 720."""
REACH = 6.0
"""Standard deviations beyond which a blob is nothing: 1.5e-8 of its middle."""
NEAREST, FARTHEST = 1 / 8, 1 / 2
"""Of the picture's width: how far the blob of no impulse would go, and how far that of the clip's strongest goes."""
ZERO, FULL = 32768, 32767
"""Codes of a map: nothing, and by how much more the clip's largest is."""
NOTHING = 1e-9
"""s: a push at a frame's moment is that frame's, though 3 x 0.1 is more than 0.3."""


@dataclass(frozen=True)
class ShownPush:
    """One push."""

    body: int
    what: str
    """`impulse`, `force`, `torque`, or `velocity`: the motion that the clip starts with, as an impulse."""
    vector: Array
    """(2,) g·px/s, of a force g·px/s²."""
    turn: float
    """g·px²/s, of a force or torque g·px²/s²: about the centre of mass, what the vector does by its arm not counted."""
    at: Array
    """(2,) px in the body's frame."""
    start: float
    """s of the motion."""
    end: float | None
    """s; None: it is given at once."""

    def parts(self, times: Array) -> Array:
        """(T,): where an impulse is given 1, of a force s that it acts, from each of `times` (T + 1,) to the next.

        Each moment of it counts once; before the first and after the last there is nothing.
        """
        if self.end is None:
            at = int(np.searchsorted(times, self.start + NOTHING, side="right")) - 1
            return np.asarray(np.arange(len(times) - 1) == at, np.float64)
        return np.diff(np.clip(times, self.start, self.end))

    def place(self, pose: Array) -> Array:
        """(2,) px of the photo where it acts on a body at a pose (3,)."""
        return np.asarray(pose[:2] + rotation(float(pose[2])) @ self.at)


def shown_pushes(world: World) -> list[ShownPush]:
    """In the order of the scene, the motion at t = 0 last."""
    found = []
    for push in world.pushes:
        if world.bodies[push.body].motion is Motion.DYNAMIC and push.start < world.duration:
            once = push.load is Load.IMPULSE
            end = None if once else min(push.end, world.duration)
            what = push.load.value
            found.append(ShownPush(push.body, what, push.vector, push.torque, push.at, push.start, end))
    for k, body in enumerate(world.bodies):
        if body.motion is Motion.DYNAMIC and (body.velocity.any() or body.spin) and isfinite(body.mass):
            found.append(_started(k, body))
    return found


def _started(k: int, body: Body) -> ShownPush:
    return ShownPush(
        k, "velocity", body.mass * body.velocity, body.moment * body.spin, np.zeros(2), 0.0, None
    )


class ForceMaps:
    """Of each frame: what the pushes give until the next one, drawn where they act."""

    def __init__(self, world: World, times: Array, size: tuple[int, int]) -> None:
        """`times` (T,) s of the motion at which frames can be; `size` of the picture, px."""
        self._shoves, self._size, self._times = shown_pushes(world), size, times
        step = float(times[1] - times[0]) if len(times) > 1 else world.duration
        edges = np.append(times, times[-1] + step)
        parts = [shove.parts(edges).tolist() for shove in self._shoves]
        given = [
            [(s.vector * part, s.turn * part) for s, part in zip(self._shoves, row, strict=True)]
            for row in zip(*parts, strict=True)
        ] or [[] for _ in times]
        self._given: list[list[tuple[Array, float]]] = given
        self.most = max((sum(float(np.hypot(*v)) for v, _ in row) for row in given), default=0.0)
        """g·px/s: of all pushes of a frame together, at most."""
        self.most_turn = max((sum(abs(turn) for _, turn in row) for row in given), default=0.0)
        """g·px²/s."""

    def idle(self, time: float) -> bool:
        """Whether nothing pushes in a frame at `time` (s)."""
        return not any(vector.any() or turn for vector, turn in self._at(time))

    def channels(self, time: float, poses: Array, lens: Array) -> NDArray[np.uint16]:
        """(H, W, 3): impulse to the right, impulse down, turn clockwise, of a frame at `time` (s); see ZERO and FULL.

        A push is a Gaussian blob, at its middle as high as what it gives; those of several add up.
        """
        width, height = self._size
        total = np.zeros((height, width, 3), np.float32)
        for shove, (vector, turn) in zip(self._shoves, self._at(time), strict=True):
            high = [*(vector / (self.most or 1.0)).tolist(), turn / (self.most_turn or 1.0)]
            if any(high):
                add_blob(total, lens @ [*shove.place(poses[shove.body]), 1.0], np.array(high, np.float32))
        return (np.rint(total * FULL) + ZERO).astype(np.uint16)

    def _at(self, time: float) -> list[tuple[Array, float]]:
        """What each push gives from the frame at a time (s) to the next sample: g·px/s and g·px²/s."""
        sample = int(np.searchsorted(self._times, time + NOTHING, side="right")) - 1
        return self._given[max(sample, 0)]


class Blobs:
    """The moving blob of Force Prompting (Gillman et al. 2025, the local force model), one for each push.

    It starts where the push acts, in the first frame that shows it, and goes straight on in its direction, equally far
    in each frame, to the last one: the farther, the stronger the push.
    """

    def __init__(
        self, world: World, frame: Callable[[float], int], count: int, size: tuple[int, int]
    ) -> None:
        """`frame` tells which of the clip's `count` frames shows what begins at a time (s of the motion)."""
        self._size, self._count = size, count
        pushed = [shove for shove in shown_pushes(world) if shove.vector.any()]
        strong = [float(np.hypot(*_whole(shove))) for shove in pushed]
        self._most = max(strong, default=0.0)
        self._pushed = [
            (shove, frame(shove.start), strength / self._most)
            for shove, strength in zip(pushed, strong, strict=True)
            if strength
        ]
        self._starts: dict[int, Array] = {}

    @property
    def most(self) -> float:
        """g·px/s: of the strongest push, whose blob goes half of the picture's width."""
        return self._most

    def picture(self, frame: int, poses: Array, lens: Array) -> NDArray[np.uint8]:
        """(H, W) of a frame; to be asked for one after the other, since a blob begins where things are then."""
        width, height = self._size
        total = np.zeros((height, width), np.float32)
        for n, (shove, first, share) in enumerate(self._pushed):
            if frame < first:
                continue
            if n not in self._starts:
                self._starts[n] = lens @ [*shove.place(poses[shove.body]), 1.0]
            way = shove.vector / np.hypot(*shove.vector)
            far = width * (NEAREST + (FARTHEST - NEAREST) * share)
            part = (frame - first) / max(self._count - 1 - first, 1)
            add_blob(total, self._starts[n] + way * far * part)
        return np.asarray(np.rint(np.minimum(total, 1) * 255), np.uint8)


def _whole(shove: ShownPush) -> Array:
    """(2,) g·px/s that it gives in all."""
    return shove.vector * (1.0 if shove.end is None else shove.end - shove.start)


def add_blob(picture: F32, at: Array, high: float | F32 = 1.0) -> None:
    """Adds a Gaussian to (H, W), or (H, W, C) with `high` (C,): at its middle, a place (2,) px, it is `high`."""
    height, width = picture.shape[:2]
    sigma = width / WIDE
    first = np.clip(np.floor(at - REACH * sigma), 0, (width, height)).astype(np.int64)
    last = np.clip(np.ceil(at + REACH * sigma) + 1, 0, (width, height)).astype(np.int64)
    across, down = (
        np.exp(-((np.arange(*span) - middle) ** 2) / (2 * sigma**2))
        for *span, middle in zip(first, last, at, strict=True)
    )
    blob = np.outer(down, across).astype(np.float32)
    box = picture[first[1] : last[1], first[0] : last[0]]
    box += blob * high if picture.ndim == 2 else blob[..., None] * high


def push_json(shove: ShownPush, world: World) -> dict[str, Any]:
    """As JSON."""
    about: dict[str, Any] = {"object": world.bodies[shove.body].name, "is": shove.what, "start": shove.start}
    if shove.end is not None:
        about["end"] = shove.end
    unit = "impulse" if shove.end is None else "force"
    if shove.vector.any():
        about[unit] = shove.vector.tolist()
    if shove.turn:
        about["turn" if shove.end is None else "torque"] = shove.turn
    return about | {"place": (world.bodies[shove.body].center + shove.at).tolist()}


# ----------------------------------------------------------------------
# Views -> what newer video models are conditioned on: coarse video, flow, masks, forces, depth and a prompt.
#
# `conditioning.json` names every file with its unit. Files are numbered by frames, as the clip plays.

DEEPEST = 65535


class Conditioning:
    """Frames of even sides, two at least."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        _check(clip)
        self._folder, self._clip = folder, clip
        self._maps = ForceMaps(clip.world, clip.trajectory.times, clip.size)
        self._blobs = Blobs(clip.world, ClipTimes(clip).frame, clip.count, clip.size)
        depth = None if clip.maps is None else clip.maps.depth
        self._depths = None if depth is None else clip.shared(DepthViews)
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
        write_png(folder / "masks" / f"{name}.png", ids)
        if moment.forward is not None:
            (folder / "flow" / f"{name}.png").write_bytes(
                self._clip.shared(KittiEncoder).every(moment.forward)
            )
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
        write_png(path, self._maps.channels(view.time, view.poses, view.lens))
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
        for shove in shown_pushes(clip.world):
            sample = min(int(np.searchsorted(times, shove.start - 1e-9)), len(times) - 1)
            x, y = shove.place(clip.trajectory.poses[sample, shove.body]).tolist()
            video = reel.seen((x, y), float(times[sample]))
            pushes.append(
                push_json(shove, clip.world) | {"frame": reel.frame(shove.start), "video_place": list(video)}
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
