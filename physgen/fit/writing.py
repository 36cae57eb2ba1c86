"""Write a fitted scene: the user's file with the estimates, and their intervals in `from`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from math import degrees, exp, hypot, log
from pathlib import Path
from typing import Any

from physgen.fit.intervals import INTERVAL, Estimate, Fit
from physgen.fit.parameters import Kind, odds
from physgen.scene.scene import Motion, Scene
from physgen.scene.yaml_edit import mark_values, write
from physgen.simulate.uncertain_values import POWERS
from physgen.text import rounded

DIGITS = 4
"""Significant digits of numbers in a scene."""
PATHS = ("image", "assets", "extends")
"""Keys of paths relative to the scene file."""


def shown_value(estimate: Estimate, scene: Scene, value: float) -> float:
    """Return a value in the units of the scene file: degrees, g or g/px²."""
    kind = estimate.parameter.kind
    if kind in (Kind.SPIN, Kind.DIRECTION):
        return degrees(value)
    if kind is Kind.MASS:
        item = scene.objects[estimate.parameter.index]
        # The parameter of a mass is its factor.
        if item.mass is not None:
            return item.mass * value
        return (item.density or 1.0) * value
    return value


def interval_text(estimate: Estimate, scene: Scene) -> str:
    """Return the interval of an estimate as text: 0.31 to 0.36."""
    low = shown_value(estimate, scene, estimate.low)
    high = shown_value(estimate, scene, estimate.high)
    return f"{rounded(low, DIGITS)} to {rounded(high, DIGITS)}"


def interval_confidence(estimate: Estimate) -> float | None:
    """Return the confidence with the spread of the interval.

    `physgen render --fan` draws values by this confidence. Returns None for kinds without
    a spread.
    """
    kind = estimate.parameter.kind
    power = POWERS.get(kind.value)
    if power is None:
        return None
    if kind is Kind.ELASTICITY:
        width = odds(estimate.high) - odds(estimate.low)
    else:
        width = log(estimate.high) - log(estimate.low)
    sigma = max(width, 0.0) / (2 * INTERVAL.quantile)
    return round(exp(-sigma / power), 3)


def source_text(estimate: Estimate, scene: Scene) -> str:
    """Return the entry of `from`: fit 0.31 to 0.36, and a confidence or the unit.

    The unit keeps a number at the end from being read as a confidence.
    """
    text = f"fit {interval_text(estimate, scene)}"
    confidence = interval_confidence(estimate)
    if confidence is None:
        return f"{text} {unit(estimate, scene)}"
    return f"{text}, {confidence:g}"


def fitted_text(
    text: str, source: Path, output: Path, scene: Scene, fit: Fit, origin: str
) -> str:
    """Return the text of the fitted scene, made from the text of the file `source`.

    Comments stay. `scene` has the values before; `origin` is the name of the clip.
    """
    data: dict[str, Any] = mark_values(text).data()
    _move_paths(data, source, output)
    objects = data.setdefault("objects", {})
    for item, fitted in zip(scene.objects, fit.scene.objects, strict=True):
        if item.motion is Motion.DYNAMIC and fitted.velocity != item.velocity:
            entry = objects.setdefault(item.name, {})
            entry["velocity"] = list(map(_round_number, fitted.velocity))
        if item.motion is Motion.DYNAMIC and fitted.spin != item.spin:
            objects.setdefault(item.name, {})["spin"] = _round_number(fitted.spin)
    if fit.scene.world.ramp != scene.world.ramp:
        data.setdefault("world", {})["ramp"] = _round_number(fit.scene.world.ramp)
    for estimate in fit.estimates:
        if estimate.is_determined:
            _write_estimate(data, estimate, scene, fit)
    notes = [
        f"{estimate.parameter.path} {interval_text(estimate, scene)}"
        for estimate in fit.estimates
        if estimate.is_determined and estimate.parameter.index < 0
    ]
    heading = f"# Fitted to {origin}; 90 % intervals are in `from`.\n"
    if notes:
        heading += f"# {'; '.join(notes)}\n"
    return heading + write(text, data)


def paths_outside(text: str, source: Path, output: Path) -> list[str]:
    """Return the paths of a scene too far outside the folder of `output`.

    A scene may extend a file in the folder above its own.
    """
    data: dict[str, Any] = mark_values(text).data()
    home = output.parent.resolve()
    roots = {"image": home, "assets": home, "extends": home.parent}
    paths = []
    for key in PATHS:
        path = data.get(key)
        if not isinstance(path, str):
            continue
        if not (source.parent / path).resolve().is_relative_to(roots[key]):
            paths.append(path)
    return paths


def _move_paths(data: dict[str, Any], source: Path, output: Path) -> None:
    """Make the paths of a scene relative to the folder of `output`."""
    folder = source.parent.resolve()
    target = output.parent.resolve()
    if folder == target:
        return
    for key in PATHS:
        if isinstance(data.get(key), str):
            path = os.path.relpath(folder / data[key], target)
            data[key] = Path(path).as_posix()


def _round_number(value: float) -> float:
    """Return a number of few digits."""
    return float(f"{value:.{DIGITS + 1}g}") + 0.0


def _write_estimate(
    data: dict[str, Any], estimate: Estimate, scene: Scene, fit: Fit
) -> None:
    """Write one estimate and its interval."""
    parameter = estimate.parameter
    if parameter.index < 0:
        _write_world(data.setdefault("world", {}), estimate, fit)
        return
    item = scene.objects[parameter.index]
    entry = data["objects"].setdefault(item.name, {})
    sources = entry.setdefault("from", {})
    key = parameter.kind.value
    if parameter.kind is Kind.MASS and item.mass is None:
        key = "density"
    text = source_text(estimate, scene)
    if parameter.kind is Kind.VELOCITY:
        # The two components share one entry.
        previous = str(sources.get(key, ""))
        if parameter.component and previous.startswith("fit"):
            text = f"{previous}, {text}"
        sources[key] = text
        return
    sources[key] = text
    if parameter.kind is Kind.FRICTION and item.static_friction is not None:
        # A base or a `*` may have another value.
        entry["static_friction"] = _round_number(estimate.value)
    if parameter.kind is not Kind.SPIN:
        entry[key] = _round_number(shown_value(estimate, scene, estimate.value))


def _write_world(world: dict[str, Any], estimate: Estimate, fit: Fit) -> None:
    """Write an estimate of the world."""
    if estimate.parameter.kind is Kind.TABLE:
        world["table"] = {
            **(world.get("table") or {}), "friction": _round_number(estimate.value)
        }  # fmt: skip
        return
    world["gravity"] = list(map(_round_number, fit.scene.world.gravity))


def gravity_size(fit: Fit) -> float:
    """Return the size of the fitted gravity, m/s²."""
    return hypot(*fit.scene.world.gravity) / fit.scene.world.pixels_per_meter


def unit(estimate: Estimate, scene: Scene) -> str:
    """Return the unit of an estimate as the report shows it."""
    units: Mapping[Kind, str] = {
        Kind.VELOCITY: "px/s",
        Kind.SPIN: "degrees/s",
        Kind.DIRECTION: "degrees, 90 is down",
        Kind.GRAVITY: "px/s²",
        Kind.MASS: "g",
    }
    kind = estimate.parameter.kind
    if kind is Kind.MASS and scene.objects[estimate.parameter.index].mass is None:
        return "g/px²"
    return units.get(kind, "")
