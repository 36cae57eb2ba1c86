"""The HTTP interface of the editor: what each address takes, and how it asks the session.

Requests are checked by the models below, which are also the source of /api/openapi.json. Handlers are plain
functions, which FastAPI runs in threads, so that a slow one holds up no other.
"""

from __future__ import annotations

import secrets
import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request, Security
from fastapi.security import APIKeyHeader
from pydantic import Field, JsonValue
from starlette.responses import FileResponse, JSONResponse, Response

from physgen.edit.operations import Body, Op
from physgen.edit.render_job import RenderJob
from physgen.edit.session import EditRequest, Session, Words
from physgen.messages import Message
from physgen.problems import EditError, Why, overtaken
from physgen.text import quoted

TOKEN = "x-physgen-token"
MAX_OPS = 1000
MAX_SAMPLE = 10**8
MAX_EVENT = 2**53 - 1
KEPT_EVENTS = 1000
"""Events that wait for the pages."""

Data = dict[str, Any]


class Events:
    """Events for the open pages, which ask again and again; its methods may be called from any thread.

    No stream is held open: of those a browser has six for all its windows together. Where pages ask, the session also
    looks at the file, which another program may have written.
    """

    def __init__(self) -> None:
        self.run = secrets.token_urlsafe(6)
        """Identifies this server: numbers of events start again with each."""
        self._lock = threading.Lock()
        self._events: deque[Data] = deque(maxlen=KEPT_EVENTS)
        self._next = 0

    def send(self, event: Data) -> None:
        """Send an event to all pages."""
        with self._lock:
            self._events.append(event)
            self._next += 1

    def since(self, run: str, number: int) -> Data:
        """Events of this server from a number on; none for a page that knows another run."""
        with self._lock:
            old = max(number - (self._next - len(self._events)), 0)
            events = list(self._events)[old:] if run == self.run else []
            return {"run": self.run, "next": self._next, "events": events}


@dataclass(frozen=True)
class Services:
    """What the handlers work with; kept in the state of the application."""

    session: Session
    events: Events
    rendering: RenderJob
    token: str
    once: set[str]  # keys that open the page one time


def services_of(request: Request) -> Services:
    """The services of the application that serves a request."""
    found: Services = request.app.state.services
    return found


Served = Annotated[Services, Depends(services_of)]


# Requests


class Operations(EditRequest):
    """Operations, all or none; a path is a list of keys and of indices from 0."""

    ops: Annotated[list[Op], Field(max_length=MAX_OPS)]


class Text(EditRequest):
    text: str


class Save(EditRequest):
    resolve: Literal["mine", "theirs"] | None = None


class MaskEdit(EditRequest):
    """A correction of masks; see physgen.edit.masks for the operations."""

    op: dict[str, JsonValue]


class Render(Body):
    version: Annotated[int, Field(ge=0)] | None = None
    variants: Annotated[list[Words | None], Field(max_length=MAX_OPS)] | None = None
    format: Words | None = None
    refine: bool | None = None


class Nothing(Body):
    pass


PNG: dict[int | str, dict[str, Any]] = {200: {"content": {"image/png": {}}}}
TOKEN_HEADER = APIKeyHeader(name=TOKEN, scheme_name="token", auto_error=False)
"""For the description: `Guard` has checked the token already."""
api = APIRouter(
    default_response_class=JSONResponse, dependencies=[Security(TOKEN_HEADER)]
)


# Reading


@api.get("/api/materials")
def materials() -> list[Data]:
    """The table of materials."""
    from physgen import materials as table

    return [asdict(row) for row in table.materials()]


@api.get("/api/state")
def state(served: Served, variant: Words | None = None) -> Response:
    """The scene, its problems and its motion."""
    served.session.look_outside()
    return JSONResponse(served.session.state(variant or None))


@api.get("/api/photo", responses=PNG, response_class=Response)
def photo(served: Served) -> Response:
    """The photo."""
    return Response(served.session.photo(), media_type="image/png")


@api.get("/api/mask", responses=PNG, response_class=Response)
def mask(
    served: Served,
    object: Annotated[str, Query(min_length=1)],
    variant: Words | None = None,
) -> Response:
    """The mask of an object."""
    return Response(
        served.session.mask(variant or None, object), media_type="image/png"
    )


@api.get("/api/motion/{key}")
def motion(
    served: Served,
    key: str,
    start: Annotated[int, Query(alias="from", ge=0, le=MAX_SAMPLE)] = 0,
) -> Response:
    """A further part of a motion, from a sample on."""
    return _present(served.session.live.more(key, start))


@api.get("/api/picture/{key}")
def picture(served: Served, key: str, motion: str | None = None) -> Response:
    """Background and objects; with a motion, their shadows."""
    pictures = served.session.pictures
    found = pictures.look(key) if motion is None else pictures.shadows(key, motion)
    return _present(found)


@api.get("/api/frame/{key}", responses=PNG, response_class=Response)
def frame(
    served: Served,
    key: str,
    motion: str,
    number: Annotated[int, Query(ge=0, le=MAX_SAMPLE)],
) -> Response:
    """A frame of a motion in the quality of the video, without its camera."""
    found = served.session.pictures.frame(key, motion, number)
    if found is None:
        raise overtaken()
    return Response(found, media_type="image/png")


def _present(found: Mapping[str, Any] | None) -> Response:
    if found is None:
        raise overtaken()
    return JSONResponse(found)


@api.get("/api/events")
def events(
    served: Served, run: str = "", since: Annotated[int, Query(ge=0, le=MAX_EVENT)] = 0
) -> Response:
    """What happened since an event of a run of the server."""
    served.session.look_outside()
    return JSONResponse(served.events.since(run, since))


# Edits


@api.post("/api/edit")
def edit(served: Served, body: Operations) -> Response:
    """Make operations, all or none."""
    return JSONResponse(served.session.edit(body, body.ops))


@api.post("/api/preview")
def preview(served: Served, body: Operations) -> Response:
    """The motion that operations would give; `overtaken` where the page showed an older version."""
    try:
        return JSONResponse(served.session.preview(body, body.ops))
    except EditError as error:
        if error.why is not Why.STALE:
            raise
        # a page asks many times while something is dragged, and a browser's console shows every refused request
        return JSONResponse({"motion": None, "problems": [], "overtaken": True})


@api.post("/api/undo")
def undo(served: Served, body: EditRequest) -> Response:
    """One step back."""
    return JSONResponse(served.session.step(body, -1))


@api.post("/api/redo")
def redo(served: Served, body: EditRequest) -> Response:
    """One step forward."""
    return JSONResponse(served.session.step(body, 1))


@api.put("/api/text")
def write(served: Served, body: Text) -> Response:
    """Replace the text."""
    return JSONResponse(served.session.write(body, body.text))


@api.post("/api/save")
def save(served: Served, body: Save) -> Response:
    """Write the file; `resolve` chooses a text where another program changed the file."""
    return JSONResponse(served.session.save(body, body.resolve))


@api.post("/api/mask")
def correct(served: Served, body: MaskEdit) -> Response:
    """Correct a mask, and what follows from it."""
    return JSONResponse(served.session.correct(body, body.op))


# Rendering


@api.post("/api/render")
def render(served: Served, body: Render) -> Response:
    """Save, and start to render."""
    unknown = set(body.variants or ()) - {None, *served.session.variants()}
    if unknown:
        raise Message.NO_SUCH_VARIANT.impossible(name=quoted(str(unknown.pop())))
    served.session.save_for_rendering(body.version)
    job = served.rendering.start(
        body.variants, body.format or "mp4", body.refine is not False
    )
    return JSONResponse({"job": job})


@api.get("/api/render")
def rendered(served: Served) -> Response:
    """Progress and results."""
    return JSONResponse(served.rendering.status())


@api.post("/api/render/stop")
def stop(served: Served, body: Nothing) -> Response:
    """Stop rendering."""
    served.rendering.stop()
    return JSONResponse(served.rendering.status())


@api.get("/api/command")
def command(
    served: Served,
    variant: Words | None = None,
    format: Words = "mp4",
    refine: Literal["true", "false"] = "true",
) -> Response:
    """The command line that renders the same."""
    line = served.rendering.command(variant or None, format, refine == "true")
    return JSONResponse({"command": line})


@api.get("/result/{key}/{name:path}", include_in_schema=False)
def result(served: Served, key: str, name: str) -> Response:
    """A file of the last run."""
    job = served.rendering.status()["job"]
    known = job is not None and secrets.compare_digest(key.encode(), job.encode())
    found = served.rendering.file(name) if known else None
    if found is None:
        raise EditError(Why.ABSENT, "there is no such result", "render again")
    return FileResponse(found)
