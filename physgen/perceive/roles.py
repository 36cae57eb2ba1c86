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
"""px: an id of fewer pixels is a speck, no object."""


@dataclass(frozen=True)
class Doubt:
    """A region that may be an object."""

    polygon: Sequence[tuple[float, float]]
    confidence: float
    reason: str = ""
    """Why it is no object, for the scene's comments; `""`: the region is unsure."""


@dataclass(frozen=True)
class Name:
    """The label of an object."""

    label: str
    confidence: float
    likely: tuple[tuple[str, float], ...] = ()
    """Other labels that it may have, with their probabilities, the likeliest first."""
    source: str = ""
    """For `from`; `""`: the backend's name."""


@dataclass(frozen=True)
class Category:
    """A noun that a photo shows, singular."""

    noun: str
    movable: bool
    """Whether its instances are whole objects that could be moved; walls, floors, skies
    are not.
    """


@dataclass(frozen=True)
class Scenery:
    """What does not move: walls, tables, floors."""

    labels: Labels
    """(H, W), 0 = unnamed."""
    nouns: Mapping[int, str]
    """By id."""


@dataclass(frozen=True)
class Segments:
    """Objects found in a photo."""

    labels: Labels
    """(H, W), 0 = background, ids 1..N, left to right by centroid."""
    confidence: NDArray[np.float64]
    """(N,) that id k + 1 is a complete movable object."""
    doubtful: Sequence[Doubt] = ()
    """Regions that are more likely no objects; the surest first."""
    names: Mapping[int, Name] = field(default_factory=dict)
    """Labels that the segmenter gave, by id."""
    scenery: Scenery | None = None


@dataclass(frozen=True)
class PromptedMask:
    """The object that a box or a point means; an empty mask where there is none."""

    mask: Mask
    """(H, W)."""
    confidence: float
    """That it is an object with about this outline."""


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
    """Of the mass."""
    reason: str
    """Source of the mass, a sentence for the scene's comments."""
    surface: str = ""
    """Source of friction, elasticity and rolling, likewise."""
    size: float | None = None
    """m: the longest side of what is seen of it, where the backend judges that; it sets
    the scene's scale.
    """
    material: str = ""
    """As `materials.yaml` or the backend calls it."""


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
    """The objects' shadows, removed, and the light that casts them."""

    clean: Rgb | None
    """The background without them; None where none are seen."""
    owners: Labels | None
    """(H, W): the id of the object whose shadow lies there, 0 = none; None where none
    are seen.
    """
    light: DistantLight
    softness: float
    """degrees: half the width of the light."""
    tilt: float
    """degrees by which the camera looks down on the floor."""
    backdrop: float | None
    """px from the objects back to an upright wall that shadows fall on."""
    confidence: float
    faint: bool = False
    """Whether so little was removed that `clean` needs no refill behind objects."""


@dataclass(frozen=True)
class Wall:
    """A fixed line that objects rest on or bump into."""

    name: str
    points: tuple[tuple[float, float], ...]
    """(K, 2), K >= 2; the first point again at the end closes it."""
    friction: float
    elasticity: float
    confidence: float
    source: str
    """In one to three words, for `from`."""
    reason: str


@dataclass(frozen=True)
class BoundaryGuess:
    """The view, and the walls that hold the objects."""

    view: View
    confidence: float
    """Of the view."""
    reason: str
    walls: tuple[Wall, ...]
    outlines: Mapping[int, Outline] = field(default_factory=dict)
    """By id, of objects that stand better than their masks show: with level feet on
    what holds them.
    """
    held: frozenset[int] = frozenset()
    """Ids of objects that nothing seen keeps from falling."""
    grip: Mapping[int, float] = field(default_factory=dict)
    """By id, the least friction that objects must have, since they lie still on a
    slope.
    """
    tilt: float | None = None
    """Degrees by which the camera looks down on the ground, if it is seen at an angle.
    """


# The roles: what the backends of each are called with, and what they return.

Categories = Callable[[Rgb], Sequence[Category]]
"""Nouns of what a photo shows, before anything is found in it: each once, the most
striking first.
"""


class Segment(Protocol):
    """Finds the movable objects of a photo.

    Those that search for given nouns take `categories: Sequence[Category]`, too (`uses`
    in the table). Those that take prompts have `meant(rgb, boxes, points) ->
    Sequence[PromptedMask]`: the object of each box (left, top, width, height), then of
    each point (x, y); all lie on the photo.
    """

    def __call__(self, rgb: Rgb) -> Segments:
        """Segments the photo."""
        ...


Label = Callable[[Rgb, Labels, Sequence[PhotoObject]], Mapping[int, Name]]
"""A name for every object, by id."""
Physics = Callable[[Rgb, Sequence[PhotoObject], float | None], Mapping[int, Matter]]
"""Matter of every object, by id.

The number is the photo's true scale, px/m; None where it is unknown.
"""
Depth = Callable[[Rgb], F32]
"""(H, W), finite, larger = farther; in m where the backend knows, else up to scale and
shift.
"""
Normals = Callable[[Rgb, Labels, Sequence[PhotoObject], BoundaryGuess], F32]
"""(H, W, 3) unit.

The boundaries have confidence 0 where they are found by normals, later.
"""
Intrinsic = Callable[[Rgb, Labels, F32], Intrinsics]
"""Albedo and shading, from the photo, its labels and its normals."""
Light = Callable[[Rgb, Labels, Sequence[PhotoObject], F32, Intrinsics], LightGuess]
"""The light, from normals, albedo and shading.

Never fails: what cannot be seen is guessed with little confidence.
"""
Matte = Callable[[Rgb, Labels], F32]
"""(H, W) in 0..1: the share of each pixel that objects cover; 1 deep inside, 0 from 5
px outside on.
"""
Inpaint = Callable[[Rgb, Mask], Rgb]
"""The photo with the hole (H, W) filled; it equals the photo outside the hole."""
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
"""Removes shadows from a background that has the objects filled and their shadows still
there, by the objects' coverage, labels and matter.

Never fails.
"""


class Boundary(Protocol):
    """Decides the view and finds floors, shelves and walls.

    Some take `depth` (H, W), `normals` (H, W, 3) and `scenery: Scenery | None`, too
    (`uses` in the table).
    """

    def __call__(
        self,
        rgb: Rgb,
        labels: Labels,
        objects: Sequence[PhotoObject],
        view: View | None,
        /,
    ) -> BoundaryGuess:
        """`view` is the user's, None to find out.

        Walls touch the outlines and never enter them: the objects' own, or those that
        the guess has instead.
        """
        ...


@dataclass(frozen=True)
class Detections:
    """The objects that perception starts from, found or given."""

    labels: Labels
    source: str
    """The source of the masks, for `from`."""
    confidence: Mapping[int, float]
    """By id."""
    names: Mapping[int, Name]
    """Labels that are known already, by id."""
    prompts: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)
    """The user's prompts, by id, as in the scene: `{"box": [x, y, w, h]}` or `{"point":
    [x, y]}`.
    """
    doubtful: Sequence[Doubt] = ()
    object_names: Mapping[int, str] = field(default_factory=dict)
    """Names in an existing scene, by id."""
    mask_sources: Mapping[int, str] = field(default_factory=dict)
    """Sources of single masks, by id, as the scene's `from` has it; the others are from
    `source`.
    """
    layers: Mapping[int, int] = field(default_factory=dict)
    """Drawing layers that the user set, by id."""
    named_by: str = "given"
    """The source of `names`, for `from`."""
    gone: Labels | None = None
    """(H, W) > 0: what a user took out, which is filled, too."""


@dataclass(frozen=True)
class Suitability:
    """Whether a photo is one of which perception makes a scene that moves as it would."""

    reasons: tuple[str, ...] = ()
    """Doubts; none: it is good."""

    @property
    def verdict(self) -> str:
        """`good` or `doubtful`."""
        return "doubtful" if self.reasons else "good"

    def __str__(self) -> str:
        return self.verdict + (f": {'; '.join(self.reasons)}" if self.reasons else "")


@dataclass(frozen=True)
class Description:
    """What perception found, for people: nothing is computed from it."""

    overview: bytes
    """A PNG file."""
    summary: Sequence[str]
    """Lines: what was found in short, then one for each subject."""


@dataclass(frozen=True)
class PerceivedScene:
    """The result of perception."""

    percepts: Percepts
    document: dict[str, Any]
    """A scene as plain YAML data, valid once the assets are written; the writer of the
    assets adds `maps`.
    """
    comments: dict[str, str]
    """Dotted path -> a sentence or more to stand above it."""
    warnings: tuple[Problem, ...] = ()
    record: Sequence[Mapping[str, Any]] = ()
    """How each role ran, where model backends took part."""
    suitability: Suitability | None = None
    """None where the scene was not perceived."""
    view_from: str = ""
    """Reason and confidence of the view."""
    wrote: Mapping[str, dict[str, Any]] = field(default_factory=dict)
    """What perception wrote where a user has set something else since, by object; `""`
    for the scale.
    """
    wholes: Mapping[int, Outline] = field(default_factory=dict)
    """Outlines with their hidden parts, by id in the label map, of objects behind
    others.
    """
    full_size: tuple[int, int] | None = None
    """Width and height, px, of a photo that was made smaller; None if it was not."""
    description: Description | None = None
    """For people, and written among the assets."""
