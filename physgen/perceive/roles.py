"""Inputs and outputs of every role of perception: protocols and frozen results.

Arrays follow the photo: `rgb` (H, W, 3) uint8 sRGB, `labels` (H, W) uint16 with 0 =
background, depth (H, W) larger = farther, normals (H, W, 3) unit with +x right, +y
down, +z to the viewer. Confidences are 0..1. Lengths are px.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Outline
from physgen.geometry.scale import PhotoObject as PhotoObject
from physgen.maps import F32, Percepts
from physgen.photometry import DistantLight
from physgen.problems import Problem
from physgen.scene.scene import Solid, View

Rgb = NDArray[np.uint8]
"""(H, W, 3) sRGB."""
Labels = NDArray[np.uint16]
"""(H, W), 0 = background."""
Mask = NDArray[np.bool_]

SMALLEST_OBJECT = 12
"""px: an id with fewer pixels is noise rather than an object."""


@dataclass(frozen=True)
class Doubt:
    """A region that may be an object."""

    polygon: Sequence[tuple[float, float]]
    confidence: float
    reason: str = ""
    """The reason against an object, for the scene's comments; `""` if the region is
    uncertain.
    """


@dataclass(frozen=True)
class Name:
    """The label of an object."""

    label: str
    confidence: float
    alternatives: tuple[tuple[str, float], ...] = ()
    """Alternative labels with their probabilities, the likeliest first."""
    source: str = ""
    """Source for `from`; `""` stands for the backend's name."""


@dataclass(frozen=True)
class Category:
    """A noun, in the singular, for objects or surfaces of a photo."""

    noun: str
    movable: bool
    """Whether its instances are whole objects that could be moved, unlike walls, floors
    and skies.
    """


@dataclass(frozen=True)
class Scenery:
    """The immovable parts of a photo: walls, tables, floors."""

    labels: Labels
    """(H, W), 0 = unnamed."""
    nouns: Mapping[int, str]
    """Nouns by id."""


@dataclass(frozen=True)
class Segments:
    """The objects of a photo."""

    labels: Labels
    """(H, W), 0 = background, ids 1..N, left to right by centroid."""
    confidence: NDArray[np.float64]
    """(N,): probability that id k + 1 is a complete movable object."""
    doubtful: Sequence[Doubt] = ()
    """Regions with an improbable object, the most confident first."""
    names: Mapping[int, Name] = field(default_factory=dict)
    """Labels from the segmenter, by id."""
    scenery: Scenery | None = None


@dataclass(frozen=True)
class PromptedMask:
    """The object selected by a box or a point; the mask is empty if there is none."""

    mask: Mask
    """(H, W)."""
    confidence: float
    """Probability of an object with about this outline."""


@dataclass(frozen=True)
class Matter:
    """Physical properties of an object."""

    mass: float
    """g."""
    friction: float
    elasticity: float
    rolling: float
    """Rolling resistance: moment = rolling x normal force x radius."""
    solid: Solid
    confidence: float
    """Confidence of the mass."""
    reason: str
    """Source of the mass: a sentence for the scene's comments."""
    surface: str = ""
    """Source of friction, elasticity and rolling: a sentence likewise."""
    size: float | None = None
    """m: longest visible side, if the backend estimates it; it sets the scene's
    scale.
    """
    material: str = ""
    """The material's name in `materials.yaml`, or the backend's name for it."""


@dataclass(frozen=True)
class LightGuess:
    """The light of a photo."""

    light: DistantLight
    confidence: float


@dataclass(frozen=True)
class Intrinsics:
    """Albedo and shading of a photo: light = albedo x shading."""

    albedo: F32
    """(H, W, 3) in 0..1, linear."""
    shading: F32
    """(H, W) >= 0, linear."""


@dataclass(frozen=True)
class Shadows:
    """The background without the objects' shadows, and the light that casts them."""

    clean_background: Rgb | None
    """The background without shadows; None if no shadow is visible."""
    owners: Labels | None
    """(H, W): id of the object that casts the shadow, 0 = none; None if no shadow is
    visible.
    """
    light: DistantLight
    softness: float
    """degrees: angular radius of the light."""
    tilt: float
    """degrees: tilt of the camera to the floor."""
    backdrop: float | None
    """px: distance from the objects back to an upright wall with shadows."""
    confidence: float
    is_faint_shadow: bool = False
    """Whether the removed shadow is so faint that `clean_background` needs no refill behind
    objects.
    """


@dataclass(frozen=True)
class Wall:
    """A fixed line on which objects rest or with which they collide."""

    name: str
    points: tuple[tuple[float, float], ...]
    """(K, 2), K >= 2; a repeated first point at the end closes the line."""
    friction: float
    elasticity: float
    confidence: float
    source: str
    """One to three words for `from`."""
    reason: str


@dataclass(frozen=True)
class BoundaryGuess:
    """The view, and the walls that support objects."""

    view: View
    confidence: float
    """Confidence of the view."""
    reason: str
    walls: tuple[Wall, ...]
    outlines: Mapping[int, Outline] = field(default_factory=dict)
    """Corrected outlines, by id, of objects with level feet on their supports."""
    held_ids: frozenset[int] = frozenset()
    """Ids of objects without a visible support."""
    grip: Mapping[int, float] = field(default_factory=dict)
    """Least friction, by id, of objects at rest on a slope."""
    tilt: float | None = None
    """Tilt of the camera to the ground in degrees, if the photo is oblique."""


# The roles: arguments and results of the backends.

Categories = Callable[[Rgb], Sequence[Category]]
"""Nouns of a photo before segmentation: each once, the most conspicuous first."""


class Segment(Protocol):
    """Find the movable objects of a photo.

    Segmenters for given nouns also take `categories: Sequence[Category]` (`uses` in the
    table). Segmenters with prompts have `segment_meant_objects(rgb, boxes, points) ->
    Sequence[PromptedMask]`: the object of each box (left, top, width, height), then of
    each point (x, y); all lie inside the photo.
    """

    def __call__(self, rgb: Rgb) -> Segments:
        """Return the segments of the photo."""
        ...


Label = Callable[[Rgb, Labels, Sequence[PhotoObject]], Mapping[int, Name]]
"""Return a label for every object, by id."""
Physics = Callable[[Rgb, Sequence[PhotoObject], float | None], Mapping[int, Matter]]
"""Return the matter of every object, by id.

The number is the photo's true scale in px/m, or None if it is unknown.
"""
Depth = Callable[[Rgb], F32]
"""Return the depth (H, W), finite, larger = farther; in m if known, else up to scale
and shift.
"""
Normals = Callable[[Rgb, Labels, Sequence[PhotoObject], BoundaryGuess], F32]
"""Return unit normals (H, W, 3).

The boundaries have confidence 0 if a later step finds them by these normals.
"""
Intrinsic = Callable[[Rgb, Labels, F32], Intrinsics]
"""Return albedo and shading from the photo, its labels and its normals."""
Light = Callable[[Rgb, Labels, Sequence[PhotoObject], F32, Intrinsics], LightGuess]
"""Return the light from normals, albedo and shading.

Backends never fail: without evidence they guess with low confidence.
"""
Matte = Callable[[Rgb, Labels], F32]
"""Return the share of each pixel (H, W), 0..1, that objects cover: 1 deep inside, 0
from 5 px outside.
"""
Inpaint = Callable[[Rgb, Mask], Rgb]
"""Return the photo with a filled hole (H, W); other pixels are unchanged."""
Shadow = Callable[
    [
        Rgb,
        F32,
        Labels,
        Sequence[PhotoObject],
        Mapping[int, Matter],
        BoundaryGuess,
        LightGuess,
    ],
    Shadows,
]
"""Remove shadows from a background with filled objects.

The shadows are found by the objects' coverage, labels and matter. Backends never fail.
"""


class Boundary(Protocol):
    """Decide on the view and find floors, shelves and walls.

    Some backends also take `depth` (H, W), `normals` (H, W, 3) and `scenery: Scenery |
    None` (`uses` in the table).
    """

    def __call__(
        self,
        rgb: Rgb,
        labels: Labels,
        objects: Sequence[PhotoObject],
        view: View | None,
        /,
    ) -> BoundaryGuess:
        """Return the view and the walls; `view` is the user's choice, or None to
        estimate it.

        Walls touch the outlines without entering them: the objects' outlines, or the
        corrected ones of the guess.
        """
        ...


@dataclass(frozen=True)
class Detections:
    """The objects with which perception starts, detected or given."""

    labels: Labels
    source: str
    """Source of the masks, for `from`."""
    confidence: Mapping[int, float]
    """By id."""
    names: Mapping[int, Name]
    """Known labels by id."""
    prompts: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)
    """The user's prompts by id, as in the scene: `{"box": [x, y, w, h]}` or `{"point":
    [x, y]}`.
    """
    doubtful: Sequence[Doubt] = ()
    object_names: Mapping[int, str] = field(default_factory=dict)
    """Names of an existing scene, by id."""
    mask_sources: Mapping[int, str] = field(default_factory=dict)
    """Sources of single masks, by id, as in the scene's `from`; the other masks come
    from `source`.
    """
    layers: Mapping[int, int] = field(default_factory=dict)
    """Drawing layers set by the user, by id."""
    name_source: str = "given"
    """Source of `names`, for `from`."""
    removed_pixels: Labels | None = None
    """(H, W) > 0: regions removed by the user and filled as well."""


@dataclass(frozen=True)
class Suitability:
    """Whether perception can turn a photo into a scene that moves realistically."""

    reasons: tuple[str, ...] = ()
    """Doubts; a photo without doubts is good."""

    @property
    def verdict(self) -> str:
        """Return `good` or `doubtful`."""
        if self.reasons:
            return "doubtful"
        return "good"

    def __str__(self) -> str:
        return self.verdict + (f": {'; '.join(self.reasons)}" if self.reasons else "")


@dataclass(frozen=True)
class Description:
    """The results of perception for people; later steps do not use it."""

    overview: bytes
    """A PNG file."""
    summary: Sequence[str]
    """Lines: a short list of the results, then one line per subject."""


@dataclass(frozen=True)
class PerceivedScene:
    """The result of perception."""

    percepts: Percepts
    document: dict[str, Any]
    """A scene as plain YAML data, valid once the assets are written; the writer of the
    assets adds `maps`.
    """
    comments: dict[str, str]
    """Comments by dotted path: one or more sentences above the entry."""
    warnings: tuple[Problem, ...] = ()
    record: Sequence[Mapping[str, Any]] = ()
    """One entry per role with a model backend: how the backend ran."""
    suitability: Suitability | None = None
    """None if the scene was not perceived."""
    view_from: str = ""
    """Reason for the view, and its confidence."""
    wrote: Mapping[str, dict[str, Any]] = field(default_factory=dict)
    """Values of perception that a user has changed since, by object; `""` for the
    scale.
    """
    wholes: Mapping[int, Outline] = field(default_factory=dict)
    """Outlines with their hidden parts, by id in the label map, of objects behind
    others.
    """
    full_size: tuple[int, int] | None = None
    """Width and height, px, of a photo before its reduction; None otherwise."""
    description: Description | None = None
    """A description for people, stored with the assets."""
