"""Inputs and outputs of every role of perception: protocols and frozen results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Outline
from physgen.maps import Percepts
from physgen.photometry import DistantLight
from physgen.problems import Problem
from physgen.scene.scene import Solid, View

# ----------------------------------------------------------------------
# What each role of perception takes and gives: protocols and frozen results.

Rgb = NDArray[np.uint8]
"""(H, W, 3) uint8 sRGB."""
Labels = NDArray[np.uint16]
"""(H, W), 0 = background."""


@dataclass(frozen=True)
class Doubt:
    """Something that may be an object."""

    polygon: Sequence[tuple[float, float]]
    """Its outline, px."""
    confidence: float
    """0..1."""


@dataclass(frozen=True)
class Name:
    """What an object is called."""

    label: str
    confidence: float
    """0..1."""


@dataclass(frozen=True)
class Category:
    """A kind of thing, or of stuff, that a photo shows."""

    noun: str
    """Singular."""
    movable: bool
    """Whether its instances are whole things that could be moved; walls, floors, skies are not."""


class Categories(Protocol):
    """Names what a photo shows, before anything is found in it."""

    def __call__(self, rgb: Rgb) -> Sequence[Category]:
        """Each noun once; the most striking first."""
        ...


@dataclass(frozen=True)
class Scenery:
    """What does not move: walls, tables, floors."""

    labels: Labels
    """(H, W), 0 = nothing that was named."""
    nouns: Mapping[int, str]
    """By id."""


@dataclass(frozen=True)
class Segments:
    """Objects found in a photo."""

    labels: NDArray[np.uint16]
    """(H, W), 0 = background, ids 1..N, left to right by centroid."""
    confidence: NDArray[np.float64]
    """(N,) in 0..1, that id k + 1 is a complete movable object."""
    doubtful: Sequence[Doubt] = ()
    """What is more likely none; the surest first."""
    names: Mapping[int, Name] = field(default_factory=dict)
    """What finding them told them to be, by id."""
    scenery: Scenery | None = None
    """What stands still, where finding told that too."""


@dataclass(frozen=True)
class PromptedMask:
    """What a box or a point is taken to mean."""

    mask: NDArray[np.bool_]
    """(H, W)."""
    confidence: float
    """0..1, that it is an object with about this outline."""


class Segment(Protocol):
    """Finds the movable objects of a photo.

    Those that find what they are told to take `categories: Sequence[Category]`, too (`uses` in the table).
    """

    def __call__(self, rgb: NDArray[np.uint8]) -> Segments:
        """`rgb` is (H, W, 3) uint8 sRGB."""
        ...


@runtime_checkable
class Prompted(Segment, Protocol):
    """A segmenter that takes boxes and points, too."""

    def meant(
        self,
        rgb: Rgb,
        boxes: Sequence[tuple[float, float, float, float]],
        points: Sequence[tuple[float, float]],
    ) -> Sequence[PromptedMask]:
        """What each box (left, top, width, height px), then each point (x, y px) means; all lie on the photo.

        An empty mask says that it does not know.
        """
        ...


@dataclass(frozen=True)
class PhotoObject:
    """One object as far as it is known: its id in the label map, its outline, and what it is called."""

    id: int
    outline: Outline
    """px."""
    label: str = ""
    """`""` while nobody has named it."""
    cut: bool = False
    """Whether the photo's border cuts it off."""


class Label(Protocol):
    """Names objects."""

    def __call__(self, rgb: Rgb, labels: Labels, things: Sequence[PhotoObject]) -> Mapping[int, Name]:
        """A name for every thing, by id."""
        ...


@dataclass(frozen=True)
class Matter:
    """What an object is made of, as physics needs it."""

    mass: float
    """g."""
    friction: float
    elasticity: float
    rolling: float
    """Rolling resistance: moment = rolling x normal force x radius."""
    solid: Solid
    confidence: float
    """0..1, of the mass."""
    reason: str
    """Where the mass comes from, a sentence for the scene's comments."""
    surface: str = ""
    """Where friction, elasticity and rolling come from, likewise."""
    size: float | None = None
    """m: the longest side of what is seen of it, where the backend judges that; it sets the scene's scale."""
    material: str = ""
    """What it is made of, as `materials.yaml` or the backend calls it."""


class Physics(Protocol):
    """Gives objects mass, friction and elasticity."""

    def __call__(
        self, rgb: Rgb, things: Sequence[PhotoObject], pixels_per_meter: float | None
    ) -> Mapping[int, Matter]:
        """Matter of every thing, by id. `pixels_per_meter` is the photo's true scale, None when nobody knows it."""
        ...


@dataclass(frozen=True)
class LightGuess:
    """The light of a photo."""

    light: DistantLight
    confidence: float
    """0..1."""
    reason: str
    others: tuple[tuple[DistantLight, float], ...] = ()
    """Lights from elsewhere, and how much of what this one explains they do, 0..1; the best first."""


class Depth(Protocol):
    """Tells how far away everything is."""

    def __call__(self, rgb: Rgb) -> NDArray[np.float32]:
        """(H, W), finite, larger = farther; in m where the backend knows, else up to scale and shift."""
        ...


class Normals(Protocol):
    """Tells which way every surface faces."""

    def __call__(
        self, rgb: Rgb, labels: Labels, things: Sequence[PhotoObject], setting: BoundaryGuess
    ) -> NDArray[np.float32]:
        """(H, W, 3) unit: +x right, +y down, +z to the viewer.

        Boundaries that are found by normals are asked after them: `setting` then knows nothing (confidence 0).
        """
        ...


@dataclass(frozen=True)
class Intrinsics:
    """A photo parted into what its surfaces are and how they are lit: light = albedo x shading."""

    albedo: NDArray[np.float32]
    """(H, W, 3) in 0..1, linear."""
    shading: NDArray[np.float32]
    """(H, W) >= 0, linear."""


class Intrinsic(Protocol):
    """Parts a photo into albedo and shading."""

    def __call__(self, rgb: Rgb, labels: Labels, normals: NDArray[np.float32]) -> Intrinsics:
        """`normals` as the role of that name gives them."""
        ...


class Light(Protocol):
    """Finds where the light comes from."""

    def __call__(
        self,
        rgb: Rgb,
        labels: Labels,
        things: Sequence[PhotoObject],
        normals: NDArray[np.float32],
        intrinsics: Intrinsics,
    ) -> LightGuess:
        """Never fails: what cannot be seen is guessed with little confidence."""
        ...


class Matte(Protocol):
    """Turns a label map into coverage."""

    def __call__(self, rgb: Rgb, labels: Labels) -> NDArray[np.float32]:
        """(H, W) in 0..1: how much of each pixel objects cover; 1 deep inside, 0 from 5 px outside on."""
        ...


@dataclass(frozen=True)
class Shadows:
    """The objects' shadows, lifted, and what throws them."""

    clean: Rgb | None
    """The background without them; None where none are seen."""
    owners: Labels | None
    """(H, W): the id of the object whose shadow lies there, 0 = none; None where none are seen."""
    light: DistantLight
    softness: float
    """degrees: half the width of the light."""
    tilt: float
    """degrees by which the camera looks down on the floor."""
    backdrop: float | None
    """px from the objects back to an upright wall that takes their shadows."""
    confidence: float
    """0..1."""
    reason: str
    faint: bool = False
    """Whether `clean` is as it should be behind objects, too: so little was lifted that nothing else shows there."""


class Shadow(Protocol):
    """Finds the shadows that objects throw, and lifts them from the background."""

    def __call__(
        self,
        background: Rgb,
        coverage: NDArray[np.float32],
        labels: Labels,
        things: Sequence[PhotoObject],
        matter: Mapping[int, Matter],
        setting: BoundaryGuess,
        light: LightGuess,
    ) -> Shadows:
        """`background` has the objects filled and their shadows still there. Never fails."""
        ...


class Inpaint(Protocol):
    """Continues the background where objects are taken away."""

    def __call__(self, rgb: Rgb, hole: NDArray[np.bool_]) -> Rgb:
        """The photo with `hole` (H, W) filled; it equals `rgb` outside the hole."""
        ...


@dataclass(frozen=True)
class Wall:
    """A fixed line that objects rest on or bump into."""

    name: str
    points: tuple[tuple[float, float], ...]
    """(K, 2) px, K >= 2; the first point again at the end closes it."""
    friction: float
    elasticity: float
    confidence: float
    """0..1."""
    source: str
    """In a word or three, for `from`."""
    reason: str


@dataclass(frozen=True)
class BoundaryGuess:
    """From where the photo is taken, and what holds the objects."""

    view: View
    confidence: float
    """0..1, of the view."""
    reason: str
    walls: tuple[Wall, ...]
    outlines: Mapping[int, Outline] = field(default_factory=dict)
    """By id, of things that stand better than their masks tell: with level feet on what holds them."""
    held: frozenset[int] = frozenset()
    """Ids of things that nothing seen keeps from falling."""
    grip: Mapping[int, float] = field(default_factory=dict)
    """By id, the least friction that things must have, since they lie still on a slope."""


class Boundary(Protocol):
    """Tells the view and finds floors, shelves and walls.

    Some take `depth` (H, W), `normals` (H, W, 3) and `scenery: Scenery | None`, too (`uses` in the table).
    """

    def __call__(
        self, rgb: Rgb, labels: Labels, things: Sequence[PhotoObject], view: View | None
    ) -> BoundaryGuess:
        """`view` is what a person said, None to find out.

        Walls touch the outlines and never enter them: the things' own, or those that the setting has instead.
        """
        ...


# ----------------------------------------------------------------------
# What perception starts from, and what a photo became.

SMALLEST_OBJECT = 12
"""px: an id of fewer pixels is a speck, no object."""


@dataclass(frozen=True)
class Detections:
    """The objects that perception starts from, found or given."""

    labels: NDArray[np.uint16]
    """(H, W), 0 = background."""
    source: str
    """Who found them, for `from`."""
    confidence: Mapping[int, float]
    """0..1, by id."""
    names: Mapping[int, Name]
    """What some of them are called already, by id."""
    prompts: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)
    """Where a person pointed, by id, as the scene says it: `{"box": [x, y, w, h]}` or `{"point": [x, y]}`, px."""
    doubtful: Sequence[Doubt] = ()
    """What may be an object and was not taken for one."""
    called: Mapping[int, str] = field(default_factory=dict)
    """What objects are named in the scene already, by id."""
    said: Mapping[int, str] = field(default_factory=dict)
    """Who found single masks, by id, as the scene's `from` has it; `source` found the others."""
    layers: Mapping[int, int] = field(default_factory=dict)
    """Who is drawn over whom as a person said it, by id."""
    named_by: str = "given"
    """Who said `names`, for `from`."""


@dataclass(frozen=True)
class PerceivedScene:
    """What a photo became."""

    percepts: Percepts
    document: dict[str, Any]
    """A scene as plain YAML data, valid once the assets are written; `maps` is for the writer of the assets to add."""
    comments: dict[str, str]
    """Dotted path -> a sentence or more to stand above it."""
    header: str
    """What to say at the top of the file."""
    warnings: tuple[Problem, ...] = ()
    """What was strange in the input and could be passed over."""
    record: Sequence[Mapping[str, Any]] = ()
    """How each role went, where others than the core's own had a part."""
