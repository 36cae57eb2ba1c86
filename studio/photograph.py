"""A stage in, a folder of `scenes/` and one of `studio/truth/` out: photo, plates, masks, maps, scene file."""

import json
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
from darkroom import decode, denoise, develop, encode, png
from exposure import Maps, Picture, Studio, maps, picture, shading
from probe import Light, probe
from records import (
    Quality,
    facts,
    readable,
    write_albedo,
    write_geometry,
    write_shading,
)
from stage import Camera, Stage
from story import text

USUAL = Quality()
WIDE = Quality(photo=128, plate=0, shading=0, masks=64)


def photograph(
    stage: Stage,
    scenes: Path,
    truth: Path,
    quality: Quality = USUAL,
    scale: float = 1.0,
    tell: Callable[[str], None] = print,
) -> None:
    """Write `scenes/NAME/` (photo, scene file, assets) and `truth/NAME/`."""
    start = time.monotonic()
    camera = scaled(stage.camera, scale)
    studio = Studio(stage, camera)
    full, lookup = studio.scene()
    clean, _ = studio.scene(things=False)
    found = maps(studio, full, lookup, quality.masks)
    folder, proof = scenes / stage.name, truth / stage.name
    assets = folder / "photo.assets"
    for place in (assets, proof):
        place.mkdir(parents=True, exist_ok=True)
    photo, plates = shoot(studio, full, clean, found, quality)
    png(folder / "photo.png", photo)
    png(assets / "background.png", plates[0])
    png(assets / "clean.png", plates[1])
    png(assets / "masks.png", found.labels)
    png(assets / "coverage.png", np.round(found.coverage * 255).astype(np.uint8))
    tell(f"{stage.name}: photo and plates, {time.monotonic() - start:.0f} s so far")
    bright = denoise(shading(studio, full, quality.shading), None, found.normals)
    write_albedo(found, proof)
    told = write_geometry(found, proof) | write_shading(found, bright, proof)
    _say(
        stage,
        camera,
        quality,
        told | {"light": asdict(probe(studio, clean))},
        scenes,
        truth,
    )
    tell(
        f"{stage.name}: {len(stage.things)} objects, all in {time.monotonic() - start:.0f} s"
    )


def remeasure(
    stage: Stage,
    scenes: Path,
    truth: Path,
    quality: Quality = USUAL,
    scale: float = 1.0,
    shade: bool = True,
    tell: Callable[[str], None] = print,
) -> None:
    """Truth and scene file anew, beside the photo as it is; shading too, if asked."""
    start = time.monotonic()
    camera, proof = scaled(stage.camera, scale), truth / stage.name
    studio = Studio(stage, camera)
    full, lookup = studio.scene()
    clean, _ = studio.scene(things=False)
    found = maps(studio, full, lookup, quality.masks)
    told = json.loads((proof / "truth.json").read_text())
    told = {"depth": told["depth"], "shading": told["shading"]}
    write_albedo(found, proof)
    told |= write_geometry(found, proof)
    if shade:
        bright = denoise(shading(studio, full, quality.shading), None, found.normals)
        told |= write_shading(found, bright, proof)
    _say(
        stage,
        camera,
        quality,
        told | {"light": asdict(probe(studio, clean))},
        scenes,
        truth,
    )
    tell(f"{stage.name}: truth in {time.monotonic() - start:.0f} s")


def retell(
    stage: Stage, scenes: Path, truth: Path, tell: Callable[[str], None] = print
) -> None:
    """What is told in words anew, with the light and the maps that were measured when the photo was taken."""
    old = json.loads((truth / stage.name / "truth.json").read_text())
    told = {key: old[key] for key in ("depth", "shading", "light")}
    _say(stage, stage.camera, Quality(**old["rays"]), told, scenes, truth)
    tell(f"{stage.name}: scene file")


def _say(
    stage: Stage,
    camera: Camera,
    quality: Quality,
    told: dict,
    scenes: Path,
    truth: Path,
) -> None:
    """Write scene.yaml and truth.json."""
    (scenes / stage.name / "scene.yaml").write_text(
        text(replace(stage, camera=camera), Light(**told["light"]))
    )
    (truth / stage.name / "truth.json").write_text(
        readable(facts(stage, camera, quality) | told) + "\n"
    )


def widen(
    stage: Stage,
    truth: Path,
    quality: Quality = WIDE,
    scale: float = 1.0,
    tell: Callable[[str], None] = print,
) -> None:
    """A second photo of the same scene on a larger film, with its masks and shapes: `truth/NAME/wide/`."""
    if stage.wide is None:
        return
    start = time.monotonic()
    camera = scaled(stage.wide, scale)
    studio = Studio(stage, camera)
    full, lookup = studio.scene()
    folder = truth / stage.name / "wide"
    folder.mkdir(parents=True, exist_ok=True)
    seen = picture(studio, full, quality.photo)
    light = denoise(seen.light, seen.albedo, seen.normals)
    png(folder / "photo.png", develop(light, stage.exposure, stage.vignette))
    found = maps(studio, full, lookup, quality.masks)
    told = facts(stage, camera, quality) | write_geometry(found, folder)
    (folder / "truth.json").write_text(readable(told) + "\n")
    tell(
        f"{stage.name}: {camera.size[0]} x {camera.size[1]}, {time.monotonic() - start:.0f} s"
    )


def scaled(camera: Camera, scale: float) -> Camera:
    """The same view on a smaller film."""
    return replace(
        camera, size=(round(camera.size[0] * scale), round(camera.size[1] * scale))
    )


def shoot(
    studio: Studio, full: object, clean: object, found: Maps, quality: Quality
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """The photo; the background in the light that the objects leave it, and without them. (H, W, 3) uint8 sRGB each."""
    stage = studio.stage
    seen = picture(studio, full, quality.photo)
    empty = picture(studio, clean, quality.plate, seed=1)
    # the lens's softness and the denoiser carry a trace of every object a pixel beyond its coverage
    covered, near = (
        cv2.dilate(
            (found.coverage > 0).astype(np.uint8), np.ones((side, side), np.uint8)
        )
        > 0
        for side in (3, 11)
    )
    behind = picture(studio, full, quality.plate, seed=2, only=near, behind=clean)
    shadowed = Picture(
        *(
            np.where(near[..., None], getattr(behind, k), getattr(seen, k))
            for k in ("light", "albedo", "normals")
        )
    )

    def print_of(what: Picture) -> np.ndarray:
        return develop(
            denoise(what.light, what.albedo, what.normals),
            stage.exposure,
            stage.vignette,
        )

    photo, bare = print_of(seen), print_of(empty)
    background = np.where(
        covered[..., None], contact_filled(print_of(shadowed), bare, covered), photo
    )
    return photo, (background, bare)


def contact_filled(
    background: np.ndarray, clean: np.ndarray, covered: np.ndarray
) -> np.ndarray:
    """Where an object stands, no light gets between it and the table: such a patch takes the darkness around it.

    What is filled is the ratio of the two plates in linear light; a patch is what keeps less than a tenth of its light.
    """
    ratio = decode(background / 255.0).sum(-1) / np.maximum(
        decode(clean / 255.0).sum(-1), 1e-3
    )
    black = ((ratio < 0.1) & covered).astype(np.uint8)
    wide = cv2.dilate(black, np.ones((3, 3), np.uint8)) * covered
    if not black.any():
        return background
    steps = cv2.inpaint(
        np.clip(ratio * 200, 0, 255).astype(np.uint8),
        wide.astype(np.uint8),
        3,
        cv2.INPAINT_TELEA,
    )
    filled = encode(decode(clean / 255.0) * (steps / 200.0)[..., None])
    return np.where(
        wide[..., None] > 0,
        np.round(filled * 255).clip(0, 255).astype(np.uint8),
        background,
    )
