"""Client of a vision-language model behind an OpenAI-compatible server: settings, requests, JSON answers, a cache."""

from __future__ import annotations

import json
import os
import re
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
from physgen.problems import InputError
from physgen.registry import Options, Setup, read_options

URL, MODEL, KEY, OPENAI_KEY = "PHYSGEN_VLM_URL", "PHYSGEN_VLM_MODEL", "PHYSGEN_VLM_KEY", "OPENAI_API_KEY"
OPENAI = "api.openai.com"
OPTIONS: Options = {
    "url": ("", {"type": "string", "not": {"pattern": "@"}}),  # no password in a file
    "model": ("", {"type": "string"}),
    "samples": (1, {"type": "integer", "minimum": 1, "maximum": 25}),
    "timeout": (90, {"type": "number", "minimum": 0.05, "maximum": 3600}),
    "parallel": (4, {"type": "integer", "minimum": 1, "maximum": 64}),
    "cache": (True, {"type": "boolean"}),
}
"""`[vlm]` of physgen.toml."""
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
    key: str = field(repr=False)
    samples: int
    """Answers to each question; their median counts, their spread gives the confidence."""
    timeout: float
    """s without a response after which a request is given up."""
    parallel: int
    """Concurrent requests."""
    cache: bool

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
    options = read_options(setup, "vlm", OPTIONS)
    url = os.environ.get(URL) or options.pop("url")
    model = setup.weights or os.environ.get(MODEL) or options.pop("model")
    name = f"{role}=vlm"
    if not url:
        fix = f"set {URL} and {MODEL} (its key in {KEY}), or write url and model below [vlm] in physgen.toml"
        raise InputError.of("--backend", name, "has no server to ask", fix)
    if urlsplit(url).scheme not in ("http", "https") or not urlsplit(url).hostname:
        fix = "write e.g. http://localhost:8000/v1"
        raise InputError.of("--backend", name, f"is given a {URL} that is no address", fix)
    if not model:
        fix = f"set {MODEL}, or write {name}:MODEL, as the server calls it"
        raise InputError.of("--backend", name, "is given a server and no model", fix)
    numbers = {key: options[key] for key in ("samples", "timeout", "parallel", "cache")}
    return Settings(role, model, url, _key(url), **numbers)


def _key(url: str) -> str:
    """The API key. OpenAI's own key is sent to OpenAI, or to the URL of the environment, never to one from a file."""
    if key := os.environ.get(KEY):
        return key.strip()
    if os.environ.get(URL) or urlsplit(url).hostname == OPENAI:
        return os.environ.get(OPENAI_KEY, "").strip()
    return ""


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
        self._knows_schemas = True
        """Whether the server takes a schema, a seed and a temperature."""

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
        samples = self.settings.samples
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
        return [found[k : k + samples] for k in range(0, len(found), samples)]

    def note(self) -> Mapping[str, Any]:
        """Model, server and usage of the last call, for the record."""
        usage = {name: self._usage[name] for name in ("requests", "cached", "tokens_in", "tokens_out")}
        settings = self.settings
        return {"model": settings.model, "server": settings.where, "samples": settings.samples} | usage

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
        with suppress(
            OSError, ValueError, KeyError, TypeError, RecursionError
        ):  # none there, or a broken one
            cached = json.loads(file.read_bytes())["answer"]
            if not _faults(cached, query):
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
        for _ in range(REQUESTS.attempts):
            text = self._complete(query, turns, sample)
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
        knows = self._knows_schemas
        try:
            reply = self._server.chat.completions.create(**self._request(query, turns, seed, knows))
            message, usage = reply.choices[0].message, reply.usage
        except (openai.BadRequestError, openai.UnprocessableEntityError) as error:
            if not knows:
                self._fail(query, error)
            self._knows_schemas = False
            return self._complete(query, turns, seed)
        except openai.OpenAIError as error:
            self._fail(query, error)
        except (ValueError, AttributeError, IndexError, TypeError):  # a web page
            self._fail(query, openai.OpenAIError("what it gave is no chat completion"))
        self._count(
            requests=1,
            tokens_in=getattr(usage, "prompt_tokens", None) or 0,
            tokens_out=getattr(usage, "completion_tokens", None) or 0,
        )
        return message.content or getattr(message, "refusal", None) or ""

    def _request(
        self, query: Query, turns: Sequence[Mapping[str, str]], seed: int, knows_schemas: bool
    ) -> dict[str, Any]:
        """Without what some servers do not know, the schema stands in the question."""
        schema = server_schema(query.schema)
        text, optional = query.text, {}
        if knows_schemas:
            answer = {"name": "answer", "strict": True, "schema": schema}
            optional = {
                "response_format": {"type": "json_schema", "json_schema": answer},
                "seed": seed,
                "temperature": self.settings.temperature,
            }
        else:
            text = f"{text}\n\nThe JSON schema of the answer:\n{json.dumps(schema)}"
        content: list[dict[str, Any]] = [{"type": "text", "text": text}]
        for picture in query.pictures:
            url = f"data:image/png;base64,{b64encode(picture).decode()}"
            content.append({"type": "image_url", "image_url": {"url": url}})
        messages = [{"role": "user", "content": content}, *turns]
        return {"model": self.settings.model, "messages": messages, **optional}

    def _asked_for(self, query: Query) -> str:
        settings = self.settings
        return f"{settings.where} (model {settings.model}), asked for {settings.role} of {query.about},"

    def _fail(self, query: Query, error: openai.OpenAIError) -> NoReturn:
        """One message: the failure, the server and model, and the fix; never the key."""
        body = getattr(error, "body", None)
        text = str(body.get("message") if isinstance(body, dict) else error.__cause__ or error)
        text = plain_line(text.replace(self.settings.key, "***") if self.settings.key else text, 160)
        if isinstance(error, openai.APIConnectionError):  # a timeout is one
            what = f"gave no answer, tried {REQUESTS.retries + 1} times ({text or type(error).__name__})"
            fix = f"see whether it runs, whether {URL} is right, or set a longer timeout below [vlm]"
        elif isinstance(error, openai.AuthenticationError | openai.PermissionDeniedError):
            what = f"refuses the key ({error.status_code})"
            fix = f"set {KEY}, or {OPENAI_KEY}, to a key of that server"
        else:
            what = f"fails ({getattr(error, 'status_code', 'no status')}: {text})"
            fix = f"check {MODEL}, {URL} (mostly ending in /v1), and that the model takes pictures"
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
    """The first JSON object in `text` that answers `query`; prose, code fences and thoughts around it are skipped.

    Raises UnusableAnswerError with the faults of the first JSON found.
    """
    text = _THOUGHT.sub(" ", text[: REQUESTS.answer]).strip()
    first = "" if text else "it was empty"
    for value in _json_objects(text):
        faults = _faults(value, query)
        if not faults:
            return value
        first = first or "; ".join(faults[:4])
    raise UnusableAnswerError(first or f'it had no JSON in it, but "{plain_line(text, 60)}"')


def _json_objects(text: str) -> Iterator[Any]:
    """Every outermost JSON object in a text."""
    position = 0
    for _ in range(REQUESTS.starts):
        if (start := text.find("{", position)) < 0:
            return
        try:
            value, position = _DECODER.raw_decode(text, start)
        except RecursionError:  # the next bracket would fail in the same way
            return
        except ValueError:
            position = start + 1
        else:
            yield value


def _faults(value: Any, query: Query) -> list[str]:
    """Breaches of the schema, or else contradictions."""
    faults = []
    errors = Draft202012Validator(query.schema).iter_errors(value)
    for error in sorted(errors, key=lambda e: (len(e.path), str(e.path))):
        where = error.json_path.removeprefix("$").lstrip(".")
        message = plain_line(error.message, 120)
        faults.append(f"{where}: {message}" if where else message)
    return faults or query.contradictions(value)


def plain_line(text: str, most: int = 300) -> str:
    """The printable characters of a text on one line, cut at a word.

    >>> plain_line("a  red\\n# ball\\x1b[0m")
    'a red # ball[0m'
    """
    line = " ".join("".join(c for c in text if c.isprintable() or c.isspace()).split())
    return line if len(line) <= most else f"{line[:most].rpartition(' ')[0] or line[:most]} ..."
