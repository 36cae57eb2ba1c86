"""Client of a vision-language model behind an OpenAI-compatible server: settings, requests, JSON answers, a cache."""

from __future__ import annotations

import json
import os
import re
import time
from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from threading import Lock
from typing import Any, NoReturn
from urllib.parse import urlsplit

import openai
from jsonschema import Draft202012Validator

from physgen.files import write_atomic
from physgen.problems import InputError, Problem
from physgen.registry import Setup, suggestion

URL, MODEL, KEY, OPENAI_KEY = "PHYSGEN_VLM_URL", "PHYSGEN_VLM_MODEL", "PHYSGEN_VLM_KEY", "OPENAI_API_KEY"
OPENAI = "api.openai.com"
LIMITS: Mapping[str, tuple[type, float, float]] = {
    "samples": (int, 1, 25),
    "timeout": (float, 0.05, 3600),
    "parallel": (int, 1, 64),
}
"""Numeric options of `[vlm]`: type, least and greatest value."""
KNOWN = ("url", "model", "cache", *LIMITS)
OPTIONAL = ("response_format", "seed", "temperature")
"""Parameters that some servers do not know: left out, in this order, when a request is refused."""
LOCAL_KEYWORDS = frozenset(["minimum", "maximum", "exclusiveMinimum", "minLength", "minItems", "maxItems"])
"""Schema keywords that are checked here only: many servers refuse a strict schema that contains them."""


@dataclass(frozen=True)
class Requests:
    """Constants of the requests."""

    attempts: int = 3
    """How often a question is put until its answer is usable."""
    retries: int = 2
    """How often a request is repeated when the server fails, is busy or does not answer."""
    temperature: float = 0.7
    """Where several samples are requested: at 0 they would all be the same."""
    answer: int = 50_000
    """Characters of an answer that are read."""
    starts: int = 200
    """Brackets at which JSON decoding is tried before giving up."""
    cache_version: int = 1
    """Raised when the meaning of an answer changes."""


REQUESTS = Requests()
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
    """The server's name for it."""
    url: str
    """Of an OpenAI-compatible server."""
    key: str = field(default="", repr=False)
    samples: int = 1
    """Answers to each question; their median counts, their spread gives the confidence."""
    timeout: float = 90.0
    """s without a response after which a request is given up."""
    parallel: int = 4
    """Concurrent requests."""
    cache: bool = True

    @property
    def where(self) -> str:
        """The server without user, password and query, for messages."""
        parts = urlsplit(self.url)
        return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"

    @property
    def temperature(self) -> float:
        """Of the model's sampling."""
        return REQUESTS.temperature if self.samples > 1 else 0.0


def read_settings(role: str, setup: Setup) -> Settings:
    """Settings from the environment, then from `[vlm]`. Raises InputError with everything missing or wrong."""
    options, problems = dict(setup.options), _option_problems(setup.options)
    url = os.environ.get(URL) or str(options.get("url", ""))
    model = setup.weights or os.environ.get(MODEL) or str(options.get("model", ""))
    name = f"{role}=vlm"
    if not url:
        fix = f"set {URL} and {MODEL} (its key in {KEY}), or write url and model below [vlm] in physgen.toml"
        problems += _problem(name, "has no server to ask", fix)
    elif urlsplit(url).scheme not in ("http", "https") or not urlsplit(url).hostname:
        fix = "write e.g. http://localhost:8000/v1"
        problems += _problem(name, f"is given a {URL} that is no address", fix)
    elif not model:
        fix = f"set {MODEL}, or write {name}:MODEL, as the server calls it"
        problems += _problem(name, "is given a server and no model", fix)
    if problems:
        raise InputError(problems)
    numbers = {name: LIMITS[name][0](options[name]) for name in LIMITS if name in options}
    return Settings(role, model, url, _key(url), cache=options.get("cache", True), **numbers)


def _key(url: str) -> str:
    """The API key. OpenAI's own key is sent to OpenAI, or to the URL of the environment, never to one from a file."""
    if key := os.environ.get(KEY):
        return key.strip()
    if os.environ.get(URL) or urlsplit(url).hostname == OPENAI:
        return os.environ.get(OPENAI_KEY, "").strip()
    return ""


def _option_problems(options: Mapping[str, Any]) -> list[Problem]:
    problems: list[Problem] = []
    for name, value in options.items():
        found = f"[vlm] {name}"
        if "key" in name.lower() or (name == "url" and "@" in urlsplit(str(value)).netloc):
            fix = f"set the environment variable {KEY} instead, and make a new key if others saw the file"
            problems += _problem(found, "is a secret in a file", fix)
        elif name not in KNOWN:
            problems += _problem(found, "means nothing here", suggestion(name, KNOWN))
        elif name in LIMITS:
            kind, least, most = LIMITS[name]
            number = isinstance(value, (int, kind)) and not isinstance(value, bool)
            if not number or not least <= value <= most:
                what = f"a {'whole ' if kind is int else ''}number from {least:g} to {most:g}"
                problems += _problem(found, f"is {value!r}, not {what}", f"write {what}")
        elif not isinstance(value, bool if name == "cache" else str):
            what = "true or false" if name == "cache" else "text"
            problems += _problem(found, f"is {value!r}, not {what}", f"write {what}")
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


class Client:
    """Puts the questions of one role to its model."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._lock = Lock()
        self._usage: Counter[str] = Counter()
        self._seconds = 0.0
        self._unknown: set[str] = set()

    @cached_property
    def _server(self) -> openai.OpenAI:
        settings = self.settings
        return openai.OpenAI(
            base_url=settings.url,
            api_key=settings.key or "none",
            timeout=settings.timeout,
            max_retries=REQUESTS.retries,
        )

    def ask(self, queries: Sequence[Query]) -> list[list[Any]]:
        """The samples of answers to each question. Raises InputError where there is no usable answer."""
        samples, started = self.settings.samples, time.perf_counter()
        self._usage = Counter()
        pool = ThreadPoolExecutor(self.settings.parallel)
        requests = [(query, sample) for query in queries for sample in range(samples)]
        answers = [pool.submit(self._sample, query, sample) for query, sample in requests]
        try:
            for answer in wait(answers, return_when=FIRST_EXCEPTION).done:
                answer.result()  # raises the error, if there is one
            found = [answer.result() for answer in answers]
        except BaseException:
            self.close()  # breaks off what is under way
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            self._seconds = time.perf_counter() - started
        return [found[k : k + samples] for k in range(0, len(found), samples)]

    def note(self) -> Mapping[str, Any]:
        """Model, server and usage of the last call, for the record."""
        names = ("requests", "cached", "asked_again", "retries", "tokens_in", "tokens_out")
        usage = {name: self._usage[name] for name in names}
        head = {"model": self.settings.model, "server": self.settings.where}
        return head | usage | {"samples": self.settings.samples, "seconds": round(self._seconds, 3)}

    def close(self) -> None:
        """Close the connections."""
        if (server := self.__dict__.pop("_server", None)) is not None:
            server.close()

    def _count(self, **usage: int) -> None:
        with self._lock:
            self._usage.update(usage)

    def _sample(self, query: Query, sample: int) -> Any:
        if not self.settings.cache:
            return self._answer(query, sample)
        file = _cache_file(query, self.settings, sample)
        cached = _read_cached(file)
        if cached is not None and not _breaches(cached, query.schema) and not query.contradictions(cached):
            self._count(cached=1)
            return cached
        value = self._answer(query, sample)
        with suppress(OSError):  # a folder that cannot be written to is no reason to fail
            file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(file, json.dumps({"answer": value}, ensure_ascii=False).encode())
        return value

    def _answer(self, query: Query, sample: int) -> Any:
        """A usable answer; the model is given the fault of each unusable one."""
        turns: list[dict[str, str]] = []
        fault = ""
        for attempt in range(REQUESTS.attempts):
            text = self._complete(query, turns, sample)
            self._count(requests=1, asked_again=int(attempt > 0))
            try:
                return parse_answer(text, query)
            except UnusableAnswerError as error:
                fault = str(error)
            again = f"That cannot be used: {fault}. Answer again, with the JSON object alone."
            turns += [
                {"role": "assistant", "content": plain_line(text, 2000) or "(nothing)"},
                {"role": "user", "content": again},
            ]
        fix = "choose a model that sees pictures and writes JSON"
        what = f"answered nonsense {REQUESTS.attempts} times: {fault}"
        raise InputError.of("--backend", self._asked_for(query), what, fix)

    def _complete(self, query: Query, turns: Sequence[Mapping[str, str]], seed: int) -> str:
        """The reply to a question, after `turns` about unusable answers. Raises InputError."""
        while True:
            unknown = frozenset(self._unknown)
            try:
                raw = self._server.chat.completions.with_raw_response.create(
                    **self._request(query, turns, seed, unknown)
                )
                self._count(retries=raw.retries_taken)
                return self._reply(raw)
            except (openai.BadRequestError, openai.UnprocessableEntityError) as error:
                left = [name for name in OPTIONAL if name not in unknown]
                if not left:
                    self._fail(query, error)
                self._unknown |= set([name for name in left if name in error.message] or left[:1])
                self._count(retries=1)
            except openai.OpenAIError as error:
                self._fail(query, error)

    def _request(
        self, query: Query, turns: Sequence[Mapping[str, str]], seed: int, unknown: frozenset[str]
    ) -> dict[str, Any]:
        schema = server_schema(query.schema)
        answer = {"name": "answer", "strict": True, "schema": schema}
        optional: dict[str, Any] = {
            "response_format": {"type": "json_schema", "json_schema": answer},
            "seed": seed,
            "temperature": self.settings.temperature,
        }
        text = query.text
        if "response_format" in unknown:
            text = f"{text}\n\nThe JSON schema of the answer:\n{json.dumps(schema)}"
        content: list[dict[str, Any]] = [{"type": "text", "text": text}]
        for picture in query.pictures:
            url = f"data:image/png;base64,{b64encode(picture).decode()}"
            content.append({"type": "image_url", "image_url": {"url": url}})
        request = {"model": self.settings.model, "messages": [{"role": "user", "content": content}, *turns]}
        return request | {name: value for name, value in optional.items() if name not in unknown}

    def _reply(self, raw: Any) -> str:
        """A response's text. Raises OpenAIError where it is no chat completion, e.g. a web page."""
        try:
            completion = raw.parse()
            message, usage = completion.choices[0].message, completion.usage
        except (ValueError, AttributeError, IndexError, TypeError, openai.APIResponseValidationError):
            raise openai.OpenAIError(f"no chat completion: {raw.text}") from None
        self._count(
            tokens_in=getattr(usage, "prompt_tokens", None) or 0,
            tokens_out=getattr(usage, "completion_tokens", None) or 0,
        )
        return message.content or getattr(message, "refusal", None) or ""

    def _asked_for(self, query: Query) -> str:
        settings = self.settings
        return f"{settings.where} (model {settings.model}), asked for {settings.role} of {query.about},"

    def _fail(self, query: Query, error: openai.OpenAIError) -> NoReturn:
        """One message: the failure, the server and model, and the fix; never the key."""
        settings, tries = self.settings, f"tried {REQUESTS.retries + 1} times"
        cause = error.__cause__ if isinstance(error, openai.APIConnectionError) else None
        body = getattr(error, "body", None)
        text = str(body.get("message") if isinstance(body, dict) else cause or error)
        text = plain_line(text.replace(settings.key, "***") if settings.key else text, 160)
        if isinstance(error, openai.APITimeoutError):
            what = f"did not answer within {settings.timeout:g} s, {tries}"
            fix = "see whether it hangs, or set timeout below [vlm] in physgen.toml to more seconds"
        elif isinstance(error, openai.APIConnectionError):
            what, fix = (
                f"cannot be reached or broke off, {tries} ({text})",
                f"see whether it runs and {URL} is right",
            )
        elif isinstance(error, openai.AuthenticationError | openai.PermissionDeniedError):
            what = f"refuses the key ({error.status_code})"
            fix = f"set {KEY}, or {OPENAI_KEY}, to a key of that server"
        elif isinstance(error, openai.RateLimitError | openai.InternalServerError):
            what, fix = f"is too busy or fails, {tries} ({error.status_code}: {text})", "try again later"
        elif isinstance(error, openai.APIStatusError):
            what = f"refuses the question ({error.status_code}: {text})"
            fix = f"check {MODEL}, {URL}, and that the model takes pictures"
        else:
            what = f"gave what cannot be read ({text})"
            fix = f"check that {URL} is that of an OpenAI-compatible server, mostly ending in /v1"
        raise InputError.of("--backend", self._asked_for(query), what, fix) from None


def _cache_file(query: Query, settings: Settings, sample: int) -> Path:
    """The file of one answer below `$XDG_CACHE_HOME/physgen/vlm`, named by everything that the answer depends on."""
    home = os.environ.get("XDG_CACHE_HOME", "")
    folder = (Path(home) if Path(home).is_absolute() else Path.home() / ".cache") / "physgen" / "vlm"
    pictures = [sha256(picture).hexdigest() for picture in query.pictures]
    content = [
        *(REQUESTS.cache_version, settings.where, settings.model),  # servers call different models `default`
        *(query.text, pictures, query.schema, settings.temperature, sample),
    ]
    digest = sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return folder / digest[:2] / f"{digest}.json"


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
    text = _THOUGHT.sub(" ", text[: REQUESTS.answer]).strip()
    first = "" if text else "it was empty"
    for value in _json_values(text):
        converted = _converted(value, query.schema)
        faults = _breaches(converted, query.schema) or query.contradictions(converted)
        if not faults:
            return converted
        first = first or "; ".join(faults[:4])
    raise UnusableAnswerError(first or f'it had no JSON in it, but "{plain_line(text, 60)}"')


def _json_values(text: str) -> Iterator[Any]:
    """Every outermost JSON object and array in a text."""
    position = 0
    for _ in range(REQUESTS.starts):
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
        message = plain_line(error.message, 120)
        breaches.append(f"{where}: {message}" if where else message)
    return breaches


def _converted(value: Any, schema: Schema) -> Any:
    """The value with obvious slips corrected: quoted numbers, a list without its key, unknown keys dropped."""
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
        return {"true": True, "false": False}.get(value.strip().lower(), value)
    elif kind in ("integer", "number") and isinstance(value, str | int | float):
        with suppress(ValueError, OverflowError):
            number = float(value) if not isinstance(value, bool) else None
            if number is not None and abs(number) < 1e30:  # NaN and infinity stay text
                return int(number) if kind == "integer" and number.is_integer() else number
        return value if isinstance(value, bool) else str(value)
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
