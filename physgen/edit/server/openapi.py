"""The interface, told in OpenAPI 3.1: what each address takes and gives."""

from __future__ import annotations

from functools import cache
from typing import Any

from physgen.edit.server.guard import TOKEN
from physgen.edit.server.limits import MAX_KEY, MAX_OPS, MAX_STEPS, MAX_WORDS, RESOLVED

Part = dict[str, Any]

TEXT: Part = {"type": "string"}
WORDS: Part = {"type": ["string", "null"], "maxLength": MAX_WORDS}
WHOLE: Part = {"type": "integer", "minimum": 0, "maximum": 2**53 - 1}
LINE: Part = {"type": ["integer", "null"], "minimum": 0}
ANY: Part = {"type": "object"}
MAYBE: Part = {"type": ["object", "null"]}


def ref(name: str) -> Part:
    """A schema by its name."""
    return {"$ref": f"#/components/schemas/{name}"}


def record(required: Part, further: Part | None = None, closed: bool = False) -> Part:
    """A mapping with these keys."""
    made: Part = {"type": "object", "required": list(required), "properties": {**required, **(further or {})}}
    return made | {"additionalProperties": False} if closed else made


def listed(items: Part, most: int | None = None) -> Part:
    """A list of such."""
    return {"type": "array", "items": items} | ({} if most is None else {"maxItems": most})


ASKED: Part = {"version": WHOLE}
BESIDE: Part = {
    "variant": WORDS,
    "what": WORDS,
    "tag": WORDS,
    "id": {"type": ["string", "null"], "maxLength": 64},
}

STEP: Part = {
    "anyOf": [{"type": "string", "maxLength": MAX_KEY}, {"type": "integer", "minimum": 0, "maximum": 10**6}]
}
PATH: Part = listed(STEP, MAX_STEPS) | {"minItems": 1}
SAID: Part = {"severity": {"enum": ["error", "warning"]}, "message": TEXT, "fix": TEXT, "path": TEXT}

SCHEMAS: Part = {
    "Op": {
        "description": "One operation; a path is a list of keys and of numbers of items, from 0.",
        "anyOf": [
            record({"set": PATH, "value": {}}, closed=True),
            record({"unset": PATH}, closed=True),
            record({"add": PATH, "value": {}}, closed=True),
            record({"rename": PATH, "to": TEXT}, closed=True),
            record({"remove": PATH}, closed=True),
        ],
    },
    "Problem": record(SAID, {"line": LINE, "column": LINE, "object": {"type": ["string", "null"]}}),
    "Error": record(
        {"error": record({"message": TEXT, "fix": TEXT}), "problems": listed(ANY)},
        {
            "version": WHOLE,
            "overtaken": {"type": "boolean"},
            "maps": {"type": "boolean"},
            "conflict": ref("Conflict"),
        },
    ),
    "Conflict": record(
        {"theirs": TEXT, "merged": {"type": ["string", "null"]}, "clashes": listed(ref("Clash"))}
    ),
    "Clash": record({"line": WHOLE, "base": TEXT, "mine": TEXT, "theirs": TEXT}),
    "Motion": record(
        {"key": TEXT, "from": WHOLE, "upto": WHOLE, "total": WHOLE, "done": {"type": "boolean"}},
        {"bodies": listed(ANY), "problems": listed(ref("Problem")), "took_ms": {"type": "number"}},
    ),
    "File": record(
        {
            "name": TEXT,
            "folder": TEXT,
            "saved": {"type": "boolean"},
            "outside": {"enum": [None, "changed", "gone", "unread"]},
            "recovered": {"type": "boolean"},
        }
    ),
    "State": record(
        {
            "version": WHOLE,
            "id": {"type": ["string", "null"]},
            "file": ref("File"),
            "windows": WHOLE,
            "text": TEXT,
            "variant": {"type": ["string", "null"]},
            "variants": listed(TEXT),
            "undo": {"type": ["string", "null"]},
            "redo": {"type": ["string", "null"]},
            "problems": listed(ref("Problem")),
            "todo": listed(ANY),
            "scene": MAYBE,
            "derived": MAYBE,
            "motion": {"anyOf": [ref("Motion"), {"type": "null"}]},
            "picture": {"type": ["string", "null"]},
        }
    ),
    "Preview": record(
        {"motion": {"anyOf": [ref("Motion"), {"type": "null"}]}, "problems": listed(ref("Problem"))},
        {"overtaken": {"type": "boolean"}},
    ),
    "Rendering": record(
        {
            "state": {"enum": ["idle", "running", "done", "stopped", "failed"]},
            "running": {"type": "boolean"},
            "stage": TEXT,
            "done": {"type": "number"},
            "total": {"type": "number"},
            "lines": listed(TEXT),
            "error": MAYBE,
            "result": {"type": ["array", "null"], "items": ANY},
            "command": TEXT,
        }
    ),
}

ERRORS: Part = {
    "400": "Not what this page says.",
    "401": "The token is missing or wrong.",
    "403": "Another site's page asks, or another name is used.",
    "405": "The address is asked in another way.",
    "507": "The disk is full, or may not be written.",
}
BODIED: Part = {"413": "The body is too large.", "415": "The body is not called JSON."}
EDITED: Part = {"409": "Of a version that is gone, or overtaken.", "422": "It cannot be done to this scene."}


def _query(name: str, schema: Part, required: bool = False) -> Part:
    return {"name": name, "in": "query", "required": required, "schema": schema}


def _answers(content: Part, errors: Part) -> Part:
    problem = {"application/json": {"schema": ref("Error")}}
    told = {code: {"description": text, "content": problem} for code, text in sorted(errors.items())}
    return {"200": {"description": "Done.", "content": content}, **told}


def _json(schema: Part) -> Part:
    return {"application/json": {"schema": schema}}


def _get(about: str, content: Part, *query: Part, errors: Part | None = None) -> Part:
    found: Part = {"summary": about, "responses": _answers(content, ERRORS | (errors or {}))}
    return found | ({"parameters": list(query)} if query else {})


def _send(about: str, body: Part, gives: Part) -> Part:
    return {
        "summary": about,
        "requestBody": {"required": True, "content": _json(body)},
        "responses": _answers(_json(gives), ERRORS | BODIED | EDITED),
    }


def _asking(further: Part | None = None) -> Part:
    return record({**ASKED, **(further or {})}, BESIDE, closed=True)


def _key(name: str) -> Part:
    return {"name": name, "in": "path", "required": True, "schema": {"type": "string", "minLength": 1}}


@cache
def document() -> Part:
    """The whole of it."""
    from physgen import __version__

    state, variant = ref("State"), _query("variant", {"type": "string", "maxLength": MAX_WORDS})
    wrong = {"422": "The scene has errors."}
    gone = {"409": "Another took its place; ask for the state."}
    absent = {"404": "There is no such."}
    ops = {"ops": listed(ref("Op"), MAX_OPS)}
    render = record(
        {},
        {
            "version": WHOLE,
            "variants": {
                "type": ["array", "null"],
                "items": {"type": ["string", "null"], "maxLength": MAX_WORDS},
                "maxItems": MAX_OPS,
            },
            "format": {"type": ["string", "null"], "maxLength": MAX_WORDS},
            "refine": {"type": ["boolean", "null"]},
        },
        closed=True,
    )
    png: Part = {"image/png": {"schema": {"type": "string", "contentMediaType": "image/png"}}}
    truth: Part = {"enum": ["true", "false"]}
    news = record({"run": TEXT, "next": WHOLE, "events": listed(ANY)})
    paths = {
        "/api/openapi.json": {"get": _get("This page.", _json(ANY))},
        "/api/materials": {"get": _get("The table of materials.", _json(listed(ANY)))},
        "/api/state": {"get": _get("The scene and how it moves.", _json(state), variant)},
        "/api/photo": {"get": _get("The photo.", png, errors=wrong | absent)},
        "/api/mask": {
            "get": _get(
                "Where an object is: 255, else 0.",
                png,
                variant,
                _query("object", {"type": "string", "minLength": 1}, True),
                errors=wrong | absent,
            ),
            "post": _send("Correct what was perceived.", _asking({"op": ANY}), state),
        },
        "/api/edit": {"post": _send("Operations, all or none.", _asking(ops), state)},
        "/api/preview": {"post": _send("What operations would do.", _asking(ops), ref("Preview"))},
        "/api/undo": {"post": _send("One step back.", _asking(), state)},
        "/api/redo": {"post": _send("One step on.", _asking(), state)},
        "/api/text": {"put": _send("Another text.", _asking({"text": TEXT}), state)},
        "/api/save": {
            "post": _send(
                "Write the file.",
                record(ASKED, {**BESIDE, "resolve": {"enum": [None, *RESOLVED]}}, closed=True),
                state,
            )
        },
        "/api/motion/{key}": {
            "get": _get(
                "More of a motion, from a sample on.",
                _json(ref("Motion")),
                _key("key"),
                _query("from", {"type": "integer", "minimum": 0, "maximum": 10**8}),
                errors=gone,
            )
        },
        "/api/picture/{key}": {
            "get": _get(
                "What is drawn; with a motion, its shadows.",
                _json(ANY),
                _key("key"),
                _query("motion", TEXT),
                errors=gone | wrong,
            )
        },
        "/api/render": {
            "get": _get("How far a run is.", _json(ref("Rendering"))),
            "post": _send("Save, and render.", render, record({"job": TEXT})),
        },
        "/api/once": {
            "post": _send(
                "A key that opens the page one time: `/?once=KEY`.",
                record({}, closed=True),
                record({"key": TEXT}),
            )
        },
        "/api/render/stop": {"post": _send("End the run.", record({}, closed=True), ref("Rendering"))},
        "/api/command": {
            "get": _get(
                "What a person types for the same.",
                _json(record({"command": TEXT})),
                variant,
                _query("format", {"type": "string", "maxLength": MAX_WORDS}),
                _query("refine", {"enum": ["true", "false"]}),
            )
        },
        "/api/events": {
            "get": _get(
                "What happened since an event of a run of the server; asked again and again.",
                _json(news),
                _query("window", TEXT),
                _query("run", TEXT),
                _query("since", {"type": "string", "pattern": "^[0-9]{1,15}$"}),
                _query("hidden", truth),
                _query("leaves", truth),
            )
        },
    }
    return {
        "openapi": "3.1.0",
        "info": {"title": "physgen edit", "version": __version__},
        "paths": paths,
        "components": {
            "schemas": SCHEMAS,
            "securitySchemes": {"token": {"type": "apiKey", "in": "header", "name": TOKEN}},
        },
        "security": [{"token": []}],
    }
