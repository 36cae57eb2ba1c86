"""Scene file entries of objects whose masks or labels were corrected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import registry
from physgen.edit.live import Live, LiveScene
from physgen.edit.operations import apply_operations
from physgen.geometry.polygon import Disc, mass_properties
from physgen.geometry.scale import is_assumed, photo_object
from physgen.maps import U16, Percepts
from physgen.messages import Message
from physgen.perceive import document, shape_entries
from physgen.perceive.refresh import rewritten, with_sources
from physgen.perceive.roles import BoundaryGuess, Detections, Name, PhotoObject
from physgen.problems import InputError
from physgen.scene.provenance import perceived_keys
from physgen.scene.scene import Scene

Data = dict[str, Any]
Mask = NDArray[np.bool_]


@dataclass
class Correction:
    """A scene before a correction, and the changes of the correction."""

    live: Live
    text: str
    sight: LiveScene
    maps: Percepts
    document: Mapping[str, Any]  # the file's data with `extends`, without defaults
    masks: dict[str, Mask] = field(default_factory=dict)
    """New pixels of existing objects."""
    new_masks: dict[str, Mask] = field(default_factory=dict)  # pixels of new objects
    entries: dict[str, Data] = field(default_factory=dict)
    """Entries of new objects, as far as known; masks, shapes and numbers are added at
    the end.
    """
    prompts: dict[str, tuple[float, Data]] = field(default_factory=dict)
    """Confidence of a mask, and the prompt that selected it."""
    merged_names: tuple[str, ...] = ()  # objects that were merged into another
    ops: list[Data] = field(default_factory=list)

    @property
    def scene(self) -> Scene:
        """Return the scene before the correction."""
        return self.sight.scene

    @property
    def labels(self) -> U16:
        """Return the label map before the correction, (H, W): k + 1 is the k-th
        object.
        """
        return self.sight.compiled_scene.labels

    def index(self, name: str) -> int:
        """Return the index of an object. Raises EditError."""
        names = [item.name for item in self.scene.objects]
        if name not in names or name not in self.document["objects"]:
            raise Message.NAME_UNKNOWN.impossible(name=name)
        return names.index(name)

    def mask(self, name: str) -> Mask:
        """Return the mask of an object before the correction, (H, W). Raises
        EditError.
        """
        return np.asarray(self.labels == self.index(name) + 1)

    def old_entry(self, name: str) -> Data:
        """Return the entry of an object as it is in the file."""
        return dict(self.document["objects"][name])

    def photo_object(self, name: str) -> PhotoObject:
        """Return the object as perception describes it."""
        k = self.index(name)
        outline = self.sight.compiled_scene.shapes.outlines[k]
        return photo_object(
            k + 1, outline, self.scene.objects[k].label, self.scene.size
        )


def begin(live: Live, text: str) -> Correction:
    """Create a correction of a text. Raises EditError for a wrong text or one without a
    photo.
    """
    try:
        sight = live.state(text)
        file_document = live.document(text)
    except InputError as error:
        raise Message.SCENE_HAS_ERROR.impossible(problem=error.problems[0]) from error
    percepts = sight.percepts
    if percepts is None:
        raise Message.NO_PHOTO_TO_MASK.impossible()
    scene = sight.scene
    own_entries = file_document.get("objects") or {}
    names = []
    for item in scene.objects:
        if item.name in own_entries:
            names.append(item.name)
    # Only objects of this file can be corrected, not those of a file that it extends.
    own_document = {
        **file_document,
        "objects": {name: dict(own_entries[name] or {}) for name in names},
    }
    own_document = with_sources(own_document, scene)
    return Correction(live, text, sight, percepts, own_document)


def table_keys(entry: Data) -> set[str]:
    """Return the keys of an object with values from the material table."""
    return perceived_keys(entry, [registry.find("physics").name])


def new_entry(
    work: Correction,
    labels: U16,
    photo_object: PhotoObject,
    name: str,
    label: Name | None,
    scale: float | None = None,
) -> Data:
    """Return the entry of a new object as perception writes it.

    `label` None: the user has named it, and `one.label` is the name. `scale`: the scale
    of the scene, px/m, if it follows from the label.
    """
    scene_scale = scale or work.scene.world.pixels_per_meter
    # An assumed scale is no evidence about the size of an object.
    if is_assumed(scene_scale, max(work.scene.size)):
        known_scale = None
    else:
        known_scale = scene_scale
    materials = registry.make("physics")(work.maps.rgb, [photo_object], known_scale)
    if label is None:
        source = ""
    else:
        source = registry.find("label").name
    labels_of_one = document.ObjectLabels(
        {photo_object.id: label or Name(photo_object.label, 1.0)},
        {photo_object.id: source},
    )
    entries, _ = document.object_entries(
        Detections(labels, "drawn", {}, {}),
        [photo_object],
        {photo_object.id: name},
        materials,
        BoundaryGuess(work.scene.world.view, 0.0, "", ()),
        labels_of_one,
        registry.find("physics").name,
    )
    entry: Data = entries[name]
    return entry


def changed_entry(
    work: Correction,
    source: str,
    name: str,
    photo_object: PhotoObject,
    labels: U16,
    label: str | None = None,
) -> Data:
    """Return the entry of `source` for `name`, with the outline or the label of
    `photo_object`.

    Values of the material table are computed again, values of the user stay. The caller
    sets the mask.
    """
    old_entry = work.old_entry(source)
    old_keys = table_keys(old_entry)
    scale = None
    if label is not None:
        # The scale may follow from the size of a labelled object: read it from the
        # scene with the new label.
        named_text = apply_operations(
            work.text, [{"set": ["objects", name, "label"], "value": label}]
        ).text
        scale = work.live.state(named_text).scene.world.pixels_per_meter
    result = rewritten(
        old_entry, new_entry(work, labels, photo_object, name, None, scale), old_keys
    )
    if label is not None:
        result["label"] = label
        if "from" in result:
            result["from"] = _without_key(result["from"], "label")
    if isinstance(result.get("shape"), Mapping):
        result["shape"] = shape_entries.shape_entry(photo_object.outline)
    # Only round objects roll.
    if not isinstance(photo_object.outline, Disc):
        if result.get("solid", "plate") != "plate":
            result["solid"] = "plate"
        result.pop("roll", None)
        if "rolling" in old_keys:
            result.pop("rolling", None)
            result["from"] = _without_key(result["from"], "rolling")
    motion = result.get("motion")
    # A path contains positions of the centre; the centre moves with the outline.
    if isinstance(motion, Mapping) and motion.get("path"):
        old_center = mass_properties(work.photo_object(source).outline).center
        new_center = mass_properties(photo_object.outline).center
        knots = _moved_knots(motion["path"], *(new_center - old_center).tolist())
        result["motion"] = {**motion, "path": knots}
    return result


def _without_key(mapping: Mapping[str, Any], key: str) -> Data:
    return {other: value for other, value in mapping.items() if other != key}


def _moved_knots(knots: list[list[Any]], dx: float, dy: float) -> list[list[Any]]:
    """Return the knots of a path, displaced by dx, dy px."""
    return [
        [t, round(x + dx, 2), round(y + dy, 2), *angles] for t, x, y, *angles in knots
    ]


def joined_mass(work: Correction, *names: str) -> float:
    """Return the sum of masses, g."""
    return sum(
        work.sight.compiled_scene.world.bodies[work.index(name)].mass for name in names
    )


def write_operations(work: Correction, name: str, entry: Data) -> list[Data]:
    """Return the operations for all differences from the entry in the file."""
    old_entry = work.old_entry(name)
    path = ["objects", name]
    # `from` is always written, since the file may name values that the user changed.
    ops = []
    for key, value in entry.items():
        if key not in old_entry or old_entry[key] != value or key == "from":
            ops.append({"set": [*path, key], "value": value})
    # Setting a mass also removes the density.
    removed_keys = []
    for key in old_entry:
        if key not in entry and (key != "density" or "mass" not in entry):
            removed_keys.append(key)
    return ops + [{"unset": [*path, key]} for key in removed_keys]
