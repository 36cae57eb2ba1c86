"""Edits that a vision-language model proposes for a story: their schema, and their values."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jsonschema import Draft202012Validator

from physgen.compile.world import Body, World
from physgen.messages import Note
from physgen.scene.scene import Motion, Scene, View
from physgen.text import listed, quoted

Schema = Mapping[str, Any]
GRAMS = 1000.0
"""g in a kg."""
TOP = 0.95
"""Share of its height above the centre of mass at which an object is pushed at the top."""
FASTEST = 40.0
"""m/s: a proposed speed at most."""
MOST_EDITS = 12
"""Edits of one proposal."""
NAME = r"^[A-Za-z][A-Za-z0-9_-]*$(?!\n)"
"""Names of objects in a scene file; `$` alone, in Python, would also match before a
line break."""
LONGEST_NAME = 64
"""Characters of such a name."""


def object_schema(properties: Schema, required_keys: Sequence[str]) -> dict[str, Any]:
    """Return the schema of an object with these properties and no others."""
    return {
        "type": "object",
        "properties": dict(properties),
        "required": list(required_keys),
        "additionalProperties": False,
    }


def number_schema(low: float, high: float) -> dict[str, Any]:
    """Return the schema of a number from `low` to `high`."""
    return {"type": "number", "minimum": low, "maximum": high}


def pair_schema(low: float, high: float) -> dict[str, Any]:
    """Return the schema of two numbers, right and down, each from `low` to `high`."""
    item = number_schema(low, high)
    return {"type": "array", "items": item, "minItems": 2, "maxItems": 2}


_NEW_NAME: Schema = {"type": "string", "pattern": NAME, "maxLength": LONGEST_NAME}


def action_schemas(scene: Scene, may_change_objects: bool) -> dict[str, dict[str, Any]]:
    """Return the schema of each edit by its action; m, s, g, N, degrees."""
    names = {"enum": [item.name for item in scene.objects]}
    length = max(scene.size)
    place = {"enum": ["middle", "top"]}
    properties: dict[str, tuple[dict[str, Any], list[str]]] = {
        "push": ({"velocity": pair_schema(-FASTEST, FASTEST)}, ["velocity"]),
        "spin": ({"rate": number_schema(-7200, 7200)}, ["rate"]),
        "drop": ({"height": number_schema(0, 100)}, ["height"]),
        "force": (
            {
                "force": pair_schema(-1e5, 1e5),
                "start": number_schema(0, 60),
                "duration": number_schema(1e-3, 60),
                "at": place,
            },
            ["force", "duration"],
        ),
    }
    # A model that may change objects can also break the photo, so that this is an
    # option.
    if may_change_objects:
        properties["remove"] = ({}, [])
        properties["add"] = (
            {
                "shape": {"enum": ["circle", "box"]},
                "center": pair_schema(-length, 2 * length),
                "size": pair_schema(1, length),
                "mass": number_schema(1e-3, 1e6),
            },
            ["shape", "center", "size", "mass"],
        )
    schemas = {}
    for action, (values, required) in properties.items():
        if action == "add":
            target = _NEW_NAME
        else:
            target = names
        keys = {"action": {"const": action}, "object": target, **values}
        schemas[action] = object_schema(keys, ["action", "object", *required])
    return schemas


@dataclass(frozen=True)
class ProposalRules:
    """What a proposal may contain."""

    schema: Schema
    """Of a whole answer, as the model reads it."""
    outline: Schema
    """Of a whole answer, without the details of edits."""
    actions: Mapping[str, Schema]
    """Of each edit, by its action."""

    def faults(self, answer: Any) -> list[str]:
        """Return one line for each fault of the edits of an answer."""
        faults = []
        for k, edit in enumerate(answer["edits"]):
            errors = Draft202012Validator(self.actions[edit["action"]]).iter_errors(
                edit
            )
            for error in errors:
                key = error.json_path.removeprefix("$")
                faults.append(f"edits[{k}]{key}: {error.message}")
        return faults


def proposal_rules(
    scene: Scene, may_change_objects: bool, is_judge: bool
) -> ProposalRules:
    """Return what a proposal may contain.

    `is_judge`: the model also judges how near the last outcome came.
    """
    actions = action_schemas(scene, may_change_objects)
    keys: dict[str, Any] = {"reason": {"type": "string"}}
    if is_judge:
        judgement = {"nearness": number_schema(0, 1)}
    else:
        judgement = {}

    def answer_schema(edit: Schema) -> dict[str, Any]:
        edits = {"type": "array", "items": edit, "maxItems": MOST_EDITS}
        properties = keys | judgement | {"edits": edits}
        return object_schema(properties, [*keys, "edits"])

    # The first answer only names actions and objects, so that the second schema is
    # short enough for small models.
    outline = {
        "type": "object",
        "properties": {"action": {"enum": list(actions)}, "object": {"type": "string"}},
        "required": ["action", "object"],
    }
    whole = answer_schema({"oneOf": list(actions.values())})
    return ProposalRules(whole, answer_schema(outline), actions)


class UnsuitableEditError(Exception):
    """An edit that this scene does not allow; its text gives the reason."""


@dataclass
class _SceneEdits:
    """Values by dotted key, while edits are added."""

    scene: Scene
    world: World
    values: dict[str, Any]

    def body_center(self, name: str) -> tuple[float, float]:
        """Return the centre of mass of an object, px."""
        x, y = self.world.bodies[self.index(name)].center.tolist()
        return x, y

    def index(self, name: str) -> int:
        """Return the number of an object."""
        return [item.name for item in self.scene.objects].index(name)

    def free(self, name: str) -> None:
        """Let an object move."""
        item = self.scene.objects[self.index(name)]
        if item.motion is Motion.SCRIPTED:
            raise UnsuitableEditError(Note.STORY_SCRIPTED.value.format(name=name))
        if item.motion is not Motion.DYNAMIC:
            self.values[f"objects.{name}.motion"] = "dynamic"

    def forces(self) -> list[Any]:
        """Return the list of forces, which may be extended."""
        own = list(self.scene.document["forces"])
        forces: list[Any] = self.values.setdefault("forces", own)
        return forces


def scene_edits(
    scene: Scene, world: World, quiet: Mapping[str, Any], edits: Sequence[Any]
) -> dict[str, Any]:
    """Return values by dotted key for proposed edits, after the `quiet` ones.

    Raises UnsuitableEditError.
    """
    values = {key: list(v) if key == "forces" else v for key, v in quiet.items()}
    draft = _SceneEdits(scene, world, values)
    for edit in edits:
        _ADDERS[edit["action"]](draft, edit)
    return draft.values


def _push(draft: _SceneEdits, edit: Mapping[str, Any]) -> None:
    draft.free(edit["object"])
    scale = draft.scene.world.pixels_per_meter
    velocity = [round(part * scale, 1) + 0.0 for part in edit["velocity"]]
    draft.values[f"objects.{edit['object']}.velocity"] = velocity


def _spin(draft: _SceneEdits, edit: Mapping[str, Any]) -> None:
    draft.free(edit["object"])
    draft.values[f"objects.{edit['object']}.spin"] = round(edit["rate"], 1)


def _drop(draft: _SceneEdits, edit: Mapping[str, Any]) -> None:
    if draft.scene.world.view is View.TOP:
        raise UnsuitableEditError(Note.STORY_FROM_ABOVE.value)
    draft.free(edit["object"])
    name = edit["object"]
    x, y = draft.body_center(name)
    item = draft.scene.objects[draft.index(name)]
    place = [
        round(x, 2),
        round(y - edit["height"] * draft.scene.world.pixels_per_meter, 2),
    ]
    if item.place and item.place[2]:
        place.append(item.place[2])
    draft.values[f"objects.{name}.place"] = place


def _force(draft: _SceneEdits, edit: Mapping[str, Any]) -> None:
    draft.free(edit["object"])
    newton = GRAMS * draft.scene.world.pixels_per_meter
    vector = [float(f"{part * newton:.4g}") for part in edit["force"]]
    force = {"object": edit["object"], "force": vector, "duration": edit["duration"]}
    if edit.get("start"):
        force["start"] = edit["start"]
    if edit.get("at") == "top":
        body = draft.world.bodies[draft.index(edit["object"])]
        highest = min(float(ring[:, 1].min()) for ring in body.rings)
        x, y = body.center.tolist()
        force["at"] = [round(x, 1), round(y + TOP * highest, 1)]
    draft.forces().append(force)


def _remove(draft: _SceneEdits, edit: Mapping[str, Any]) -> None:
    name = edit["object"]
    for key in [key for key in draft.values if key.startswith(f"objects.{name}.")]:
        del draft.values[key]
    draft.values[f"objects.{name}"] = None
    remaining = []
    for force in draft.forces():
        if force["object"] != name:
            remaining.append(force)
    draft.values["forces"] = remaining


def _add(draft: _SceneEdits, edit: Mapping[str, Any]) -> None:
    names = [item.name for item in draft.scene.objects]
    if edit["object"] in names:
        taken = Note.STORY_NAME_TAKEN.value
        raise UnsuitableEditError(taken.format(name=quoted(edit["object"])))
    width, height = edit["size"]
    shape: dict[str, Any] = {"center": edit["center"]}
    if edit["shape"] == "circle":
        shape["radius"] = max(width, height) / 2
    else:
        shape["size"] = [width, height]
    entry = {"shape": {edit["shape"]: shape}, "mass": edit["mass"]}
    draft.values[f"objects.{edit['object']}"] = entry


_ADDERS: Mapping[str, Callable[[_SceneEdits, Mapping[str, Any]], None]] = {
    "push": _push,
    "spin": _spin,
    "drop": _drop,
    "force": _force,
    "remove": _remove,
    "add": _add,
}


def object_table(scene: Scene, world: World) -> str:
    """Return the table of objects and boundaries that the model reads."""
    scale = scene.world.pixels_per_meter
    lines = ["name | label | centre px | width x height px | mass g | motion"]
    for item, body in zip(scene.objects, world.bodies, strict=True):
        # A label with a line break would look like another row of the table.
        label = re.sub(r"\s+", " ", item.label or "")
        sizes = _size_text(body)
        motion = item.motion.name.lower()
        lines.append(f"{item.name} | {label} | {sizes} | {body.mass:.4g} | {motion}")
    lines.append(f"boundaries: {listed([wall.name for wall in world.walls], 'and')}")
    width, height = scene.size
    view = "the side; gravity points down"
    if scene.world.view is View.TOP:
        view = "above; objects lie on a table"
    lines.append(
        f"picture: {width} x {height} px, {scale:.4g} px/m, seen from {view};"
        f" {world.duration:.2g} s are simulated"
    )
    return "\n".join(lines)


def _size_text(body: Body) -> str:
    """Return the centre of a body, and its width and height, px."""
    x, y = body.center.tolist()
    points = np.concatenate(body.rings)
    width, height = np.ptp(points, axis=0).tolist()
    return f"{x:.0f}, {y:.0f} | {width:.0f} x {height:.0f}"
