"""Names of weights -> what their configurations say, where they came from, and a pipeline that is in its place."""

from __future__ import annotations

import hashlib
import importlib.util
from pathlib import Path
from typing import Any

import torch
from diffusers import AutoencoderKL, DiffusionPipeline

from physgen.backends import find
from physgen.perceive.backends.models import Flag, loaded
from physgen.perceive.backends.pipelines import typed, unmoved
from physgen.problems import InputError
from physgen.roster import hub_cache

REFINE = Flag("--refine", "NAME:PATH")
NAMES = {"AnimateDiff": "animatediff", "Wan": "wan", "CogVideoX": "cogvideox"}
"""What names of pipelines begin with -> the backend that they are for."""
LIBRARIES = ("diffusers", "transformers")
"""Whose classes the parts of a pipeline may be."""
HEAD = 1 << 20
"""Bytes of each file that its folder's digest reads."""
FULL = 0.7
"""Of a GPU's free memory that weights may take before they are moved there in turn only."""


def index(weights: str, what: str) -> dict[str, Any]:
    """`model_index.json`: which pipeline weights are of, and of which classes its parts are."""
    found = loaded(lambda path: dict(DiffusionPipeline.load_config(path)), weights, what, REFINE)
    for part, kind in found.items():
        if isinstance(kind, list) and kind[0] not in (None, *LIBRARIES):  # a module of its own: a program
            said = f"would run {kind[0]} for its {part}"
            raise InputError.of(REFINE.name, f'"{weights}"', said, "name weights of plain parts")
    return found


def config(weights: str, part: str, what: str) -> dict[str, Any]:
    """`config.json` of a part, `""` for weights that are one."""
    at = {"subfolder": part} if part else {}
    return loaded(lambda path: dict(AutoencoderKL.load_config(path, **at)), weights, what, REFINE)


def pipeline(kind: Any, weights: str, dtype: torch.dtype, what: str, vae: Any, **parts: Any) -> Any:
    """The pipeline, on the processor, its VAE (of the class `vae`) in float32.

    In a VAE of bfloat16 a grey level is as much as its numbers' last bit, and what is shown are differences.
    """

    def load(path: str) -> Any:
        fine = vae.from_pretrained(path, subfolder="vae", dtype=torch.float32, use_safetensors=True)
        return unmoved(kind, path, dtype, vae=typed(fine, torch.float32), **parts)

    return loaded(load, weights, what, REFINE)


def expect(weights: str, found: str, known: tuple[str, ...], what: str) -> None:
    """Raises InputError where the pipeline `found` is none of those `known`."""
    if found in known:
        return
    name = next((name for start, name in NAMES.items() if found.startswith(start)), None)
    own = next((row for start, row in NAMES.items() if known[0].startswith(start)), None)
    fix = f"write {name}:{weights}" if name and name != own else f"name weights of a {known[0]}"
    raise InputError.of(REFINE.name, f'"{weights}"', f"is a {found}: not for {what}", fix)


def named(name: str, said: str) -> tuple[str, ...]:
    """The weights of backend `name`: what was said after its name's colon, or the row's own.

    One part that is said may be a whole pipeline or the row's first weights; `A,B` are the first and the second.
    """
    own = tuple(weights.id for weights in find("refine", name).weights)
    if not said:
        return own
    parts = [said] if len(own) == 1 or Path(said).expanduser().exists() else said.split(",")
    if len(parts) > len(own):
        fix = f"write at most {len(own)}, with a comma between"
        raise InputError.of(REFINE.name, f'"{said}"', f"names {len(parts)} weights for {name}", fix)
    stripped = [part.strip() for part in parts]
    return tuple(part or default for part, default in zip(stripped, own, strict=False))


def revision(weights: str) -> str:
    """Which weights exactly: the hub's commit; of a folder, a digest of names, sizes and the head of each file."""
    path = Path(weights).expanduser()
    if path.exists():
        return f"sha256:{_digest(path)}"
    home = hub_cache() / f"models--{weights.replace('/', '--')}"
    main = home / "refs" / "main"
    if main.is_file():
        return main.read_text(encoding="utf-8").strip()
    return max((found.name for found in (home / "snapshots").glob("*")), default="")


def _digest(path: Path) -> str:
    told = hashlib.sha256()
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    for file in files:
        name = file.relative_to(path).as_posix() if file != path else file.name
        told.update(f"{name}\0{file.stat().st_size}\0".encode())
        with file.open("rb") as bytes_of:
            told.update(bytes_of.read(HEAD))
    return told.hexdigest()


def may_offload(table: str, offload: str, device: str) -> None:
    """Raises InputError for an option `offload` that cannot be had on `device`."""
    if offload in ("auto", "none"):
        return
    found = f'{table}.offload: "{offload}"'
    if not device.startswith("cuda"):
        raise InputError.of("physgen.toml", found, f"needs a GPU, and this runs on {device}", "leave it out")
    if importlib.util.find_spec("accelerate") is None:
        raise InputError.of("physgen.toml", found, "needs accelerate", "pip install accelerate")


def placed(pipe: Any, offload: str, device: str) -> str:
    """Moves a pipeline to where it runs, and says how: `none`, all of it now; `model`, `sequential`, when needed."""
    if offload == "auto":
        offload = "none"
        if device.startswith("cuda") and importlib.util.find_spec("accelerate"):
            free, _ = torch.cuda.mem_get_info(device)
            offload = "model" if _bytes(pipe) > FULL * free else "none"
    if offload == "model":
        pipe.enable_model_cpu_offload(device=device)
    elif offload == "sequential":
        pipe.enable_sequential_cpu_offload(device=device)
    else:
        pipe.to(device)
    return offload


def _bytes(pipe: Any) -> int:
    """Of all weights."""
    parts = [part for part in pipe.components.values() if isinstance(part, torch.nn.Module)]
    return sum(p.numel() * p.element_size() for part in parts for p in part.parameters())
