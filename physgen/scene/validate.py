"""Check a scene document against the JSON Schema. Every problem has its line and its
fix.

The library `jsonschema` finds the faults. This module turns each error into a message
with place, value and fix, in the words of the schema. The library is not imported for
scenes accepted by a quick test.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any

from physgen.messages import Message, did_you_mean, one_of
from physgen.problems import Place, Problem, RefusedError
from physgen.scene.document import Node, to_plain_data
from physgen.scene.overlay import NAMED, kind_of
from physgen.scene.schema import (
    Schema,
    advice,
    bounds,
    find_schema_part,
    inner,
    limit,
    load_expanded_schema,
    measure,
    parents,
)
from physgen.scene.schema_tests import quick_check, schema_validator
from physgen.scene.slips import has_decimal_comma, meant_list, meant_number
from physgen.scene.slips import normalize_text as plain_text
from physgen.text import (
    ALLOWED,
    UNITS,
    KeyPath,
    add_space,
    counted,
    dotted,
    example,
    listed,
    nearest,
    number,
    quoted,
    shown,
    similarity,
)

if TYPE_CHECKING:
    from jsonschema import ValidationError


MAX_PROBLEMS = 200
"""Maximum number of messages for one file; nobody reads more."""
MAX_ERRORS = 10 * MAX_PROBLEMS
"""Maximum number of errors of one part of the file: several can lead to the same
message.
"""


class TooManyError(Exception):
    """A file has more than MAX_PROBLEMS problems."""


class Findings:
    """Collects problems and the faulty parts of the tree."""

    def __init__(self) -> None:
        self.problems: dict[Problem, None] = {}
        self._texts: dict[Place, set[tuple[str, ...]]] = {}
        self.bad: set[Node] = set()

    def report(self, problem: Problem) -> None:
        """Add a problem, without repetitions at one place. Raise TooManyError after
        MAX_PROBLEMS.
        """
        place = problem.place
        key = problem.path.rpartition(".")[2]
        text = key, problem.found, problem.expected, problem.fix
        # One wrong key with a star reaches many objects, but is one mistake.
        if text in self._texts.setdefault(place, set()):
            return
        if len(self.problems) >= MAX_PROBLEMS:
            self.problems[Message.TOO_MANY_PROBLEMS.problem(place)] = None
            raise TooManyError
        self._texts[place].add(text)
        self.problems[problem] = None

    def value(self, node: Node, path: KeyPath, refusal: RefusedError) -> None:
        """Report the problem of a value. A value that an overlay wrote into many
        objects is reported once.
        """
        if node not in self.bad:
            self.bad.add(node)
            if node.text is None:
                value_text = shown(node.value)
            else:
                value_text = quoted(node.text)
            self.report(refusal.problem(node.place, dotted(path), value_text))


def check_schema(root: Node, findings: Findings) -> None:
    """Report every violation of the schema in a tree."""
    check_part(root, (), "", findings, shallow=True)
    if not isinstance(root.value, dict):
        return
    properties = load_expanded_schema()["properties"]
    for key, node in root.value.items():
        if key in NAMED and isinstance(node.value, dict):
            check_part(node, (key,), key, findings, shallow=True)
            for name, entry in node.value.items():
                check_part(entry, (key, name), f"{key}.*", findings)
        elif key in properties:
            check_part(node, (key,), key, findings)


def check_part(
    node: Node,
    path: KeyPath,
    schema_path: str,
    findings: Findings,
    shallow: bool = False,
) -> None:
    """Report the violations in one part of the tree. `shallow` checks only the keys of
    a mapping.
    """
    # Values of a mapping are checked one by one, so that each has its own errors.
    data: Any
    if isinstance(node.value, dict) and shallow:
        data = dict.fromkeys(node.value)
    else:
        data = to_plain_data(node)
    if quick_check(schema_path, shallow)(data):
        return
    # Only a wrong part pays for the full validator, which is much slower than the quick
    # check.
    validator = schema_validator(schema_path, shallow)
    errors = list(islice(validator.iter_errors(data), MAX_ERRORS))
    for error in _without_consequences(errors):
        _Fault(error, node, path, find_schema_part(schema_path)).report(findings)


def _without_consequences(
    errors: Sequence[ValidationError],
) -> Iterator[ValidationError]:
    """Yield the errors without those that repeat or follow from another one."""
    # A list of the wrong length needs no messages about its items.
    list_paths = []
    for error in errors:
        if error.validator in ("minItems", "maxItems"):
            list_paths.append(tuple(error.path))
    point_lists: set[tuple[str | int, ...]] = set()
    for error in errors:
        path = tuple(error.path)
        if any(len(path) > len(p) and path[: len(p)] == p for p in list_paths):
            continue
        # Numbers in a list of points: one message about the first number is enough.
        if _is_number_for_point(error):
            if path[:-1] in point_lists:
                continue
            point_lists.add(path[:-1])
        yield error


def _is_number_for_point(error: ValidationError) -> bool:
    """Return whether an item of a list is a number in place of a point."""
    if error.validator != "type" or error.validator_value != "array":
        return False
    is_item = bool(error.path) and isinstance(error.path[-1], int)
    return is_item and isinstance(error.instance, int | float)


class _Fault:
    """One error of jsonschema, with its node and its part of the schema."""

    def __init__(
        self, error: ValidationError, node: Node, path: KeyPath, schema: Schema
    ) -> None:
        self.error = error
        self.chain = [node]
        self.path: KeyPath = (*path, *error.path)
        self.unit = schema.get("x-unit", "")
        for key in error.path:
            content: Any = node.value
            node = content[key]
            self.chain.append(node)
            schema = inner(schema, key) or {}
            # Items of a list have the unit of the list.
            self.unit = schema.get("x-unit", self.unit if isinstance(key, int) else "")
        self.node, self.schema = node, schema
        kinds = schema.get("type", "")
        self.kinds: list[str] = [kinds] if isinstance(kinds, str) else kinds
        if "examples" in schema:
            self.hint = f", e.g. {example(schema['examples'][0])}"
        else:
            self.hint = ""

    def report(self, findings: Findings) -> None:
        """Report the message, and mark the values that other rules cannot use."""
        keyword = str(self.error.validator)
        # Such an error is about a key and not about its value.
        if "propertyNames" in self.error.schema_path:
            self._name(findings)
        elif keyword == "additionalProperties":
            self._unknown(findings)
        else:
            _MESSAGES[keyword](self, findings)
            findings.bad.update(self.chain)

    def _type(self, findings: Findings) -> None:
        """Report a value with a type outside the schema's."""
        value, kinds = self.node.value, self.kinds
        # A wrong type is also a wrong choice, and the list of choices is the better
        # advice.
        if "enum" in self.schema:
            return self._choice(findings)
        may_be_list = "array" in kinds
        if "object" in kinds and (len(kinds) == 1 or may_be_list):
            kind, fix = "a mapping", self._mapping_fix()
        elif len(kinds) > 1 and not ("integer" in kinds and type(value) is float):
            refusal = Message.NO_WAY_FITS.refusal(ways=listed(self._ways()))
            return findings.value(self.node, self.path, refusal)
        elif may_be_list:
            kind, fix = self._list_fix()
        elif "boolean" in kinds:
            if isinstance(value, str):
                word = BOOLEAN_WORDS.get(value.lower())
            else:
                word = None
            kind, fix = "true or false", f"write {word or 'true or false'}"
        elif "string" in kinds:
            kind, fix = "text", self._text_fix()
        else:
            return self._not_a_number(findings)
        refusal = Message.WRONG_TYPE.refusal(kind=kind, fix=fix)
        return findings.value(self.node, self.path, refusal)

    def _mapping_fix(self) -> str:
        """Return the fix for a value in place of a mapping."""
        value = self.node.value
        if value is None:
            mapping = advice({**self.schema, "type": "object"})
            return f"{mapping}, or indent its keys below it"
        if isinstance(value, str):
            spaced_text = add_space(value)
        else:
            spaced_text = None
        return spaced_text or advice({**self.schema, "type": "object"})

    def _list_fix(self) -> tuple[str, str]:
        """Return the kind of a list, and the fix for a value in its place."""
        item_name, count = self._count()
        kind = f"a list of {count}"
        meaning = self._meant_list(item_name)
        if meaning:
            return kind, f"write {meaning}"
        return kind, f"write {kind}{self._in_unit(item_name)}{self.hint}"

    def _text_fix(self) -> str:
        """Return the fix for a value in place of text."""
        value = self.node.value
        if isinstance(value, int | float):
            return f'write it in quotes: "{shown(value)}"'
        return f"write text{self.hint}"

    def _not_a_number(self, findings: Findings) -> None:
        """Report a value in place of a number, with the intended number."""
        value = self.node.value
        # The fix is the intended number, if the value contains one.
        kind = "a number"
        if "integer" in self.kinds:
            kind = "a whole number"
        if isinstance(value, str):
            meaning = meant_number(value, self.unit)
        else:
            meaning = None
        if meaning and has_decimal_comma(str(value)):
            refusal = Message.DECIMAL_COMMA.refusal(number=meaning)
            return findings.value(self.node, self.path, refusal)
        if meaning:
            fix = f"write {meaning}"
            fix += ", without quotes" if meaning == value else ""
        else:
            form = measure(
                self._numeric(), self.unit, has_range=isinstance(value, float)
            )
            fix = f"write {form}{self._units()}{self.hint}"
        refusal = Message.WRONG_TYPE.refusal(kind=kind, fix=fix)
        return findings.value(self.node, self.path, refusal)

    def _meant_list(self, noun: str) -> str | None:
        """Return the intended list of a text, or None for another text."""
        value = self.node.value
        if not isinstance(value, str):
            return None
        if noun == "names":
            names = list(map(plain_text, value.split(",")))
            is_names = all(re.fullmatch(r"[A-Za-z][\w-]*", name) for name in names)
            if is_names:
                return f"[{', '.join(names)}]"
            return None
        if noun in ("numbers", "whole numbers"):
            return meant_list(value)
        return None

    def _ways(self) -> list[str]:
        """Return the accepted words, numbers, keys or lists of a part with several
        types.
        """
        words = self.schema.get("then", {}).get("enum", [])
        ways = [*words]
        if "boolean" in self.kinds:
            ways += ["true", "false"]
        ways = ways or ["a whole number"]
        keys = [f"{{{key}: ...}}" for key in self.schema.get("properties", {})]
        return ways + (keys or [f"{self.schema['minItems']} numbers"])

    def _numeric(self) -> Schema:
        (kind,) = (kind for kind in self.kinds if kind in ("integer", "number"))
        return {**self.schema, "type": kind}

    def _count(self) -> tuple[str, str]:
        """Return the noun of a list's items, `points`, and with their number, `2
        points`.
        """
        part = inner(self.schema, 0) or {}
        kinds = {
            "number": "numbers",
            "integer": "whole numbers",
            "array": "points",
            "object": "mappings",
        }
        item_name = kinds.get(
            part.get("type", ""), "names" if part.get("type") == "string" else "values"
        )
        minimum = self.schema.get("minItems", 0)
        maximum = self.schema.get("maxItems")
        return item_name, f"{minimum} {item_name}" if minimum == maximum else item_name

    def _in_unit(self, noun: str) -> str:
        if self.unit and noun != "mappings":
            return f" in {UNITS.get(self.unit, self.unit)}"
        return ""

    def _units(self) -> str:
        """Return the units for texts at this place."""
        auto = ""
        if self.path == ("world", "duration"):
            auto = ", or auto"
        if self.unit in ALLOWED:
            return f", or a number with {ALLOWED[self.unit]} behind it{auto}"
        return ""

    def _choice(self, findings: Findings) -> None:
        value, schema = self.node.value, self.schema
        if "const" in schema:
            version = example(schema["const"])
            refusal = Message.UNKNOWN_VERSION.refusal(version=version)
        elif "then" in schema:
            words = schema["then"]["enum"]
            close = nearest(str(value), [*words, *schema.get("properties", {})])
            fix = f"write {listed(self._ways())}"
            if close is not None and close in words:
                fix = did_you_mean(close)
            refusal = Message.UNKNOWN_WORD.refusal(fix=fix)
        else:
            names = list(map(example, schema["enum"]))
            fix = f"write {listed(names)}"
            if isinstance(value, str) and value in names:
                fix = f"write {value}, without quotes"
            elif isinstance(value, str):
                fix = one_of(value, names)
            unknown = Message.UNKNOWN_CHOICE
            refusal = unknown.refusal(choices=listed(names), fix=fix)
        findings.value(self.node, self.path, refusal)

    def _range(self, findings: Findings) -> None:
        schema = self._numeric()
        value = self.node.value
        assert isinstance(value, int | float)
        # Name the limit that the value violates, and not the whole range twice.
        lowest, greatest, _ = bounds(schema)
        if value > greatest:
            side, limit_text = "above", limit(greatest)
        else:
            side = "below"
            if value == lowest:
                side = "not above"
            limit_text = limit(lowest)
        fix = measure(schema, self.unit, has_range=True)
        if value > greatest and limit(greatest) not in fix:
            fix = f"{measure(schema, self.unit, has_range=False)} of at most {limit(greatest)}"
        fix = f"write {fix}{self.hint}"
        # A tiny length in px is probably in metres.
        if self.unit == "px" and 0 < value < lowest and self.node.text is None:
            fix += f"; did you mean meters? write {number(value)} m"
        refusal = Message.OUT_OF_RANGE.refusal(side=side, bound=limit_text, fix=fix)
        findings.value(self.node, self.path, refusal)

    def _text(self, findings: Findings) -> None:
        value = str(self.node.value)
        schema = self.schema
        if self.error.validator == "maxLength":
            maximum = schema["maxLength"]
            refusal = Message.TEXT_TOO_LONG.refusal(length=len(value), most=maximum)
        elif self.error.validator == "minLength":
            refusal = Message.TEXT_EMPTY.refusal(example=self.hint)
        else:
            fix = f"write {schema['x-pattern']}{self.hint}"
            refusal = Message.NOT_A_NAME.refusal(fix=fix)
        findings.value(self.node, self.path, refusal)

    def _length(self, findings: Findings) -> None:
        item_name, _ = self._count()
        items = self.node.value
        assert isinstance(items, list)
        minimum = self.schema.get("minItems", 0)
        maximum = self.schema.get("maxItems")
        if len(items) < minimum:
            limit_count = minimum
        else:
            limit_count = maximum
        if minimum == maximum:
            quantifier = ""
        else:
            quantifier = "at most "
            if limit_count == minimum:
                quantifier = "at least "
        if limit_count != 1:
            noun = item_name
        else:
            noun = item_name.removesuffix("s")
        fix = f"write {quantifier}{limit_count} {noun}{self._in_unit(item_name)}{self.hint}"
        if len(items) == 1:
            item_text = items[0].value
        else:
            item_text = None
        # A single text such as "1 2" can hold all numbers of a list.
        if isinstance(item_text, str):
            meaning = meant_list(item_text)
        else:
            meaning = None
        if meaning:
            fix = f"write {meaning}, with a comma between"
        count = counted(len(items), "item")
        problem = Message.LIST_LENGTH.problem(
            self.node.place, self.path, items=count, fix=fix
        )
        findings.report(problem)

    def _report_missing_keys(self, findings: Findings) -> None:
        value = self.node.value
        assert isinstance(value, dict)
        # A misspelt key has a message of its own, which names the missing one.
        misspelt = misspelt_keys(value, self.schema["properties"])
        for key in self.schema["required"]:
            if key not in value and key not in misspelt:
                fix = advice(self.schema["properties"][key])
                key_path = (*self.path, key)
                message = Message.IS_MISSING
                findings.report(message.problem(self.node.place, key_path, fix=fix))

    def _report_key_count(self, findings: Findings) -> None:
        value = self.node.value
        parts = self.schema.get("properties", {})
        assert isinstance(value, dict)
        if not parts:
            maximum = self.schema["maxProperties"]
            refusal = Message.TOO_MANY_KEYS.refusal(count=len(value), most=maximum)
        elif all(key in parts for key in value):
            content = "is empty"
            if value:
                content = f"has {listed(value, 'and')}"
            kinds = listed(parts)
            refusal = Message.NOT_ONE_KEY.refusal(content=content, kinds=kinds)
        else:
            # The message about the unknown key is enough.
            return
        findings.report(refusal.problem(self.node.place, dotted(self.path)))

    def _name(self, findings: Findings) -> None:
        key = str(self.error.instance)
        names = self.schema["propertyNames"]
        assert isinstance(self.node.value, dict)
        fix = f"write {names['x-pattern']}, e.g. {example(names['examples'][0])}"
        # No-break spaces come from web pages and are invisible.
        if "\u00a0" in key:
            fix = "write plain spaces in place of no-break spaces"
        place = self.node.value[key].key_place
        key_path = (*self.path, key)
        findings.report(
            Message.NOT_A_NAME.problem(place, key_path, quoted(key), fix=fix)
        )

    def _unknown(self, findings: Findings) -> None:
        value = self.node.value
        known_keys = list(self.schema["properties"])
        assert isinstance(value, dict)
        # Every unknown key has its own fix: the key may be misspelt, or belong to
        # another section.
        for key, child in value.items():
            if key in known_keys:
                continue
            fix = self._fix_of_key(key, value)
            key_path = (*self.path, key)
            unknown = Message.UNKNOWN_KEY
            findings.report(unknown.problem(child.key_place, key_path, fix=fix))
            findings.bad.add(child)
        # Without exactly one kind, no other rule can use the entry.
        if (
            self.schema.get("maxProperties") == 1
            and sum(key in known_keys for key in value) != 1
        ):
            findings.bad.update(self.chain)

    def _fix_of_key(self, key: str, siblings: dict[str, Node]) -> str:
        """Return the replacement for an unknown key."""
        spaced_text = add_space(key)
        if spaced_text is not None:
            return spaced_text
        # A key below an empty one often has too little indentation.
        parent_key = _empty_above(key, siblings)
        if parent_key is not None and inner(self.schema, parent_key):
            return f"indent it by two spaces more, so that it belongs to {parent_key}"
        known_keys = list(self.schema["properties"])
        kinds = self._missing_kinds(siblings)
        # Users of other engines write their names.
        aliases = _ALIASES.get(dotted(kind_of(self.path)), {})
        alias = aliases.get(key.replace("-", "_").lower())
        homes = parents().get(key, ())
        if alias:
            return did_you_mean(alias)
        close, likeness = _nearest_key(key, known_keys)
        # A key of another section, unless a key of this one is almost equal.
        if homes and likeness < SURE:
            return f"it belongs to {listed(self._nearest_of(homes))}"
        if kinds:
            close, likeness = _nearest_key(key, kinds)
        if close and (not kinds or likeness >= SURE):
            return did_you_mean(close)
        # At the top of the file, a key of a section may also be misspelt.
        if not kinds and not self.path:
            parent, likeness = _nearest_key(key, parents())
            if parent and likeness >= SURE:
                home = listed(self._nearest_of(parents()[parent]))
                return f"{did_you_mean(parent)} it belongs to {home}"
        return f"write {listed(islice(kinds or known_keys, 30))}"

    def _nearest_of(self, homes: Iterable[str]) -> list[str]:
        """Return names of mappings, preferably of those below this one."""
        prefix = f"{dotted(kind_of(self.path))}.".replace("*", "NAME")
        homes_within = []
        for home in homes:
            if home.startswith(prefix):
                homes_within.append(home)
        return [home or "the top level of the file" for home in homes_within or homes]

    def _missing_kinds(self, siblings: dict[str, Node]) -> list[str]:
        """Return the possible kinds of a joint, field or force without a kind."""
        if not self.path or self.path[0] not in ("joints", "fields", "forces"):
            return []
        if len(self.path) != 2:
            return []
        (kinds,) = self.schema["x-exclusive"]
        if any(kind in siblings for kind in kinds):
            return []
        return list(kinds)


def _nearest_key(key: str, names: Iterable[str]) -> tuple[str | None, float]:
    """Return the most similar of several names, or None, and its similarity."""
    close = nearest(key, names)
    return close, similarity(key, close or "")


def _empty_above(key: str, siblings: dict[str, Node]) -> str | None:
    """Return the previous key, if it has no value."""
    keys = list(siblings)
    number = keys.index(key)
    if number == 0:
        return None
    parent_key = keys[number - 1]
    if siblings[parent_key].value is None:
        return parent_key
    return None


def misspelt_keys(keys: Iterable[str], known_keys: Iterable[str]) -> set[str | None]:
    """Return the known keys that are probably meant by unknown ones."""
    known_keys = list(known_keys)
    return {nearest(key, known_keys) for key in keys if key not in known_keys}


SURE = 0.8
"""Minimum similarity of two words to count as a misspelling, even if the word is a key
elsewhere: `force` for `forces` is 0.91.
"""


_ALIASES: dict[str, dict[str, str]] = {
    "objects.*": {
        **dict.fromkeys(("restitution", "bounciness", "bounce"), "elasticity"),
        **dict.fromkeys(("angular_velocity", "angular_speed", "omega"), "spin"),
        **dict.fromkeys(("fixed", "static", "pinned", "is_static"), "motion: static"),
        **dict.fromkeys(("gravity_scale", "g"), "world.gravity"),
        **dict.fromkeys(("position", "rotation"), "place"),
        "weight": "mass",
        "speed": "velocity",
        "rolling_friction": "rolling",
        "name": "label",
    },
    "objects.*.shape": {
        **dict.fromkeys(("rectangle", "rect", "square"), "box"),
        **dict.fromkeys(("disc", "disk", "ball", "sphere"), "circle"),
    },
    "objects.*.shape.circle": {"r": "radius"},
    "objects.*.shape.box": dict.fromkeys(("width", "height", "w", "h"), "size"),
    "forces[0]": {"push": "impulse"},
    "boundaries.*": {"line": "segment", "points": "polyline"},
    "joints.*": {
        **dict.fromkeys(("hinge", "pin", "revolute"), "pivot"),
        **dict.fromkeys(("fixed", "glue"), "weld"),
        "bodies": "objects",
    },
}
"""Kind of mapping -> names in other engines -> our names."""
BOOLEAN_WORDS = {
    "yes": "true",
    "on": "true",
    "y": "true",
    "no": "false",
    "off": "false",
    "n": "false",
}
"""Words for true and false in YAML 1.1, which YAML 1.2 reads as text."""
_MESSAGES: dict[str, Callable[[_Fault, Findings], None]] = {
    "type": _Fault._type,
    "const": _Fault._choice,
    "enum": _Fault._choice,
    "minimum": _Fault._range,
    "maximum": _Fault._range,
    "exclusiveMinimum": _Fault._range,
    "minLength": _Fault._text,
    "maxLength": _Fault._text,
    "pattern": _Fault._text,
    "minItems": _Fault._length,
    "maxItems": _Fault._length,
    "required": _Fault._report_missing_keys,
    "minProperties": _Fault._report_key_count,
    "maxProperties": _Fault._report_key_count,
}
"""Keyword of the schema -> message about its violation."""
