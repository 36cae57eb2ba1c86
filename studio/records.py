"""Truth as files: exact maps as compact pictures; truth.json says how to read them and what is physically true."""

import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from darkroom import encode, png, webp
from exposure import F32, Maps
from stage import Camera, Stage, Thing

STEPS = 65534  # of depth.png, from the nearest to the farthest


@dataclass(frozen=True)
class Quality:
    """Rays a pixel."""

    photo: int = 256
    plate: int = 128
    shading: int = 128
    masks: int = 128

    def times(self, factor: float) -> "Quality":
        """More or fewer of all."""
        return Quality(
            *(max(4, round(v * factor)) if v else 0 for v in asdict(self).values())
        )


def write_geometry(found: Maps, folder: Path) -> dict:
    """instances.png, depth.png, normals.webp; returns how to read depth."""
    parts = [found.labels, np.round(found.first * 255), found.second]
    png(folder / "instances.png", np.stack([v.astype(np.uint8) for v in parts], -1))
    near, far = float(found.depth.min()), float(found.depth.max())
    steps = np.round((found.depth - near) / max(far - near, 1e-9) * STEPS)
    png(folder / "depth.png", steps.astype(np.uint16))
    webp(
        folder / "normals.webp",
        np.round(128 + 127 * found.normals).clip(0, 255).astype(np.uint8),
    )
    return {"depth": {"unit": "m behind the plane of motion", "near": near, "far": far}}


def write_albedo(found: Maps, folder: Path) -> None:
    """albedo.webp."""
    webp(
        folder / "albedo.webp",
        np.round(encode(found.albedo.clip(0, 1)) * 255).astype(np.uint8),
        95,
    )


def write_shading(found: Maps, bright: F32, folder: Path) -> dict:
    """shading.webp; returns how to read it. Nothing on a thing is cut off at the top."""
    things = bright[found.labels > 0]
    top = max(float(np.percentile(bright, 99.9)), float(np.percentile(things, 99.95)))
    webp(
        folder / "shading.webp",
        np.round(encode((bright / top).clip(0, 1)) * 255).astype(np.uint8),
        95,
    )
    return {"shading": {"scale": top, "encoding": "sRGB curve of shading / scale"}}


def facts(stage: Stage, camera: Camera, quality: Quality) -> dict:
    """What is true of the whole picture and of each thing; px and SI as the keys say."""
    return {
        "scene": f"scenes/{stage.name}/scene.yaml",
        "size": list(camera.size),
        "view": camera.view,
        "pixels_per_meter": camera.ppm,
        "camera": {
            "kind": "shift lens: film parallel to the plane of motion, where pixels are metres x pixels_per_meter",
            "distance": camera.distance,
            "rise": list(camera.rise),
            "aperture_radius": camera.aperture,
            "unit": "m",
        },
        "exposure": stage.exposure,
        "vignette": stage.vignette,
        "diffuse": stage.diffuse,
        "combine": stage.world.get("combine", "geometric"),
        "table": stage.world.get("table"),
        "rays": asdict(quality),
        "objects": [
            _thing(k, thing, camera) for k, thing in enumerate(stage.things, 1)
        ],
        "boundaries": {
            name: {
                "points": np.round(camera.pixel(line.points), 2).tolist(),
                "friction": line.friction,
                "elasticity": line.elasticity,
            }
            for name, line in stage.boundaries.items()
        },
    }


def _thing(number: int, thing: Thing, camera: Camera) -> dict:
    told = {
        "id": number,
        "name": thing.name,
        "label": thing.label,
        **thing.shape(camera),
        "mass_g": thing.mass,
    }
    told |= {"friction": thing.friction, "elasticity": thing.elasticity}
    return told | {"solid": thing.solid, "rolling": thing.rolling}


def readable(truth: dict) -> str:
    """JSON with one object a line."""
    rows = ",\n".join("    " + json.dumps(entry) for entry in truth["objects"])
    head = json.dumps({k: v for k, v in truth.items() if k != "objects"}, indent=2)
    head = re.sub(
        r"\[\s+([^{}]*?)\s+\](?=,?\n)",
        lambda m: "[" + re.sub(r"\s+", " ", m.group(1)) + "]",
        head,
    )
    return head[:-2] + ',\n  "objects": [\n' + rows + "\n  ]\n}"
