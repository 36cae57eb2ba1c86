"""A role and a name -> the backend that fills it; the one table, importing nothing until asked.

A newcomer adds a backend with one file under a `backends/` folder and one row here; `tests/contract` then
runs on it.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from physgen.problems import InputError, Place, Problem


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
        raise InputError.of("--backend", f'"{role}"', "is not a role", choose(role, roles()))
    for row in BACKENDS:
        if row.role == role and name in (None, row.name):
            return row
    known = names(role)
    raise InputError.of("--backend", f'{role}="{name}"', "is not a backend", choose(str(name), known))


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


def choose(found: str, known: Iterable[str]) -> str:
    """What else there is, for a message: the nearest first."""
    known = list(known)
    near = difflib.get_close_matches(found, known, 1)
    return (f"did you mean {near[0]}? " if near else "") + f"choose from {', '.join(known)}"
