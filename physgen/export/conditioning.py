"""Inputs for conditioned video models: coarse video, flow, masks, force maps, depth and a prompt.

`conditioning.json` names every file with its unit. Files are numbered by frames, as the clip plays. A still photo shows
no motion, so an object that moves when the clip starts appears as the impulse that would give it its velocity.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from shutil import copyfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.export.events import ClipTimes, pace, story
from physgen.export.files import write_json, write_png
from physgen.export.flow import KittiEncoder
from physgen.export.labels import Clip, Moment, View, Writer
from physgen.export.maps import DepthViews
from physgen.export.video import Format, open_video
from physgen.geometry.polygon import rotation
from physgen.problems import InputError
from physgen.scene.scene import Load, Motion

Array = NDArray[np.float64]
F32 = NDArray[np.float32]


@dataclass(frozen=True)
class ForceCodes:
    """Blobs and codes of forces."""

    sigmas_per_width: int = 36
    """Standard deviations of a blob in the picture's width: Force Prompting has 20 px in 720."""
    blob_reach: float = 6.0
    """Standard deviations beyond which a blob is cut off, at 1.5e-8 of its peak."""
    nearest: float = 1 / 8
    farthest: float = 1 / 2
    """Of the picture's width: path of the blob of a vanishing impulse, and of the clip's strongest."""
    zero: int = 32768
    full: int = 32767
    """Codes of a force map: no push, and by how much the clip's largest is higher."""
    rounding: float = 1e-9
    """s: a push at a frame's moment belongs to that frame, though 3 x 0.1 is more than 0.3."""


CODES = ForceCodes()

UNITS = {
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
}


@dataclass(frozen=True)
class ShownPush:
    """One push of the scene, or a velocity at t = 0 as an impulse."""

    body: int
    kind: str
    """`impulse`, `force`, `torque` or `velocity`."""
    vector: Array
    """(2,) g·px/s, of a force g·px/s²."""
    turn: float
    """g·px²/s about the centre of mass, without the arm of the vector; of a force or torque g·px²/s²."""
    at: Array
    """(2,) px in the body's frame."""
    start: float
    """s of the motion."""
    end: float | None
    """s; None: an impulse."""

    def given(self, times: Array) -> Array:
        """(T,) between `times` (T + 1,): 1 where an impulse is given, of a force the s that it acts."""
        if self.end is None:
            at = int(np.searchsorted(times, self.start + CODES.rounding, side="right")) - 1
            return np.asarray(np.arange(len(times) - 1) == at, np.float64)
        return np.diff(np.clip(times, self.start, self.end))

    def place(self, pose: Array) -> Array:
        """(2,) px of the photo where it acts on a body at a pose (3,)."""
        return np.asarray(pose[:2] + rotation(float(pose[2])) @ self.at)

    def seen_at(self, view: View) -> Array:
        """(2,) px of the video."""
        return np.asarray(view.lens @ [*self.place(view.poses[self.body]), 1.0])

    def as_dict(self, world: World) -> dict[str, Any]:
        """For JSON."""
        body = world.bodies[self.body]
        about: dict[str, Any] = {"object": body.name, "is": self.kind, "start": self.start}
        if self.end is not None:
            about["end"] = self.end
        if self.vector.any():
            about["impulse" if self.end is None else "force"] = self.vector.tolist()
        if self.turn:
            about["turn" if self.end is None else "torque"] = self.turn
        return about | {"place": (body.center + self.at).tolist()}


def shown_pushes(world: World) -> list[ShownPush]:
    """In the order of the scene, velocities at t = 0 last."""
    found = []
    for push in world.pushes:
        if world.bodies[push.body].motion is Motion.DYNAMIC and push.start < world.duration:
            end = None if push.load is Load.IMPULSE else min(push.end, world.duration)
            kind = push.load.value
            found.append(ShownPush(push.body, kind, push.vector, push.torque, push.at, push.start, end))
    for k, body in enumerate(world.bodies):
        if body.motion is Motion.DYNAMIC and (body.velocity.any() or body.spin) and isfinite(body.mass):
            vector, turn = body.mass * body.velocity, body.moment * body.spin
            found.append(ShownPush(k, "velocity", vector, turn, np.zeros(2), 0.0, None))
    return found


class ForceMaps:
    """Of each frame, the impulse that the pushes give until the next sample, drawn where they act."""

    def __init__(self, pushes: list[ShownPush], times: Array, duration: float) -> None:
        """`times` (T,) s of the motion at which frames can be."""
        self._pushes, self._times = pushes, times
        step = float(times[1] - times[0]) if len(times) > 1 else duration
        edges = np.append(times, times[-1] + step)
        self._given = np.array([push.given(edges) for push in pushes]).reshape(len(pushes), len(times))
        vectors = np.array([np.hypot(*push.vector) for push in pushes]).reshape(-1, 1)
        turns = np.array([abs(push.turn) for push in pushes]).reshape(-1, 1)
        self.most = float((vectors * self._given).sum(axis=0).max(initial=0.0))
        """g·px/s: of all pushes of a frame together, at most."""
        self.most_turn = float((turns * self._given).sum(axis=0).max(initial=0.0))
        """g·px²/s."""

    def _sample(self, time: float) -> int:
        return max(int(np.searchsorted(self._times, time + CODES.rounding, side="right")) - 1, 0)

    def idle(self, time: float) -> bool:
        """Whether no push acts in a frame at `time` (s)."""
        return not self._given[:, self._sample(time)].any()

    def picture(self, view: View) -> NDArray[np.uint16]:
        """(H, W, 3): impulse to the right, impulse down, turn clockwise; see `CODES.zero` and `CODES.full`.

        A push is a Gaussian blob whose peak is its impulse; the blobs of several add up.
        """
        width, height = view.size
        total = np.zeros((height, width, 3), np.float32)
        for push, given in zip(self._pushes, self._given[:, self._sample(view.time)].tolist(), strict=True):
            peak = [*(push.vector * given / (self.most or 1.0)), push.turn * given / (self.most_turn or 1.0)]
            if any(peak):
                add_blob(total, push.seen_at(view), np.array(peak, np.float32))
        return (np.rint(total * CODES.full) + CODES.zero).astype(np.uint16)


class Blobs:
    """The moving blob of Force Prompting (Gillman et al. 2025, the local force model), one for each push.

    It starts where the push acts, in the first frame that shows it, and moves evenly in the push's direction until the
    last frame; the stronger the push, the longer the path.
    """

    def __init__(self, pushes: list[ShownPush], times: ClipTimes, count: int) -> None:
        """`count` frames of the clip."""
        strengths = [
            float(np.hypot(*push.vector)) * (1.0 if push.end is None else push.end - push.start)
            for push in pushes
        ]
        self.most, self._count = max(strengths, default=0.0), count
        """g·px/s: of the strongest push, whose blob crosses half of the picture's width."""
        self._pushed = [
            (push, times.frame(push.start), strength / self.most)
            for push, strength in zip(pushes, strengths, strict=True)
            if strength
        ]
        self._starts: dict[int, Array] = {}

    def picture(self, view: View) -> NDArray[np.uint8]:
        """(H, W) of a frame; frames must come in order, since a blob begins where its object is then."""
        width, height = view.size
        total = np.zeros((height, width), np.float32)
        for n, (push, first, share) in enumerate(self._pushed):
            if view.index < first:
                continue
            start = self._starts.setdefault(n, push.seen_at(view))
            path = (
                width
                * (CODES.nearest + (CODES.farthest - CODES.nearest) * share)
                * push.vector
                / np.hypot(*push.vector)
            )
            add_blob(total, start + path * (view.index - first) / max(self._count - 1 - first, 1))
        return np.asarray(np.rint(np.minimum(total, 1) * 255), np.uint8)


def add_blob(picture: F32, at: Array, peak: float | F32 = 1.0) -> None:
    """Adds a Gaussian with its centre at a place (2,) px to (H, W), or to (H, W, C) with `peak` (C,)."""
    height, width = picture.shape[:2]
    sigma = width / CODES.sigmas_per_width
    first = np.clip(np.floor(at - CODES.blob_reach * sigma), 0, (width, height)).astype(np.int64)
    last = np.clip(np.ceil(at + CODES.blob_reach * sigma) + 1, 0, (width, height)).astype(np.int64)
    across, down = (
        np.exp(-((np.arange(*span) - center) ** 2) / (2 * sigma**2))
        for *span, center in zip(first, last, at, strict=True)
    )
    blob = np.outer(down, across).astype(np.float32)
    box = picture[first[1] : last[1], first[0] : last[0]]
    box += blob * peak if picture.ndim == 2 else blob[..., None] * peak


class Conditioning(Writer):
    """All inputs of a clip with frames of even sides, two at least."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        _check(clip)
        self._folder, self._clip = folder, clip
        self._pushes = shown_pushes(clip.world)
        self._maps = ForceMaps(self._pushes, clip.trajectory.times, clip.world.duration)
        self._blobs = Blobs(self._pushes, ClipTimes(clip), clip.count)
        self._depths = None if clip.maps is None or clip.maps.depth is None else clip.shared(DepthViews)
        for name in ("masks", "flow", "force", *(["depth"] if self._depths else [])):
            (folder / name).mkdir()
        self._idle: Path | None = None
        self._open = ExitStack()
        self._video, self._force = (
            self._open.enter_context(open_video(folder, Format.MP4, clip.size, clip.fps, name))
            for name in ("video", "force")
        )

    def add(self, moment: Moment) -> None:
        """One picture of each kind, and the flow to the next frame."""
        view, folder = moment.view, self._folder
        name = f"{view.index:05d}.png"
        self._video(view.rgb)
        if view.index == 0:
            (folder / "first.png").write_bytes(view.png)
        ids = view.ids if len(self._clip.names) > 255 else view.ids.astype(np.uint8)
        write_png(folder / "masks" / name, ids)
        if moment.forward is not None:
            (folder / "flow" / name).write_bytes(self._clip.shared(KittiEncoder).png(moment.forward))
        idle = self._maps.idle(view.time)
        if idle and self._idle is not None:  # all maps without a push are the same file
            copyfile(self._idle, folder / "force" / name)
        else:
            write_png(folder / "force" / name, self._maps.picture(view))
            self._idle = folder / "force" / name if idle else self._idle
        self._force(np.repeat(self._blobs.picture(view)[..., None], 3, axis=2))
        if self._depths is not None:
            (folder / "depth" / name).write_bytes(self._depths.png(view))

    def close(self) -> None:
        """Finish the videos and write the prompt and the JSON."""
        self._open.close()
        clip, times = self._clip, ClipTimes(self._clip)
        caption = clip.shared(story).caption
        (self._folder / "prompt.txt").write_text(caption + "\n", encoding="utf-8")
        samples = clip.trajectory.times
        pushes = []
        for push in self._pushes:
            sample = min(int(np.searchsorted(samples, push.start - 1e-9)), len(samples) - 1)
            x, y = push.place(clip.trajectory.poses[sample, push.body]).tolist()
            place = times.seen((x, y), float(samples[sample]))
            pushes.append(
                push.as_dict(clip.world) | {"frame": times.frame(push.start), "video_place": list(place)}
            )
        about = {
            "version": 1,
            "clip": clip.name,
            "prompt": caption,
            "frames": clip.count,
            "size": list(clip.size),
            "fps": clip.fps,
            "seconds": clip.count / clip.fps,
            "slower": pace(clip),
            "scale": clip.scale.as_dict(),
            "files": self._files(),
            "objects": [
                {"id": k + 1, "name": name, "label": label}
                for k, (name, label) in enumerate(zip(clip.names, clip.labels, strict=True))
            ],
            "pushes": pushes,
            "lenses": [clip.shot.affine(float(samples[sample])).tolist() for sample in clip.shot.order],
            "units": UNITS,
        }
        write_json(self._folder / "conditioning.json", about)

    def _files(self) -> dict[str, Any]:
        count, width = self._clip.count, self._clip.size[0]

        def row(path: str, about: str, **more: float) -> dict[str, Any]:
            return {"path": path, **({"count": count} if "%" in path else {}), "is": about, **more}

        files = {
            "video": row("video.mp4", "the coarse video, H.264 4:2:0, BT.709"),
            "first": row("first.png", "its first frame, 8-bit sRGB"),
            "prompt": row("prompt.txt", "the events of the clip in sentences, UTF-8"),
            "masks": row(
                "masks/%05d.png", "ids of objects, 0 background; 8 bits, 16 with more than 255 objects"
            ),
            "flow": row(
                "flow/%05d.png",
                "from frame k to k + 1, px of the video, in KITTI's encoding: R = 64 u + 32768, G = 64 v + 32768, "
                "B = 1 for valid pixels; 16 bits",
            )
            | {"count": count - 1},
            "force": row(
                "force/%05d.png",
                "R, G: impulse to the right and down that pushes give from this frame's moment to the next "
                "sample's; B: turn, clockwise; 16 bits",
                zero=CODES.zero,
                code=CODES.full,
                impulse_at_code=self._maps.most,
                turn_at_code=self._maps.most_turn,
                sigma=width / CODES.sigmas_per_width,
            ),
            "blobs": row(
                "force.mp4",
                "a blob for each push, as in Force Prompting: from where it acts straight on in its direction, "
                "from the frame it begins in to the last; the stronger, the farther",
                sigma=width / CODES.sigmas_per_width,
                nearest=CODES.nearest * width,
                farthest=CODES.farthest * width,
                impulse_at_farthest=self._blobs.most,
            ),
        }
        if self._depths is not None:
            low, high = self._depths.range
            about = "depth in the photo's unit, larger is farther; 16 bits"
            files["depth"] = row("depth/%05d.png", about, at_0=low, at_65535=high)
        return files


def _check(clip: Clip) -> None:
    """Raises InputError where there is no motion, or no video can be encoded."""
    width, height = clip.size
    if clip.count < 2:
        fix = "write --frames 2 or more"
        raise InputError.of("--format conditioning", f"{clip.count} frame", "has no motion", fix)
    if width % 2 or height % 2:
        even = f"{width + width % 2}x{height + height % 2}"
        found, expected = f"{width} x {height} px", "has an odd side, which H.264 with 4:2:0 cannot hold"
        raise InputError.of("--format conditioning", found, expected, f"write --size {even}")
