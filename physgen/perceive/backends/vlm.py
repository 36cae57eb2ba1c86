"""Categories, labels and physical properties from a vision-language model.

The model runs behind an OpenAI-compatible server. The two questions follow the paper
(appendix, "Segmentation" and "Physical properties reasoning") in other words, and ask
for more: material, solid, rolling and true size, which gives the photo's scale. Each
answer is one JSON object and is checked against a schema. If an answer is unusable, the
model gets the fault and is asked again.
"""

from __future__ import annotations

import json
import os
import re
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import urlsplit

import numpy as np
import openai
from jsonschema import Draft202012Validator

from physgen.files import cache_folder, write_atomic
from physgen.geometry import raster
from physgen.geometry.polygon import Disc
from physgen.geometry.scale import box_sides
from physgen.messages import Message
from physgen.perceive.backends.vlm_questions import (
    VLM,
    Mask,
    Query,
    categories_query,
    clean_name,
    label_query,
    median_lab,
    physics_query,
    plain_line,
)
from physgen.perceive.roles import Category, Labels, Matter, Name, PhotoObject, Rgb
from physgen.registry import Options, Setup, read_options
from physgen.scene.scene import Solid

URL, MODEL, KEY = "PHYSGEN_VLM_URL", "PHYSGEN_VLM_MODEL", "PHYSGEN_VLM_KEY"
OPTIONS: Options = {
    "url": ("", {"type": "string", "not": {"pattern": "@"}}),  # no password in a file
    "model": ("", {"type": "string"}),
    "timeout": (90, {"type": "number", "minimum": 0.05, "maximum": 3600}),
}
"""Section `[vlm]` of physgen.toml.

`timeout`: a request without a response is given up after this many seconds.
"""
SAMPLING: Mapping[str, Any] = {"temperature": 0, "seed": 0}
"""Sampling options, omitted for servers that refuse them."""


@dataclass(frozen=True)
class Turn:
    """One message of a conversation."""

    text: str
    pictures: tuple[bytes, ...] = ()  # PNG
    is_reply: bool = False


class UnusableAnswerError(Exception):
    """Raised for an unusable answer, with the reason for the model and the user."""


class _Role:
    """A role with questions to one model."""

    role = ""

    def __init__(self, setup: Setup) -> None:
        """Read the settings from the environment, then from `[vlm]`.

        Raises InputError with all missing or invalid settings.
        """
        options = read_options(setup, "vlm", OPTIONS)
        self._url = os.environ.get(URL) or options["url"]
        self._model = setup.weights or os.environ.get(MODEL) or options["model"]
        self._key = os.environ.get(KEY, "").strip()
        self._timeout = options["timeout"]
        parts = urlsplit(self._url)
        name = f"{self.role}=vlm"
        if not self._url or not self._model:
            raise Message.NO_SERVER.error(
                "--backend", name, url=URL, model=MODEL, key=KEY
            )
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise Message.SERVER_NOT_ADDRESS.error("--backend", name, url=URL)
        self._where = f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"
        self._sampling = SAMPLING
        self._usage: list[dict[str, int]] = []

    @cached_property
    def _server(self) -> openai.OpenAI:
        return openai.OpenAI(
            base_url=self._url,
            api_key=self._key or "none",
            timeout=self._timeout,
            max_retries=VLM.retries,
        )

    def ask(self, queries: Sequence[Query]) -> list[Any]:
        """Return the answers to all questions, or raise InputError if one has no usable
        answer.
        """
        self._usage = []
        pool = ThreadPoolExecutor(VLM.parallel)
        try:
            return list(pool.map(self._answer, queries))
        except BaseException:
            # Closing the client aborts the requests in progress.
            self.close()
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)

    def note(self) -> Mapping[str, Any]:
        """Return the model, the server and the usage of the last call, for the
        record.
        """
        keys = ("requests", "cached", "tokens_in", "tokens_out")
        usage = {key: sum(record.get(key, 0) for record in self._usage) for key in keys}
        return {"model": self._model, "server": self._where, **usage}

    def close(self) -> None:
        """Close the connections."""
        if (server := self.__dict__.pop("_server", None)) is not None:
            server.close()

    def _answer(self, query: Query) -> Any:
        """Return a usable answer, from the cache if possible."""
        file = self._cache_file(query)
        # The file may be missing or broken; then the model is asked.
        with suppress(OSError, UnicodeDecodeError, UnusableAnswerError):
            cached_answer = parse_answer(file.read_text(encoding="utf-8"), query)
            self._usage.append({"cached": 1})
            return cached_answer
        answer = self._usable(query)
        # The cache is optional, so a read-only folder is not an error.
        with suppress(OSError):
            file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(file, json.dumps(answer, ensure_ascii=False).encode())
        return answer

    def _usable(self, query: Query) -> Any:
        """Return an answer of the model, which gets the fault of each unusable
        answer.
        """
        content: list[dict[str, Any]] = [{"type": "text", "text": query.text}]
        content += list(map(picture_part, query.pictures))
        turns: list[dict[str, Any]] = [{"role": "user", "content": content}]
        fault = ""
        for _ in range(VLM.attempts):
            text = self._complete(query, turns)
            try:
                return parse_answer(text, query)
            except UnusableAnswerError as error:
                fault = str(error)
            retry_request = f"That cannot be used: {fault}. Answer again, with the JSON object alone."
            turns += [
                {"role": "assistant", "content": plain_line(text, 2000) or "(nothing)"},
                {"role": "user", "content": retry_request},
            ]
        self._fail(query, f"answered nonsense {VLM.attempts} times: {fault}")

    def _complete(self, query: Query, turns: Sequence[Mapping[str, Any]]) -> str:
        """Return the reply to `turns`, or raise InputError if the server fails."""
        request: dict[str, Any] = {"model": self._model, "messages": turns}
        try:
            try:
                reply = self._server.chat.completions.create(
                    **request, **self._sampling
                )
            # Some models refuse sampling options; such a server is asked without them
            # from now on.
            except (openai.BadRequestError, openai.UnprocessableEntityError):
                self._sampling = {}
                reply = self._server.chat.completions.create(**request)
            message = reply.choices[0].message
            usage = reply.usage
        except openai.OpenAIError as error:
            body = getattr(error, "body", None)
            text = str(
                body.get("message")
                if isinstance(body, dict)
                else error.__cause__ or error
            )
            status = getattr(error, "status_code", type(error).__name__)
            self._fail(query, f"fails ({status}: {plain_line(text, 160)})")
        # A wrong address often returns a web page instead of a completion.
        except (ValueError, AttributeError, IndexError, TypeError):
            self._fail(query, "gave what is no chat completion")
        tokens = (
            getattr(usage, f"{kind}_tokens", None) or 0
            for kind in ("prompt", "completion")
        )
        self._usage.append(
            dict(
                zip(("requests", "tokens_in", "tokens_out"), (1, *tokens), strict=True)
            )
        )
        return message.content or getattr(message, "refusal", None) or ""

    def _fail(self, query: Query, reason: str) -> NoReturn:
        """Raise InputError with the failure, the server, the model and the fix.

        The key is masked in the text.
        """
        about = f"{self._where} (model {self._model}), asked for {self.role} of {query.subject},"
        if self._key:
            reason = reason.replace(self._key, "***")
        message = Message.SERVER_FAILED
        values = {"failure": reason, "url": URL, "model": MODEL, "key": KEY}
        raise message.error("--backend", about, **values) from None

    def _cache_file(self, query: Query) -> Path:
        """Return the cache file of an answer in `$XDG_CACHE_HOME/physgen/vlm`.

        Its name is a hash of everything that the answer depends on.
        """
        pictures = [sha256(picture).hexdigest() for picture in query.pictures]
        # The server is part of the hash because servers call different models
        # `default`.
        content = [self._where, self._model, query.text, pictures, query.schema]
        digest = sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
        return cache_folder() / "vlm" / digest[:2] / f"{digest}.json"


class Categories(_Role):
    """The backend `categories=vlm`: the kinds of objects and surfaces in a photo."""

    role = "categories"

    def __call__(self, rgb: Rgb) -> Sequence[Category]:
        """Return each noun once, or raise InputError.

        A repeated noun is movable only if it is movable every time.
        """
        (answer,) = self.ask([categories_query(rgb)])
        movability: dict[str, bool] = {}
        for entry in answer["categories"]:
            if noun := clean_name(entry["noun"]):
                movability[noun] = entry["movable"] and movability.get(noun, True)
        return [Category(*item) for item in movability.items()][: VLM.categories]


class Label(_Role):
    """The backend `label=vlm`: labels of objects."""

    role = "label"

    def __call__(
        self, rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]
    ) -> Mapping[int, Name]:
        """Return the label of every object by id, or raise InputError.

        Similar objects share one question.
        """
        masks = {item.id: np.asarray(labels == item.id) for item in objects}
        groups = similar_groups(rgb, objects, masks)
        queries = [label_query(rgb, masks[group[0].id]) for group in groups]
        names = []
        for answer in self.ask(queries):
            names.append(Name(clean_name(answer["name"]), VLM.label_confidence))
        return {
            item.id: name
            for group, name in zip(groups, names, strict=True)
            for item in group
        }


class Physics(_Role):
    """The backend `physics=vlm`: mass, friction, elasticity, rolling, material and
    size.
    """

    role = "physics"

    def __call__(
        self, rgb: Rgb, objects: Sequence[PhotoObject], pixels_per_meter: float | None
    ) -> Mapping[int, Matter]:
        """Return the matter of every object by id, or raise InputError.

        Similar objects share one question.
        """
        size = rgb.shape[1], rgb.shape[0]
        masks = {}
        for item in objects:
            masks[item.id] = raster.coverage(item.outline, size) >= 0.5
        groups = similar_groups(rgb, objects, masks)
        queries = []
        for group in groups:
            queries.append(
                physics_query(rgb, masks[group[0].id], group[0], pixels_per_meter)
            )
        result: dict[int, Matter] = {}
        for group, answer in zip(groups, self.ask(queries), strict=True):
            result |= group_matter(answer, group, self._model)
        return result


class Story(_Role):
    """Puts the question which edits make a story come true, in one conversation."""

    role = "story"

    def reply(self, query: Query, turns: Sequence[Turn]) -> str:
        """Return the reply to a conversation; it may be unusable. Raises InputError."""
        messages = []
        for turn in turns:
            content: list[dict[str, Any]] = [{"type": "text", "text": turn.text}]
            content += list(map(picture_part, turn.pictures))
            if turn.is_reply:
                role = "assistant"
            else:
                role = "user"
            messages.append(
                {"role": role, "content": turn.text if turn.is_reply else content}
            )
        return self._complete(query, messages)


categories, label, physics = Categories, Label, Physics
"""The factories named in the registry."""


def similar_groups(
    rgb: Rgb, objects: Sequence[PhotoObject], masks: Mapping[int, Mask]
) -> list[list[PhotoObject]]:
    """Group objects by label and size, and also by colour if the label is a single
    word.

    A plain `ball` may be of steel or rubber, so that its colour matters.
    """
    groups: list[list[PhotoObject]] = []
    lengths = {item.id: box_sides(item.outline) for item in objects}
    colours = {item.id: median_lab(rgb, masks[item.id]) for item in objects}

    def similar(a: PhotoObject, b: PhotoObject) -> bool:
        pairs = zip(lengths[a.id], lengths[b.id], strict=True)
        same_size = all(
            1 / VLM.similar_size <= x / y <= VLM.similar_size for x, y in pairs
        )
        distance = float(np.linalg.norm(colours[a.id] - colours[b.id]))
        same_material = " " in a.label.strip() or distance <= VLM.similar_colour
        return a.label == b.label and a.cut == b.cut and same_size and same_material

    for item in objects:
        group = next((group for group in groups if similar(group[0], item)), None)
        if group is None:
            groups.append([item])
        else:
            group.append(item)
    return groups


def group_matter(
    answer: Mapping[str, Any], group: Sequence[PhotoObject], model: str
) -> Mapping[int, Matter]:
    """Return the matter of each object of a group by id, from the answer about the
    first one.

    If another object is larger or smaller, its mass is scaled by the cube of the ratio
    of lengths.
    """
    reason = plain_line(answer["reason"], 240).rstrip(".")
    if len(group) > 1:
        reason += f"; asked once for {len(group)} alike"
    material = plain_line(answer["material"], 60)
    result = {}
    for item in group:
        ratio = box_sides(item.outline)[0] / box_sides(group[0].outline)[0]
        ratio = ratio if abs(ratio - 1) > VLM.same_length else 1.0
        result[item.id] = Matter(
            mass=float(f"{answer['mass'] * ratio**3:.3g}"),
            friction=round(answer["friction"], 3),
            elasticity=round(answer["elasticity"], 3),
            rolling=float(f"{answer['rolling']:.2g}"),
            # Only for circles the moment of inertia depends on the solid.
            solid=Solid(answer["solid"])
            if isinstance(item.outline, Disc)
            else Solid.PLATE,
            confidence=VLM.mass_confidence,
            reason=reason,
            surface=f"{material}, as {plain_line(model, 60)} judges",
            size=float(f"{answer['size'] * ratio:.3g}"),
            material=material,
        )
    return result


def parse_answer(text: str, query: Query) -> Any:
    """Return the first JSON object in `text` that answers `query`.

    Prose, code fences and thoughts around it are skipped. Raises UnusableAnswerError
    with the faults of the first JSON object.
    """
    text = re.sub(
        r"<think>.*?(</think>|\Z)", " ", text[: VLM.answer], flags=re.DOTALL
    ).strip()
    if text:
        first = ""
    else:
        first = "it was empty"
    for value in _json_objects(text):
        faults = _faults(value, query)
        if not faults:
            return value
        first = first or "; ".join(faults[:4])
    raise UnusableAnswerError(
        first or f'it had no JSON in it, but "{plain_line(text, 60)}"'
    )


def _json_objects(text: str) -> Iterator[Any]:
    """Yield every outermost JSON object of a text."""
    # NaN and Infinity stay text, so that the schema refuses them.
    decoder = json.JSONDecoder(parse_constant=lambda name: name)
    position = 0
    for _ in range(VLM.starts):
        if (start := text.find("{", position)) < 0:
            return
        try:
            value, position = decoder.raw_decode(text, start)
        # The nesting is too deep; the next bracket would fail in the same way.
        except RecursionError:
            return
        except ValueError:
            position = start + 1
        else:
            yield value


def _faults(value: Any, query: Query) -> list[str]:
    """Return violations of the schema, or contradictions if the schema is satisfied."""
    faults = []
    errors = Draft202012Validator(query.schema).iter_errors(value)
    for error in sorted(errors, key=lambda e: (len(e.path), str(e.path))):
        place = error.json_path.removeprefix("$").lstrip(".")
        message = plain_line(error.message, 120)
        faults.append(f"{place}: {message}" if place else message)
    return faults or query.contradictions(value)


def picture_part(picture: bytes) -> dict[str, Any]:
    """Return a PNG as a part of a message."""
    url = f"data:image/png;base64,{b64encode(picture).decode()}"
    return {"type": "image_url", "image_url": {"url": url}}
