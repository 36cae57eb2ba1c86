"""What perception says of photos with known truth, beside that truth: rest, supports, view, light, surfaces, shadows.

Given true masks, and with those it finds by itself. Studio photos have exact truth; peers' photos floors and views.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import yaml

from physgen import pipeline, registry
from physgen.compile.compile import compile_scene
from physgen.maps import read_labels
from physgen.perceive.perceive import perceive
from physgen.perceive.photo_objects import fit_objects
from physgen.perceive.roles import PerceivedScene
from physgen.perceive.scene_files import write_scene
from physgen.perceive.segment.prompts import from_masks
from physgen.photometry import decode, luminance
from physgen.photos import read_image

ROOT = Path(__file__).resolve().parents[1]
PEERS = {"pool": "top", "domino": "side", "pig_ball": "side", "boxes": "side"}
STILL = 2.0
"""s without any force."""
DARK = 0.1
"""Of the logarithm of light: what lies deeper in shadow is a shadow."""
STANDS = 4.0
"""px from a true boundary, within which a thing stands on it."""
COARSE, FINE = 6.0, 2.0
"""px: standard deviations of the blurs that part a background's colour from its texture."""


@dataclass(frozen=True)
class Photo:
    """A photo and what is true of it; None where nobody knows."""

    name: str
    half: str
    rgb: np.ndarray
    labels: np.ndarray
    view: str
    floors: list[np.ndarray] | None
    """(K, 2) px each."""
    truth: dict | None
    folder: Path | None


def photos(names: list[str] | None = None) -> Iterator[Photo]:
    split = json.loads((ROOT / "studio/split.json").read_text())
    for half in ("tune", "test"):
        for name in split[half]:
            if names and name not in names:
                continue
            folder = ROOT / "studio/truth" / name
            told = json.loads((folder / "truth.json").read_text())
            assets = ROOT / "scenes" / name
            floors = [np.array(b["points"], float) for b in told["boundaries"].values()]
            rgb, labels = (
                read_image(assets / "photo.png"),
                read_labels(assets / "photo.assets/masks.png"),
            )
            yield Photo(name, half, rgb, labels, told["view"], floors, told, folder)
    if peers := os.environ.get("PHYSGEN_PEER_SCENES"):
        for name, view in PEERS.items():
            if names and name not in names:
                continue
            folder = Path(peers, name)
            floors = None
            if (folder / "sim.yaml").exists() and view == "side":
                sim = yaml.safe_load((folder / "sim.yaml").read_text())
                floors = [np.array(edge, float) for edge in sim["edge_list"]]
            rgb, labels = (
                read_image(folder / "original.png"),
                read_labels(folder / "mask.png"),
            )
            yield Photo(name, "peers", rgb, labels, view, floors, None, None)


def percepts(
    folder: Path, names: list[str] | None = None, given_alone: bool = False
) -> list[dict]:
    rows = []
    for photo in photos(names):
        given = perceive(photo.rgb, from_masks(photo.labels), renames=labels_of(photo))
        found = given if given_alone else perceive(photo.rgb)
        row = {
            "photo": photo.name, "half": photo.half, "still": moved(photo, given), "still_found": moved(photo, found),
            "view": given.document["world"]["view"] == photo.view,
            "view_found": found.document["world"]["view"] == photo.view,
            **supports(photo, given),
        }  # fmt: skip
        if photo.truth is not None:
            row |= {"light": light(photo, given), "light_found": light(photo, found)}
            row |= (
                surfaces(photo, given)
                | shadows(photo, given)
                | background(photo, given)
                | masses(photo, given)
            )
        rows.append(row)
        print(json.dumps(row), file=sys.stderr, flush=True)
    return rows


def labels_of(photo: Photo) -> list[str]:
    return (
        []
        if photo.truth is None
        else [f"{one['id']}={one['label']}" for one in photo.truth["objects"]]
    )


def moved(photo: Photo, perceived: PerceivedScene) -> float:
    """px by which anything moves, at most, while nothing is pushed."""
    if not perceived.document["objects"]:
        return 0.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        write_scene(perceived, None, "photo", path)
        scene = pipeline.load(path, ["forces=[]", f"world.duration={STILL}"])
        track = pipeline.simulate(compile_scene(scene, perceived.percepts.labels).world)
    off = track.poses[:, :, :2] - track.poses[:1, :, :2]
    return round(float(np.hypot(off[..., 0], off[..., 1]).max()), 3)


def supports(photo: Photo, perceived: PerceivedScene) -> dict:
    """How many objects stand on a true floor, and under how many of them a floor was found within 3 px."""
    if not photo.floors or photo.view != "side":
        return {"standing": 0, "supported": 0}
    walls = [
        np.array(said.get("segment") or said["polyline"])
        for name, said in perceived.document["boundaries"].items()
        if name != "bottom"
    ]
    standing = supported = 0
    for i in np.unique(photo.labels[photo.labels > 0]).tolist():
        rows, columns = np.nonzero(photo.labels == i)
        if rows.max() + 1 >= photo.labels.shape[0]:
            continue
        foot = columns[rows >= rows.max() - 1]
        x, bottom = float(np.median(foot)), float(rows.max()) + 0.5
        true = [
            y for floor in photo.floors if (y := _below(floor, x, bottom)) is not None
        ]
        if not true:
            continue
        standing += 1
        supported += any(
            (y := _below(wall, x, bottom)) is not None and abs(y - min(true)) <= 3
            for wall in walls
        )
    return {"standing": standing, "supported": supported}


def _below(chain: np.ndarray, x: float, bottom: float) -> float | None:
    """y of a chain of points at x, where that is within `STANDS` of `bottom`."""
    heights = [
        y0 + (y1 - y0) * (x - x0) / (x1 - x0)
        for (x0, y0), (x1, y1) in pairwise(chain)
        if min(x0, x1) <= x <= max(x0, x1) and abs(x1 - x0) > 1
    ]
    near = [y for y in heights if abs(y - bottom) <= STANDS]
    return min(near, key=lambda y: abs(y - bottom)) if near else None


def light(photo: Photo, perceived: PerceivedScene) -> float | None:
    """degrees between the light told and the true one."""
    if "light" not in perceived.document:
        return None
    told, true = (
        np.array(perceived.document["light"]["direction"]),
        np.array(photo.truth["light"]["direction"]),
    )
    return round(
        float(
            np.degrees(np.arccos(np.clip(told @ true / np.linalg.norm(told), -1, 1)))
        ),
        1,
    )


def read_map(path: Path) -> np.ndarray:
    return cv2.imread(str(path), cv2.IMREAD_COLOR)[..., ::-1]


def surfaces(photo: Photo, perceived: PerceivedScene) -> dict:
    """Normals: mean degrees over objects and over balls. Albedo and shading: errors, and those of grey albedo."""
    true = (read_map(photo.folder / "normals.webp").astype(np.float32) - 128) / 127
    true /= np.maximum(np.linalg.norm(true, axis=2, keepdims=True), 1e-6)
    said = perceived.percepts.normals
    off = np.degrees(np.arccos(np.clip((said * true).sum(-1), -1, 1)))
    inner = (
        cv2.erode((photo.labels > 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    )
    every, balls = [], []
    for one in photo.truth["objects"]:
        own = inner & (photo.labels == one["id"])
        if not own.any():
            continue
        every.append(float(off[own].mean()))
        if one.get("solid") == "sphere":
            balls.append(every[-1])
    scale = photo.truth["shading"]["scale"]
    albedo = decode(read_map(photo.folder / "albedo.webp"))
    shading = luminance(decode(read_map(photo.folder / "shading.webp"))) * scale
    known = (luminance(albedo) > 0.01) & (shading > 0.005)
    photo_light = decode(photo.rgb)
    both = {
        "albedo": error(perceived.percepts.albedo[known], albedo[known]),
        "albedo_grey": error(np.ones_like(albedo[known]), albedo[known]),
        "shading": error(perceived.percepts.shading[known], shading[known]),
        "shading_grey": error(luminance(photo_light)[known], shading[known]),
    }
    return {
        "normals": round(float(np.mean(every)), 1), "balls": round(float(np.mean(balls)), 1) if balls else None,
        "normals_flat": round(float(np.degrees(np.arccos(np.clip(true[inner][:, 2], -1, 1))).mean()), 1), **both,
    }  # fmt: skip


def error(said: np.ndarray, true: np.ndarray) -> float:
    """Root mean square after the best common factor, over that of the truth: 0 is perfect, 1 no better than black."""
    said, true = said.astype(np.float64).ravel(), true.astype(np.float64).ravel()
    factor = (said @ true) / max(said @ said, 1e-12)
    return round(float(np.linalg.norm(factor * said - true) / np.linalg.norm(true)), 3)


def shadows(photo: Photo, perceived: PerceivedScene) -> dict:
    """Intersection over union of shadows on what is not an object."""
    assets = ROOT / "scenes" / photo.name / "photo.assets"
    dark = logs(read_image(assets / "clean.png")) - logs(
        read_image(assets / "background.png")
    )
    open_ = (
        cv2.dilate((photo.labels > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
    )
    true = open_ & (cv2.GaussianBlur(dark, (0, 0), 1.0) > DARK)
    maps = perceived.percepts
    said = np.zeros_like(true)
    if maps.shadows is not None:
        said = open_ & (maps.shadows > 0)
    elif maps.clean is not None:
        said = open_ & (logs(maps.clean) - logs(maps.background) > DARK)
    return {
        "shadow": round(float((true & said).sum() / max((true | said).sum(), 1)), 3),
        "in_shadow": int(true.sum()),
    }


def logs(rgb: np.ndarray) -> np.ndarray:
    return np.log(luminance(decode(rgb)) + 2e-3)


def background(photo: Photo, perceived: PerceivedScene) -> dict:
    """Behind removed things: low-pass PSNR in dB; texture there, said and true, against that around it."""
    assets, maps = ROOT / "scenes" / photo.name / "photo.assets", perceived.percepts
    hole = photo.labels > 0

    def psnr(true: np.ndarray, said: np.ndarray) -> float:
        low = [
            cv2.GaussianBlur(picture.astype(np.float32), (0, 0), COARSE)
            for picture in (true, said)
        ]
        return round(
            10
            * np.log10(
                255**2 / max(float(((low[0] - low[1])[hole] ** 2).mean()), 1e-6)
            ),
            1,
        )

    true, said = read_image(assets / "background.png"), maps.background
    clean = maps.background if maps.clean is None else maps.clean
    bare = read_image(assets / "clean.png")
    filled = registry.make("inpaint")(bare, hole)
    decibels = {
        "psnr": psnr(true, said),
        "psnr_clean": psnr(bare, clean),
        "psnr_fill": psnr(bare, filled),
    }
    true, said = true.astype(np.float32), said.astype(np.float32)
    fine = [
        ((p - cv2.GaussianBlur(p, (0, 0), FINE)) ** 2).mean(-1) for p in (true, said)
    ]
    wide = cv2.dilate(hole.astype(np.uint8), np.ones((31, 31), np.uint8)) > 0
    near = cv2.dilate(hole.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    around = wide & ~near
    inside = cv2.erode(hole.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    spread = [
        float(np.sqrt(np.median(part)))
        for part in (fine[1][inside], fine[1][around], fine[0][inside])
    ]
    return {
        **decibels,
        "texture": round(spread[0] / max(spread[1], 1e-6), 2),
        "texture_true": round(spread[2] / max(spread[1], 1e-6), 2),
    }


def masses(photo: Photo, perceived: PerceivedScene) -> dict:
    """How many objects weigh within a factor of 2 of the truth, told their labels; and told the scale, too."""
    true = {one["id"]: one["mass_g"] for one in photo.truth["objects"]}
    said = {one["mask"]: one["mass"] for one in perceived.document["objects"].values()}
    labels = {one["id"]: one["label"] for one in photo.truth["objects"]}
    things = [
        replace(t, label=labels[t.id])
        for t in fit_objects(photo.rgb, from_masks(photo.labels))[0]
    ]
    scaled = registry.make("physics")(
        photo.rgb, things, photo.truth["pixels_per_meter"]
    )
    at_scale = {i: one.mass for i, one in scaled.items()}

    def right(masses: dict) -> int:
        return sum(0.5 <= masses[i] / true[i] <= 2 for i in masses if true.get(i))

    return {
        "weighed": sum(bool(true.get(i)) for i in said),
        "mass": right(said),
        "mass_scaled": right(at_scale),
    }


if __name__ == "__main__":
    percepts(
        Path(),
        [name for name in sys.argv[1:] if name != "--given"],
        "--given" in sys.argv,
    )
