"""Client of a vision-language model: settings, cached requests, JSON answers and usage counts.

`vlm_server` and `vlm_local` hold the two kinds of model.
"""

from __future__ import annotations

import json
import os
import re
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from hashlib import sha256
from pathlib import Path
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any, Protocol
from urllib.parse import urlsplit

from jsonschema import Draft202012Validator

from physgen.files import write_atomic
from physgen.problems import InputError, Problem
from physgen.registry import Setup, suggestion

URL, MODEL, KEY, OPENAI_KEY = "PHYSGEN_VLM_URL", "PHYSGEN_VLM_MODEL", "PHYSGEN_VLM_KEY", "OPENAI_API_KEY"
OPENAI = "api.openai.com"
SAMPLING_TEMPERATURE = 0.7
"""Temperature where several samples are requested: at 0 they would all be the same."""
LIMITS: Mapping[str, tuple[type, float, float]] = {
    "samples": (int, 1, 25),
    "attempts": (int, 1, 10),
    "retries": (int, 0, 20),
    "timeout": (float, 0.05, 3600),
    "parallel": (int, 1, 64),
    "max_tokens": (int, 16, 1_000_000),
    "temperature": (float, 0, 2),
    "price_in": (float, 0, 1e6),
    "price_out": (float, 0, 1e6),
}
"""Numeric options of `[vlm]`: type, least and greatest value."""
TEXTS = ("url", "model")
SWITCHES = ("cache",)
LONGEST_ANSWER = 50_000
"""Characters of an answer that are read."""
JSON_STARTS = 200
"""Brackets at which JSON decoding is tried before giving up."""
LOCAL_KEYWORDS = frozenset(["minimum", "maximum", "exclusiveMinimum", "minLength", "minItems", "maxItems"])
"""Schema keywords that are checked here only: many servers refuse a strict schema that contains them."""
CACHE_VERSION = 1
"""Raised when the meaning of an answer changes."""
_START = re.compile(r"[\[{]")
_THOUGHT = re.compile(r"<think>.*?(</think>|\Z)", re.DOTALL)
_DECODER = json.JSONDecoder(parse_constant=lambda name: name)  # NaN and Infinity stay text
Schema = Mapping[str, Any]


@dataclass(frozen=True)
class Settings:
    """Which model answers, and how it is called."""

    role: str
    """For messages: `physics`."""
    model: str
    """The server's name for it; a hub id or a path where there is no `url`."""
    url: str = ""
    """Of an OpenAI-compatible server; `""`: the model runs here, in transformers."""
    key: str = field(default="", repr=False)
    samples: int = 1
    """Answers to each question; their median counts, their spread gives the confidence."""
    attempts: int = 3
    """How often a question is put, at most, until its answer is usable."""
    retries: int = 2
    """How often a request is repeated when the server fails, is busy or does not answer."""
    timeout: float = 90.0
    """s without a response after which a request is given up."""
    parallel: int = 4
    """Concurrent requests to a server."""
    max_tokens: int | None = None
    """Of an answer, at most; None: the server's limit, 1024 for a local model."""
    temperature: float = 0.0
    cache: bool = True
    price_in: float | None = None
    """Price of a million tokens of question."""
    price_out: float | None = None
    """Price of a million tokens of answer."""

    @property
    def where(self) -> str:
        """The server without user, password and query, for messages; `""` for a local model."""
        parts = urlsplit(self.url)
        host = parts.netloc.rpartition("@")[2]
        return f"{parts.scheme}://{host}{parts.path}" if host else ""


def read_settings(role: str, setup: Setup) -> Settings:
    """Settings from the environment, then from `[vlm]`. Raises InputError with everything missing or wrong."""
    options, problems = dict(setup.options), _option_problems(setup.options)
    url = os.environ.get(URL) or str(options.get("url", ""))
    model = setup.weights or os.environ.get(MODEL) or str(options.get("model", ""))
    name = f"{role}=vlm"
    if not url and not setup.weights:
        fix = (
            f"set {URL} and {MODEL} for an OpenAI-compatible server (its key in {KEY}), or write url and model "
            f"below [vlm] in physgen.toml, or write {name}:PATH for a transformers model on this machine"
        )
        problems += _problem(name, "has no model to ask", fix)
    elif url and (urlsplit(url).scheme not in ("http", "https") or not urlsplit(url).hostname):
        fix = "write e.g. http://localhost:8000/v1"
        problems += _problem(name, f"is given a {URL} that is no address", fix)
    elif url and not model:
        fix = f"set {MODEL}, or write {name}:MODEL, as the server calls it"
        problems += _problem(name, "is given a server and no model", fix)
    if problems:
        raise InputError(problems)
    numbers = {name: LIMITS[name][0](options[name]) for name in LIMITS if name in options}
    several = numbers.get("samples", 1) > 1
    numbers["temperature"] = (numbers.get("temperature", 0) or SAMPLING_TEMPERATURE) if several else 0.0
    return Settings(role, model, url, _key(url), cache=bool(options.get("cache", True)), **numbers)


def _key(url: str) -> str:
    """The API key. OpenAI's own key is sent to OpenAI, or to the URL of the environment, never to one from a file."""
    if key := os.environ.get(KEY):
        return key.strip()
    if os.environ.get(URL) or urlsplit(url).hostname == OPENAI:
        return os.environ.get(OPENAI_KEY, "").strip()
    return ""


def _option_problems(options: Mapping[str, Any]) -> list[Problem]:
    known = (*TEXTS, *LIMITS, *SWITCHES)
    problems: list[Problem] = []
    for name, value in options.items():
        if "key" in name.lower() or (name == "url" and "@" in urlsplit(str(value)).netloc):
            fix = f"set the environment variable {KEY} instead, and make a new key if others saw the file"
            problems += _problem(f"[vlm] {name}", "is a secret in a file", fix)
        elif name not in known:
            problems += _problem(f"[vlm] {name}", "means nothing here", suggestion(name, known))
        elif name in LIMITS:
            kind, least, most = LIMITS[name]
            number = isinstance(value, int | float if kind is float else int) and not isinstance(value, bool)
            if not number or not least <= value <= most:
                what = "a whole number" if kind is int else "a number"
                expected = f"is {value!r}, not {what} from {least:g} to {most:g}"
                problems += _problem(f"[vlm] {name}", expected, f"write {what}")
        elif not isinstance(value, bool if name in SWITCHES else str):
            what = "true or false" if name in SWITCHES else "text"
            problems += _problem(f"[vlm] {name}", f"is {value!r}, not {what}", f"write {what}")
    return problems


def _problem(found: str, expected: str, fix: str) -> list[Problem]:
    place = "physgen.toml" if found.startswith("[") else "--backend"
    return InputError.of(place, found, expected, fix).problems


class UnusableAnswerError(Exception):
    """An answer that cannot be used; its text gives the reason, for the model and for the user."""


@dataclass(frozen=True)
class Query:
    """A question about pictures."""

    about: str
    """In one to three words, for messages: `ball`."""
    text: str
    pictures: tuple[bytes, ...]
    """PNG."""
    schema: Schema
    """Of the answer."""
    contradictions: Callable[[Any], list[str]] = lambda answer: []
    """Faults of an answer that keeps to the schema."""


@dataclass(frozen=True)
class Turn:
    """A message after the question."""

    role: str
    """`assistant`, `user`."""
    text: str


@dataclass(frozen=True)
class Reply:
    """A model's reply, and its cost."""

    text: str
    tokens_in: int = 0
    tokens_out: int = 0
    retries: int = 0
    """Repeated requests."""
    cut: bool = False
    """Whether it reached the length limit."""


class Model(Protocol):
    """A model of a server or of this machine."""

    def complete(self, query: Query, turns: Sequence[Turn], seed: int) -> Reply:
        """The reply to a question, after `turns` about unusable answers. Raises InputError."""
        ...

    def close(self) -> None:
        """Free memory and connections."""
        ...


@dataclass(frozen=True)
class Usage:
    """Counts of one call, for the record."""

    requests: int = 0
    """Replies, usable or not."""
    cached: int = 0
    """Answers from an earlier run."""
    asked_again: int = 0
    """Questions put again after an unusable answer."""
    retries: int = 0
    """Requests repeated because the server failed, was busy, or did not know a part of the request."""
    tokens_in: int = 0
    tokens_out: int = 0

    def __add__(self, other: Usage) -> Usage:
        return Usage(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


class Client:
    """Puts the questions of one role to its model, which is made at the first question without a cached answer."""

    def __init__(self, settings: Settings, setup: Setup, load: Callable[[Settings, Setup], Model]) -> None:
        self.settings = settings
        self._setup = setup
        self._load = load
        self._model: Model | None = None
        self._lock = Lock()
        self._usage = Usage()
        self._seconds = 0.0

    def ask(self, queries: Sequence[Query]) -> list[list[Any]]:
        """The samples of answers to each question. Raises InputError where there is no usable answer."""
        settings, started = self.settings, time.perf_counter()
        self._usage = Usage()
        requests = [(query, sample) for query in queries for sample in range(settings.samples)]
        threads = min(settings.parallel, len(requests)) if settings.url else 1
        try:
            if threads > 1:
                found = self._concurrently(requests, threads)
            else:
                found = [self._sample(*one) for one in requests]
        finally:
            self._seconds = time.perf_counter() - started
        return [found[k : k + settings.samples] for k in range(0, len(found), settings.samples)]

    def note(self) -> Mapping[str, Any]:
        """Usage of the last call, for the record."""
        settings, usage = self.settings, self._usage
        note: dict[str, Any] = {"model": settings.model}
        if settings.where:
            note["server"] = settings.where
        note |= {f.name: getattr(usage, f.name) for f in fields(usage)}
        note |= {"samples": settings.samples, "seconds": round(self._seconds, 3)}
        if settings.price_in is not None or settings.price_out is not None:
            cost = usage.tokens_in * (settings.price_in or 0) + usage.tokens_out * (settings.price_out or 0)
            note["cost"] = round(cost / 1e6, 6)
        return note

    def close(self) -> None:
        """Free the model."""
        model, self._model = self._model, None
        if model is not None:
            model.close()

    def _concurrently(self, requests: Sequence[tuple[Query, int]], threads: int) -> list[Any]:
        """`_sample` of each request. After a failure or Ctrl-C, requests under way are not waited for."""
        work, done = deque(enumerate(requests)), SimpleQueue[tuple[int, Any, BaseException | None]]()

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
            while len(found) < len(requests):
                k, value, error = done.get()
                if error is not None:
                    raise error
                found[k] = value
        finally:
            work.clear()
        return [found[k] for k in range(len(requests))]

    def _sample(self, query: Query, sample: int) -> Any:
        settings = self.settings
        if not settings.cache:
            return self._answer(query, sample)
        model = settings.model if settings.url else _fingerprint(settings.model, self._setup.dtype)
        file = _cache_file(query, settings, model, sample)
        cached = _read_cached(file)
        if cached is not None and not _breaches(cached, query.schema) and not query.contradictions(cached):
            self._count(Usage(cached=1))
            return cached
        value = self._answer(query, sample)
        with suppress(OSError):  # a folder that cannot be written to is no reason to fail
            file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(file, json.dumps({"answer": value}, ensure_ascii=False).encode())
        return value

    def _answer(self, query: Query, sample: int) -> Any:
        """A usable answer; the model is given the fault of each unusable one."""
        settings, turns = self.settings, list[Turn]()
        model, fault = self._loaded_model(), ""
        for attempt in range(settings.attempts):
            reply = model.complete(query, turns, sample)
            again = int(attempt > 0)
            self._count(Usage(1, 0, again, reply.retries, reply.tokens_in, reply.tokens_out))
            try:
                return parse_answer(reply.text, query)
            except UnusableAnswerError as error:
                fault = f"{error}{', cut off for its length' if reply.cut else ''}"
            turns += [
                Turn("assistant", plain_line(reply.text, 2000) or "(nothing)"),
                Turn("user", f"That cannot be used: {fault}. Answer again, with the JSON object alone."),
            ]
        where = settings.where or "transformers"
        found = f"{where} (model {settings.model}), asked for {settings.role} of {query.about},"
        times = f"{settings.attempts} times" if settings.attempts > 1 else "once"
        fix = "choose a model that sees pictures and writes JSON, or allow --fallback"
        raise InputError.of("--backend", found, f"answered nonsense {times}: {fault}", fix)

    def _loaded_model(self) -> Model:
        with self._lock:
            if self._model is None:
                self._model = self._load(self.settings, self._setup)
            return self._model

    def _count(self, usage: Usage) -> None:
        with self._lock:
            self._usage += usage


def _cache_file(query: Query, settings: Settings, model: str, sample: int) -> Path:
    """The file of one answer below `$XDG_CACHE_HOME/physgen/vlm`, named by everything that the answer depends on."""
    home = os.environ.get("XDG_CACHE_HOME", "")
    folder = (Path(home) if Path(home).is_absolute() else Path.home() / ".cache") / "physgen" / "vlm"
    pictures = [sha256(picture).hexdigest() for picture in query.pictures]
    where, temperature = settings.where, settings.temperature  # servers call different models `default`
    content = [CACHE_VERSION, where, model, query.text, pictures, query.schema, temperature, sample]
    digest = sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return folder / digest[:2] / f"{digest}.json"


def _fingerprint(model: str, dtype: str) -> str:
    """A local model's name with sizes and dates of its files."""
    path = Path(model).expanduser()
    files = sorted(path.iterdir()) if path.is_dir() else []
    stats = [(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files]
    return json.dumps([str(path.resolve()) if files else model, dtype, stats])


def _read_cached(path: Path) -> Any:
    """The answer in a file; None where there is none, or a broken one."""
    try:
        return json.loads(path.read_bytes())["answer"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def object_schema(**properties: Schema) -> dict[str, Any]:
    """The schema of an object with these properties, all of them required and no others allowed."""
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def server_schema(schema: Any) -> Any:
    """The schema without the keywords that are checked here only."""
    if isinstance(schema, Mapping):
        return {key: server_schema(value) for key, value in schema.items() if key not in LOCAL_KEYWORDS}
    return [server_schema(value) for value in schema] if isinstance(schema, list) else schema


def parse_answer(text: str, query: Query) -> Any:
    """The first JSON in `text` that answers `query`; prose, code fences and thoughts around it are skipped.

    Raises UnusableAnswerError with the faults of the first JSON found.
    """
    text = _THOUGHT.sub(" ", text[:LONGEST_ANSWER]).strip()
    if not text:
        raise UnusableAnswerError("it was empty")
    first = ""
    for value in _json_values(text):
        converted = _converted(value, query.schema)
        faults = _breaches(converted, query.schema) or query.contradictions(converted)
        if not faults:
            return converted
        first = first or "; ".join(faults[:4])
    raise UnusableAnswerError(first or f'it had no JSON in it, but "{_short(text, 60)}"')


def _json_values(text: str) -> Iterator[Any]:
    """Every outermost JSON object and array in a text."""
    position = 0
    for _ in range(JSON_STARTS):
        if not (found := _START.search(text, position)):
            return
        try:
            value, position = _DECODER.raw_decode(text, found.start())
        except RecursionError:  # the next bracket would fail in the same way
            return
        except ValueError:
            position = found.end()
        else:
            yield value


def _breaches(value: Any, schema: Schema) -> list[str]:
    breaches = []
    errors = Draft202012Validator(schema).iter_errors(value)
    for error in sorted(errors, key=lambda e: (len(e.path), str(e.path))):
        where = error.json_path.removeprefix("$").lstrip(".")
        breaches.append(f"{where}: {_short(error.message, 120)}" if where else _short(error.message, 120))
    return breaches


def _converted(value: Any, schema: Schema) -> Any:
    """The value with obvious slips corrected: quoted numbers, yes for true, unknown keys dropped."""
    kind = schema.get("type")
    if kind == "object":
        properties = schema["properties"]
        if isinstance(value, list) and len(properties) == 1:  # the list itself, without the key above it
            value = {next(iter(properties)): value}
        if isinstance(value, Mapping):
            return {key: _converted(value[key], properties[key]) for key in properties if key in value}
    elif kind == "array" and isinstance(value, list):
        return [_converted(item, schema["items"]) for item in value]
    elif kind == "boolean" and isinstance(value, str):
        return {"true": True, "yes": True, "false": False, "no": False}.get(value.strip().lower(), value)
    elif kind == "integer" and isinstance(value, str) and value.strip().isdecimal() and len(value) < 20:
        return int(value)
    elif kind == "number" and isinstance(value, str | int | float) and not isinstance(value, bool):
        try:
            number = float(value)
        except (ValueError, OverflowError):
            return _short(str(value), 40)
        return number if abs(number) < 1e30 else str(number)  # infinity stays text
    elif kind == "string" and isinstance(value, str):
        value = plain_line(value)
        return value.lower() if value.lower() in schema.get("enum", ()) else value
    return value


def plain_line(text: str, most: int = 300) -> str:
    """The printable characters of a text on one line, cut at a word.

    >>> plain_line("a  red\\n# ball\\x1b[0m")
    'a red # ball[0m'
    """
    line = " ".join("".join(c for c in text if c.isprintable() or c.isspace()).split())
    return line if len(line) <= most else f"{line[:most].rpartition(' ')[0] or line[:most]} ..."


def _short(text: str, most: int) -> str:
    line = plain_line(text, 10_000)
    return line if len(line) <= most else f"{line[: most - 3]}..."
