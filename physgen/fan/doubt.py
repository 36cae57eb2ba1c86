"""Scene -> which of its numbers somebody guessed, and how each is spread; what a person set is certain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from physgen.fan.spread import Cone, Spread, cone, spread
from physgen.scene.model import Boundary, Motion, Object, Scene
from physgen.scene.said import Said, Source, source

PARAMETERS = ("mass", "density", "friction", "elasticity", "rolling")
"""Of objects, that are drawn."""
OF_WALLS = ("friction", "elasticity")
AT_LEAST = "lies on a slope"
"""Who says so of a friction says that it is no smaller: the thing lies still in the photo."""
VAGUE = ("", "object", "thing")
"""Labels that tell nothing of what is alike."""


@dataclass(frozen=True)
class Doubt:
    """One number that somebody guessed."""

    section: str
    """`objects` or `boundaries`."""
    thing: str
    """Name of the object or boundary."""
    parameter: str
    value: float
    """As the file has it."""
    source: Source
    spread: Spread
    label: str = ""
    """What kind of thing it is, for what is alike."""
    alike: float = 0.0
    """0..1: how much of what is open about it is open in the same way about everything of its label."""

    @property
    def path(self) -> str:
        """Where it is written."""
        return f"{self.section}.{self.thing}.{self.parameter}"


@dataclass(frozen=True)
class LightDoubt:
    """A direction of light that somebody guessed."""

    source: Source
    cone: Cone


def doubts(scene: Scene, variant: str | None = None) -> tuple[Doubt, ...]:
    """Every number that is drawn, of objects, then of boundaries; `variant` is the one that was applied."""
    said = Said(scene, variant)
    of_objects = [one for item in scene.objects for one in _of_object(scene, item, said)]
    return (*of_objects, *(one for item in scene.boundaries for one in _of_wall(scene, item, said)))


def light_doubt(scene: Scene, variant: str | None = None) -> LightDoubt | None:
    """How sure the light's direction is; None where it is certain, or where there is no light."""
    if scene.light is None or not scene.light.provenance:
        return None
    told = Said(scene, variant).of("light.direction", scene.light.provenance, told="light.from")
    found = None if told.sure is None else cone(scene.light.direction, told.sure)
    return None if found is None else LightDoubt(told, found)


def _of_object(scene: Scene, item: Object, said: Said) -> Iterator[Doubt]:
    path = f"objects.{item.name}"
    alike = _alike(scene, item, said)
    for parameter in PARAMETERS:
        value = getattr(item, parameter)
        weighs = parameter in ("mass", "density")
        if (
            value is None
            or parameter not in item.provenance
            or (weighs and item.motion is not Motion.DYNAMIC)
        ):
            continue
        told = said.of(f"{path}.{parameter}", item.provenance[parameter], told=f"{path}.from.{parameter}")
        if told.sure is None:
            continue
        at_least = parameter == "friction" and told.text == AT_LEAST
        if (found := spread(parameter, value, told.sure, at_least)) is not None:
            kind = item.label.strip().lower()
            yield Doubt("objects", item.name, parameter, value, told, found, kind, alike)


def _of_wall(scene: Scene, item: Boundary, said: Said) -> Iterator[Doubt]:
    who = scene.document["boundaries"][item.name].get("from")
    if who is None:
        return
    path = f"boundaries.{item.name}"
    for parameter in OF_WALLS:
        told = said.of(f"{path}.{parameter}", who, told=f"{path}.from")
        value = getattr(item, parameter)
        if told.sure is not None and (found := spread(parameter, value, told.sure)) is not None:
            yield Doubt("boundaries", item.name, parameter, value, told, found)


def _alike(scene: Scene, item: Object, said: Said) -> float:
    """As sure as its label is, 1 where a person said it: things of one kind are of one matter."""
    if item.label.strip().lower() in VAGUE:
        return 0.0
    who = item.provenance.get("label")
    told = said.of(f"objects.{item.name}.label", who, told=f"objects.{item.name}.from.label")
    return 1.0 if who is None or told.kind != "guess" else source(who).sure or 0.0
