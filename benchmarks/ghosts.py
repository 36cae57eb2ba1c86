"""Ghosts: what the last frame of a clip shows where objects and their shadows were, against a ring beside it.

    python benchmarks/ghosts.py FOLDER             # all bundled scenes, the two perceived ones and the peers' scenes
    python benchmarks/ghosts.py FOLDER cups pool   # some, with the last frames and the pictures without objects

The index is the mean slope across the old outline, over that across lines RING px farther out and in. Slopes are of
sRGB levels, along the normal of the outline. Only places count that nothing covers in the last frame, no
object and no new shadow. A picture without any ghost has about 1: texture is as strong on the line as beside it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen import pipeline
from physgen.cli.main import main as physgen
from physgen.photometry import decode, luminance
from physgen.render.stage import Frame
from physgen.simulate.engine import simulate

ROOT = Path(__file__).resolve().parents[1]
PERCEIVED = ("billiards", "dominoes")
PUSHES = {
    "billiards": ["objects.billiard-ball-1.velocity=[4200,-356]"],
    "dominoes": [
        "world.pixels_per_meter=1000",
        "forces=[{object: block-1, impulse: [1200, 0], at: [160, 262]}]",
    ],
}
PEERS = ("pool", "domino", "pig_ball")
RING = 12
"""px from an outline to the lines that it is compared with."""
BAND = 1.5
"""px: half the width of an outline in which the greatest slope counts, for the outline may be off by as much."""
APART = 3
"""px from objects and new shadows within which nothing counts."""
ALONG = 4.0
"""px, standard deviation: slopes are averaged along a line before their amount is taken, so that texture cancels."""
FLOOR = 0.5
"""Levels a pixel added to both slopes: below, nobody sees an edge."""
DARK = 0.08
"""-log of light, smoothed, from which a shadow counts."""
FEWEST = 60
"""px of an outline that must be in sight."""


def scene_files(
    folder: Path, names: list[str] | None = None
) -> Iterator[tuple[str, Path, list[str]]]:
    """Name, scene file and overrides of each clip; scenes of photos and peers are made in `folder`."""
    for path in sorted((ROOT / "scenes").glob("*/scene.yaml")):
        if not names or path.parent.name in names:
            yield path.parent.name, path, []
    for name in PERCEIVED:
        if not names or f"{name}-perceived" in names:
            path = folder / f"{name}-perceived.yaml"
            assert (
                physgen(
                    [
                        "perceive",
                        str(ROOT / "scenes" / name / "photo.png"),
                        "-o",
                        str(path),
                    ]
                )
                == 0
            )
            yield path.stem, path, PUSHES[name]
    peers = os.environ.get("PHYSGEN_PEER_SCENES")
    for name in PEERS if peers else ():
        if not names or name in names:
            path = folder / f"{name}.yaml"
            assert (
                physgen(
                    [
                        "import",
                        "physgen",
                        "--faithful",
                        str(Path(peers, name)),
                        "-o",
                        str(path),
                    ]
                )
                == 0
            )
            yield name, path, []


def ghosts(folder: Path, names: list[str] | None = None) -> list[dict]:
    """One row a scene: indices of the outlines of objects and of their shadows, and of the true background."""
    rows = []
    for name, path, overrides in scene_files(folder, names):
        scene = pipeline.load(path, overrides)
        maps = pipeline.percepts(scene)
        assert maps is not None
        assert maps.background is not None
        compiled = pipeline.compile(scene, maps)
        drawn = pipeline.stage(scene, compiled, maps)
        track = simulate(compiled.world, np.array([0.0, compiled.world.duration]))
        away = replace(
            track, poses=track.poses + np.array([[[0.0, 0, 0]], [[1e5, 1e5, 0]]])
        )
        last, empty = (list(pipeline.render(drawn, one))[-1] for one in (track, away))
        open_ = _open(last, empty)
        gone = np.zeros(maps.labels.shape, bool)
        for k in range(len(scene.objects)):
            moved = np.hypot(*(track.poses[1, k, :2] - track.poses[0, k, :2])) > 2
            gone |= (compiled.labels == k + 1) & bool(moved)
        shadow = np.zeros_like(gone)
        if maps.clean is not None:
            dark = _log(maps.clean) - _log(maps.background)
            shadow = (cv2.GaussianBlur(dark, (0, 0), 2.0) > DARK) & (
                cv2.blur(gone * 1.0, (9, 9)) == 0
            )
        true = None
        truth = (
            ROOT
            / "scenes"
            / name.removesuffix("-perceived")
            / "photo.assets"
            / "clean.png"
        )
        if truth.exists():
            true = cv2.imread(str(truth))[..., ::-1]
        outlines = {"outline": gone, "shadow": shadow & ~(compiled.labels > 0)}
        row: dict = {"scene": name}
        for kind, mask in outlines.items():
            row[kind] = ghost_index(last.rgb, mask, open_)
            row[f"{kind}_true"] = (
                None if true is None else ghost_index(true, mask, open_)
            )
        rows.append(row)
        print(row, file=sys.stderr, flush=True)
        if names is not None:
            for word, frame in (("last", last), ("empty", empty)):
                cv2.imwrite(str(folder / f"{name}-{word}.png"), frame.rgb[..., ::-1])
    return rows


def ghost_index(
    rgb: NDArray[np.uint8], mask: NDArray[np.bool_], open_: NDArray[np.bool_]
) -> float | None:
    """Slope across the border of `mask` over that across lines beside it, where `open_`; None where little is seen."""
    if not mask.any():
        return None
    inside, outside = (
        cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, 5)
        for part in (mask, ~mask)
    )
    signed = cv2.GaussianBlur(np.where(mask, inside - 0.5, 0.5 - outside), (0, 0), 1.0)
    down, right = np.gradient(signed)
    picture = cv2.GaussianBlur(rgb.astype(np.float32).mean(axis=2), (0, 0), 0.7)
    dy, dx = np.gradient(picture)
    slope = ((dx * right + dy * down) / np.maximum(np.hypot(right, down), 0.3)).astype(
        np.float32
    )
    found = []
    for far in (0.0, float(RING)):
        line = ((np.abs(np.abs(signed) - far) <= BAND) & open_).astype(np.float32)
        if line.sum() < FEWEST * 2 * BAND:
            return None
        along = cv2.GaussianBlur(slope * line, (0, 0), ALONG) / np.maximum(
            cv2.GaussianBlur(line, (0, 0), ALONG), 1e-3
        )
        found.append(float(np.abs(along[line > 0]).mean()) + FLOOR)
    return round(found[0] / found[1], 2)


def _open(last: Frame, empty: Frame) -> NDArray[np.bool_]:
    """Where the last frame shows what is left when all objects have gone."""
    off = np.abs(last.rgb.astype(np.float32) - empty.rgb).max(axis=2)
    covered = (last.ids > 0) | (cv2.GaussianBlur(off, (0, 0), 1.0) > 2)
    return (
        cv2.dilate(covered.astype(np.uint8), np.ones((2 * APART + 1,) * 2, np.uint8))
        == 0
    )


def _log(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    return np.log(luminance(decode(rgb)) + 2e-3)


if __name__ == "__main__":
    home = Path(sys.argv[1])
    home.mkdir(parents=True, exist_ok=True)
    ghosts(home, sys.argv[2:])
