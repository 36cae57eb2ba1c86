"""All backends in one place: the table of roles and names, the choice from physgen.toml and flags, missing
libraries and weights, and the run of one backend after another.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import os
import re
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import urlsplit

from physgen.problems import InputError, Place, Problem, Severity

# ----------------------------------------------------------------------
# A role and a name -> the backend that fills it; the one table, importing nothing until asked.
#
# A newcomer adds a backend with one file under a `backends/` folder and one row here; `tests/contract` then
# runs on it.


@dataclass(frozen=True)
class Weights:
    """What a model is without: a file or a folder of numbers, loaded when it runs and never before."""

    id: str
    """On the hub; `""` where only a person's own file serves."""
    size: str
    """About, e.g. `1.1 GB`."""
    licence: str
    """As its card says; read it before use."""
    get: str = ""
    """How to get it, where it is not on the hub."""


@dataclass(frozen=True)
class Setup:
    """What a model's backend is told: which weights, and where to run them."""

    weights: str = ""
    """What stood after the colon of its name: a hub id or a local path; `""`: the row's own."""
    device: str = "auto"
    """`auto`, `cpu`, `cuda`, `cuda:1`, `mps`."""
    dtype: str = "auto"
    """`auto`, `float32`, `float16`, `bfloat16`."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Its table of the configuration, `[vlm]` for those called vlm."""


@dataclass(frozen=True)
class Backend:
    """One row of the table."""

    role: str
    """What it does: `segment`, `inpaint` ... ; the Protocol of the same name says what it takes and gives."""
    name: str
    target: str
    """`module:factory`; the factory gives a callable of the role's Protocol. It takes a `Setup` where the row has
    `weights` or is `told`, else nothing."""
    about: str
    """One sentence for `physgen backends`."""
    extra: str | None = None
    """The extra that brings what it imports; None: it is in the core."""
    needs: tuple[str, ...] = ()
    """Modules that it imports beyond the core."""
    weights: tuple[Weights, ...] = ()
    """What it loads unless told otherwise, the one that a `NAME:WEIGHTS` replaces first; `NAME:A,B` replaces two."""
    told: bool = False
    """Whether the factory takes a `Setup` though it loads no weights: a file's name, a server."""
    settings: tuple[str, ...] = ()
    """Environment variables without which it does not run, where its weights are not named after a colon."""
    uses: tuple[str, ...] = ()
    """What its callable takes by keyword beyond the Protocol's own: `categories`; `depth`, `normals`, `scenery`."""

    def missing(self) -> tuple[str, ...]:
        """Modules that it needs and that are not installed (looked for, not imported)."""
        return tuple(name for name in self.needs if importlib.util.find_spec(name) is None)


_HERE = "physgen.perceive.backends"
_REFINE = "physgen.refine.backends"
_EVALUATE = "physgen.evaluate.backends"

_TRANSFORMERS: dict[str, Any] = {"extra": "models", "needs": ("torch", "transformers")}
_DIFFUSERS: dict[str, Any] = {"extra": "models", "needs": ("torch", "diffusers", "transformers")}
_VLM: dict[str, Any] = {
    "extra": "models",
    "needs": ("openai", "jsonschema"),
    "told": True,
    "settings": ("PHYSGEN_VLM_URL", "PHYSGEN_VLM_MODEL"),
}
_GROUNDING = Weights("IDEA-Research/grounding-dino-tiny", "0.7 GB", "Apache-2.0")
_MAPS = ("depth", "normals", "scenery")

BACKENDS: tuple[Backend, ...] = (
    Backend("categories", "everyday", f"{_HERE}.categories_everyday:everyday",
            "Asks for the same things every time: what the material table names most often."),
    Backend("categories", "vlm", f"{_HERE}.vlm:categories",
            "A vision-language model names what the photo shows, and what of it could be moved.", **_VLM),
    Backend("segment", "learned", f"{_HERE}.segment_learned:learned",
            "A small network and edges propose, the network judges; trained on drawn and rendered homes."),
    Backend("segment", "classical", f"{_HERE}.segment_classical:classical",
            "Finds objects by edges, circles and colour; no model."),
    Backend("segment", "grounding-dino+sam", f"{_HERE}.segment_grounded:with_sam",
            "Grounding DINO boxes what it is told to find, SAM cuts it out; NAME:DINO,SAM names both weights.",
            uses=("categories",),
            weights=(_GROUNDING, Weights("facebook/sam-vit-huge", "2.6 GB", "Apache-2.0")), **_TRANSFORMERS),
    Backend("segment", "grounding-dino+sam2", f"{_HERE}.segment_grounded:with_sam2",
            "Grounding DINO boxes what it is told to find, SAM 2 cuts it out; NAME:DINO,SAM2 names both weights.",
            uses=("categories",),
            weights=(_GROUNDING, Weights("facebook/sam2.1-hiera-tiny", "0.2 GB", "Apache-2.0")), **_TRANSFORMERS),
    Backend("segment", "sam3", f"{_HERE}.segment_sam3:sam3",
            "SAM 3 cuts out every instance of what it is told to find.", uses=("categories",),
            weights=(Weights("facebook/sam3", "3.4 GB", "SAM licence", "ask for access on its hub page"),),
            **_TRANSFORMERS),
    Backend("segment", "file", f"{_HERE}.from_file:segment",
            "Another program's masks: a label map, PNG or .npy.", told=True),
    Backend("label", "shape", f"{_HERE}.label_shape:shape",
            "Calls round things ball, rectangles block and the rest object."),
    Backend("label", "vlm", f"{_HERE}.vlm:label",
            "A vision-language model names each object, shown the photo and its outline.", **_VLM),
    Backend("physics", "table", f"{_HERE}.physics_table:table",
            "Looks the label up in the material table and weighs the outline."),
    Backend("physics", "vlm", f"{_HERE}.vlm:physics",
            "A vision-language model judges mass, friction, elasticity, material and size.", **_VLM),
    Backend("depth", "none", f"{_HERE}.depth_none:none",
            "Holds everything for equally far: nothing in the offline line asks for depth."),
    Backend("depth", "depth-anything", f"{_HERE}.depth_anything:depth",
            "Depth Anything V2.",
            weights=(Weights("depth-anything/Depth-Anything-V2-Small-hf", "0.1 GB", "Apache-2.0"),), **_TRANSFORMERS),
    Backend("depth", "marigold", f"{_HERE}.marigold:depth",
            "Marigold's depth, by diffusion.",
            weights=(Weights("prs-eth/marigold-depth-v1-1", "2.6 GB", "RAIL++-M"),), **_DIFFUSERS),
    Backend("depth", "file", f"{_HERE}.from_file:depth",
            "Another program's depth, larger = farther: .npy, or a PNG of 8 or 16 bits.", told=True),
    Backend("normals", "blended", f"{_HERE}.normals_blended:blended",
            "Balls, turned things, cushions and flat faces, as outline, shading and the network say; tables, walls."),
    Backend("normals", "marigold", f"{_HERE}.marigold:normals",
            "Marigold's normals, by diffusion.",
            weights=(Weights("prs-eth/marigold-normals-v1-1", "2.6 GB", "RAIL++-M"),), **_DIFFUSERS),
    Backend("normals", "file", f"{_HERE}.from_file:normals",
            "Another program's normals, +x right, +y down, +z to the viewer: .npy, or a PNG with 128 = 0.", told=True),
    Backend("intrinsic", "retinex", f"{_HERE}.intrinsic_retinex:retinex",
            "Takes changes of colour as albedo, most others as shading; normals tell the rest."),
    Backend("intrinsic", "marigold", f"{_HERE}.marigold:intrinsic",
            "Marigold's albedo and shading, by diffusion.",
            weights=(Weights("prs-eth/marigold-iid-lighting-v1-1", "2.6 GB", "RAIL++-M"),), **_DIFFUSERS),
    Backend("intrinsic", "file", f"{_HERE}.from_file:intrinsic",
            "Another program's shading, linear: .npy or PNG; albedo is what is left of the photo.", told=True),
    Backend("light", "shading", f"{_HERE}.light_shading:shading",
            "Compares lights all over the sky with the shading of all things, and with highlights."),
    Backend("matte", "edge", f"{_HERE}.matte_edge:edge",
            "A soft border of about two pixels that follows the photo's own edge."),
    Backend("matte", "file", f"{_HERE}.from_file:matte",
            "Another program's coverage, 0 to 1: .npy or PNG.", told=True),
    Backend("inpaint", "fill", f"{_HERE}.inpaint_fill:fill",
            "Continues the surroundings' colour smoothly and borrows their grain."),
    Backend("inpaint", "lama", f"{_HERE}.inpaint_lama:lama",
            "LaMa, from its TorchScript file.", extra="models", needs=("torch",),
            weights=(Weights("", "0.2 GB", "Apache-2.0",
                             "save big-lama.pt, from whom you trust (it is a program), write inpaint=lama:PATH"),)),
    Backend("inpaint", "diffusion", f"{_HERE}.inpaint_diffusion:diffusion",
            "A diffusion model paints what is behind; the photo is put back around it.",
            weights=(Weights("stable-diffusion-v1-5/stable-diffusion-inpainting", "4.3 GB", "CreativeML OpenRAIL-M"),),
            **_DIFFUSERS),
    Backend("inpaint", "file", f"{_HERE}.from_file:inpaint",
            "Another program's background, as a picture; the photo is put back around it.", told=True),
    Backend("shadow", "geometry", f"{_HERE}.shadow_geometry:geometry",
            "Looks for the light whose shadows lie where the photo is dark, and lifts them."),
    Backend("boundary", "support", f"{_HERE}.boundary_support:support",
            "Tells side from top views and lays floors under the lowest points of objects."),
    Backend("boundary", "depth-normals", f"{_HERE}.boundary_depth_normals:depth_normals",
            "The paper's: what stands still, as far away as the objects are, as level, upright and sloped edges.",
            uses=_MAPS),
    Backend("refine", "none", f"{_REFINE}.none:none",
            "Leaves the video as it was drawn."),
    Backend("refine", "animatediff", f"{_REFINE}.animatediff:animatediff",
            "AnimateDiff retouches the video, 16 frames at a time; NAME:ADAPTER,BASE names both weights.",
            weights=(Weights("guoyww/animatediff-motion-adapter-v1-5-3", "1.7 GB", "no licence on its page"),
                     Weights("SG161222/Realistic_Vision_V5.1_noVAE", "4.3 GB", "CreativeML OpenRAIL-M")),
            **_DIFFUSERS),
    Backend("refine", "wan", f"{_REFINE}.wan:wan",
            "Wan 2.1 or 2.2 retouches the video, 81 frames at a time.",
            weights=(Weights("Wan-AI/Wan2.1-T2V-1.3B-Diffusers", "29 GB", "Apache-2.0"),), **_DIFFUSERS),
    Backend("refine", "cogvideox", f"{_REFINE}.cogvideox:cogvideox",
            "CogVideoX retouches the video, 49 frames at a time.",
            weights=(Weights("zai-org/CogVideoX-2b", "14 GB", "Apache-2.0"),), **_DIFFUSERS),
    Backend("features", "bank", f"{_EVALUATE}.features_bank:bank",
            "Colours and edges in fields of a picture, for evaluate fid; NOT what published FIDs are made of."),
    Backend("features", "inception", f"{_EVALUATE}.features_inception:inception",
            "The Inception network of published FIDs, from its TorchScript file.", extra="models", needs=("torch",),
            weights=(Weights("", "0.1 GB", "Apache-2.0",
                             "save inception-2015-12-05.pt, from whom you trust (it is a program), "
                             "write --features inception:PATH"),)),
    Backend("features", "module", f"{_EVALUATE}.features_module:own",
            "Anybody's function from pictures to features: module:PACKAGE.MODULE:FACTORY, or module:FILE.py:FACTORY.",
            told=True),
    Backend("flow", "dis", f"{_EVALUATE}.flow_dis:dis",
            "Dense Inverse Search, OpenCV's, for evaluate fid."),
    Backend("flow", "raft", f"{_EVALUATE}.flow_raft:raft",
            "RAFT, torchvision's.", extra="raft", needs=("torch", "torchvision"),
            weights=(Weights("", "20 MB", "BSD-3-Clause",
                             "save torchvision's raft_large_C_T_SKHT_V2-ff5fadd5.pth, write --flow raft:PATH"),)),
)  # fmt: skip
"""In each role, the first row is the default."""


def roles() -> tuple[str, ...]:
    """Every role, in the table's order."""
    return tuple(dict.fromkeys(row.role for row in BACKENDS))


def names(role: str) -> tuple[str, ...]:
    """Names of one role's backends, the default first."""
    return tuple(row.name for row in BACKENDS if row.role == role)


def find(role: str, name: str | None = None) -> Backend:
    """The row of `role` called `name` (None: the role's default).

    Raises InputError for a role or a name that is not in the table.

    >>> find("inpaint").name
    'fill'
    """
    if role not in roles():
        raise InputError.of("--backend", f'"{role}"', "is not a role", suggestion(role, roles()))
    for row in BACKENDS:
        if row.role == role and name in (None, row.name):
            return row
    known = names(role)
    raise InputError.of("--backend", f'{role}="{name}"', "is not a backend", suggestion(str(name), known))


def make(role: str, name: str | None = None, setup: Setup | None = None) -> Any:
    """The backend itself, imported now: a callable of the role's Protocol.

    Raises InputError for an unknown role or name, or when a library that it needs is not installed.
    """
    row = find(role, name)
    if problem := unmet(row):
        raise InputError([problem])
    module, _, factory = row.target.partition(":")
    build = getattr(importlib.import_module(module), factory)
    return build(setup or Setup()) if row.weights or row.told else build()


def unmet(row: Backend) -> Problem | None:
    """What keeps a row from running here: libraries that are not installed."""
    if not (missing := row.missing()):
        return None
    found, fix = f'{row.role}="{row.name}"', install(row) or "install physgen again"
    verb = "is" if len(missing) == 1 else "are"
    return Problem(
        Place("--backend"), "", found, f"needs {', '.join(missing)}, which {verb} not installed", fix
    )


def install(row: Backend) -> str | None:
    """The command that brings what a row imports; None: it is in the core."""
    return f'pip install "physgen[{row.extra}]"' if row.extra else None


def suggestion(found: str, known: Iterable[str]) -> str:
    """What else there is, for a message: the nearest first."""
    known = list(known)
    near = difflib.get_close_matches(found, known, 1)
    return (f"did you mean {near[0]}? " if near else "") + f"choose from {', '.join(known)}"


# ----------------------------------------------------------------------
# Who fills each role of perception, and how it went: choices -> backends called in turn, timed, and let go
# again.

Warn = Callable[[Problem], None]
FLAG = Place("--backend")


@dataclass(frozen=True)
class Choice:
    """One backend of a role, as `--backend` or a configuration names it."""

    name: str
    weights: str = ""
    """A hub id, or a path of weights or of a map; `""`: the row's own."""
    place: Place = field(default=FLAG, compare=False)
    """Where it was written."""

    def __str__(self) -> str:
        return f"{self.name}:{self.weights}" if self.weights else self.name


@dataclass(frozen=True)
class Plan:
    """Who shall do what, and with what; nothing is imported yet."""

    choices: Mapping[str, Choice] = field(default_factory=dict)
    """By role; the others are filled by their defaults."""
    device: str = "auto"
    dtype: str = "auto"
    keep: bool = False
    """Whether models stay in memory once their role is done, for the next photo."""
    fallback: bool = False
    """Whether the default of a role takes over from a backend that fails."""
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Tables of the configuration, by backend."""

    def row(self, role: str) -> Backend:
        """The row of the table that fills `role`."""
        choice = self.choices.get(role)
        return find(role, choice.name if choice else None)

    def setup(self, role: str) -> Setup:
        """What its factory is told."""
        choice = self.choices.get(role)
        options = self.options.get(self.row(role).name, {})
        return Setup(choice.weights if choice else "", self.device, self.dtype, options)

    def of(self, roles: Iterable[str]) -> Plan:
        """The same without what was chosen for other roles: a crew makes, and checks, all that is chosen."""
        kept = set(roles)
        return replace(self, choices={role: who for role, who in self.choices.items() if role in kept})


def choices(settings: Iterable[str], place: Place = FLAG) -> dict[str, Choice]:
    """`["segment=sam3:models/sam3", ...]` -> role -> Choice. Raises InputError with every wrong one.

    >>> str(choices(["inpaint=fill"])["inpaint"])
    'fill'
    """
    result: dict[str, Choice] = {}
    problems: list[Problem] = []
    for setting in settings:
        role, sign, text = setting.partition("=")
        name, colon, weights = text.partition(":")
        try:
            if not sign:
                raise InputError(
                    [Problem(place, "", f'"{setting}"', "is not ROLE=NAME", "write e.g. inpaint=fill")]
                )
            result[role] = choice(role, name, weights, place, bool(colon))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return result


def choice(role: str, name: str, weights: str = "", place: Place = FLAG, colon: bool = False) -> Choice:
    """A choice that the table knows. Raises InputError."""
    try:
        row = find(role, name)
    except InputError as error:
        raise InputError([Problem(place, "", p.found, p.expected, p.fix) for p in error.problems]) from None
    said = f'"{role}={name}{":" if colon or weights else ""}{weights}"'
    takes = bool(row.weights or row.told)
    if (colon or weights) and not takes:
        raise InputError(
            [Problem(place, "", said, "names weights for what has none", f"write {role}={name}")]
        )
    if colon and not weights:
        raise InputError(
            [Problem(place, "", said, "names nothing after the colon", f"write {role}={name}:PATH")]
        )
    return Choice(name, weights, place)


@dataclass
class Step:
    """How one role went, for the record."""

    role: str
    backend: str
    weights: str
    seconds: float
    instead_of: str = ""
    """What had been chosen and failed."""
    because: str = ""
    """How it failed."""
    note: Mapping[str, Any] = field(default_factory=dict)
    """What the backend says of its run: device, requests, tokens ..."""


def _unheard(problem: Problem) -> None:
    """Warnings that nobody reads."""


class Backends:
    """Backends by role, made when first called.

    A backend may have `close()`, which lets its model go, and `note()`, a mapping for the record.
    """

    def __init__(self, plan: Plan | None = None, warn: Warn = _unheard) -> None:
        """Raises InputError with everything that the plan needs and that is not here."""
        self.plan = plan or Plan()
        self.steps: list[Step] = []
        self._warn = warn
        self._made: dict[str, Any] = {}
        self._fallen: set[str] = set()
        problems: list[Problem] = []
        for role, said in self.plan.choices.items():
            missing = unmet(self.plan.row(role))
            if self.plan.fallback:
                continue  # what fails is told when its turn comes
            if missing is not None:
                problems.append(replace(missing, place=said.place))
                continue
            try:
                self.get(role)  # no weights are loaded yet
            except InputError as error:
                problems += [p if p.place != FLAG else replace(p, place=said.place) for p in error.problems]
        if "depth" in self.plan.row("boundary").uses and self.plan.row("depth").name == "none":
            place = self.plan.choices["boundary"].place
            fix = "choose who tells depth, too: depth=depth-anything, or depth=file:PATH"
            problems.append(
                Problem(place, "", f'"boundary={self.plan.choices["boundary"]}"', "needs depth", fix)
            )
        if problems:
            raise InputError(problems)

    def begin(self, warn: Warn = _unheard) -> None:
        """Another photo: the record starts anew, and what failed on the last is tried again."""
        self.steps, self._warn = [], warn
        for role in self._fallen:  # the stand-in goes, the chosen one is made again
            self.close(role)
        self._fallen.clear()

    def row(self, role: str) -> Backend:
        """The row that fills `role`: the default where the chosen one has failed."""
        return find(role) if role in self._fallen else self.plan.row(role)

    def name(self, role: str) -> str:
        """The row's name, for `from`."""
        return self.row(role).name

    def get(self, role: str) -> Any:
        """The backend itself."""
        if role not in self._made:
            setup = Setup() if role in self._fallen else self.plan.setup(role)
            self._made[role] = make(role, self.name(role), setup)
        return self._made[role]

    def call(self, role: str, *arguments: Any, **extra: Any) -> Any:
        """What the role's backend makes of `arguments`; of `extra` it is given what its row uses. See `run`."""

        def use(made: Any) -> Any:
            uses = self.row(role).uses
            return made(*arguments, **{key: extra[key] for key in uses if key in extra})

        return self.run(role, use)

    def run(self, role: str, use: Callable[[Any], Any]) -> Any:
        """What `use` makes of the role's backend; it takes a step of the record.

        Where it fails and the plan allows that, the role's default does it, `warn` is told, and so is the record.
        Raises InputError where what was chosen fails.
        """
        started = time.perf_counter()
        step = Step(role, self.name(role), self._weights(role), 0.0)
        try:
            result = use(self.get(role))
        except Exception as error:
            if self.row(role) is find(role):
                raise  # our own: nobody who chooses can mend that
            said, because = f"{role}={self.plan.choices[role]}", f"failed ({describe_error(error)})"
            if not self.plan.fallback:
                if isinstance(error, InputError):
                    raise
                fix = "see what failed, choose another, or let the offline one take over: --fallback"
                raise InputError([Problem(FLAG, "", said, because, fix)]) from error
            step.instead_of, step.because = str(self.plan.choices[role]), describe_error(error)
            self.close(role)
            self._fallen.add(role)
            step.backend, step.weights = self.name(role), ""
            fix = f"{step.backend} took over: see what failed, or choose another"
            self._warn(Problem(FLAG, "", said, because, fix, Severity.WARNING))
            result = use(self.get(role))
        step.seconds = time.perf_counter() - started
        told = getattr(self._made.get(role), "note", None)
        step.note = told() if told else {}
        self.steps.append(step)
        return result

    def fallen(self, role: str) -> bool:
        """Whether what was chosen has failed on this photo."""
        return role in self._fallen

    def _weights(self, role: str) -> str:
        row, said = self.row(role), self.plan.setup(role).weights
        return said or (row.weights[0].id if row.weights else "")

    def release(self, *roles: str) -> None:
        """The roles are done for this photo: their models go, unless they are to be kept."""
        if not self.plan.keep:
            for role in roles:
                self.close(role)

    def close(self, *roles: str) -> None:
        """Let go of what was made for `roles`, or for all."""
        for role in roles or tuple(self._made):
            let_go = getattr(self._made.pop(role, None), "close", None)
            if let_go is not None:
                with suppress(Exception):
                    let_go()

    def fell(self) -> list[Step]:
        """Steps that a default took over."""
        return [step for step in self.steps if step.instead_of]

    def models(self) -> bool:
        """Whether others than the core's own had a part, or were to have one."""
        return any(step.instead_of or step.backend != find(step.role).name for step in self.steps)

    def record(self) -> list[dict[str, Any]]:
        """Every step as JSON."""
        return [
            {**asdict(step), "seconds": round(step.seconds, 3), "note": dict(step.note)}
            for step in self.steps
        ]


def describe_error(error: Exception) -> str:
    """One line of what went wrong.

    >>> why(ValueError("a\\nb"))
    'ValueError: a'
    """
    if isinstance(error, InputError):
        told = "; ".join(" ".join(part for part in (p.found, p.expected) if part) for p in error.problems)
        return " ".join(told.split())
    lines = [line for line in str(error).splitlines() if line.strip()]
    return f"{type(error).__name__}: {lines[0][:200]}" if lines else type(error).__name__


# ----------------------------------------------------------------------
# physgen.toml, the user's and the folder's, and flags -> the plan of who perceives, with the mistakes in
# them.

NAME = "physgen.toml"
PROFILES: Mapping[str, Mapping[str, str]] = {
    "offline": {},
    "models": {
        "categories": "vlm",
        "segment": "grounding-dino+sam",
        "label": "vlm",
        "physics": "vlm",
        "depth": "depth-anything",
        "normals": "marigold",
        "intrinsic": "marigold",
        "inpaint": "diffusion",
        "boundary": "depth-normals",
    },
    "best": {
        "categories": "vlm",
        "segment": "sam3",
        "label": "vlm",
        "physics": "vlm",
        "depth": "marigold",
        "normals": "marigold",
        "intrinsic": "marigold",
        "inpaint": "diffusion",
        "boundary": "depth-normals",
    },
}
"""Profiles that are always there: role -> backend; the roles that they leave out have their defaults."""
SWITCHES = {"keep": bool, "fallback": bool, "device": str, "dtype": str, "profile": str}
PROGRAMS = ("lama", "inception", "module")
"""Backends whose weights are a program."""
OURS = f"say it on the command line, with --config, or in ~/.config/physgen/{NAME}"
DTYPES = ("auto", "float32", "float16", "bfloat16")
DEVICE = re.compile(r"auto|cpu|mps|cuda(:\d+)?")


@dataclass(frozen=True)
class Configuration:
    """One file's say, checked."""

    switches: Mapping[str, Any] = field(default_factory=dict)
    """`profile`, `device`, `dtype`, `keep`, `fallback`."""
    choices: Mapping[str, Choice] = field(default_factory=dict)
    profiles: Mapping[str, Mapping[str, Choice]] = field(default_factory=dict)
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Other tables, by backend."""
    place: Place = field(default=Place(NAME), compare=False)
    """Of its profile."""


def load_plan(
    settings: Sequence[str] = (),
    *,
    profile: str | None = None,
    config: Path | None = None,
    otherwise: Mapping[str, Any] = MappingProxyType({}),
    **switches: Any,
) -> Plan:
    """Flags over the folder's physgen.toml over the user's; `settings` are `ROLE=NAME[:WEIGHTS]`.

    `config` is read in place of both files. `switches` are `device`, `dtype`, `keep` and `fallback`, None where
    nobody said; `otherwise` has them where no file says either. Raises InputError with everything wrong.
    """
    files = (
        [read_configuration(config)]
        if config
        else [read_configuration(path, ours=path == user_file()) for path in configuration_files()]
    )
    problems: list[Problem] = []
    said: dict[str, Choice] = {}
    try:
        said = choices(settings)
    except InputError as error:
        problems += error.problems
    told: dict[str, Any] = dict(otherwise)
    merged: dict[str, Choice] = {}
    options: dict[str, dict[str, Any]] = {}
    profiles: dict[str, Mapping[str, Choice]] = {
        name: {role: choice(role, who) for role, who in rows.items()} for name, rows in PROFILES.items()
    }

    def take(name: str, place: Place) -> Mapping[str, Choice]:
        if name not in profiles:
            problems.append(Problem(place, "", f'"{name}"', "is no profile", suggestion(name, profiles)))
        # what a profile leaves out has its default, whoever chose before
        return profiles.get(name, {})

    for file in files:
        profiles |= file.profiles
        if (name := file.switches.get("profile")) is not None:
            merged = dict(take(name, file.place))
        merged |= file.choices
        told |= {key: value for key, value in file.switches.items() if key != "profile"}
        for name, table in file.options.items():
            options.setdefault(name, {}).update(table)
    if profile is not None:
        merged = dict(take(profile, Place("--profile")))
    merged |= said
    told |= {key: value for key, value in switches.items() if value is not None}
    problems += _odd(told, Place("--device"), Place("--dtype"))
    if problems:
        raise InputError(problems)
    return Plan(merged, options=options, **told)


def user_file() -> Path:
    """The user's own configuration."""
    home = os.environ.get("XDG_CONFIG_HOME")
    return (Path(home) if home else Path.home() / ".config") / "physgen" / NAME


def configuration_files() -> Iterator[Path]:
    """The configuration files that are there: the user's, then that of the folder or of one above it.

    Folders above that belong to somebody else are not looked into.
    """
    if user_file().is_file():
        yield user_file()
    here = Path.cwd()
    for folder in (here, *here.parents):
        if folder.stat().st_uid != here.stat().st_uid:
            return
        if (folder / NAME).is_file():
            yield folder / NAME
            return


def read_configuration(path: Path, ours: bool = True) -> Configuration:
    """One file. Raises InputError with everything wrong in it, by line.

    One that is not `ours`, but came with a folder, may not name programs to run or servers that photos are sent to.
    """
    try:
        text = path.read_text(encoding="utf-8")
        data = tomllib.loads(text)
    except OSError as error:
        raise InputError.of(str(path), "", f"cannot be read ({error.strerror})", "see --config") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError.of(
            str(path), "", f"is not TOML: {error}", "see docs/models.md for an example"
        ) from None
    problems: list[Problem] = []

    def at(*keys: str) -> Place:
        return Place(str(path), *_line(text, keys))

    def rows(table: Any, *above: str) -> dict[str, Choice]:
        result: dict[str, Choice] = {}
        if not isinstance(table, dict):
            problems.append(
                Problem(at(*above), ".".join(above), "", "is not a table", 'write segment = "sam3" below it')
            )
            return result
        for role, text_of in table.items():
            place = at(*above, role)
            if not isinstance(text_of, str):
                problems.append(Problem(place, role, repr(text_of), "is not text", 'write e.g. "sam3"'))
                continue
            who, colon, weights = text_of.partition(":")
            weights = ",".join(_beside(path, part) for part in weights.split(","))
            if who in PROGRAMS and weights and not ours:
                found = f'"{role} = {text_of}"'
                problems.append(
                    Problem(place, role, found, "is a program that a folder's file may not run", OURS)
                )
                continue
            try:
                result[role] = choice(role, who, weights, place, bool(colon))
            except InputError as error:
                problems.extend(error.problems)
        return result

    switches = {key: data.pop(key) for key in SWITCHES if key in data}
    for key, value in list(switches.items()):
        if not isinstance(value, SWITCHES[key]):
            kind = "true or false" if SWITCHES[key] is bool else "text"
            problems.append(Problem(at(key), key, repr(value), f"is not {kind}", f"write {kind}"))
            del switches[key]
    problems += _odd(switches, at("device"), at("dtype"))
    chosen = rows(data.pop("backend", {}), "backend")
    named = {name: rows(table, "profiles", name) for name, table in data.pop("profiles", {}).items()}
    known = {row.name for row in BACKENDS}
    options = {}
    for name, table in data.items():
        if name not in known or not isinstance(table, dict):
            keys = [*SWITCHES, "backend", "profiles", *sorted(known)]
            problems.append(
                Problem(at(name), name, f'"{name}"', "means nothing here", suggestion(name, keys))
            )
        else:
            options[name] = table
    for name, table in () if ours else options.items():
        host = urlsplit(str(table.get("url", ""))).hostname
        if host not in (None, "localhost", "127.0.0.1", "::1"):
            expected = "is a server that a folder's file may not choose: photos are sent to it"
            problems.append(Problem(at(name, "url"), f"{name}.url", f'"{host}"', expected, OURS))
    if problems:
        raise InputError(problems)
    return Configuration(switches, chosen, named, options, at("profile"))


def _beside(path: Path, weights: str) -> str:
    """A name of weights as a file has it: a path is one beside that file."""
    try:
        beside = path.parent / Path(weights).expanduser()
        return str(beside) if weights and beside.exists() else weights
    except (OSError, RuntimeError, ValueError):  # no path at all
        return weights


def _odd(switches: Mapping[str, Any], device: Place, dtype: Place) -> Iterator[Problem]:
    where = switches.get("device", "auto")
    if not DEVICE.fullmatch(where):
        yield Problem(device, "", f'"{where}"', "is no device", "write auto, cpu, cuda, cuda:1 or mps")
    kind = switches.get("dtype", "auto")
    if kind not in DTYPES:
        yield Problem(dtype, "", f'"{kind}"', "is no number format", suggestion(kind, DTYPES))


def _line(text: str, keys: Sequence[str]) -> tuple[int, int]:
    """Line and column, from 1, of a key; (0, 0) where it cannot be told."""
    table = ".".join(keys[:-1])
    inside = not table
    for number, line in enumerate(text.splitlines(), 1):
        header = re.match(r"\s*\[([^\]]+)\]", line)
        if header:
            if header[1].strip() == ".".join(keys):
                return number, line.index("[") + 1
            inside = header[1].strip() == table
        elif inside and (key := re.match(rf"""(\s*)["']?{re.escape(keys[-1])}["']?\s*=""", line)):
            return number, len(key[1]) + 1
    return 0, 0


# ----------------------------------------------------------------------
# The table of backends and a plan -> who can do each step here, what is missing for the rest, and how to get
# it.

WIDTH = 24
"""Of the column of names."""
MAP = "file"
"""The name of the rows that take another program's map, which somebody has to name."""


def listing(plan: Plan | None = None) -> list[Mapping[str, Any]]:
    """One mapping a row: role, name, default, chosen, ready, missing, install, weights, settings, about.

    `chosen` rows are those that `plan` takes, `ready` those that would run now; nothing is imported or fetched.
    `weights` of rows that take another program's map is that file.
    """
    plan = plan or Plan()
    return [_row(row, plan) for row in BACKENDS]


def _row(row: Backend, plan: Plan) -> dict[str, Any]:
    chosen = plan.row(row.role) is row
    said = plan.choices[row.role].weights if chosen and row.role in plan.choices else ""
    kept = _kept(row, said)
    unset = (
        [name for name in row.settings if not os.environ.get(name) and name not in _told(row, plan)]
        if not said
        else []
    )
    return {
        "role": row.role,
        "name": row.name,
        "default": row is find(row.role),
        "chosen": chosen,
        "installed": not row.missing(),
        "ready": not row.missing() and not unset and all(one["here"] for one in kept),
        "missing": list(row.missing()),
        "install": install(row),
        "weights": kept,
        "unset": unset,
        "about": row.about,
    }


def _kept(row: Backend, said: str) -> list[dict[str, Any]]:
    """What a row reads when it runs: its own weights, those that `said` names in their place, or a map's file."""
    if row.name == MAP:
        there = bool(said) and Path(said).expanduser().is_file()
        get = "" if said else f"write {row.role}={row.name}:PATH"
        return [{"id": said, "size": "", "licence": "", "here": there, "get": get}]
    # where one path is meant, it may have a comma in its name
    parts = [part.strip() for part in said.split(",")] if len(row.weights) > 1 else [said] * len(row.weights)
    parts += [""] * (len(row.weights) - len(parts))
    owns = (*row.weights, *(Weights("", "", "") for _ in parts[len(row.weights) :]))
    return [
        {"id": part, "size": "", "licence": "", "here": weights_present(part), "get": ""}
        if part
        else {
            "id": own.id,
            "size": own.size,
            "licence": own.licence,
            "here": weights_present(own.id),
            "get": how(own),
        }
        for own, part in zip(owns, parts, strict=True)
    ]


def _told(row: Backend, plan: Plan) -> Iterator[str]:
    """Settings that the configuration's table for the backend holds: `url` for PHYSGEN_VLM_URL."""
    options = plan.options.get(row.name, {})
    return (name for name in row.settings if options.get(name.rsplit("_", 1)[-1].lower()))


def weights_present(weights: str) -> bool:
    """Whether weights lie on this machine: at a path, or in the hub's cache."""
    if not weights:
        return False
    if Path(weights).expanduser().exists():
        return True
    return in_hub_cache(weights)


def in_hub_cache(weights: str) -> bool:
    """Whether anything of a hub id has been fetched before."""
    return any((hub_cache() / f"models--{weights.replace('/', '--')}" / "snapshots").glob("*/*"))


def hub_cache() -> Path:
    """Where the hub's library keeps what it fetches: as `huggingface_hub.constants` finds it, not imported."""
    said = os.environ.get
    home = said("HF_HOME", os.path.join(said("XDG_CACHE_HOME", "~/.cache"), "huggingface"))
    cache = said("HF_HUB_CACHE", said("HUGGINGFACE_HUB_CACHE", os.path.join(home, "hub")))
    return Path(os.path.expandvars(os.path.expanduser(cache)))


def how(weights: Weights) -> str:
    """How to get weights."""
    return weights.get or f"hf download {weights.id}"


def listing_lines(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Lines for people: a role, its backends, and below each what it still lacks."""
    role = None
    for row in rows:
        if row["role"] != role:
            role = row["role"]
            yield role
        yield f"  {'*' if row['chosen'] else ' '} {row['name']:<{WIDTH}} {row['about']}"
        yield from (f"{'':{WIDTH + 5}}{line}" for line in _lacks(row))


def _lacks(row: Mapping[str, Any]) -> Iterator[str]:
    if row["missing"]:
        yield f"[needs {', '.join(row['missing'])}: {row['install']}]"
    for one in row["weights"]:
        if row["name"] == MAP and not one["id"]:
            yield f"[{one['get']}]"
            continue
        what = ", ".join(part for part in (one["size"], one["licence"]) if part)
        named = f"{one['id'] or 'its file'}" + (f" ({what})" if what else "")
        yield (
            f"{named}, here"
            if one["here"]
            else f"[lacks {named}" + (f": {one['get']}]" if one["get"] else "]")
        )
    if row["unset"]:
        yield f"[set {' and '.join(row['unset'])}]"
