"""Addresses of the interface -> doors of the session. What takes time runs in a thread; the loop stays free."""

from __future__ import annotations

import json
import secrets
from dataclasses import asdict
from functools import cache
from typing import Any, TypeVar

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from physgen.edit.refusing import EditError, Why
from physgen.edit.rendering import Rendering
from physgen.edit.server.asked import Fields, body, malformed, query
from physgen.edit.server.events import Windows
from physgen.edit.server.keys import Keys
from physgen.edit.server.limits import MAX_WORDS, RESOLVED
from physgen.edit.server.openapi import document
from physgen.edit.server.turns import Turns, overtaken
from physgen.edit.session import Asked, Session

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
