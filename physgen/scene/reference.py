"""The reference of the scene file, docs/scene.md: written from the schema by `physgen schema --markdown`."""

from __future__ import annotations

from collections.abc import Iterator
from string import Template

from physgen.files import resource
from physgen.image_formats import MOST_PIXELS, SCENE_FORMATS
from physgen.scene.document import MAX_BYTES, MAX_DEPTH, MAX_NODES, MAX_OBJECTS
from physgen.scene.files import MAX_EXTENDS, SUFFIXES
from physgen.scene.schema import Schema, expanded, measure
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


def markdown() -> str:
    """The reference as Markdown."""
    schema = expanded()
    groups = [group for _, part in _mappings(schema, "") for group in part.get("x-exclusive", [])]
    template = Template(resource("templates", "scene-reference.md").read_text(encoding="utf-8"))
    return template.substitute(
        example=EXAMPLE,
        sections="\n".join("\n".join(_section(path, part)) + "\n" for path, part in _mappings(schema, "")),
        rivals=listed(dict.fromkeys("/".join(f"`{key}`" for key in group) for group in groups)),
        extends=MAX_EXTENDS,
        bytes=MAX_BYTES // 2**20,
        depth=MAX_DEPTH,
        nodes=f"{MAX_NODES:,}",
        objects=f"{MAX_OBJECTS:,}",
        pixels=MOST_PIXELS // 10**6,
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


def _section(path: str, schema: Schema) -> Iterator[str]:
    yield f"## {f'`{path}`' if path else 'The keys of a scene'}"
    yield ""
    yield schema["description"]
    yield ""
    yield "| key | value | unit | default | meaning |"
    yield "|---|---|---|---|---|"
    for key, part in schema["properties"].items():
        default = f"`{example(part['default'])}`" if part.get("default", {}) != {} else "-"
        if key in schema.get("required", []):
            default = "required"
        value = _value(part, f"{path}.{key}" if path else key)
        meaning = f"{part['description']} E.g. `{example(part['examples'][0])}`.".replace("|", "\\|")
        yield f"| `{key}` | {value} | {part.get('x-unit', '-')} | {default} | {meaning} |"


def _value(part: Schema, path: str) -> str:
    """What may be written, in words."""
    if "const" in part:
        return f"`{part['const']}`"
    kind = part.get("type", "string")
    kinds = kind if isinstance(kind, list) else [kind]
    words = part.get("enum") or part.get("then", {}).get("enum", [])
    ways = [f"`{word}`" for word in words]
    if "boolean" in kinds:
        ways.append("`true` or `false`")
    for number in ("integer", "number"):
        if number in kinds:
            ways.append(measure({**part, "type": number}, "", ranged=True))
    if "string" in kinds and not words:
        ways.append("a name" if "pattern" in part else "text")
    if "array" in kinds:
        ways.append(_list(part, path))
    if "object" in kinds:
        ways.append(_mapping(part, path))
    return listed(ways)


def _mapping(part: Schema, path: str) -> str:
    rest = part.get("additionalProperties")
    if isinstance(rest, dict):
        return (
            f"{_link('a mapping', f'{path}.NAME')} by name" if "properties" in rest else "a mapping by name"
        )
    return _link("a mapping", path)


def _link(text: str, path: str) -> str:
    """A link to a section; the anchor is the heading in small letters without its punctuation."""
    return f"[{text}](#{''.join(c for c in path.lower() if c.isalnum() or c == '_')})"


def _list(part: Schema, path: str) -> str:
    fewest, most = part.get("minItems", 0), part.get("maxItems", 0)
    inner = part["prefixItems"][0] if "prefixItems" in part else part["items"]
    count = f"{fewest}" if fewest == most else f"at least {fewest}" if fewest > 1 else "a list of"
    if fewest + 1 == most:
        count = f"{fewest} or {most}"
    if inner["type"] == "object":
        return f"{count} {_link('mappings', f'{path}[]')}"
    return f"{count} {_items_of(inner)}"


def _items_of(inner: Schema) -> str:
    if "enum" in inner:
        return listed(f"`{word}`" for word in inner["enum"])
    if inner["type"] != "array":
        return {"integer": "whole numbers", "string": "names"}.get(inner["type"], "numbers")
    if "prefixItems" in inner:
        return "points `[x, y]`"
    deeper = inner["items"]
    return (
        f"lists of {_items_of(deeper)}"
        if deeper["type"] == "array"
        else f"knots `{example(inner['examples'][0])}`"
    )
