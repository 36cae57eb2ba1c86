"""Sources of a scene's numbers, and new estimates after a change of label or scale."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from pathlib import Path
from typing import Any

from physgen import registry
from physgen.geometry.polygon import Disc, Outline
from physgen.geometry.scale import (
    MIN_SCALE_CONFIDENCE,
    PAPER_SCALE,
    WEIGHING,
    Scale,
    is_assumed,
    photo_object,
    photo_scale,
    slow_motion,
    weigh,
)
from physgen.materials import kind
from physgen.problems import Place
from physgen.scene.files import Record, equal
from physgen.scene.scene import Scene
from physgen.text import quantity

_SURE = re.compile(r"^(.*?)\s*(?<![\d.])(0(?:\.\d+)?|1(?:\.0+)?)$")
"""A source and its confidence from 0 to 1: `table 0.4`."""


@dataclass(frozen=True)
class Source:
    """The origin of a number."""

    # `flag`, `variant`, `guess`, `file`, `default` or `computed`.
    kind: str
    text: str
    # Confidence, 0 to 1.
    confidence: float | None = None


def source(text: str) -> Source:
    """Return the source of an entry of `from`.

    >>> source("table 0.4")
    Source(kind='guess', text='table', confidence=0.4)
    """
    match = _SURE.match(text.strip())
    if match is None or not match[1]:
        return Source("guess", text)
    return Source("guess", match[1], float(match[2]))


class Provenance:
    """The origins of a scene's values."""

    def __init__(self, scene: Scene, variant: str | None) -> None:
        self._scene = scene
        start = f"variants.{variant}"
        self._edited = {
            place
            for key, place in scene.places.items()
            if variant is not None and key.startswith(start)
        }
        self._variant = variant
        root = scene.places.get("", Place(""))
        self._file = root.file

    def of(
        self,
        path: str,
        provenance: str | None,
        *,
        text_path: str | None = None,
        uses_parent: bool = False,
    ) -> Source:
        """Return the source of the value at `path`, or its `provenance` if that is
        newer. `text_path` is the path of the provenance's text.

        With `uses_parent`, an unwritten value has the source of its parent.
        """
        place = self._scene.places.get(path)
        if place is None and uses_parent:
            place = self._scene.place(path)
        # A value that perception wrote keeps its source until someone edits it.
        if provenance is not None and self._counts(
            place, None if text_path is None else self._scene.place(text_path)
        ):
            return source(provenance)
        if place is None:
            return Source("default", "default")
        # Only flags have no lines.
        if not place.line:
            return Source("flag", "--set")
        if place in self._edited:
            return Source("variant", f"variant {self._variant}")
        name = Path(place.file).name
        return Source(
            "file",
            f"line {place.line}"
            if place.file == self._file
            else f"{name}, line {place.line}",
        )

    def _counts(self, value: Place | None, entry: Place | None) -> bool:
        """Return whether an entry of `from` still describes a number: no later place
        sets the number again.
        """
        # A recorded source has no place: it is older than variants and flags.
        if value is None or entry is None:
            return value is None or self._rank(value) < 2
        # The order of several base files is unknown here.
        if self._rank(value) == self._rank(entry) == 0:
            return value.file == entry.file
        return self._rank(value) <= self._rank(entry)

    def _rank(self, place: Place) -> int:
        """Return the order of reading: base files, the file, variants, flags."""
        if not place.line:
            return 3
        if place in self._edited:
            return 2
        if place.file == self._file:
            return 1
        return 0


Entry = Mapping[str, Any]
"""One object or boundary of the scene's data, or all data."""
SCALED_SECTIONS = ("forces", "joints", "fields", "camera", "extends", "variants")
"""Sections with numbers in px and s, which the user chose for the earlier scale."""


def provenance(source: str, confidence: float) -> str:
    """Return a source and its confidence as in `from`: table 0.4."""
    return f"{source} {round(confidence, 2):g}"


def perceived_keys(object_data: Entry, backends: Collection[str] = ()) -> set[str]:
    """Return the keys in an object's `from`, without label and mask. `backends` limits them
    to some sources.
    """
    if isinstance(object_data.get("from", {}), Mapping):
        sources = object_data.get("from", {})
    else:
        sources = {}
    keys = set()
    for key, source_text in sources.items():
        if not backends or str(source_text).split(" ")[0] in backends:
            keys.add(key)
    return (keys | ({"solid"} if "mass" in keys else set())) - {"label", "mask"}


def follows_scale(scene: Entry, record: Record, side: int) -> bool:
    """Return whether the scale is perception's, and no number in the scene was made for
    it.

    `side` is the photo's longer side, px.
    """
    moving = ("velocity", "spin", "roll", "density")
    has_scaled_values = any(map(scene.get, SCALED_SECTIONS)) or "gravity" in scene.get(
        "world", {}
    )
    # A number in px was chosen for the scale: a new scale would change its meaning.
    if has_scaled_values or any(
        key in entry
        and not (
            _metric(entry[key])
            or equal(entry[key], record.entry(name, entry).get(key, [0, 0]))
        )
        for name, entry in scene["objects"].items()
        for key in moving
    ):
        return False
    return not scale_is_given(scene, record, side)


def _metric(value: object) -> bool:
    """Return whether a speed has a metric unit, and no px."""
    if isinstance(value, list):
        parts = value
    else:
        parts = [value]
    return all(
        part == 0 or (isinstance(part, str) and "px" not in part) for part in parts
    )


def scale_is_given(scene: Entry, record: Record, side: int) -> bool:
    """Return whether a user set the scale, now or before an earlier perception."""
    scale = stated_scale(scene)
    if record.world.get("given"):
        return True
    return not (
        is_assumed(scale, side) if record.scale is None else equal(scale, record.scale)
    )


def stated_scale(scene: Entry) -> float:
    """Return the scale of data in the file's form, px/m."""
    scale = scene.get("world", {}).get("pixels_per_meter", PAPER_SCALE)
    if isinstance(scale, str):
        return quantity(scale, "px/m", 1.0) or 0.0
    return float(scale)


def scaled_values(
    scene: Entry, record: Record, pixels_per_meter: float, side: int
) -> dict[tuple[str, ...], Any]:
    """Return perception's speeds of pushes and slow motion for another scale, by path.

    `scene` is the data in the file's form. The new speeds suit the scale.
    """
    old = record.scale
    if old is None or equal(old, pixels_per_meter):
        return {}
    values: dict[tuple[str, ...], Any] = {}
    # Speeds of falls grow with the square root of lengths: the motion looks the same.
    ratio = sqrt(old / pixels_per_meter)
    for name, item in scene.get("objects", {}).items():
        for key, value in _scaled_push(item, record.entry(name, item), ratio).items():
            values["objects", name, key] = value
    # Slow motion follows the scale only if its value is still that of perception.
    film = scene.get("render", {})
    before = film.get("slow", 1)
    slow = slow_motion(side, pixels_per_meter)
    if (
        "frames" not in film
        and equal(before, record.world.get("slow"))
        and slow != before
    ):
        values["render", "slow"] = slow
    return values


def _scaled_push(item: Entry, entry: Entry, ratio: float) -> Entry:
    """Return the velocity and the spin of a recorded push, times `ratio`.

    Empty for an object without a push, and for a push changed by the user.
    """
    velocity = entry.get("velocity")
    if not isinstance(velocity, list) or not equal(item.get("velocity"), velocity):
        return {}
    speeds = list(map(_speed, velocity))
    if None in speeds or not any(speeds):
        return {}
    values: dict[str, Any] = {
        "velocity": [meters(ratio * (speed or 0)) for speed in speeds]
    }
    spin = entry.get("spin")
    # A rate is a speed over a length.
    if spin and equal(item.get("spin"), spin):
        values["spin"] = round(spin / ratio, 1)
    return values


def _speed(component: Any) -> float | None:
    """Return a component of a recorded velocity, m/s; None for an unknown unit."""
    if isinstance(component, str):
        return quantity(component, "m/s", 1.0)
    return 0


def meters(speed: float) -> Any:
    """Return a speed in m/s, in the form of perception."""
    if abs(speed) > 1e-9:
        return f"{float(f'{speed:.3g}'):g} m/s"
    return 0


def _changed_labels(objects: Entry, entries: Mapping[str, Entry]) -> list[str]:
    """Return the names of the objects whose label is not that of the record."""
    names = []
    for name, entry in entries.items():
        if objects[name]["label"] != entry["label"]:
            names.append(name)
    return names


def apply_consequences(
    written_data: Entry,
    full_data: Entry,
    record: Record,
    outlines: Mapping[str, Outline],
    size: tuple[int, int],
) -> tuple[dict[tuple[str, ...], Any], Record]:
    """Return values that depend on labels and scale but are not in the record, by path,
    and their new record.

    Values of perception follow, and values of a user stay: the scale if it is
    perception's, the values of the material table, for a new label the values of any
    backend, pushes and playback. `written_data` is the scene's data in the file's form,
    `full_data` in numbers with defaults; `outlines` are the known ones, by object.
    """
    # The order of dependence: labels may change the scale, the scale changes speeds and
    # masses of all objects.
    objects = full_data["objects"]
    side = max(size)
    old_entries = _labelled_entries(written_data, objects, record, outlines)
    new_labels = _changed_labels(objects, old_entries)
    per_meter = full_data["world"]["pixels_per_meter"]
    values: dict[tuple[str, ...], Any] = {}
    if new_labels and follows_scale(written_data, record, side):
        scale = _scale_of_labels(objects, old_entries, new_labels, outlines, size)
        # A doubtful scale would change all masses at once.
        if scale is not None and scale.confidence >= MIN_SCALE_CONFIDENCE:
            per_meter = values["world", "pixels_per_meter"] = scale.pixels_per_meter
    names: Iterable[str] = new_labels
    if "pixels_per_meter" in written_data.get("world", {}):
        values |= scaled_values(written_data, record, per_meter, side)
        # All masses depend on the scale, so that all labelled objects change with it.
        if record.scale is not None and not equal(record.scale, per_meter):
            names = old_entries
    entries = dict(record.objects)
    for name in names:
        item = objects[name]
        new_values, new_entry = _entry_of_label(
            item,
            written_data["objects"][name],
            old_entries[name],
            _table_values(
                outlines[name],
                item["label"],
                per_meter,
                _highest_confidence(per_meter, side),
            ),
            is_new=name in new_labels,
        )
        values.update(_object_paths(name, new_values))
        entries[_record_key(record, name, item)] = new_entry
    world = dict(record.world)
    world["by_labels"] = ("world", "pixels_per_meter") in values
    return values, replace(record, objects=entries, world=world)


def _object_paths(name: str, values: Entry) -> dict[tuple[str, ...], Any]:
    """Return the values of an object by their paths in the scene."""
    return {("objects", name, key): value for key, value in values.items()}


def _record_key(record: Record, name: str, item: Entry) -> str:
    """Return the key of an object's entry in the record: its mask, or its name."""
    mask_id = str(item.get("mask"))
    if mask_id in record.objects:
        return mask_id
    return name


def _highest_confidence(pixels_per_meter: float, side: int) -> float:
    """Return the highest confidence of a mass, at most that of the scale behind it."""
    if is_assumed(pixels_per_meter, side):
        return WEIGHING.unscaled_confidence
    return 1.0


def _labelled_entries(
    written_data: Entry,
    objects: Mapping[str, Any],
    record: Record,
    outlines: Mapping[str, Outline],
) -> dict[str, Entry]:
    """Return the recorded entries with a label, for objects with a label and an
    outline.
    """
    entries = {}
    for name in outlines:
        if "label" not in written_data["objects"][name]:
            continue
        entry = record.entry(name, objects[name])
        if isinstance(entry.get("label"), str):
            entries[name] = entry
    return entries


def _scale_of_labels(
    objects: Mapping[str, Any],
    entries_by_name: Mapping[str, Entry],
    new_labels: Sequence[str],
    outlines: Mapping[str, Outline],
    size: tuple[int, int],
) -> Scale | None:
    """Return the scale of the photo from the labels of its objects. A user's label is
    certain.
    """
    photo_objects, kinds, confidences = [], {}, {}
    for k, (name, entry) in enumerate(entries_by_name.items()):
        photo_objects.append(photo_object(k, outlines[name], "", size))
        kinds[k] = kind(objects[name]["label"])
        confidences[k] = 1.0
        if name not in new_labels:
            confidences[k] = label_confidence(entry.get("from"))
    return photo_scale(photo_objects, kinds, confidences)


def _entry_of_label(
    item: Mapping[str, Any],
    written_item: Mapping[str, Any],
    entry: Entry,
    table: tuple[dict[str, Any], dict[str, str]],
    *,
    is_new: bool,
) -> tuple[dict[str, Any], Entry]:
    """Return the values of an object that follow its label, and its entry of the
    record.

    `table` has the values of the material table and their sources. If `is_new`, the
    values of all backends follow the label, otherwise only those of the table.
    """
    table_values, table_sources = table
    backends: Sequence[str] = [registry.find("physics").name]
    if is_new:
        backends = registry.names("physics")
    sources = {"from": written_item.get("from", entry.get("from")) or {}}
    keys = perceived_keys(sources, backends) | ({"solid"} - item.keys())
    # A text with a unit is the user's, even if its number equals the record's.
    keys = {key for key in keys if key == "solid" or not _is_text(written_item, key)}
    # An object without a solid has it in the assets.
    item = {"solid": entry.get("solid"), **item}
    values = {}
    for key in keys & entry.keys() & table_values.keys():
        new_value = table_values[key]
        # A value that differs from the record is the user's, and stays.
        if equal(item.get(key), entry[key]) or item.get(key) == new_value:
            values[key] = new_value
    value_sources = dict(entry.get("from", {}))
    for key in values:
        if key in table_sources:
            value_sources[key] = table_sources[key]
    return values, {**entry, **values, "from": value_sources}


def _is_text(written_item: Mapping[str, Any], key: str) -> bool:
    return isinstance(written_item.get(key), str)


def _table_values(
    outline: Outline, label: str, per_meter: float, highest_confidence: float
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return an object's values from the material table, and their sources. `highest_confidence` is
    the highest confidence of a mass.
    """
    object_kind = kind(label)
    mass, confidence, _ = weigh(outline, object_kind, per_meter)
    material = {}
    for key in ("friction", "elasticity", "rolling"):
        material[key] = getattr(object_kind.material, key)
    if isinstance(outline, Disc):
        solid = {"solid": object_kind.solid or "sphere"}
    else:
        solid = {}
    table = registry.find("physics").name
    confidences = table_confidences(min(confidence, highest_confidence))
    return {"mass": mass, **material, **solid}, {
        key: provenance(table, confidence_value)
        for key, confidence_value in confidences.items()
    }


def table_confidences(mass: float) -> dict[str, float]:
    """Return the confidences by key, from the confidence of a mass."""
    return {"mass": mass} | dict.fromkeys(
        ("friction", "elasticity", "rolling"), 0.5 * mass + 0.2
    )


def label_confidence(sources: object) -> float:
    """Return the label's confidence in a `from`, or 1 without one."""
    if isinstance(sources, Mapping):
        text = sources.get("label")
    else:
        text = None
    if isinstance(text, str):
        confidence = source(text).confidence
    else:
        confidence = None
    if confidence is None:
        return 1.0
    return confidence
