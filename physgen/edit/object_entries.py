"""Scene file entries of objects whose masks or labels were corrected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import registry
from physgen.edit.live import Live, LiveScene
from physgen.edit.operations import edited
from physgen.geometry.polygon import Disc, mass_properties
from physgen.geometry.scale import is_assumed, photo_object
from physgen.maps import U16, Percepts
from physgen.messages import Message
from physgen.perceive import document
from physgen.perceive.refresh import rewritten, with_sources
from physgen.perceive.roles import BoundaryGuess, Detections, Name, PhotoObject
from physgen.problems import InputError
from physgen.scene.provenance import perceived_keys
from physgen.scene.scene import Scene

Data = dict[str, Any]
Mask = NDArray[np.bool_]


@dataclass
class Correction:
    """A scene before a correction, and what the correction changes."""

    live: Live
    text: str
    sight: LiveScene
    maps: Percepts
    document: Mapping[
        str, Any
    ]  # the file's data, with what it extends, without defaults
    masks: dict[str, Mask] = field(
        default_factory=dict
    )  # new pixels of objects that were there
    fresh: dict[str, Mask] = field(default_factory=dict)  # pixels of new objects
    entries: dict[str, Data] = field(default_factory=dict)
    """Their entries, as far as they are known; masks, shapes and numbers come at the end."""
    found: dict[str, tuple[float, Data]] = field(default_factory=dict)
    """How sure a mask is, and the prompt that it was found by."""
    gone: tuple[str, ...] = ()  # objects that were merged into another
    ops: list[Data] = field(default_factory=list)

    @property
    def scene(self) -> Scene:
        """Before the correction."""
        return self.sight.scene

    @property
    def labels(self) -> U16:
        """(H, W): id k + 1 is the k-th object."""
        return self.sight.compiled.labels

    def index(self, name: str) -> int:
        """Of an object. Raises EditError."""
        every = [item.name for item in self.scene.objects]
        if name not in every or name not in self.document["objects"]:
            raise Message.NAME_UNKNOWN.impossible(name=name)
        return every.index(name)

    def mask(self, name: str) -> Mask:
        """Pixels of an object as they are. Raises EditError."""
        return np.asarray(self.labels == self.index(name) + 1)

    def was(self, name: str) -> Data:
        """The entry of an object as it is written."""
        return dict(self.document["objects"][name])

    def photo_object(self, name: str) -> PhotoObject:
        """The object as perception describes it."""
        k = self.index(name)
        outline = self.sight.compiled.shapes.outlines[k]
        return photo_object(
            k + 1, outline, self.scene.objects[k].label, self.scene.size
        )


def begin(live: Live, text: str) -> Correction:
    """A correction of a text begins. Raises EditError where the text is wrong, or shows no photo."""
    try:
        sight = live.state(text)
        written = live.document(text)
    except InputError as error:
        raise Message.SCENE_HAS_ERROR.impossible(problem=error.problems[0]) from error
    percepts = sight.percepts
    if percepts is None:
        raise Message.NO_PHOTO_TO_MASK.impossible()
    scene, own = sight.scene, written.get("objects") or {}
    names = [item.name for item in scene.objects if item.name in own]
    plain = {**written, "objects": {name: dict(own[name] or {}) for name in names}}
    plain = with_sources(plain, scene)
    return Correction(live, text, sight, percepts, plain)


def table_keys(was: Data) -> set[str]:
    """Keys of an object that the material table gave."""
    return perceived_keys(was, [registry.find("physics").name])


def new_entry(
    work: Correction,
    labels: U16,
    one: PhotoObject,
    name: str,
    label: Name | None,
    scale: float | None = None,
) -> Data:
    """The entry of a new object as perception writes it; `label` None: a user named it, with `one.label`.

    `scale` is that of the scene, px/m, where it follows the label.
    """
    stated = scale or work.scene.world.pixels_per_meter
    known = None if is_assumed(stated, max(work.scene.size)) else stated
    matter = registry.make("physics")(work.maps.rgb, [one], known)
    source = "" if label is None else registry.find("label").name
    labels_of_one = document.ObjectLabels(
        {one.id: label or Name(one.label, 1.0)}, {one.id: source}
    )
    made, _ = document.object_entries(
        Detections(labels, "drawn", {}, {}),
        [one],
        {one.id: name},
        matter,
        BoundaryGuess(work.scene.world.view, 0.0, "", ()),
        labels_of_one,
        registry.find("physics").name,
    )
    entry: Data = made[name]
    return entry


def changed_entry(
    work: Correction,
    source: str,
    name: str,
    one: PhotoObject,
    labels: U16,
    label: str | None = None,
) -> Data:
    """The entry of `source` as that of `name`, with the outline, or the label, of `one`; its mask is the caller's.

    Values of the table are computed again; what a user set stays.
    """
    was = work.was(source)
    ours = table_keys(was)
    scale = None
    if label is not None:
        named = edited(
            work.text, [{"set": ["objects", name, "label"], "value": label}]
        ).text
        scale = work.live.state(named).scene.world.pixels_per_meter
    result = rewritten(was, new_entry(work, labels, one, name, None, scale), ours)
    if label is not None:
        result["label"] = label
        if "from" in result:
            result["from"] = {
                key: who for key, who in result["from"].items() if key != "label"
            }
    if isinstance(result.get("shape"), Mapping):
        result["shape"] = document.shape_entry(one.outline)
    if not isinstance(one.outline, Disc):  # only round objects roll
        if result.get("solid", "plate") != "plate":
            result["solid"] = "plate"
        result.pop("roll", None)
        if "rolling" in ours:
            result.pop("rolling", None)
            result["from"] = {
                key: who for key, who in result["from"].items() if key != "rolling"
            }
    path = result.get("motion")
    if isinstance(path, Mapping) and path.get("path"):  # of the centre
        old, new = (
            mass_properties(outline).center
            for outline in (work.photo_object(source).outline, one.outline)
        )
        dx, dy = (new - old).tolist()
        knots = [
            [t, round(x + dx, 2), round(y + dy, 2), *rest]
            for t, x, y, *rest in path["path"]
        ]
        result["motion"] = {**path, "path": knots}
    return result


def joined_mass(work: Correction, *names: str) -> float:
    """g: the sum of masses."""
    return sum(
        work.sight.compiled.world.bodies[work.index(name)].mass for name in names
    )


def written(work: Correction, name: str, made: Data) -> list[Data]:
    """Operations for what differs from the entry as it is written."""
    was, path = work.was(name), ["objects", name]
    ops = [
        {"set": [*path, key], "value": value}
        for key, value in made.items()
        if key not in was
        or was[key] != value
        or key == "from"  # the file may name what a user has changed since
    ]
    gone = [
        key
        for key in was
        if key not in made and (key != "density" or "mass" not in made)
    ]
    return ops + [
        {"unset": [*path, key]} for key in gone
    ]  # setting a mass drops the density
