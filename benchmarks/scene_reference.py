"""The reference of the scene file: `python benchmarks/scene_reference.py > docs/scene.md` writes it from the schema."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from string import Template

from physgen.files import SCENE_FORMATS
from physgen.problems import Limit
from physgen.scene.files import SUFFIXES
from physgen.scene.schema import Schema, find_schema_part, load_expanded_schema, measure
from physgen.text import example, listed

EXAMPLE = """\
physgen: 1
size: [512, 512]
world: {view: side, duration: 2.0}
objects:
  ball:
    shape: {circle: {center: [120, 100], radius: 30}}
    mass: 170
    velocity: [150, 0]
  crate:
    shape: {box: {center: [330, 420], size: [60, 60], angle: 10}}
    mass: 900
boundaries:
  floor: {segment: [[0, 457], [512, 457]], friction: 0.6}
forces:
  - {object: ball, impulse: [2.0e4, 0]}
variants:
  on-the-moon: {world.gravity: [0, 162]}
"""


FORMS = {"array": "a list", "object": "a mapping", "boolean": "`true` or `false`"}


def markdown() -> str:
    """The reference as Markdown."""
    schema = load_expanded_schema()
    groups = [
        group
        for _, part in _mappings(schema, "")
        for group in part.get("x-exclusive", [])
    ]
    template = Template(
        Path(__file__).with_name("scene-reference.md").read_text(encoding="utf-8")
    )
    return template.substitute(
        example=EXAMPLE,
        sections="\n".join(
            "\n".join(_section(path, part)) + "\n" for path, part in _distinct(schema)
        ),
        rivals=listed(
            dict.fromkeys("/".join(f"`{key}`" for key in group) for group in groups)
        ),
        extends=Limit.EXTENDS.most,
        limits="\n".join(
            f"| {row.what} | {row.expected}; {row.fix} |" for row in Limit
        ),
        corners=f"{find_schema_part('objects.*.shape.polygon')['maxItems']:,}",
        formats=listed({"WEBP": "WebP"}.get(name, name) for name in SCENE_FORMATS),
        suffixes=listed(f"`{suffix}`" for suffix in SUFFIXES),
    )


def _mappings(schema: Schema, path: str) -> Iterator[tuple[str, Schema]]:
    """Every mapping that has keys of its own, with its dotted path, a name in it as NAME."""
    if schema.get("properties"):
        yield path, schema
    for key, part in schema.get("properties", {}).items():
        yield from _mappings(part, f"{path}.{key}" if path else key)
    rest = schema.get("additionalProperties")
    if isinstance(rest, dict):
        yield from _mappings(rest, f"{path}.NAME")
    if isinstance(schema.get("items"), dict):
        yield from _mappings(schema["items"], f"{path}[]")


def _distinct(schema: Schema) -> Iterator[tuple[str, Schema]]:
    """Mappings without those that an earlier one is equal to."""
    seen: list[Schema] = []
    for path, part in _mappings(schema, ""):
        if part not in seen:
            seen.append(part)
            yield path, part


def _section(path: str, schema: Schema) -> Iterator[str]:
    yield f"## {f'`{path}`' if path else 'The keys of a scene'}"
    yield ""
    yield schema["description"]
    yield ""
    yield "| key | value | meaning |"
    yield "|---|---|---|"
    for key, part in schema["properties"].items():
        default = (
            f"default `{example(part['default'])}`"
            if part.get("default", {}) != {}
            else ""
        )
        needed = "required" if key in schema.get("required", []) else ""
        value = ", ".join(
            filter(None, (_value(part), part.get("x-unit"), default, needed))
        )
        sample = f"`{example(part['examples'][0])}`"
        meaning = part["description"] + (
            f" E.g. {sample}." if sample not in value else ""
        )
        yield f"| `{key}` | {value} | " + meaning.replace("|", "\\|") + " |"


def _value(part: Schema) -> str:
    """What may be written, in words; the example shows its form."""
    words = (
        part.get("enum")
        or part.get("then", {}).get("enum", [])
        or [part[k] for k in ("const",) if k in part]
    )
    ways = [f"`{word}`" for word in words]
    kind = part.get("type", "string")
    for name in [kind] if isinstance(kind, str) else kind:
        if name in ("integer", "number") and not words:
            ways.append(measure({**part, "type": name}, "", has_range=True))
        elif name == "string" and not words:
            ways.append("a name" if "pattern" in part else "text")
        elif name in FORMS:
            ways.append(FORMS[name])
    return listed(ways)


if __name__ == "__main__":
    print(markdown(), end="")
