"""The schema -> docs/scene.md, the reference of the scene file.

`python -m physgen.scene.reference > docs/scene.md` writes it, and a test fails when the two differ.
"""

from __future__ import annotations

from collections.abc import Iterator

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

_INTRO = """\
# The scene file

<!-- Written by `python -m physgen.scene.reference > docs/scene.md` from schemas/scene-1.schema.json; edit that. -->

A scene file is a photo as text that a person can edit: what is in it, what it weighs, what pushes it. It is YAML, and
every number has a unit. The origin is the centre of the photo's top-left pixel, +x points right, +y down, and a
positive angle turns +x towards +y. This one needs no photo and renders as it stands:

```yaml
{example}```

`physgen check scene.yaml` lists everything wrong with a file, each with its line, its column and what to write instead.
Editors with a YAML language server complete and check as you type when the first line is

```yaml
# yaml-language-server: $schema=photo.assets/scene-1.schema.json
```

Words mean what they say: `on`, `yes` and `1:30` are text, `1.0e6` is a number (YAML 1.2's core schema, not 1.1).
"""

_OVERLAYS = """\
## Overlays: extends, variants and --set

A scene can start from another one, name edits of itself, and be edited on the command line, in this order: what it
extends, the file, the variant, the flags. The result is checked as a whole, and a message names the file, line and
column, or the flag, that the value came from.

| overlay | written as | a mapping | a list or a single value | null |
|---|---|---|---|---|
| `extends: ../pool/scene.yaml` | a scene file | merges, key by key | replaces | takes the inherited key away |
| `variants: {{fast: {{objects.ball.spin: 90}}}}` | dotted keys | replaces | replaces | takes the key away |
| `--set objects.ball.spin=90` | one dotted key | replaces | replaces | takes the key away |

- Keys that rule each other out never meet. An overlay that sets one of {rivals}
  drops the inherited other; so it is with two kinds of shape or of mask.
- A dotted key may go through lists, counted from 0: `forces[0].impulse[1]`. A `*` stands for every key that is there,
  `[*]` for every item: `objects.*.friction`.
- The value of `--set` is YAML: `--set forces=[]`, `--set light={{direction: [0, 0, 1]}}`; without a value it takes the
  key away.
- `--variant NAME` picks a variant, `--variant all` renders each. Every variant is checked whichever is picked.
- Paths stay relative to the file that they are written in. Files can extend each other {extends} deep.
"""

_UNTRUSTED = """\
## Scene files of strangers

A scene file is data, never code, and may come from anybody. Reading one stops at the first excess:

| what | at most |
|---|---|
| size of the file | {bytes} MiB, UTF-8 |
| nesting | {depth} levels |
| keys and values | {nodes:,} |
| objects | {objects:,} |
| photo, map or canvas | {pixels} megapixels, by the header of the file, before a pixel is decoded |

- Anchors, aliases, merge keys and tags are refused, as are duplicate keys, NaN, infinities and a second document.
- The photo and the assets are {formats} files below the folder of the file that names them.
- `extends` names a {suffixes} file below the folder above the opened scene's: `../pool/scene.yaml` works,
  `../../pool/scene.yaml` does not. Symbolic links are followed before this is decided.
- `--allow-outside` lifts the rules on folders, for scenes that you trust.
"""


def markdown() -> str:
    """The reference as Markdown."""
    schema = expanded()
    groups = [group for _, part in _mappings(schema, "") for group in part.get("x-exclusive", [])]
    rivals = listed(dict.fromkeys("/".join(f"`{key}`" for key in group) for group in groups))
    parts = [_INTRO.format(example=EXAMPLE)]
    for path, part in _mappings(schema, ""):
        parts.append("\n".join(_section(path, part)) + "\n")
    parts.append(_OVERLAYS.format(rivals=rivals, extends=MAX_EXTENDS))
    parts.append(
        _UNTRUSTED.format(
            bytes=MAX_BYTES // 2**20,
            depth=MAX_DEPTH,
            nodes=MAX_NODES,
            objects=MAX_OBJECTS,
            pixels=MOST_PIXELS // 10**6,
            formats=listed({"WEBP": "WebP"}.get(name, name) for name in SCENE_FORMATS),
            suffixes=listed(f"`{suffix}`" for suffix in SUFFIXES),
        )
    )
    return "\n".join(parts)


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


if __name__ == "__main__":
    print(markdown(), end="")
