"""Flashes in clips: pixels that jump although no object passed them.

    python benchmarks/flashes.py                 # a row for each bundled scene and each of the paper's scenes
    python benchmarks/flashes.py cups seesaw     # those scenes alone
    python benchmarks/flashes.py cups --pictures out/flashes   # and the frames with the most jumps, jumps in red

A pixel jumps if it changes by more than 18 grey levels between two frames. The first count is of jumps that no object
passed within 7 px, from one frame before to one frame after. Shadows of fast objects make such jumps, too: the second
count, of flashes, leaves out those in the shadow of an object that moved, unless they are brighter than the photo and
the background without shadows are nearby. Frame 1 is compared with frame 0 farther than 20 px from what moved, and
from its shadows.

The paper's scenes are read from the folder in PHYSGEN_PEER_SCENES.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen import pipeline
from physgen.cli.main import main as physgen
from physgen.maps import Percepts
from physgen.photometry import encode_u8
from physgen.render.camera import exposure_times
from physgen.render.mattes import matte_stage
from physgen.render.occlusion import sprite_silhouette
from physgen.render.shadow_decomposition import LitBackground
from physgen.render.stage import (
    Frame,
    SpritePose,
    Stage,
    sprite_coverage,
    sprite_poses,
)
from physgen.simulate.trajectory import Trajectory

ROOT = Path(__file__).resolve().parent.parent
PEER_SCENES = ("domino", "pig_ball", "pool")
JUMP = 18
"""Grey levels between two frames above which a pixel jumps."""
PASSED = 7
"""px around an object within which its passing explains a jump."""
CHANGE = 8
"""Grey levels by which frame 1 may differ from frame 0 far from what moved."""
FAR = 20
"""px from what moved that count as far."""
MOVED = 1.0
"""px between two frames from which an object's shadow may jump."""
SHADE = 0.03
"""-log of light: where a shadow is at least as deep, it may jump; half of the levels of a jump."""
LOOKS = 3
"""Samples of an exposure at which shadows are computed."""

Mask = NDArray[np.bool_]
Rgb = NDArray[np.uint8]


@dataclass(frozen=True)
class Flashes:
    """Counts of one clip."""

    jumps: int
    """Jumps of pixels that no object passed, in all frames."""
    flashes: int
    """Those that no shadow of a moving object explains."""
    worst: tuple[int, int]
    """The frame with the most flashes, and its number of them."""
    first: tuple[int, int]
    """px that changed in frame 1 far from what moved, and those of them far from its shadows."""
    pictures: tuple[Rgb, ...] = ()
    """The frame with the most flashes, those before and after it, and flashes in red."""


@dataclass(frozen=True)
class ClipFrames:
    """A clip as its video shows it, without noise."""

    stage: Stage
    maps: Percepts | None
    trajectory: Trajectory
    moments: Trajectory
    """Samples of the exposures."""
    parts: int
    """Samples in an exposure."""

    def frames(self) -> Iterator[Frame]:
        """Yield the frames."""
        return pipeline.render(self.stage, self.moments, self.parts)

    def mattes(self) -> Iterator[Frame]:
        """Yield the coverage of all objects in each exposure."""
        return pipeline.render(matte_stage(self.stage), self.moments, self.parts)


def open_clip(path: Path, overrides: Sequence[str] = ()) -> ClipFrames:
    """Load and simulate a scene."""
    stages = pipeline.Stages()
    scene = stages.load(path, list(overrides), None, False)
    maps = stages.maps(scene)
    compiled = stages.compile(scene, maps)
    trajectory = stages.simulate(compiled.world)
    stage = stages.stage(scene, compiled, maps)
    blur = scene.render.motion_blur
    times, parts = exposure_times(trajectory, compiled.world, blur)
    moments = trajectory.resample(times) if parts > 1 else trajectory
    return ClipFrames(stage, maps.percepts, trajectory, moments, parts)


def measure(clip: ClipFrames, has_pictures: bool = False) -> Flashes:
    """Count the flashes of a clip."""
    jumps, flashes, worst, first = 0, 0, (0, 0), (0, 0)
    pictures: tuple[Rgb, ...] = ()
    shade, ceiling = _Shade(clip), _ceiling(clip)
    opening: Frame | None = None
    # Two frames are compared, beside one before and one after.
    window: deque[tuple[Rgb, Mask]] = deque(maxlen=4)
    for number, (rgb, covered, frame) in enumerate(_frames_and_end(clip), -1):
        window.append((rgb, covered))
        if number == -1:
            opening = frame
            continue
        if number == 0:
            assert opening is not None
            shadows = shade.between(1)
            first = _far_changes(clip.trajectory, (opening, frame), shadows)
            continue
        before, after = window[-3][0], window[-2][0]
        passed = np.logical_or.reduce([mask for _, mask in window])
        is_jump = (_change(before, after) > JUMP) & ~_grown(passed, PASSED)
        if not is_jump.any():
            continue
        jumps += int(np.count_nonzero(is_jump))
        is_bright = (after.astype(np.int16) - ceiling).max(axis=2) > JUMP
        is_flash = is_jump & (is_bright | ~_grown(shade.between(number), PASSED))
        count = int(np.count_nonzero(is_flash))
        flashes += count
        if count > worst[1]:
            worst = number, count
            if has_pictures:
                marked = after.copy()
                marked[is_flash] = (255, 0, 0)
                pictures = (before, after, rgb, marked)
    return Flashes(jumps, flashes, worst, first, pictures)


def _frames_and_end(clip: ClipFrames) -> Iterator[tuple[Rgb, Mask, Frame]]:
    """Yield each frame with the pixels that objects cover, and the last one twice."""
    for frame, matte in zip(clip.frames(), clip.mattes(), strict=True):
        last = frame.rgb, matte.rgb[..., 0] > 0, frame
        yield last
    yield last


class _Shade:
    """Shadows of moving objects."""

    def __init__(self, clip: ClipFrames) -> None:
        self._clip = clip

    def between(self, number: int) -> Mask:
        """Return (H, W) the shadows, in frame `number` and the one before, of objects that moved between them."""
        clip = self._clip
        shade = np.zeros(clip.stage.background.shape[:2], np.bool_)
        lit = clip.stage.lit_background
        if lit is None:
            return shade
        end = (number + 1) * clip.parts - 1
        start = max(end - 2 * clip.parts + 1, 0)
        looks = sorted({*np.linspace(start, end, 2 * LOOKS).astype(int).tolist()})
        stands = [poses for _, poses in sprite_poses(clip.stage, clip.moments, looks)]
        for k, sprite in enumerate(clip.stage.sprites):
            reach = max(sprite.coverage.shape) / 2
            ways = np.array([poses[k].pose for poses in stands])
            way = np.ptp(ways, axis=0)
            if max(way[0], way[1], reach * way[2]) < MOVED:
                continue
            for poses in stands:
                _add_shade(shade, clip.stage, lit, poses[k])
        return shade


def _add_shade(
    shade: Mask, stage: Stage, lit: LitBackground, stand: SpritePose
) -> None:
    """Add the shadow of a sprite at a pose."""
    figure = None
    if stand.placement is not None:
        coverage = sprite_coverage(stage.sprites[stand.k], stand.placement)
        figure = sprite_silhouette(stage, stand, stand.placement, coverage)
    for box, shadow in lit.move_shadow(stand.k, figure, stand.start, stand.pose):
        x0, y0, x1, y1 = box
        shade[y0:y1, x0:x1] |= np.abs(shadow) > SHADE


def _ceiling(clip: ClipFrames) -> NDArray[np.int16]:
    """Return (H, W, 3) the brightest of photo and background without shadows nearby."""
    bright = clip.stage.background
    if clip.stage.lit_background is not None:
        bright = np.maximum(bright, encode_u8(clip.stage.lit_background.plate))
    if clip.maps is not None:
        bright = np.maximum(bright, clip.maps.rgb)
        if clip.maps.clean is not None:
            bright = np.maximum(bright, clip.maps.clean)
    side = 2 * PASSED + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(cv2.dilate(bright, kernel), np.int16)


def _far_changes(
    trajectory: Trajectory, frames: Sequence[Frame], shade: Mask
) -> tuple[int, int]:
    """Count px of frame 1 that differ from frame 0, far from all objects that moved.

    The second count leaves out those near their shadows, `shade` (H, W).
    """
    moved = (trajectory.poses[1] != trajectory.poses[0]).any(axis=1)
    near = np.zeros(frames[0].rgb.shape[:2], np.bool_)
    for frame in frames:
        for cover in frame.covers:
            if moved[cover.body]:
                near[cover.box] |= cover.mask
    change = _change(frames[0].rgb, frames[1].rgb) > CHANGE
    is_far = change & ~_grown(near, FAR)
    unexplained = is_far & ~_grown(shade, FAR)
    return int(np.count_nonzero(is_far)), int(np.count_nonzero(unexplained))


def _change(before: Rgb, after: Rgb) -> NDArray[np.uint8]:
    """Return (H, W) the largest change of a channel, grey levels."""
    return np.asarray(cv2.absdiff(before, after).max(axis=2), np.uint8)


def _grown(mask: Mask, reach: int) -> Mask:
    side = 2 * reach + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0, np.bool_)


def scene_paths(names: Sequence[str], folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield name and scene file of bundled scenes with a photo and of the paper's scenes, all unless named.

    The paper's scenes are imported into `folder`.
    """
    for path in sorted(ROOT.glob("scenes/*/scene.yaml")):
        name = path.parent.name
        if not names or name in names:
            yield name, path
    peers = os.environ.get("PHYSGEN_PEER_SCENES")
    for name in PEER_SCENES:
        if peers is None or (names and name not in names):
            continue
        path = folder / f"{name}.yaml"
        source = Path(peers) / name
        if (
            physgen(["import", "physgen", "--faithful", str(source), "-o", str(path)])
            == 0
        ):
            yield name, path


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    print(
        "| scene | jumps | flashes | most in a frame | changed in frame 1 | without shadows |"
    )
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, path in scene_paths(arguments.names, Path(folder)):
            found = measure(open_clip(path), arguments.pictures is not None)
            frame, count = found.worst
            most = f"{count} in {frame}" if count else "0"
            counts = f"{found.jumps} | {found.flashes} | {most} | {found.first[0]} | {found.first[1]}"
            print(f"| {name} | {counts} |", flush=True)
            for k, picture in enumerate(found.pictures):
                arguments.pictures.mkdir(parents=True, exist_ok=True)
                Image.fromarray(picture).save(arguments.pictures / f"{name}-{k}.png")


if __name__ == "__main__":
    main()
