"""Categories, labels and physical properties from a vision-language model behind an OpenAI-compatible server.

The two questions of the paper (appendix, "Segmentation" and "Physical properties reasoning") in other words, and for
more answers: material, solid, rolling and true size, which gives the photo its scale. Each answer is one JSON object,
checked against a schema; the model is given the fault of an unusable one and asked again.
"""

from __future__ import annotations

import json
import os
import re
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from math import ceil
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import urlsplit

import cv2
import numpy as np
import openai
from jsonschema import Draft202012Validator
from numpy.typing import NDArray

from physgen.files import cache_folder, write_atomic
from physgen.geometry import raster
from physgen.geometry.polygon import Disc
from physgen.geometry.scale import box_sides
from physgen.messages import Message
from physgen.perceive.roles import Category, Labels, Matter, Name, PhotoObject, Rgb
from physgen.registry import Options, Setup, read_options
from physgen.scene.scene import Solid

Mask = NDArray[np.bool_]
Schema = Mapping[str, Any]
URL, MODEL, KEY = "PHYSGEN_VLM_URL", "PHYSGEN_VLM_MODEL", "PHYSGEN_VLM_KEY"
OPTIONS: Options = {
    "url": ("", {"type": "string", "not": {"pattern": "@"}}),  # no password in a file
    "model": ("", {"type": "string"}),
    "timeout": (90, {"type": "number", "minimum": 0.05, "maximum": 3600}),
}
"""`[vlm]` of physgen.toml; `timeout`: s without a response after which a request is given up."""
SAMPLING: Mapping[str, Any] = {"temperature": 0, "seed": 0}
"""Left out for a server that refuses them."""


@dataclass(frozen=True)
class Constants:
    """Constants of requests, answers and pictures."""

    attempts: int = 3  # how often a question is put until its answer is usable
    retries: int = 2  # how often a request is repeated when the server fails, is busy or does not answer
    parallel: int = 4  # concurrent requests
    answer: int = 50_000  # characters of an answer that are read
    starts: int = 200  # brackets at which JSON decoding is tried before giving up
    categories: int = 48  # at most, of a photo
    similar_size: float = (
        1.15  # ratio of lengths up to which two objects share one question
    )
    similar_colour: float = (
        20.0  # CIELAB distance up to which two objects have one colour
    )
    named: float = 0.8  # confidence of a name
    weighed: float = (
        0.49  # confidence of a mass judged by eye: its logarithm scatters by 0.6
    )
    same_length: float = (
        0.05  # relative difference in length up to which similar objects count as equal
    )
    name: int = 48  # characters of a name
    densest: float = 23.0  # g/cm³: osmium, the densest element (CRC)
    photo: int = 1024  # px: the longer side of a whole photo, at most
    closeup: tuple[int, int] = (
        256,
        512,
    )  # px: the longer side of a close-up, at least and at most
    margin: float = 0.25  # around an object, as a share of its longer side
    surroundings: float = 0.4  # share of their light that an object's surroundings keep
    ink: tuple[int, int, int] = (
        255,
        0,
        255,
    )  # RGB of outlines: hardly any object is magenta


VLM = Constants()


def object_schema(**properties: Schema) -> dict[str, Any]:
    """The schema of an object with these properties, all of them required and no others allowed."""
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


TEXT: Schema = {"type": "string", "minLength": 1}
CATEGORIES_SCHEMA = object_schema(
    categories={
        "type": "array",
        "minItems": 1,
        "items": object_schema(noun=TEXT, movable={"type": "boolean"}),
    }
)
LABEL_SCHEMA = object_schema(name=TEXT)
PHYSICS_SCHEMA = object_schema(
    reason=TEXT,
    material=TEXT,
    size={"type": "number", "minimum": 1e-3, "maximum": 50},
    solid={"type": "string", "enum": [solid.value for solid in Solid]},
    mass={"type": "number", "minimum": 1e-3, "maximum": 1e7},
    friction={"type": "number", "minimum": 0, "maximum": 1.5},
    elasticity={"type": "number", "minimum": 0, "maximum": 1},
    rolling={"type": "number", "minimum": 0, "maximum": 0.3},
)
"""From a grain to a lorry, in m and g; rubber on dry asphalt has the most friction. The reason comes first, so that the
model reasons before it writes numbers."""

CATEGORIES_QUESTION = """\
Name every kind of object and of surface that this photo shows, so that each part of it belongs to exactly
one kind, from the most striking to the least. Leave out nothing that stands, lies or hangs in it, and
neither the table, floor, wall or sky behind. For each kind write one noun, a single word in the singular
without a hyphen; no kind twice, and none that is part of another.
State for each whether it is movable: true for separate objects with an outline of their own (a ball, a cup,
a toy car) of which every one in the photo is seen whole, nothing of it hidden and not cut off by the photo's
edge, and could be pushed or lifted. False for surfaces and stuff (grass, water, a wall), for what is fixed
in place, and for what holds the rest.
Answer with one JSON object: {"categories": [{"noun": ..., "movable": true or false}, ...]}."""

LABEL_QUESTION = """\
The first picture is a photo; one object in it is outlined in magenta. The second picture shows that object
close, its surroundings darkened.
Name it so that a person could guess its weight from the name: a short English noun in the singular, with
the material before it where that can be seen ("wooden block", "tennis ball", "steel can", "ceramic mug").
No numbers, no place, and no colour unless the name needs it.
Answer with one JSON object: {"name": ...}."""

PHYSICS_QUESTION = """\
The first picture is a photo; one object in it{label} is outlined in magenta. The second picture shows that
object close, its surroundings darkened. Judge the real object, not its picture:
- reason: in one sentence, what it is, how large and of what, and how the mass follows from that; think of
  ordinary objects of its kind, of what is hollow or filled, and of objects beside it whose size is known
- material: of its surface, in a word or two
- size: its longest side in metres, as it is in reality{hint}
- solid: sphere for a ball, hoop for a ring or tyre, disc for a coin, wheel or cylinder seen from its end,
  else plate
- mass: in grams
- friction: Coulomb's coefficient of friction on an ordinary table, 0 for none, 1.5 at most
- elasticity: the share of its speed that it keeps when it bounces off something hard, 0 for none, 1 for all
- rolling: its coefficient of rolling resistance on a hard floor: about 0.001 for polished steel, 0.01 for
  wood, 0.05 for what gives way
Every number is one exact number, without its unit. Answer with one JSON object of these keys."""


@dataclass(frozen=True)
class Query:
    """A question about pictures."""

    about: str  # in one to three words, for messages: `ball`
    text: str
    pictures: tuple[bytes, ...]  # PNG
    schema: Schema  # of the answer
    contradictions: Callable[[Any], list[str]] = lambda answer: []
    """Faults of an answer that keeps to the schema."""


@dataclass(frozen=True)
class Turn:
    """One message of a conversation."""

    text: str
    pictures: tuple[bytes, ...] = ()  # PNG
    is_reply: bool = False


class UnusableAnswerError(Exception):
    """An answer that cannot be used; its text gives the reason, for the model and for the user."""


class _Role:
    """Puts the questions of one role to its model."""

    role = ""

    def __init__(self, setup: Setup) -> None:
        """Settings from the environment, then from `[vlm]`. Raises InputError with what is missing or wrong."""
        options = read_options(setup, "vlm", OPTIONS)
        self._url = os.environ.get(URL) or options["url"]
        self._model = setup.weights or os.environ.get(MODEL) or options["model"]
        self._key = os.environ.get(KEY, "").strip()
        self._timeout = options["timeout"]
        parts, name = urlsplit(self._url), f"{self.role}=vlm"
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
        """The answer to each question. Raises InputError where one has no usable answer."""
        self._usage = []
        pool = ThreadPoolExecutor(VLM.parallel)
        try:
            return list(pool.map(self._answer, queries))
        except BaseException:
            self.close()  # breaks off what is under way
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)

    def note(self) -> Mapping[str, Any]:
        """Model, server and usage of the last call, for the record."""
        keys = ("requests", "cached", "tokens_in", "tokens_out")
        usage = {key: sum(one.get(key, 0) for one in self._usage) for key in keys}
        return {"model": self._model, "server": self._where, **usage}

    def close(self) -> None:
        """Close the connections."""
        if (server := self.__dict__.pop("_server", None)) is not None:
            server.close()

    def _answer(self, query: Query) -> Any:
        """A usable answer, from the cache where it was given before."""
        file = self._cache_file(query)
        with suppress(
            OSError, UnicodeDecodeError, UnusableAnswerError
        ):  # none there, or a broken one
            cached = parse_answer(file.read_text(encoding="utf-8"), query)
            self._usage.append({"cached": 1})
            return cached
        answer = self._usable(query)
        with suppress(
            OSError
        ):  # a folder that cannot be written to is no reason to fail
            file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(file, json.dumps(answer, ensure_ascii=False).encode())
        return answer

    def _usable(self, query: Query) -> Any:
        """An answer of the model; it is given the fault of each unusable one."""
        content: list[dict[str, Any]] = [{"type": "text", "text": query.text}]
        content += [picture_part(picture) for picture in query.pictures]
        turns: list[dict[str, Any]] = [{"role": "user", "content": content}]
        fault = ""
        for _ in range(VLM.attempts):
            text = self._complete(query, turns)
            try:
                return parse_answer(text, query)
            except UnusableAnswerError as error:
                fault = str(error)
            again = f"That cannot be used: {fault}. Answer again, with the JSON object alone."
            turns += [
                {"role": "assistant", "content": plain_line(text, 2000) or "(nothing)"},
                {"role": "user", "content": again},
            ]
        self._fail(query, f"answered nonsense {VLM.attempts} times: {fault}")

    def _complete(self, query: Query, turns: Sequence[Mapping[str, Any]]) -> str:
        """The reply to `turns`. Raises InputError."""
        request: dict[str, Any] = {"model": self._model, "messages": turns}
        try:
            try:
                reply = self._server.chat.completions.create(
                    **request, **self._sampling
                )
            except (openai.BadRequestError, openai.UnprocessableEntityError):
                self._sampling = {}
                reply = self._server.chat.completions.create(**request)
            message, usage = reply.choices[0].message, reply.usage
        except openai.OpenAIError as error:
            body = getattr(error, "body", None)
            text = str(
                body.get("message")
                if isinstance(body, dict)
                else error.__cause__ or error
            )
            status = getattr(error, "status_code", type(error).__name__)
            self._fail(query, f"fails ({status}: {plain_line(text, 160)})")
        except (ValueError, AttributeError, IndexError, TypeError):  # a web page
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

    def _fail(self, query: Query, what: str) -> NoReturn:
        """One message: the failure, the server and model, and the fix; never the key."""
        about = f"{self._where} (model {self._model}), asked for {self.role} of {query.about},"
        what = what.replace(self._key, "***") if self._key else what
        failed = Message.SERVER_FAILED
        values = {"failure": what, "url": URL, "model": MODEL, "key": KEY}
        raise failed.error("--backend", about, **values) from None

    def _cache_file(self, query: Query) -> Path:
        """The file of an answer below `$XDG_CACHE_HOME/physgen/vlm`, named by all that the answer depends on."""
        pictures = [sha256(picture).hexdigest() for picture in query.pictures]
        # servers call different models `default`
        content = [self._where, self._model, query.text, pictures, query.schema]
        digest = sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
        return cache_folder() / "vlm" / digest[:2] / f"{digest}.json"


class Categories(_Role):
    """The backend `categories=vlm`: the kinds of objects and surfaces in a photo."""

    role = "categories"

    def __call__(self, rgb: Rgb) -> Sequence[Category]:
        """Each noun once; a repeated one is movable if it is so each time. Raises InputError."""
        picture = _png(_resized(rgb, 0, VLM.photo))
        query = Query(
            "the photo", CATEGORIES_QUESTION, (picture,), CATEGORIES_SCHEMA, _nameless
        )
        (answer,) = self.ask([query])
        found: dict[str, bool] = {}
        for one in answer["categories"]:
            if noun := clean_name(one["noun"]):
                found[noun] = one["movable"] and found.get(noun, True)
        return [Category(*item) for item in found.items()][: VLM.categories]


class Label(_Role):
    """The backend `label=vlm`: names of objects."""

    role = "label"

    def __call__(
        self, rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]
    ) -> Mapping[int, Name]:
        """A name for every object, by id; similar objects share one question. Raises InputError."""
        masks = {item.id: np.asarray(labels == item.id) for item in objects}
        groups = similar_groups(rgb, objects, masks)
        queries = [label_query(rgb, masks[group[0].id]) for group in groups]
        names = [
            Name(clean_name(answer["name"]), VLM.named) for answer in self.ask(queries)
        ]
        return {
            item.id: name
            for group, name in zip(groups, names, strict=True)
            for item in group
        }


class Physics(_Role):
    """The backend `physics=vlm`: mass, friction, elasticity, rolling, material and size."""

    role = "physics"

    def __call__(
        self, rgb: Rgb, objects: Sequence[PhotoObject], pixels_per_meter: float | None
    ) -> Mapping[int, Matter]:
        """Matter of every object, by id; similar objects share one question. Raises InputError."""
        size = rgb.shape[1], rgb.shape[0]
        masks = {
            item.id: raster.coverage(item.outline, size) >= 0.5 for item in objects
        }
        groups = similar_groups(rgb, objects, masks)
        queries = [
            physics_query(rgb, masks[group[0].id], group[0], pixels_per_meter)
            for group in groups
        ]
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
            content += [picture_part(picture) for picture in turn.pictures]
            role = "assistant" if turn.is_reply else "user"
            messages.append(
                {"role": role, "content": turn.text if turn.is_reply else content}
            )
        return self._complete(query, messages)


categories, label, physics = Categories, Label, Physics
"""The factories named in the registry."""


def similar_groups(
    rgb: Rgb, objects: Sequence[PhotoObject], masks: Mapping[int, Mask]
) -> list[list[PhotoObject]]:
    """Objects grouped by label and size, and by colour where the label is one word: a `ball` may be steel or rubber."""
    groups: list[list[PhotoObject]] = []
    lengths = {item.id: box_sides(item.outline) for item in objects}
    colours = {item.id: median_lab(rgb, masks[item.id]) for item in objects}

    def similar(a: PhotoObject, b: PhotoObject) -> bool:
        pairs = zip(lengths[a.id], lengths[b.id], strict=True)
        sized = all(1 / VLM.similar_size <= x / y <= VLM.similar_size for x, y in pairs)
        distance = float(np.linalg.norm(colours[a.id] - colours[b.id]))
        same_material = " " in a.label.strip() or distance <= VLM.similar_colour
        return a.label == b.label and a.cut == b.cut and sized and same_material

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
    """Matter of each of the similar objects of a group, by id, from the `answer` about the first.

    Mass is scaled by the cube of the length where an object is larger or smaller than that.
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
            # only circles have another moment than that of their area
            solid=Solid(answer["solid"])
            if isinstance(item.outline, Disc)
            else Solid.PLATE,
            confidence=VLM.weighed,
            reason=reason,
            surface=f"{material}, as {plain_line(model, 60)} judges",
            size=float(f"{answer['size'] * ratio:.3g}"),
            material=material,
        )
    return result


def label_query(rgb: Rgb, mask: Mask) -> Query:
    """The name of one object."""
    pictures = _outlined_photo(rgb, mask), _closeup(rgb, mask)
    return Query("an object", LABEL_QUESTION, pictures, LABEL_SCHEMA, _nameless)


def _nameless(answer: Mapping[str, Any]) -> list[str]:
    """A fault where no name is left of the answer."""
    names = (
        [answer["name"]]
        if "name" in answer
        else [one["noun"] for one in answer["categories"]]
    )
    return [] if any(map(clean_name, names)) else ["there is no name in it"]


def physics_query(
    rgb: Rgb, mask: Mask, item: PhotoObject, pixels_per_meter: float | None
) -> Query:
    """Material, mass and size of one object."""
    name = plain_line(item.label, VLM.name)
    label = f', "{name}",' if name else ""
    hint = ""
    if pixels_per_meter is not None and not item.cut:
        hint = f"; by the photo's scale it is about {box_sides(item.outline)[0] / pixels_per_meter:.2g}"
    pictures = _outlined_photo(rgb, mask), _closeup(rgb, mask)
    text = PHYSICS_QUESTION.format(label=label, hint=hint)
    return Query(
        name or "an object", text, pictures, PHYSICS_SCHEMA, mass_contradictions
    )


def mass_contradictions(answer: Mapping[str, Any]) -> list[str]:
    """A fault where the mass is more than that of a cube of the densest element with the longest side."""
    size, mass = answer["size"], answer["mass"]
    if mass <= VLM.densest * (100 * size) ** 3:
        return []
    return [f"mass: an object whose longest side is {size:g} m cannot weigh {mass:g} g"]


def clean_name(text: str) -> str:
    """A noun as labels are written: lower case, no quotes, no article.

    >>> clean_name(' A "Tennis ball." ')
    'tennis ball'
    """
    ends = " \"'`.,;:*"
    line = plain_line(text, VLM.name).lower().strip(ends)
    for article in ("a ", "an ", "the "):
        line = line.removeprefix(article).strip(ends)
    return line


def median_lab(rgb: Rgb, mask: Mask) -> NDArray[np.float64]:
    """(3,) an object's median colour in CIELAB, L in 0..100."""
    inside = rgb[mask] if mask.any() else rgb.reshape(-1, 3)
    lab = cv2.cvtColor(
        np.median(inside, axis=0).astype(np.float32)[None, None] / 255,
        cv2.COLOR_RGB2LAB,
    )
    return np.asarray(lab[0, 0], np.float64)


def _outlined_photo(rgb: Rgb, mask: Mask) -> bytes:
    """The photo with one object outlined, as PNG."""
    picture = _resized(rgb, 0, VLM.photo).copy()
    _draw_outline(picture, _fitted(mask, picture))
    return _png(picture)


def _closeup(rgb: Rgb, mask: Mask) -> bytes:
    """One object with a margin, outlined, its surroundings darkened, as PNG."""
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    if not len(rows):  # the object lies outside the photo
        return _png(_resized(rgb, *VLM.closeup))
    (y0, y1), (x0, x1) = ((int(line[0]), int(line[-1]) + 1) for line in (rows, columns))
    margin = max(ceil(VLM.margin * max(y1 - y0, x1 - x0)), 8)
    y0, x0 = max(y0 - margin, 0), max(x0 - margin, 0)
    part, inside = (
        rgb[y0 : y1 + margin, x0 : x1 + margin],
        mask[y0 : y1 + margin, x0 : x1 + margin],
    )
    picture = _resized(np.ascontiguousarray(part), *VLM.closeup).copy()
    fitted = _fitted(inside, picture)
    picture[~fitted] = (picture[~fitted] * VLM.surroundings).astype(np.uint8)
    _draw_outline(picture, fitted)
    return _png(picture)


def _resized(rgb: Rgb, least: int, most: int) -> Rgb:
    """A picture whose longer side is from `least` to `most` px."""
    tall, wide = rgb.shape[:2]
    factor = min(max(1.0, least / max(tall, wide)), most / max(tall, wide))
    if factor == 1:
        return rgb
    size = max(round(wide * factor), 1), max(round(tall * factor), 1)
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(rgb, size, interpolation=method), np.uint8)


def _fitted(mask: Mask, picture: Rgb) -> Mask:
    """A mask in the picture's size."""
    tall, wide = picture.shape[:2]
    if mask.shape == (tall, wide):
        return mask
    return np.asarray(cv2.resize(mask.astype(np.float32), (wide, tall)) >= 0.5)


def _draw_outline(picture: Rgb, mask: Mask) -> None:
    """An outline around the mask, outside of it so that the object is not covered."""
    wide = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    picture[wide & ~mask] = VLM.ink


def _png(rgb: Rgb) -> bytes:
    return cv2.imencode(".png", rgb[..., ::-1])[1].tobytes()


def parse_answer(text: str, query: Query) -> Any:
    """The first JSON object in `text` that answers `query`; prose, code fences and thoughts around it are skipped.

    Raises UnusableAnswerError with the faults of the first JSON found.
    """
    text = re.sub(
        r"<think>.*?(</think>|\Z)", " ", text[: VLM.answer], flags=re.DOTALL
    ).strip()
    first = "" if text else "it was empty"
    for value in _json_objects(text):
        faults = _faults(value, query)
        if not faults:
            return value
        first = first or "; ".join(faults[:4])
    raise UnusableAnswerError(
        first or f'it had no JSON in it, but "{plain_line(text, 60)}"'
    )


def _json_objects(text: str) -> Iterator[Any]:
    """Every outermost JSON object in a text."""
    decoder = json.JSONDecoder(
        parse_constant=lambda name: name
    )  # NaN and Infinity stay text
    position = 0
    for _ in range(VLM.starts):
        if (start := text.find("{", position)) < 0:
            return
        try:
            value, position = decoder.raw_decode(text, start)
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


def picture_part(picture: bytes) -> dict[str, Any]:
    """Return a PNG as a part of a message."""
    url = f"data:image/png;base64,{b64encode(picture).decode()}"
    return {"type": "image_url", "image_url": {"url": url}}


def plain_line(text: str, most: int = 300) -> str:
    """The printable characters of a text on one line, cut at a word.

    >>> plain_line("a  red\\n# ball\\x1b[0m")
    'a red # ball[0m'
    """
    line = " ".join("".join(c for c in text if c.isprintable() or c.isspace()).split())
    return (
        line
        if len(line) <= most
        else f"{line[:most].rpartition(' ')[0] or line[:most]} ..."
    )
