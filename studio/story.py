"""A stage as the scene file that a person would enjoy editing."""

import numpy as np
from probe import Light
from stage import Stage, tidy

from physgen.scene.write import scene_text

SCHEMA = "../../schemas/scene-1.schema.json"


def document(stage: Stage, light: Light) -> tuple[dict, dict[str, str]]:
    """Plain data of the scene file, and the comments by dotted path."""
    camera = stage.camera
    comments = {}
    objects = {}
    for k, thing in enumerate(stage.things, 1):
        item: dict = {"label": thing.label, "mask": k, "shape": thing.shape(camera)}
        optional = {
            "solid": thing.solid,
            "mass": thing.mass,
            "friction": thing.friction,
        }
        optional |= {"elasticity": thing.elasticity, "rolling": thing.rolling}
        if thing.velocity is not None:
            optional["velocity"] = camera.shift(thing.velocity)
        item |= {
            key: value
            for key, value in (optional | {"spin": thing.spin}).items()
            if value is not None
        }
        objects[thing.name] = item | thing.extra
        if thing.note:
            comments[f"objects.{thing.name}.label"] = thing.note
    boundaries = {}
    for name, line in stage.boundaries.items():
        points = [tidy(p) for p in camera.pixel(line.points)]
        kind = "segment" if len(points) == 2 else "polyline"
        boundaries[name] = {
            kind: points,
            "friction": line.friction,
            "elasticity": line.elasticity,
        }
        if line.static_friction is not None:
            boundaries[name]["static_friction"] = line.static_friction
        if line.note:
            comments[f"boundaries.{name}"] = line.note
    found = {
        "physgen": 1,
        "title": stage.title,
        "image": "photo.png",
        "assets": "photo.assets",
        "world": {
            "view": camera.view,
            "pixels_per_meter": tidy([camera.ppm], 3)[0],
            "duration": stage.duration,
            **seen(stage),
            **stage.world,
        },
        "objects": objects,
        "boundaries": boundaries,
        "light": {
            "direction": [round(v, 3) for v in light.direction],
            "intensity": round(light.intensity, 3),
            "ambient": round(light.ambient, 3),
            "softness": stage.softness,
        },
    }
    sections = stage.sections(camera)
    comments |= sections.pop("comments", {})
    sections["render"] = sections.get("render", {}) | {"motion_blur": 0.5}
    return found | sections, comments


def seen(stage: Stage) -> dict:
    """What shadows depend on: how far the lens looks down on the floor, the lowest boundary; and the wall behind."""
    camera = stage.camera
    if camera.view == "top":
        return {}
    lowest = min(
        point[1] for line in stage.boundaries.values() for point in line.points
    )
    down = np.degrees(
        np.arctan((camera.centre[1] + camera.rise[1] - lowest) / camera.distance)
    )
    wall = (
        {}
        if stage.backdrop is None
        else {"backdrop": round(stage.backdrop * camera.ppm)}
    )
    return {"tilt": round(float(down), 1), **wall}


def text(stage: Stage, light: Light) -> str:
    """The scene file."""
    head = f"{stage.story.strip()}\nThe photo is our own: studio/sets/{stage.name.replace('-', '_')}.py."
    return scene_text(*document(stage, light), header=head, schema=SCHEMA)
