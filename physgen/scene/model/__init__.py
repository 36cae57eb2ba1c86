"""A scene as a person writes it, after defaults and overlays: px, s, g, degrees; frozen.

Image axes: origin at the top-left pixel's centre, +x right, +y down, a positive angle turns +x towards +y.
Every field is explained once, in `schemas/scene-1.schema.json`. `things` are what a scene
holds, `film` is how it is shown.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any

from physgen.framing import video_size
from physgen.problems import Place
from physgen.scene.model.film import Overlay, Play, Refine, Render, Sight
from physgen.scene.model.things import (
    Auto,
    Boundary,
    Box,
    BoxPrompt,
    Circle,
    Field,
    FieldKind,
    Force,
    Joint,
    JointKind,
    Load,
    Mask,
    MaskId,
    MaskPolygon,
    MaskRle,
    Motion,
    Object,
    Point,
    PointPrompt,
    Points,
    Polygon,
    Ring,
    Shape,
    Solid,
    Waypoint,
)
from physgen.showing import html

__all__ = [
    "Auto",
    "Boundary",
    "Box",
    "BoxPrompt",
    "Circle",
    "Combine",
    "Field",
    "FieldKind",
    "Force",
    "Joint",
    "JointKind",
    "Light",
    "Load",
    "Mask",
    "MaskId",
    "MaskPolygon",
    "MaskRle",
    "Motion",
    "Object",
    "Overlay",
    "Play",
    "Point",
    "PointPrompt",
    "Points",
    "Polygon",
    "Refine",
    "Render",
    "Ring",
    "Scene",
    "Settings",
    "Shape",
    "Sight",
    "Solid",
    "View",
    "Waypoint",
]


class View(Enum):
    """`SIDE`: gravity points down the photo. `TOP`: seen from above, gravity presses on the table."""

    SIDE = "side"
    TOP = "top"


class Combine(Enum):
    """How the coefficients of two surfaces make the pair's."""

    GEOMETRIC = "geometric"
    MULTIPLY = "multiply"


@dataclass(frozen=True)
class Settings:
    """`world:`."""

    view: View
    pixels_per_meter: float
    gravity: Point
    """px/s²."""
    table_friction: float
    combine: Combine
    duration: float
    steps_per_second: float
    tilt: float
    """degrees by which the camera looks down on the floor, seen from the side."""
    backdrop: float | None
    """px from the objects back to an upright wall; None: none is near."""


@dataclass(frozen=True)
class Light:
    """`light:`: unit vector towards the light (+x right, +y down, +z to the viewer), and two strengths."""

    direction: tuple[float, float, float]
    intensity: float
    ambient: float
    softness: float
    """degrees: half its width as the objects see it."""
    provenance: str = ""
    """`from`: who found its direction and how sure; empty where nobody says."""


@dataclass(frozen=True)
class Scene:
    """One scene file, with its overlays applied and every default filled in."""

    name: str
    """The file's stem, or its folder's name where the file is called `scene.yaml`."""
    folder: Path
    """Where relative paths start."""
    image: Path | None
    """The photo, resolved; None for a scene without one."""
    size: tuple[int, int]
    """Width and height of the canvas, px: the photo's, or as given."""
    assets: Path | None
    """Folder of the maps, resolved; None when the scene names none."""
    world: Settings
    objects: tuple[Object, ...]
    """In the natural order of their names, as boundaries, joints and fields are; the document keeps the file's."""
    boundaries: tuple[Boundary, ...]
    forces: tuple[Force, ...]
    joints: tuple[Joint, ...]
    fields: tuple[Field, ...]
    light: Light | None
    render: Render
    refine: Refine
    maps: Mapping[str, tuple[float, float]]
    """What 0 and 65535 stand for in a 16-bit map: `{"depth": (lo, hi), "shading": (lo, hi)}`."""
    places: Mapping[str, Place] = field(
        default_factory=lambda: MappingProxyType({}), compare=False, repr=False
    )
    """Dotted path -> where it was written; the nearest written ancestor's place is used for a default."""
    document: Mapping[str, Any] = field(
        default_factory=lambda: MappingProxyType({}), compare=False, repr=False
    )
    """The resolved document as plain YAML data, defaults filled in: what `check --resolved` prints."""
    variants: tuple[str, ...] = ()
    """Names of the variants that the file offers."""
    files: tuple[Path, ...] = field(default=(), compare=False, repr=False)
    """It, and what it extends, as they were opened."""

    @property
    def video_size(self) -> tuple[int, int]:
        """Width and height of the video, px."""
        return video_size(self.size, self.render.scale, self.render.size)

    def _repr_html_(self) -> str:
        """For notebooks."""
        return html(self)

    def place(self, path: str) -> Place:
        """Where a value came from: its own place, or its nearest ancestor's."""
        while path:
            if path in self.places:
                return self.places[path]
            path = path[: max(path.rfind("."), path.rfind("["), 0)]
        return self.places.get("", Place(str(self.folder / self.name)))

    def file_of(self, place: Place) -> Path:
        """Where that stands which a place with a line names: places name files as the user knows them."""
        home = os.path.dirname(self.place("").file)
        return self.folder / os.path.relpath(place.file, home or os.curdir)
