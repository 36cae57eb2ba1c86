"""What perception found of each object -> its entry in the scene document, and the comments in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from physgen.perceive import words
from physgen.perceive.found import Found
from physgen.perceive.occlusion import layers, orders
from physgen.perceive.roles import Matter, Name, Setting, Thing


def entries(
    found: Found,
    things: Sequence[Thing],
    called: Mapping[int, str],
    matter: Mapping[int, Matter],
    setting: Setting,
    named: Mapping[int, Name],
    label_source: Mapping[int, str],
    table: str,
) -> tuple[dict[str, Any], dict[str, str]]:
    """`objects:`, and comments by dotted path. `table` is who tells matter."""
    layer_of, kept = layers(orders(found.labels, [thing.id for thing in things]), found.layers)
    objects: dict[str, Any] = {}
    comments: dict[str, str] = {}
    for thing in sorted(things, key=lambda t: list(called).index(t.id)):
        name, it = called[thing.id], matter[thing.id]
        told = {"mask": _masked(found, thing.id)}
        if label_source[thing.id]:
            told["label"] = words.source(label_source[thing.id], named[thing.id].confidence)
        told |= {
            "mass": words.source(table, it.confidence),
            "friction": words.source(table, 0.5 * it.confidence + 0.2),
        }
        told["elasticity"] = told["friction"]
        one: dict[str, Any] = {"label": thing.label, "mask": thing.id, "shape": words.shape(thing.outline)}
        one |= {
            "solid": it.solid.value,
            "mass": it.mass,
            "friction": max(it.friction, setting.grip.get(thing.id, 0.0)),
            "elasticity": it.elasticity,
        }
        still = thing.cut or thing.id in setting.held
        if words.rolls(thing, it.solid, setting.view) and not still:
            one["rolling"] = it.rolling
            told["rolling"] = told["friction"]
        if it.surface:
            comments[f"objects.{name}.friction"] = it.surface
        if thing.cut:
            one["motion"] = "static"
            comments[f"objects.{name}.motion"] = (
                "cut off by the photo's border, so it is held; dynamic lets it go"
            )
        elif thing.id in setting.held:
            one["motion"] = "static"
            comments[f"objects.{name}.motion"] = (
                "nothing that is seen keeps it from falling, so it is held; dynamic lets it go"
            )
        if it.friction < setting.grip.get(thing.id, 0.0):
            told["friction"] = words.source("lies on a slope", 0.5)
            comments[f"objects.{name}.friction"] = "at least this much, since it lies still on a slope"
        if thing.id in layer_of:
            behind = [order for order in kept if order.front == thing.id]
            one["layer"] = layer_of[thing.id]
            told["layer"] = words.source("outlines", max(order.confidence for order in behind))
            comments[f"objects.{name}.layer"] = words.before([called[order.behind] for order in behind])
        comments[f"objects.{name}.mass"] = f"g: {it.reason}"
        if not objects and found.doubtful:
            comments[f"objects.{name}"] = words.doubts(found.doubtful, found.source)
        objects[name] = {**one, "from": told}
        if thing.id in found.prompts:
            objects[name]["prompt"] = dict(found.prompts[thing.id])
    return objects, comments


def _masked(found: Found, i: int) -> str:
    """Who found an object's mask, and how sure."""
    source = "pointed at" if i in found.prompts else found.source
    return found.said.get(i) or words.source(source, found.confidence.get(i, 1.0))
