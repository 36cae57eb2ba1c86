"""Part of the schema -> what a message advises to write: `write grams, e.g. 170`."""

from __future__ import annotations

from physgen.scene.schema import Schema
from physgen.scene.words import UNITS, example, listed, number


def bounds(schema: Schema) -> tuple[float, float, bool]:
    """Least and greatest value, and whether the least itself is left out."""
    open_ = "exclusiveMinimum" in schema
    least = schema["exclusiveMinimum"] if open_ else schema["minimum"]
    return least, schema["maximum"], open_


def limit(value: float) -> str:
    """A bound as a person writes it.

    >>> [limit(v) for v in (10, 0.01, 1.0e6, 1.0e15)]
    ['10', '0.01', '1000000', '1.0e15']
    """
    if value == int(value) and abs(value) < 1e9:
        return str(int(value))
    return number(value)


def measure(schema: Schema, unit: str, ranged: bool) -> str:
    """What to write for a number: `grams above 0`, `a number from 0 to 10`; the unit alone where not `ranged`."""
    least, greatest, open_ = bounds(schema)
    what = "a whole number" if schema["type"] == "integer" else "a number"
    if unit:
        what = UNITS.get(unit, unit)
        if not ranged:
            return what
    huge = greatest >= 1e9
    if open_:
        return f"{what} above {limit(least)}" + ("" if huge else f", at most {limit(greatest)}")
    if huge:
        return what if least <= -1e9 else f"{what} of at least {limit(least)}"
    return f"{what} from {limit(least)} to {limit(greatest)}"


def advice(schema: Schema) -> str:
    """What to write for a part of the schema that is missing or of the wrong kind."""
    if "enum" in schema or "const" in schema:
        return f"write {listed(example(choice) for choice in schema.get('enum', [schema.get('const')]))}"
    hint = f", e.g. {example(schema['examples'][0])}" if "examples" in schema else ""
    kind, unit = schema["type"], schema.get("x-unit", "")
    if kind in ("number", "integer"):
        return f"write {measure(schema, unit, ranged=False)}{hint}"
    if kind == "array":
        return f"write a list{f' in {UNITS.get(unit, unit)}' if unit else ''}{hint}"
    what = "a name" if "pattern" in schema else "text" if kind == "string" else "a mapping"
    return f"write {what}{hint}"
