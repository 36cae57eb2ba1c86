"""The HTTP interface of the editor."""

from __future__ import annotations

import json
import re
import secrets
from dataclasses import asdict
from functools import cache
from itertools import islice
from typing import Any, NoReturn, TypeVar

from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from physgen.edit.errors import EditError, Why
from physgen.edit.guard import (
    BODY,
    MAX_DEPTH,
    MAX_OPS,
    MAX_VALUES,
    MAX_WORDS,
    RESOLVED,
    TOKEN,
    Keys,
    Turns,
    Windows,
    overtaken,
    too_large,
)
from physgen.edit.operations import MAX_KEY, MAX_STEPS
from physgen.edit.render_job import Rendering
from physgen.edit.session import Asked, Session

# ----------------------------------------------------------------------
# A request -> what it asks for, as plain checked data; raises EditError where it is not what the interface
# says.

_MARKS = re.compile(rb'"(?:[^"\\]++|\\.)*+"?|[\[{,]', re.DOTALL)
"""Texts, beginnings of lists and objects, and commas: no fewer than there are values."""


def malformed(message: str, fix: str) -> EditError:
    """Not as the interface says."""
    return EditError(Why.MALFORMED, message, fix)


async def body(request: Request) -> dict[str, Any]:
    """The JSON mapping that a request carries. Raises EditError."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise EditError(Why.KIND, "the body is not called JSON", "send Content-Type: application/json")
    data = bytearray()
    try:
        async for part in request.stream():
            if len(data) + len(part) > BODY:
                raise too_large(BODY)
            data += part
    except ClientDisconnect:
        raise malformed("the body ended early", "send it again") from None
    return await run_in_threadpool(parsed, data)


def parsed(data: bytes | bytearray) -> dict[str, Any]:
    """Bytes -> a mapping. Raises EditError, and before anything is made of them where that would be too much."""
    if next(islice(_MARKS.finditer(data), MAX_VALUES, None), None) is not None:
        raise malformed(f"the body holds more than {MAX_VALUES:,} texts, lists and commas", "send less")
    try:
        text = data.decode("utf-8")
        told = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        reason = "it is nested too deep" if isinstance(error, RecursionError) else str(error)
        raise malformed(f"the body is not JSON: {reason}"[:300], "send a JSON object") from None
    if not isinstance(told, dict):
        raise malformed("the body is not a JSON object", 'send {"version": 1, ...}')
    if not _shallow(told) or not _encodable(told):
        raise malformed("the body holds what no scene can", "nest less, and send whole characters")
    return told


def _refuse_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is no number")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    if len(made) != len(pairs):
        raise ValueError("a key is written twice")
    return made


def _shallow(told: Any) -> bool:
    level = [told]
    for _ in range(MAX_DEPTH):
        level = [
            child
            for value in level
            if isinstance(value, dict | list)
            for child in (value.values() if isinstance(value, dict) else value)
        ]
        if not level:
            return True
    return False


def _encodable(told: Any) -> bool:
    """Whether every text in it is one: half a pair of surrogates is none."""
    try:
        json.dumps(told, ensure_ascii=False).encode("utf-8")
    except (UnicodeEncodeError, ValueError):
        return False
    return True


def query(request: Request, *names: str) -> dict[str, str]:
    """What stands behind the question mark: these names alone, each once. Raises EditError."""
    told: dict[str, str] = {}
    for name, value in request.query_params.multi_items():
        if name not in names or name in told:
            raise malformed(f"{name[:40]} is not asked here, or twice", f"send {', '.join(names) or 'none'}")
        told[name] = value
    return told


class Fields:
    """The keys of a body, each asked for by kind; what nobody asked for is refused at the end."""

    def __init__(self, told: dict[str, Any]) -> None:
        self._told = told
        self._known: set[str] = set()

    def take(self, key: str) -> Any:
        """The value of a key, None where it is absent."""
        self._known.add(key)
        return self._told.get(key)

    def version(self) -> int:
        """Of the state that was seen."""
        version = self.take("version")
        if isinstance(version, float) and version.is_integer():
            version = int(version)
        if not isinstance(version, int) or isinstance(version, bool) or not 0 <= version < 2**53:
            raise malformed("version is not a whole number", "send the version of the state that you see")
        return version

    def asked(self) -> Asked:
        """Version, variant, what, tag and id."""
        version = self.version()
        variant, what, tag = self.words("variant") or None, self.words("what") or "", self.words("tag")
        return Asked(version, variant, what, tag, self.words("id", 64))

    def words(self, key: str, most: int = MAX_WORDS) -> str | None:
        """A text on one line, or null."""
        value = self.take(key)
        if value is None:
            return None
        if not isinstance(value, str) or len(value) > most:
            raise malformed(f"{key} is not a text of at most {most} characters", "send a short text or null")
        return value

    def choice(self, key: str, words: tuple[str, ...]) -> str | None:
        """One of several words, or null."""
        value = self.take(key)
        if value is not None and value not in words:
            raise malformed(f"{key} is none of {', '.join(words)}", "send one of them, or null")
        chosen: str | None = value
        return chosen

    def text(self, key: str) -> str:
        """A long text."""
        value = self.take(key)
        if not isinstance(value, str):
            raise malformed(f"{key} is not a text", "send the text of the file")
        return value

    def truth(self, key: str) -> bool:
        """True or false; true where it is absent."""
        value = self.take(key)
        if value is not None and not isinstance(value, bool):
            raise malformed(f"{key} is neither true nor false", "send one of the two")
        return value is not False

    def mapping(self, key: str) -> dict[str, Any]:
        """An object."""
        value = self.take(key)
        if not isinstance(value, dict):
            raise malformed(f"{key} is not an object", "send {...}")
        return value

    def listed(self, key: str) -> list[str | None] | None:
        """A list of names, in which null may be, or null."""
        value = self.take(key)
        if value is None:
            return None
        if not isinstance(value, list) or len(value) > MAX_OPS or not all(map(_is_name, value)):
            raise malformed(f"{key} is not a list of names", "send [...] or null")
        return value

    def ops(self) -> list[dict[str, Any]]:
        """Operations; what each says is looked at where it is made."""
        value = self.take("ops")
        if isinstance(value, list) and len(value) > MAX_OPS:
            raise malformed(f"more than {MAX_OPS} operations", "send fewer at a time")
        if not isinstance(value, list) or not all(isinstance(op, dict) for op in value):
            raise malformed("ops is not a list of objects", 'send [{"set": [...], "value": ...}]')
        return value

    def done(self) -> None:
        """Nothing else was sent. Raises EditError."""
        rest = min(set(self._told) - self._known, default=None)
        if rest is not None:
            raise malformed(f"{rest[:40]} is not known here", f"send {', '.join(sorted(self._known))}")


def _is_name(item: object) -> bool:
    return item is None or (isinstance(item, str) and len(item) <= MAX_WORDS)


# ----------------------------------------------------------------------
# The interface, told in OpenAPI 3.1: what each address takes and gives.

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


# ----------------------------------------------------------------------
# Addresses of the interface -> doors of the session. What takes time runs in a thread; the loop stays free.

T = TypeVar("T")

WINDOW = "x-physgen-window"


class Answer(JSONResponse):
    """JSON that is made fast, and refuses what is none."""

    def render(self, content: Any) -> bytes:
        """Bytes of the body."""
        return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode("utf-8")


class Api:
    """The addresses below /api."""

    def __init__(self, session: Session, windows: Windows, rendering: Rendering, keys: Keys) -> None:
        self.session, self.windows, self.rendering, self.keys = session, windows, rendering, keys
        self.turns = Turns()

    def routes(self) -> list[Route]:
        """All of them."""
        get, put, post = ["GET"], ["PUT"], ["POST"]
        return [
            Route("/api/openapi.json", self.openapi, methods=get),
            Route("/api/materials", self.materials, methods=get),
            Route("/api/state", self.state, methods=get),
            Route("/api/photo", self.photo, methods=get),
            Route("/api/mask", self.mask, methods=get),
            Route("/api/mask", self.correct, methods=post),
            Route("/api/edit", self.edit, methods=post),
            Route("/api/preview", self.preview, methods=post),
            Route("/api/undo", self.undo, methods=post),
            Route("/api/redo", self.redo, methods=post),
            Route("/api/text", self.write, methods=put),
            Route("/api/save", self.save, methods=post),
            Route("/api/motion/{key}", self.motion, methods=get),
            Route("/api/picture/{key}", self.picture, methods=get),
            Route("/api/render", self.rendered, methods=get),
            Route("/api/render", self.render, methods=post),
            Route("/api/render/stop", self.stop, methods=post),
            Route("/api/command", self.command, methods=get),
            Route("/api/once", self.once, methods=post),
            Route("/api/events", self.events, methods=get),
            Route("/result/{key}/{name:path}", self.result, methods=get),
        ]

    # What there is

    async def openapi(self, request: Request) -> Response:
        """This interface."""
        query(request)
        return Answer(document())

    async def materials(self, request: Request) -> Response:
        """The table."""
        query(request)
        return Answer(await run_in_threadpool(materials))

    async def state(self, request: Request) -> Response:
        """The scene and how it moves."""
        return Answer(await run_in_threadpool(self.session.state, _variant(query(request, "variant"))))

    async def photo(self, request: Request) -> Response:
        """As PNG."""
        query(request)
        return Response(await run_in_threadpool(self.session.photo), media_type="image/png")

    async def mask(self, request: Request) -> Response:
        """Of one object, as PNG."""
        told = query(request, "variant", "object")
        if not told.get("object"):
            raise malformed("no object is named", "send object=NAME")
        made = await run_in_threadpool(self.session.mask, _variant(told), told["object"])
        return Response(made, media_type="image/png")

    async def motion(self, request: Request) -> Response:
        """More of one."""
        begin = query(request, "from").get("from", "0")
        if not (begin.isascii() and begin.isdecimal() and len(begin) < 10):
            raise malformed("from is not a number of samples", "send from=0")
        key = request.path_params["key"]
        told = await run_in_threadpool(self.session.live.more, key, int(begin))
        if told is None:
            raise overtaken()
        return Answer(told)

    async def picture(self, request: Request) -> Response:
        """What is drawn; with `motion`, its shadows."""
        key, motion = request.path_params["key"], query(request, "motion").get("motion")
        pictures = self.session.pictures
        if motion is None:
            told = await run_in_threadpool(pictures.look, key)
        else:
            told = await run_in_threadpool(pictures.shadows, key, motion)
        if told is None:
            raise overtaken()
        return Answer(told)

    async def once(self, request: Request) -> Response:
        """A key that opens the page one time."""
        told = Fields(await body(request))
        told.done()
        return Answer({"key": self.keys.made()})

    async def events(self, request: Request) -> Response:
        """What is new; a window that asks is counted until it leaves, or asks no more."""
        told = query(request, "window", "run", "since", "hidden", "leaves")
        since, window = told.get("since", "0"), (told.get("window") or request.headers.get(WINDOW, ""))[:80]
        if not (since.isascii() and since.isdecimal() and len(since) < 16):
            raise malformed("since is no number of an event", "send the next of the answer before")
        if not {told.get("hidden", "false"), told.get("leaves", "false")} <= {"true", "false"}:
            raise malformed("hidden and leaves are true or false", "send hidden=true")
        if told.get("leaves") == "true":
            self.windows.leave(window)
            return Answer({"run": self.windows.run, "next": int(since), "events": []})
        hidden = told.get("hidden") == "true"
        return Answer(self.windows.ask(window, told.get("run", ""), int(since), hidden))

    # Edits

    async def edit(self, request: Request) -> Response:
        """Operations."""
        told = Fields(await body(request))
        asked, ops = told.asked(), told.ops()
        told.done()
        return Answer(await run_in_threadpool(self.session.edit, asked, ops))

    async def preview(self, request: Request) -> Response:
        """What they would do; of one window's requests only the newest of the present version is worked out."""
        told = Fields(await body(request))
        asked, ops = told.asked(), told.ops()
        told.done()
        window = request.headers.get(WINDOW, "")[:80]
        turn = self.turns.take(window)

        def work() -> dict[str, Any]:
            return self.session.preview(asked, ops)

        try:
            return Answer(await run_in_threadpool(self.turns.when_newest, window, turn, work))
        except EditError as error:
            if error.why is not Why.STALE or not window:
                raise
            # a page asks many times while something is dragged, and a browser's console tells of each answer that is no
            return Answer({"motion": None, "problems": [], "overtaken": True})

    async def undo(self, request: Request) -> Response:
        """One step back."""
        return await self._step(request, -1)

    async def redo(self, request: Request) -> Response:
        """One step on."""
        return await self._step(request, 1)

    async def _step(self, request: Request, by: int) -> Response:
        asked = await self._asked(request)
        return Answer(await run_in_threadpool(self.session.step, asked, by))

    async def write(self, request: Request) -> Response:
        """Another text."""
        told = Fields(await body(request))
        asked, text = told.asked(), told.text("text")
        told.done()
        return Answer(await run_in_threadpool(self.session.write, asked, text))

    async def save(self, request: Request) -> Response:
        """Write the file."""
        told = Fields(await body(request))
        asked, resolve = told.asked(), told.choice("resolve", RESOLVED)
        told.done()
        return Answer(await run_in_threadpool(self.session.save, asked, resolve))

    async def correct(self, request: Request) -> Response:
        """A mask made right."""
        told = Fields(await body(request))
        asked, op = told.asked(), told.mapping("op")
        told.done()
        return Answer(await run_in_threadpool(self.session.correct, asked, op))

    # What is rendered

    async def render(self, request: Request) -> Response:
        """Save, and begin."""
        told = Fields(await body(request))
        version = None if told.take("version") is None else told.version()
        variants, format, refine = told.listed("variants"), told.words("format"), told.truth("refine")
        told.done()

        def begin() -> str:
            self.session.save_for_rendering(version)
            return self.rendering.start(variants, format or "mp4", refine)

        return Answer({"job": await run_in_threadpool(begin)})

    async def rendered(self, request: Request) -> Response:
        """How far it is."""
        query(request)
        return Answer(self._status())

    async def stop(self, request: Request) -> Response:
        """End it."""
        told = Fields(await body(request))
        told.done()
        await run_in_threadpool(self.rendering.stop)
        return Answer(self._status())

    def _status(self) -> dict[str, Any]:
        return addressed(self.rendering.status())

    async def command(self, request: Request) -> Response:
        """What a person types for the same."""
        told = query(request, "variant", "format", "refine")
        format, refine = told.get("format", "mp4"), told.get("refine", "true")
        if len(format) > MAX_WORDS or refine not in ("true", "false"):
            raise malformed("format or refine is not what it may be", "send format=mp4 and refine=true")
        variant = _variant(told)
        line = await run_in_threadpool(self.rendering.command, variant, format, refine == "true")
        return Answer({"command": line})

    async def result(self, request: Request) -> Response:
        """A file of the last run."""
        key, name = request.path_params["key"], request.path_params["name"]
        job = self.rendering.status()["job"]
        known = job is not None and secrets.compare_digest(key.encode(), job.encode())
        found = await run_in_threadpool(self.rendering.file, name) if known else None
        if found is None:
            raise EditError(Why.ABSENT, "there is no such result", "render again")
        return FileResponse(found)

    async def _asked(self, request: Request) -> Asked:
        told = Fields(await body(request))
        asked = told.asked()
        told.done()
        return asked


def addressed(status: dict[str, Any]) -> dict[str, Any]:
    """How far a run is, its folders as addresses of this server."""
    if status["result"] is None:
        return status
    rows = [{**row, "folder": f"/result/{status['job']}/{row['folder']}/"} for row in status["result"]]
    return {**status, "result": rows}


@cache
def materials() -> list[dict[str, Any]]:
    """The table of materials, by name."""
    from physgen import materials as table

    return [asdict(row) for row in table.materials()]


def _variant(told: dict[str, str]) -> str | None:
    value = told.get("variant") or None
    if value is not None and len(value) > MAX_WORDS:
        raise malformed("variant is no name", "send the name of a variant")
    return value
