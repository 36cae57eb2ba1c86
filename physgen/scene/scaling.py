"""Scale a scene's data for its photo at another size: lengths in pixels are multiplied.

The origin is the centre of the top-left pixel, so that a position x becomes `factor (x
+ 1/2) - 1/2`. A length or a speed is multiplied.
"""

from __future__ import annotations

import re
from typing import Any

from physgen.scene.schema import Schema, inner, load_expanded_schema, schema_at
from physgen.text import KeyPath, pixel_power, rescaled_quantity

VIDEO_SIZE: KeyPath = ("render", "size")
"""The only length in pixels that is not of the photo."""
POSITION_KEYS = {
    *("center", "polygon", "outline", "holes", "point", "place"),
    *("segment", "polyline", "at", "attractor"),
    *("pivot", "weld", "motor", "spring", "slider", "rope", "pulley"),
    *("bezier", "center_of_mass"),
}
"""Keys with positions in px. Boxes begin at the border of a pixel."""
REGIONS = ("water", "belt", "turntable")
"""Keys with a place and lengths in one list."""
PATH_KEYS = ("path", "finger")
"""Keys of knots [s, px, px, degrees], which have no unit in the schema."""
DIGITS = 9
"""Significant digits of a scaled number: more than any estimate has."""
_KEY = re.compile(r"[^.\[\]]+")


def scale_scene(data: dict[str, Any], factor: float) -> dict[str, Any]:
    """Return a scene's plain data for a photo `factor` times as large.

    Units of the schema decide: speeds in px/s grow as lengths do, torques in g·px²/s²
    with the square, and 1 m/s stays. Keys of variants are read as paths.
    """
    scaled_data: dict[str, Any] = _scale(data, load_expanded_schema(), "", (), factor)
    variants = data.get("variants")
    if isinstance(variants, dict):
        scaled_data["variants"] = {
            name: _scaled_variant(edits, factor) for name, edits in variants.items()
        }
    return scaled_data


def scale_part(value: Any, path: KeyPath, factor: float) -> Any:
    """Return the value at a path of a scene for a photo `factor` times as large."""
    unit, parent_path = "", path
    # A list has the unit of its numbers.
    while parent_path and isinstance(parent_path[-1], int):
        parent_path = parent_path[:-1]
    schema = schema_at(path)
    for candidate in (schema, schema_at(parent_path)):
        unit = unit or (candidate or {}).get("x-unit", "")
    if schema is None:
        return value
    return _scale(value, schema, unit, path, factor)


def _scaled_variant(edits: Any, factor: float) -> Any:
    """Return the scaled edits of a variant. Their keys are dotted paths."""
    if not isinstance(edits, dict):
        return edits
    return {
        key: scale_part(value, _path_of(str(key)), factor)
        for key, value in edits.items()
    }


def _path_of(key: str) -> KeyPath:
    """Split the key of an edit: `objects.*.velocity.0` or `forces[0].at`."""
    parts = _KEY.findall(key)
    return tuple(int(part) if part.isdecimal() else part for part in parts)


def _scale(value: Any, schema: Schema, unit: str, path: KeyPath, factor: float) -> Any:
    # A bool is an int in Python.
    if path == VIDEO_SIZE or isinstance(value, bool):
        return value
    if isinstance(value, dict):
        return {
            key: _scaled_child(child, schema, "", (*path, str(key)), factor)
            for key, child in value.items()
        }
    if isinstance(value, list):
        return [
            _scaled_child(child, schema, unit, (*path, index), factor)
            for index, child in enumerate(value)
        ]
    if isinstance(value, str) and unit:
        return rescaled_quantity(value, factor)
    if not isinstance(value, int | float):
        return value
    if _is_position(unit, path):
        # The photo's border, half a pixel before 0, is the fixed point.
        return _round_estimate(factor * (value + 0.5) - 0.5, value)
    # Torques have px²: the power of px in the unit decides.
    power = 0
    if unit:
        power = pixel_power(unit)
    if power == 0:
        return value
    return _round_estimate(value * factor**power, value)


def _is_position(unit: str, path: KeyPath) -> bool:
    """Return whether the number at a path is an x or a y in px."""
    names = []
    for key in path:
        if isinstance(key, str):
            names.append(key)
    if names and names[-1] in PATH_KEYS:
        return path[-1] in (1, 2)
    if names and names[-1] in REGIONS:
        # A corner or a centre, then lengths.
        return path[-1] in (0, 1)
    return unit == "px" and bool(names) and names[-1] in POSITION_KEYS


def _round_estimate(value: float, before: float) -> float:
    """Return a value with the digits of an estimate. An integer stays one if
    possible.
    """
    rounded = float(f"{value:.{DIGITS}g}")
    is_whole = isinstance(before, int) and rounded.is_integer()
    if is_whole:
        return int(rounded)
    return rounded


def _scaled_child(
    value: Any, schema: Schema, unit: str, path: KeyPath, factor: float
) -> Any:
    """Return a scaled value of a mapping or a list, with its own unit or the list's."""
    child_schema = inner(schema, path[-1])
    if child_schema is None:
        return value
    return _scale(value, child_schema, child_schema.get("x-unit", unit), path, factor)
