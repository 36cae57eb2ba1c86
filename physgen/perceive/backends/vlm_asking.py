"""Questions -> answers that make sense: kept from earlier runs, asked again on nonsense, in samples; counted."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any

from physgen.backends import Setup
from physgen.perceive.backends import vlm_cache
from physgen.perceive.backends.vlm_answers import NonsenseError, Query, answer, fits, plain
from physgen.perceive.backends.vlm_settings import settings
from physgen.perceive.backends.vlm_turns import Model, Turn
from physgen.problems import InputError


@dataclass(frozen=True)
class Tally:
    """What answers took."""

    requests: int = 0
    """That were answered, sensibly or not."""
    cached: int = 0
    """Answers that an earlier run had got."""
    asked_again: int = 0
    """Since the answer made no sense."""
    retries: int = 0
    """Since the server failed, was busy, or did not know a part of the request."""
    tokens_in: int = 0
    tokens_out: int = 0

    def __add__(self, other: Tally) -> Tally:
        return Tally(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


class Asker:
    """Puts a role's questions to its model, which is made when the first of them has no kept answer."""

    def __init__(self, role: str, setup: Setup) -> None:
        """Raises InputError where no model is named."""
        self.settings = settings(role, setup)
        self._setup = setup
        self._model: Model | None = None
        self._making = Lock()
        self._tally = Tally()
        self._seconds = 0.0

    def ask(self, queries: Sequence[Query]) -> list[list[Any]]:
        """The samples of answers to each question. Raises InputError for what cannot be had."""
        told, started = self.settings, time.perf_counter()
        self._tally = Tally()
        asked = [(query, sample) for query in queries for sample in range(told.samples)]
        threads = min(told.parallel, len(asked)) if told.url else 1
        try:
            found = self._together(asked, threads) if threads > 1 else [self._sample(*one) for one in asked]
        finally:
            self._seconds = time.perf_counter() - started
        return [found[k : k + told.samples] for k in range(0, len(found), told.samples)]

    def note(self) -> Mapping[str, Any]:
        """What the last call took, for the record."""
        told, count = self.settings, self._tally
        said: dict[str, Any] = {"model": told.model}
        if told.where:
            said["server"] = told.where
        said |= {f.name: getattr(count, f.name) for f in fields(count)}
        said |= {"samples": told.samples, "seconds": round(self._seconds, 3)}
        if told.price_in is not None or told.price_out is not None:
            cost = count.tokens_in * (told.price_in or 0) + count.tokens_out * (told.price_out or 0)
            said["cost"] = round(cost / 1e6, 6)
        return said

    def close(self) -> None:
        """The model is let go."""
        model, self._model = self._model, None
        if model is not None:
            model.close()

    def _together(self, asked: Sequence[tuple[Query, int]], threads: int) -> list[Any]:
        """As `_sample` for each. After a failure, or Ctrl-C, nobody waits for what is still under way."""
        work, done = deque(enumerate(asked)), SimpleQueue[tuple[int, Any, BaseException | None]]()

        def serve() -> None:
            with suppress(IndexError):
                while True:
                    k, one = work.popleft()
                    try:
                        done.put((k, self._sample(*one), None))
                    except BaseException as error:
                        done.put((k, None, error))
                        return

        for _ in range(threads):
            Thread(target=serve, daemon=True).start()
        found: dict[int, Any] = {}
        try:
            while len(found) < len(asked):
                k, value, error = done.get()
                if error is not None:
                    raise error
                found[k] = value
        finally:
            work.clear()
        return [found[k] for k in range(len(asked))]

    def _sample(self, query: Query, sample: int) -> Any:
        told = self.settings
        model = told.model if told.url else vlm_cache.fingerprint(told.model, self._setup.dtype)
        file = vlm_cache.name(query, told.where, model, told.temperature, sample)
        if told.cache and (kept := vlm_cache.kept(file)) is not None and fits(kept, query):
            self._count(Tally(cached=1))
            return kept
        value = self._sensible(query, sample)
        if told.cache:
            vlm_cache.keep(file, value)
        return value

    def _sensible(self, query: Query, sample: int) -> Any:
        """An answer that makes sense; each that does not is told what is wrong with it."""
        told, turns = self.settings, list[Turn]()
        model, wrong = self._made(), ""
        for attempt in range(told.attempts):
            reply = model.complete(query, turns, sample)
            again = int(attempt > 0)
            self._count(Tally(1, 0, again, reply.retries, reply.tokens_in, reply.tokens_out))
            try:
                return answer(reply.text, query)
            except NonsenseError as error:
                wrong = f"{error}{', cut off for its length' if reply.cut else ''}"
            turns += [
                Turn("assistant", plain(reply.text, 2000) or "(nothing)"),
                Turn("user", f"That cannot be used: {wrong}. Answer again, with the JSON object alone."),
            ]
        where = told.where or "transformers"
        found = f"{where} (model {told.model}), asked for {told.role} of {query.about},"
        times = f"{told.attempts} times" if told.attempts > 1 else "once"
        fix = "choose a model that sees pictures and writes JSON, or allow --fallback"
        raise InputError.of("--backend", found, f"answered nonsense {times}: {wrong}", fix)

    def _made(self) -> Model:
        with self._making:
            if self._model is None:
                self._model = _model(self)
            return self._model

    def _count(self, more: Tally) -> None:
        with self._making:
            self._tally += more


def _model(asker: Asker) -> Model:
    """The library that answers is imported now."""
    if asker.settings.url:
        from physgen.perceive.backends.vlm_server import Server

        return Server(asker.settings)
    from physgen.perceive.backends.vlm_local import local

    return local(asker.settings, asker._setup)
