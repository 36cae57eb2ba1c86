"""The HTTP interface of the editor: what each address takes and returns, and how it asks the session.

Requests are checked by the models below, which are also the source of /api/openapi.json. Handlers are plain
functions, which FastAPI runs in threads, so that a slow one holds up no other.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Header, Query, Request, Security
from fastapi.security import APIKeyHeader
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, JsonValue
from starlette.responses import FileResponse, JSONResponse, Response

from physgen.edit.errors import EditError, Why
from physgen.edit.events import Windows, overtaken
from physgen.edit.guard import TOKEN, Keys
from physgen.edit.operations import MAX_KEY, MAX_STEPS
from physgen.edit.render_job import RenderJob
from physgen.edit.session import EditRequest, Session

MAX_OPS = 1000
MAX_WORDS = 200
"""Characters of names, and of what an edit is called."""
MAX_SAMPLE = 10**8
MAX_EVENT = 2**53 - 1

Data = dict[str, Any]


class JsonAnswer(JSONResponse):
    """JSON in compact form; raises ValueError for numbers that JSON does not have."""

    def render(self, content: Any) -> bytes:
        """The body of the answer."""
        return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode("utf-8")


@dataclass(frozen=True)
class Services:
    """What the handlers work with; kept in the state of the application."""

    session: Session
    windows: Windows
    rendering: RenderJob
    keys: Keys
    token: str


def services_of(request: Request) -> Services:
    """The services of the application that serves a request."""
    found: Services = request.app.state.services
    return found


Served = Annotated[Services, Depends(services_of)]
Window = Annotated[str, Header(alias="X-Physgen-Window", max_length=80)]


# Requests


def _whole(value: object) -> object:
    """JSON does not tell 1.0 from 1."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


Whole = Annotated[int, Field(strict=True, ge=0, le=2**53 - 1), BeforeValidator(_whole)]
Index = Annotated[int, Field(strict=True, ge=0, le=10**6), BeforeValidator(_whole)]
Words = Annotated[str, Field(max_length=MAX_WORDS)]
Step = Annotated[str, Field(max_length=MAX_KEY)] | Index
Path = Annotated[list[Step], Field(min_length=1, max_length=MAX_STEPS)]


class Body(BaseModel):
    """A request's body; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", strict=True)


class SetOp(Body):
    set: Path
    value: JsonValue


class UnsetOp(Body):
    unset: Path


class AddOp(Body):
    add: Path
    value: JsonValue


class RenameOp(Body):
    rename: Path
    to: str


class RemoveOp(Body):
    remove: Path


class Edit(Body):
    """An edit of the version that the page shows, in the file or in a variant."""

    version: Whole
    variant: Words | None = None
    what: Words | None = None
    tag: Words | None = None
    id: Annotated[str, Field(max_length=64)] | None = None

    def request(self) -> EditRequest:
        """For the session."""
        return EditRequest(self.version, self.variant or None, self.what or "", self.tag, self.id)


class Operations(Edit):
    """Operations, all or none; a path is a list of keys and of indices from 0."""

    ops: Annotated[list[SetOp | UnsetOp | AddOp | RenameOp | RemoveOp], Field(max_length=MAX_OPS)]

    def plain(self) -> list[Data]:
        """The operations as mappings."""
        return [op.model_dump() for op in self.ops]


class Text(Edit):
    text: str


class Save(Edit):
    resolve: Literal["mine", "theirs", "merge"] | None = None


class MaskEdit(Edit):
    """A correction of masks; see physgen.edit.masks for the operations."""

    op: dict[str, JsonValue]


class Render(Body):
    version: Whole | None = None
    variants: Annotated[list[Words | None], Field(max_length=MAX_OPS)] | None = None
    format: Words | None = None
    refine: bool | None = None


class Nothing(Body):
    pass


Flag = Literal["true", "false"]


# Answers, as /api/openapi.json describes them


class Message(BaseModel):
    message: str
    fix: str


class Error(BaseModel):
    error: Message
    problems: list[Data]
    version: int | None = None
    overtaken: bool | None = None
    maps: bool | None = None
    conflict: Data | None = None


class Motion(BaseModel):
    key: str
    start: int = Field(alias="from")
    upto: int
    total: int
    done: bool
    bodies: list[Data]
    problems: list[Data]
    took_ms: float


class State(BaseModel):
    version: int
    id: str | None
    file: Data
    windows: int
    text: str
    variant: str | None
    variants: list[str]
    undo: str | None
    redo: str | None
    problems: list[Data]
    todo: list[Data]
    scene: Data | None
    derived: Data | None
    motion: Motion | None
    picture: str | None
    made: str | None


class Preview(BaseModel):
    motion: Motion | None
    problems: list[Data]
    overtaken: bool = False


class Rendering(BaseModel):
    job: str | None
    state: Literal["idle", "running", "done", "stopped", "failed"]
    running: bool
    stage: str
    done: float
    total: float
    lines: list[str]
    error: Data | None
    result: list[Data] | None
    command: str


PNG: dict[int | str, dict[str, Any]] = {200: {"content": {"image/png": {}}}}
ERRORS: dict[int | str, dict[str, Any]] = {
    400: {"description": "The request does not match this description."},
    401: {"description": "The token is missing or wrong."},
    403: {"description": "A page of another site asks, or another host name is used."},
    404: {"description": "There is no such address."},
    405: {"description": "The address does not take this method."},
    409: {"description": "The request is about a state that is gone, or the file on disk has changed."},
    413: {"description": "The body is too large."},
    415: {"description": "The body is not application/json."},
    422: {"description": "The request is well formed and cannot be carried out on this scene."},
    500: {"description": "The editor failed."},
    507: {"description": "The disk is full, or may not be written."},
}
for _row in ERRORS.values():
    _row["model"] = Error

TOKEN_HEADER = APIKeyHeader(name=TOKEN, scheme_name="token", auto_error=False)
"""For the description: `Guard` has checked the token already."""
api = APIRouter(default_response_class=JsonAnswer, dependencies=[Security(TOKEN_HEADER)])


# Reading


@api.get("/api/materials")
def materials() -> list[Data]:
    """The table of materials."""
    return materials_table()


@cache
def materials_table() -> list[Data]:
    """Rows of the table of materials."""
    from physgen import materials as table

    return [asdict(row) for row in table.materials()]


@api.get("/api/state", response_model=State)
def state(served: Served, variant: Words | None = None) -> Response:
    """The scene, its problems and its motion."""
    return JsonAnswer(served.session.state(variant or None))


@api.get("/api/photo", responses=PNG, response_class=Response)
def photo(served: Served) -> Response:
    """The photo."""
    return Response(served.session.photo(), media_type="image/png")


@api.get("/api/mask", responses=PNG, response_class=Response)
def mask(
    served: Served, object: Annotated[str, Query(min_length=1)], variant: Words | None = None
) -> Response:
    """The mask of an object."""
    return Response(served.session.mask(variant or None, object), media_type="image/png")


@api.get("/api/motion/{key}", response_model=Motion)
def motion(
    served: Served, key: str, start: Annotated[int, Query(alias="from", ge=0, le=MAX_SAMPLE)] = 0
) -> Response:
    """A further part of a motion, from a sample on."""
    return _present(served.session.live.more(key, start))


@api.get("/api/picture/{key}")
def picture(served: Served, key: str, motion: str | None = None) -> Response:
    """Background and objects; with a motion, their shadows."""
    pictures = served.session.pictures
    found = pictures.look(key) if motion is None else pictures.shadows(key, motion)
    return _present(found)


def _present(found: Mapping[str, Any] | None) -> Response:
    if found is None:
        raise overtaken()
    return JsonAnswer(found)


@api.get("/api/events", response_model=dict[str, Any])
def events(
    served: Served,
    caller: Window = "",
    window: str = "",
    run: str = "",
    since: Annotated[int, Query(ge=0, le=MAX_EVENT)] = 0,
    hidden: Flag = "false",
    leaves: Flag = "false",
) -> Response:
    """What happened since an event of a run of the server. A window that asks is counted until it leaves."""
    name = (window or caller)[:80]
    if leaves == "true":
        served.windows.leave(name)
        return JsonAnswer({"run": served.windows.run, "next": since, "events": []})
    return JsonAnswer(served.windows.ask(name, run, since, hidden == "true"))


# Edits


@api.post("/api/edit", response_model=State)
def edit(served: Served, body: Operations) -> Response:
    """Make operations, all or none."""
    return JsonAnswer(served.session.edit(body.request(), body.plain()))


@api.post("/api/preview", response_model=Preview)
def preview(served: Served, body: Operations, window: Window = "") -> Response:
    """The motion that operations would give."""
    try:
        return JsonAnswer(served.session.preview(body.request(), body.plain()))
    except EditError as error:
        if error.why is not Why.STALE or not window:
            raise
        # a page asks many times while something is dragged, and a browser's console shows every refused request
        return JsonAnswer({"motion": None, "problems": [], "overtaken": True})


@api.post("/api/undo", response_model=State)
def undo(served: Served, body: Edit) -> Response:
    """One step back."""
    return JsonAnswer(served.session.step(body.request(), -1))


@api.post("/api/redo", response_model=State)
def redo(served: Served, body: Edit) -> Response:
    """One step forward."""
    return JsonAnswer(served.session.step(body.request(), 1))


@api.put("/api/text", response_model=State)
def write(served: Served, body: Text) -> Response:
    """Replace the text."""
    return JsonAnswer(served.session.write(body.request(), body.text))


@api.post("/api/save", response_model=State)
def save(served: Served, body: Save) -> Response:
    """Write the file."""
    return JsonAnswer(served.session.save(body.request(), body.resolve))


@api.post("/api/mask", response_model=State)
def correct(served: Served, body: MaskEdit) -> Response:
    """Correct a mask, and what follows from it."""
    return JsonAnswer(served.session.correct(body.request(), body.op))


# Rendering


@api.post("/api/render", response_model=dict[str, Any])
def render(served: Served, body: Render) -> Response:
    """Save, and start to render."""
    served.session.save_for_rendering(body.version)
    job = served.rendering.start(body.variants, body.format or "mp4", body.refine is not False)
    return JsonAnswer({"job": job})


@api.get("/api/render", response_model=Rendering)
def rendered(served: Served) -> Response:
    """Progress and results."""
    return JsonAnswer(with_addresses(served.rendering.status()))


@api.post("/api/render/stop", response_model=Rendering)
def stop(served: Served, body: Nothing) -> Response:
    """Stop rendering."""
    served.rendering.stop()
    return JsonAnswer(with_addresses(served.rendering.status()))


@api.get("/api/command", response_model=dict[str, Any])
def command(
    served: Served, variant: Words | None = None, format: Words = "mp4", refine: Flag = "true"
) -> Response:
    """The command line that renders the same."""
    line = served.rendering.command(variant or None, format, refine == "true")
    return JsonAnswer({"command": line})


@api.post("/api/once", response_model=dict[str, Any])
def once(served: Served, body: Nothing) -> Response:
    """A key that opens the page one time: `/?once=KEY`."""
    return JsonAnswer({"key": served.keys.new()})


@api.get("/result/{key}/{name:path}", include_in_schema=False)
def result(served: Served, key: str, name: str) -> Response:
    """A file of the last run."""
    job = served.rendering.status()["job"]
    known = job is not None and secrets.compare_digest(key.encode(), job.encode())
    found = served.rendering.file(name) if known else None
    if found is None:
        raise EditError(Why.ABSENT, "there is no such result", "render again")
    return FileResponse(found)


def with_addresses(status: Data) -> Data:
    """The status of a run with its folders as addresses of this server."""
    if status["result"] is None:
        return status
    rows = [{**row, "folder": f"/result/{status['job']}/{row['folder']}/"} for row in status["result"]]
    return {**status, "result": rows}
