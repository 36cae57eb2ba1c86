"""The HTTP interface of the editor: the parameters of each address and the call it
makes.

Requests are checked by the models below, which are also the source of
/api/openapi.json. Handlers are plain functions, which FastAPI runs in threads, so that
a slow request does not delay the others.
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

import physgen.materials
from physgen.edit.operations import Body, Op
from physgen.edit.render_job import RenderJob
from physgen.edit.session import EditRequest, Session, Words
from physgen.messages import Message
from physgen.problems import EditError, EditRefusal, overtaken
from physgen.text import quoted

TOKEN = "x-physgen-token"
MAX_OPS = 1000
MAX_SAMPLE = 10**8
MAX_EVENT = 2**53 - 1
KEPT_EVENTS = 1000
"""Number of stored events, for the next poll of each page."""

Data = dict[str, Any]


class Events:
    """A queue of events for the open pages, which poll it; all methods are thread-safe.

    The pages poll because a browser allows six open connections per server for all its
    windows together. Each poll also makes the session compare the scene file with the
    disk, since another program may have written it.
    """

    def __init__(self) -> None:
        self.run = secrets.token_urlsafe(6)
        """Random name of this server: each server numbers its events from 0."""
        self._lock = threading.Lock()
        self._events: deque[Data] = deque(maxlen=KEPT_EVENTS)
        self._next = 0

    def send(self, event: Data) -> None:
        """Send an event to all pages."""
        with self._lock:
            self._events.append(event)
            self._next += 1

    def since(self, run: str, number: int) -> Data:
        """Return the events of this server from a number on, and the next number.

        A page that knows another `run` was loaded from an earlier server, whose numbers
        mean nothing here: such a page receives no events.
        """
        with self._lock:
            # The queue drops its oldest events, so that its first event has the number
            # `_next - len`.
            skipped_count = max(number - (self._next - len(self._events)), 0)
            if run == self.run:
                events = list(self._events)[skipped_count:]
            else:
                events = []
            return {"run": self.run, "next": self._next, "events": events}


@dataclass(frozen=True)
class Services:
    """The objects that the handlers use, stored in the state of the application."""

    session: Session
    events: Events
    rendering: RenderJob
    token: str
    page_keys: set[str]  # one-time keys that open the page


def services_of(request: Request) -> Services:
    """Return the services of the application of a request."""
    services: Services = request.app.state.services
    return services


Served = Annotated[Services, Depends(services_of)]


# Requests


class Operations(EditRequest):
    """A list of operations, applied all or none; a path is a list of keys and indices
    from 0.
    """

    ops: Annotated[list[Op], Field(max_length=MAX_OPS)]


class Text(EditRequest):
    text: str


class Save(EditRequest):
    resolve: Literal["mine", "theirs"] | None = None


class MaskEdit(EditRequest):
    """A correction of masks; `physgen.edit.masks` defines the operations."""

    op: dict[str, JsonValue]


class Render(Body):
    version: Annotated[int, Field(ge=0)] | None = None
    variants: Annotated[list[Words | None], Field(max_length=MAX_OPS)] | None = None
    format: Words | None = None
    refine: bool | None = None


class NoParameters(Body):
    pass


PNG: dict[int | str, dict[str, Any]] = {200: {"content": {"image/png": {}}}}
TOKEN_HEADER = APIKeyHeader(name=TOKEN, scheme_name="token", auto_error=False)
"""The token for the OpenAPI description only: `Guard` has already checked it."""
api = APIRouter(
    default_response_class=JSONResponse, dependencies=[Security(TOKEN_HEADER)]
)


# Reading


@api.get("/api/materials")
def materials() -> list[Data]:
    """Return the table of materials."""
    return list(map(asdict, physgen.materials.materials()))


@api.get("/api/state")
def state(services: Served, variant: Words | None = None) -> Response:
    """Return the scene, its problems and its motion."""
    services.session.look_outside()
    return JSONResponse(services.session.state(variant or None))


@api.get("/api/photo", responses=PNG, response_class=Response)
def photo(services: Served) -> Response:
    """Return the photo as a PNG."""
    return Response(services.session.photo(), media_type="image/png")


@api.get("/api/mask", responses=PNG, response_class=Response)
def mask(
    services: Served,
    object: Annotated[str, Query(min_length=1)],
    variant: Words | None = None,
) -> Response:
    """Return the mask of an object as a PNG."""
    return Response(
        services.session.mask(variant or None, object), media_type="image/png"
    )


@api.get("/api/motion/{key}")
def motion(
    services: Served,
    key: str,
    start: Annotated[int, Query(alias="from", ge=0, le=MAX_SAMPLE)] = 0,
) -> Response:
    """Return the next part of a motion, from a sample on."""
    return _present(services.session.live.next_part(key, start))


@api.get("/api/picture/{key}")
def picture(services: Served, key: str, motion: str | None = None) -> Response:
    """Return the background and the sprites; with `motion`, their shadows."""
    pictures = services.session.pictures
    if motion is None:
        picture_data = pictures.look(key)
    else:
        picture_data = pictures.shadows(key, motion)
    return _present(picture_data)


@api.get("/api/frame/{key}", responses=PNG, response_class=Response)
def frame(
    services: Served,
    key: str,
    motion: str,
    number: Annotated[int, Query(ge=0, le=MAX_SAMPLE)],
) -> Response:
    """Render a frame of a motion in the quality of the video, without its camera."""
    frame_png = services.session.pictures.frame(key, motion, number)
    if frame_png is None:
        raise overtaken()
    return Response(frame_png, media_type="image/png")


def _present(data: Mapping[str, Any] | None) -> Response:
    if data is None:
        raise overtaken()
    return JSONResponse(data)


@api.get("/api/events")
def events(
    services: Served,
    run: str = "",
    since: Annotated[int, Query(ge=0, le=MAX_EVENT)] = 0,
) -> Response:
    """Return the events after a number of a run of the server."""
    services.session.look_outside()
    return JSONResponse(services.events.since(run, since))


# Edits


@api.post("/api/edit")
def edit(services: Served, body: Operations) -> Response:
    """Apply operations, all or none."""
    return JSONResponse(services.session.edit(body, body.ops))


@api.post("/api/preview")
def preview(services: Served, body: Operations) -> Response:
    """Return the motion after operations; `overtaken` is true for an outdated version."""
    try:
        return JSONResponse(services.session.preview(body, body.ops))
    except EditError as error:
        if error.why is not EditRefusal.STALE:
            raise
        # While the user drags an object, the page sends many previews, and the
        # browser's console lists every refused request: an outdated one is no error.
        return JSONResponse({"motion": None, "problems": [], "overtaken": True})


@api.post("/api/undo")
def undo(services: Served, body: EditRequest) -> Response:
    """Restore the state before the latest edit."""
    return JSONResponse(services.session.step(body, -1))


@api.post("/api/redo")
def redo(services: Served, body: EditRequest) -> Response:
    """Restore the state after the last undone edit."""
    return JSONResponse(services.session.step(body, 1))


@api.put("/api/text")
def write(services: Served, body: Text) -> Response:
    """Replace the text."""
    return JSONResponse(services.session.write(body, body.text))


@api.post("/api/save")
def save(services: Served, body: Save) -> Response:
    """Save the file; `resolve` chooses a text if another program changed the file."""
    return JSONResponse(services.session.save(body, body.resolve))


@api.post("/api/mask")
def correct(services: Served, body: MaskEdit) -> Response:
    """Apply a correction of a mask, and change the values that follow from the mask."""
    return JSONResponse(services.session.correct(body, body.op))


# Rendering


@api.post("/api/render")
def render(services: Served, body: Render) -> Response:
    """Save the file and start to render it."""
    unknown_variants = set(body.variants or ()) - {None, *services.session.variants()}
    if unknown_variants:
        raise Message.NO_SUCH_VARIANT.impossible(
            name=quoted(str(unknown_variants.pop()))
        )
    services.session.save_for_rendering(body.version)
    job = services.rendering.start(
        body.variants, body.format or "mp4", body.refine is not False
    )
    return JSONResponse({"job": job})


@api.get("/api/render")
def render_status(services: Served) -> Response:
    """Report the progress and the results of rendering."""
    return JSONResponse(services.rendering.status())


@api.post("/api/render/stop")
def stop(services: Served, body: NoParameters) -> Response:
    """Stop rendering."""
    services.rendering.stop()
    return JSONResponse(services.rendering.status())


@api.get("/api/command")
def command(
    services: Served,
    variant: Words | None = None,
    format: Words = "mp4",
    refine: Literal["true", "false"] = "true",
) -> Response:
    """Return the command line to render the same clips."""
    line = services.rendering.command(variant or None, format, refine == "true")
    return JSONResponse({"command": line})


@api.get("/result/{key}/{name:path}", include_in_schema=False)
def result(services: Served, key: str, name: str) -> Response:
    """Return a file of the latest run."""
    job = services.rendering.status()["job"]
    # Compare in constant time: the key of the job is also the permission to read its
    # files.
    is_current_job = job is not None and secrets.compare_digest(
        key.encode(), job.encode()
    )
    if is_current_job:
        path = services.rendering.file(name)
    else:
        path = None
    if path is None:
        raise EditError(EditRefusal.ABSENT, "there is no such result", "render again")
    return FileResponse(path)
