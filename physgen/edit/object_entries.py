"""Scene file entries of objects whose masks or labels were corrected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import registry
from physgen.compile.compile import Compiled
from physgen.geometry.polygon import Disc, Outline, bounds, mass_properties
from physgen.materials import kind
from physgen.perceive.document import object_entries, shape_entry
from physgen.perceive.refresh import TableValues, find_table_values, with_new_values
from physgen.perceive.roles import BoundaryGuess, Detections, Matter, Name, PhotoObject, Rgb
from physgen.perceive.scale import DEFAULT_SCALE, MIN_SCALE_CONFIDENCE, photo_scale
from physgen.scene.scene import Scene

Data = dict[str, Any]
U16 = NDArray[np.uint16]

SOLID = 1.5
"""Power of the area with which the volume of an object grows."""


@dataclass(frozen=True)
class Before:
    """The scene before a correction."""

    scene: Scene
    document: Mapping[str, Any]
    """The file's data, with what it extends, without defaults."""
    rgb: Rgb
    labels: U16
    """(H, W): id k + 1 is the k-th object."""
    outlines: Sequence[Outline]
    ours: TableValues
    """Values of the table that no user has set."""
    reasons: dict[str, str] = field(default_factory=dict)
    """By dotted path, the reasons of values that were computed again."""

    def was(self, name: str) -> Data:
        """The entry of an object as it is written."""
        return dict(self.document["objects"][name])

    def photo_object(self, name: str) -> PhotoObject:
        """The object as perception describes it."""
        k = [item.name for item in self.scene.objects].index(name)
        return photo_object(k + 1, self.outlines[k], self.scene.objects[k].label, self.scene.size)


def before(scene: Scene, document: Mapping[str, Any], compiled: Compiled, rgb: Rgb) -> Before:
    """The scene before a correction, with the values that come from the table."""
    objects = {
        item.name: photo_object(k + 1, compiled.shapes.outlines[k], item.label, scene.size)
        for k, item in enumerate(scene.objects)
        if item.name in (document.get("objects") or {})
    }
    guessed: Mapping[int, Name] = registry.make("label")(rgb, compiled.labels, list(objects.values()))
    table = registry.find("physics").name
    plain = {**document, "objects": {name: dict(document["objects"][name] or {}) for name in objects}}
    ours = find_table_values(plain, rgb, objects, guessed, registry.make("physics"), table)
    return Before(scene, plain, rgb, compiled.labels, compiled.shapes.outlines, ours)


def photo_object(id_: int, outline: Outline, label: str, size: tuple[int, int]) -> PhotoObject:
    """An object, and whether the photo's border cuts it off."""
    x0, y0, x1, y1 = bounds(outline)
    cut = min(x0, y0) < 0 or x1 > size[0] - 1 or y1 > size[1] - 1
    return PhotoObject(id_, outline, label, cut)


def matter_of(known: Before, objects: Sequence[PhotoObject]) -> Mapping[int, Matter]:
    """The table's values of objects, at the scene's scale or at that which its objects have."""
    stated = known.scene.world.pixels_per_meter
    measured: float | None = None if stated == DEFAULT_SCALE else stated
    if known.ours.scale:
        new = {one.id for one in objects}
        rest = [known.photo_object(item.name) for item in known.scene.objects]
        every = [*objects, *(one for one in rest if one.id not in new)]
        scale = photo_scale(every, {one.id: kind(one.label) for one in every}, None)
        if scale is not None and scale.confidence >= MIN_SCALE_CONFIDENCE:
            measured = scale.pixels_per_meter
    found: Mapping[int, Matter] = registry.make("physics")(known.rgb, objects, measured)
    return found


def named(known: Before, labels: U16, one: PhotoObject) -> Name:
    """The name that a new object gets by its looks."""
    found: Mapping[int, Name] = registry.make("label")(known.rgb, labels, [one])
    return found[one.id]


def entry(
    known: Before, labels: U16, one: PhotoObject, name: str, called: Name | None, found: Detections
) -> Data:
    """The entry of a new object as perception writes it; `called` None: a user named it, with `one.label`."""
    matter = matter_of(known, [one])
    source = "" if called is None else registry.find("label").name
    setting = BoundaryGuess(known.scene.world.view, 0.0, "", ())
    made, comments = object_entries(
        found,
        [one],
        {one.id: name},
        matter,
        setting,
        {one.id: called or Name(one.label, 1.0)},
        {one.id: source},
        registry.find("physics").name,
    )
    known.reasons.update(comments)
    found_entry: Data = made[name]
    return found_entry


def changed(known: Before, name: str, one: PhotoObject, labels: U16, label: str | None = None) -> Data:
    """An object's entry with the outline, or the label, of `one`; its mask is left to the caller.

    Values of the table are computed again. A mass that another source guessed grows with the volume; what a user set
    stays.
    """
    was, result = known.was(name), _updated(known, name, name, one, labels, label)
    if _has_own_mass(known, name) and "mass" in was.get("from", {}):
        grown = was["mass"] * (_area(one) / _area(known.photo_object(name))) ** SOLID
        _set_mass(known, name, result, grown, "g: as it was guessed before, by the size of its mask now")
    return result


def shared(known: Before, source: str, name: str, part: float, one: PhotoObject, labels: U16) -> Data:
    """The entry of a half with a part (0..1) of an object's area, which gets that part of a mass that was set."""
    result = _updated(known, source, name, one, labels)
    if _has_own_mass(known, source):
        mass = known.was(source)["mass"] * part
        _set_mass(known, name, result, mass, "g: its share of the whole, by area")
    return result


def joined(known: Before, kept: str, other: str, one: PhotoObject, labels: U16) -> Data:
    """The entry of an object into which another is merged: masses that were set add up."""
    result, more = _updated(known, kept, kept, one, labels), known.was(other)
    if _has_own_mass(known, kept):
        mass = more.get("mass", float(more.get("density", 1.0)) * _area(known.photo_object(other)))
        total = known.was(kept)["mass"] + mass
        _set_mass(known, kept, result, total, "g: of both that it was made of")
    return result


def _has_own_mass(known: Before, name: str) -> bool:
    """Whether an object has a mass that is not the table's."""
    return "mass" in known.was(name) and "mass" not in known.ours.keys.get(name, frozenset())


def _set_mass(known: Before, name: str, made: Data, mass: float, reason: str) -> None:
    made["mass"] = short(mass)
    known.reasons[f"objects.{name}.mass"] = reason


def _updated(
    known: Before, source: str, name: str, one: PhotoObject, labels: U16, label: str | None = None
) -> Data:
    """The entry of `source` as that of `name`, with the table's values and the outline of `one`."""
    fresh = entry(known, labels, one, name, None, Detections(labels, "", {}, {}))
    ours = known.ours.keys.get(source, frozenset())
    result = with_new_values(known.was(source), fresh, ours, label)
    if result.get("shape", "auto") != "auto":
        result["shape"] = shape_entry(one.outline)
    if not isinstance(one.outline, Disc):
        if result.get("solid", "plate") != "plate":
            result["solid"] = "plate"
        result.pop("roll", None)
        if "rolling" in ours:  # only round objects roll
            result.pop("rolling", None)
            result["from"] = {key: who for key, who in result["from"].items() if key != "rolling"}
    path = result.get("motion")
    if isinstance(path, Mapping) and path.get("path"):
        old = known.photo_object(source)
        dx, dy = (mass_properties(one.outline).center - mass_properties(old.outline).center).tolist()
        knots = [[t, round(x + dx, 2), round(y + dy, 2), *rest] for t, x, y, *rest in path["path"]]
        result["motion"] = {**path, "path": knots}
    return result


def short(value: float) -> float:
    """Rounded to four digits.

    >>> short(123.456)
    123.5
    """
    value = float(f"{value:.4g}")
    return int(value) if value.is_integer() and abs(value) < 1e5 else value


def _area(one: PhotoObject) -> float:
    return max(float(mass_properties(one.outline).area), 1e-9)
