"""A scene and its photo -> which of its numbers the table gave, and which a person set.

Nothing in a file says what its numbers were before they were edited. But what the table gives for a label can be
reckoned again. A number is the table's where `from` says so and where it is what the table gives, at the scale that
the scene states or that its things tell, for the label in the file, for the one that the object's name was made from,
or for what its shape was guessed to be. Any other number is a person's, and stays, whatever `from` says.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from physgen.materials import kind
from physgen.perceive.occlusion import layers, orders
from physgen.perceive.roles import Labels, Matter, Name, Physics, Rgb, Thing
from physgen.perceive.scale import DEFAULT, ENOUGH, scale

KEYS = ("mass", "friction", "elasticity", "rolling")
"""Keys that `from` names; `solid` goes with them."""
SAME = 0.01
"""Share by which two numbers may differ and be the same: outlines are written to 0.01 px."""
TUNED = ("forces", "joints", "fields", "camera", "extends", "variants")
"""Sections with numbers in px and s, which a person chose for the scale that the scene had."""


@dataclass(frozen=True)
class Derived:
    """What nobody has set."""

    keys: Mapping[str, frozenset[str]]
    """Keys of objects, by name: those of `KEYS`, and `solid`."""
    scale: bool
    """Whether the scale is what physgen wrote, and nothing in the scene was made for it."""


def derived(
    scene: Mapping[str, Any],
    rgb: Rgb,
    things: Mapping[str, Thing],
    guessed: Mapping[int, Name],
    physics: Physics,
    table: str,
) -> Derived:
    """`scene` is the file's data, `things` its objects by name; `table` is how `from` calls the backend `physics`."""
    stated = float(scene.get("world", {}).get("pixels_per_meter", DEFAULT))
    objects = {name: scene["objects"][name] for name in things}
    found: list[Mapping[int, Matter]] = []
    ours = stated == DEFAULT
    for labels in _labels(objects, things, guessed):
        called = [replace(thing, label=labels[name]) for name, thing in things.items()]
        values = {None if stated == DEFAULT else stated, None}
        for sure in (None, _guesses(objects, things, guessed)):
            told = scale(called, {thing.id: kind(thing.label) for thing in called}, sure)
            if told is not None:
                values.add(told.pixels_per_meter)
                ours |= told.confidence >= ENOUGH and _same(told.pixels_per_meter, stated)
        found += [physics(rgb, called, value) for value in values]
    keys = {}
    for name, was in objects.items():
        said, gave = was.get("from", {}), [matter[things[name].id] for matter in found]
        by_table = {key for key in KEYS if str(said.get(key, "")).split(" ")[0] == table and key in was}
        own = {key for key in by_table if any(_same(was[key], getattr(matter, key)) for matter in gave)}
        if own and any(was.get("solid") == matter.solid.value for matter in gave):
            own.add("solid")
        keys[name] = frozenset(own)
    return Derived(keys, ours and not _tuned(scene))


def set_layers(scene: Mapping[str, Any], labels: Labels, ids: Mapping[str, int]) -> dict[str, int]:
    """Layers that a person set, by name; `labels` (H, W) shows the scene's objects by `ids`.

    One is ours where `from` says so and where it is what `labels` tell; where an object has no `from`, all of it is a
    person's.
    """
    written = {name: was for name, was in scene["objects"].items() if name in ids}
    sure = {name: int(was.get("layer", 0)) for name, was in written.items() if not _layered(was)}
    found = orders(labels, list(ids.values()))
    # as they were told at first, or when the scene was last refreshed
    told = [layers(found)[0], layers(found, {ids[name]: layer for name, layer in sure.items()})[0]]
    moved = {
        name: int(was.get("layer", 0)) for name, was in written.items()
        if name not in sure and "layer" in was and all(was["layer"] != of.get(ids[name], 0) for of in told)
    }  # fmt: skip
    return sure | moved


def relayered(was: Mapping[str, Any], now: Mapping[str, Any]) -> dict[str, Any]:
    """An object as it `was`, in the layer that it has `now`."""
    if was.get("layer", 0) == now.get("layer", 0):
        return dict(was)
    said = {key: who for key, who in was["from"].items() if key != "layer"}
    before = {key: value for key, value in was.items() if key not in ("layer", "from", "prompt")}
    if "layer" in now:
        before["layer"], said["layer"] = now["layer"], now["from"]["layer"]
    return {**before, "from": said} | {key: was[key] for key in ("prompt",) if key in was}


def _layered(was: Mapping[str, Any]) -> bool:
    """Whether its layer may be ours: `from` names it, or none is written where `from` names other keys."""
    return "from" in was and ("layer" in was["from"] or "layer" not in was)


def anew(
    was: Mapping[str, Any], now: Mapping[str, Any], keys: frozenset[str], label: str | None
) -> dict[str, Any]:
    """An object as it `was`, with its `keys` as they are `now`; `label` is what a person calls it from now on."""
    said = dict(was.get("from", {}))
    result = dict(was)
    if label is not None:
        result["label"] = label
        said.pop("label", None)
    for key in keys & set(now):
        if not _same(was[key], now[key]):
            result[key] = now[key]
            if key in now["from"]:
                said[key] = now["from"][key]
    return {**result, "from": said} if "from" in was else result


def _labels(
    objects: Mapping[str, Mapping[str, Any]], things: Mapping[str, Thing], guessed: Mapping[int, Name]
) -> Iterator[dict[str, str]]:
    """What objects may have been called when their numbers were reckoned, by name."""
    written = {name: str(was.get("label", "")) for name, was in objects.items()}
    named = {name: re.sub(r"-\d+$", "", name).replace("-", " ") for name in objects}
    guesses = {name: guessed[things[name].id].label for name in objects}
    seen: list[dict[str, str]] = []
    for labels in (written, named, guesses):
        if labels not in seen:
            seen.append(labels)
            yield labels


def _guesses(
    objects: Mapping[str, Mapping[str, Any]], things: Mapping[str, Thing], guessed: Mapping[int, Name]
) -> dict[int, float]:
    """How sure labels are of objects whose `from` says that nobody said them."""
    return {
        things[name].id: guessed[things[name].id].confidence
        for name, was in objects.items() if "label" in was.get("from", {})
    }  # fmt: skip


def _same(was: Any, now: Any) -> bool:
    if isinstance(was, int | float) and isinstance(now, int | float):
        return abs(was - now) <= SAME * max(abs(was), abs(now))
    return bool(was == now)


def _tuned(scene: Mapping[str, Any]) -> bool:
    """Whether a person wrote something that depends on the scale."""
    moving: Sequence[Mapping[str, Any]] = list(scene["objects"].values())
    still = not any(key in was for was in moving for key in ("velocity", "spin", "roll", "density"))
    return any(scene.get(key) for key in TUNED) or "gravity" in scene.get("world", {}) or not still
