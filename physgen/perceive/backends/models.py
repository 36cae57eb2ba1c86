"""Loading of model backends: options, device, number type, weights and pipelines."""

from __future__ import annotations

import gc
import importlib.util
import math
import os
import re
import socket
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

import torch

from physgen.problems import InputError, Place, Problem
from physgen.registry import Setup, in_hub_cache, suggestion

# ----------------------------------------------------------------------
# What a model is told -> its device, its numbers' type, and the model itself; or one message of what is
# missing.
#
# Every model backend loads through `loaded`, so that weights that are not here are named the same way, and
# soon.

T = TypeVar("T")

DTYPES = {"float32": torch.float32, "float16": torch.float16, "bfloat16": torch.bfloat16}
PATIENCE = 3.0
"""s to wait for the hub's first word; the library itself would try for some 20."""
SHORT = ("can't allocate memory", "defaultcpuallocator: not enough memory", "out of memory")
"""What errors say, in small letters, where memory does not suffice."""
ID = re.compile(r"[\w.-]+/[\w.-]+")
"""An id on the hub: OWNER/NAME."""


@dataclass(frozen=True)
class Flag:
    """Where a person names weights, for messages."""

    name: str
    form: str


BACKEND = Flag("--backend", "ROLE=NAME:PATH")


def device_of(setup: Setup) -> str:
    """Where to run: what the setup says, else the best that is here. Raises InputError for what is not.

    >>> device_of(Setup(device="cpu"))
    'cpu'
    """
    said = setup.device
    here = {"cpu": True, "cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available()}
    best = next(kind for kind in ("cuda", "mps", "cpu") if here[kind])
    if said == "auto":
        return best
    kind, _, number = said.partition(":")
    if not here.get(kind, False) or (number and not number.isdigit()):
        lacks = f"is not here: torch {torch.__version__} finds none" if kind in here else "is no device"
        raise InputError.of("--device", f'"{said}"', lacks, f"choose auto or {best}")
    if kind == "cuda" and number and int(number) >= torch.cuda.device_count():
        last = torch.cuda.device_count() - 1
        raise InputError.of("--device", f'"{said}"', "is not here", f"the last one is cuda:{last}")
    return said


def dtype_of(setup: Setup, device: str) -> torch.dtype:
    """The type of the weights: what the setup says; else half as long on a GPU, where nothing is lost by it.

    >>> dtype_of(Setup(), "cpu")
    torch.float32
    """
    if setup.dtype == "auto":
        if not device.startswith("cuda"):
            return torch.float32
        return torch.bfloat16 if torch.cuda.is_bf16_supported() else torch.float16
    if setup.dtype not in DTYPES:
        raise InputError.of(
            "--dtype", f'"{setup.dtype}"', "is no type of numbers", f"choose from auto, {', '.join(DTYPES)}"
        )
    return DTYPES[setup.dtype]


def load_weights(load: Callable[[str], T], weights: str, what: str, flag: Flag = BACKEND) -> T:
    """`load(weights)`: a hub id or a folder or file, `~` allowed. `what` names the model in messages: `SAM`.

    Raises InputError that says which id or path was wanted and how to get it: where it is not here, where it is
    broken, where it is another model's, where the memory does not suffice.
    """

    def refused(expected: str, fix: str) -> InputError:
        return InputError.of(flag.name, f'"{weights}"', expected, fix)

    path = Path(weights).expanduser()
    local = path.exists()
    get = f"run hf download {weights}, or write {flag.form}"
    if not local and not ID.fullmatch(weights):
        fix = f"write {flag.form}, or OWNER/NAME as the hub has it"
        raise refused(f"is not there: the weights of {what}", fix)
    if not local and _stop_asking() and not in_hub_cache(weights):
        raise refused(f"{_absent(what)}, nor can the hub be asked", get)
    _quiet(path.is_dir() or (not local and in_hub_cache(weights)))
    try:
        return load(str(path) if local else weights)
    except InputError:
        raise
    except torch.cuda.OutOfMemoryError as error:
        raise refused(
            f"does not fit into the GPU: {_line(error)}", 'write device = "cpu" in physgen.toml'
        ) from error
    except Exception as error:  # what a library says of files that are no model is of every type
        if is_out_of_memory(error):
            fix = 'choose a smaller model, or write dtype = "bfloat16" in physgen.toml'
            raise refused(f"does not fit into the memory: {_line(error)}", fix) from error
        if local:
            raise refused(f"does not load as {what} ({_line(error)})", "fetch it again") from error
        if isinstance(error, OSError):
            raise refused(f"{_absent(what)} ({_line(error)})", get) from error
        raise refused(f"does not load as {what} ({_line(error)})", f"is it {what}? {get}") from error


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an error says that the memory of a device, the processor's included, does not suffice."""
    if isinstance(error, MemoryError | torch.cuda.OutOfMemoryError):
        return True
    told = str(error).lower()  # the processor's allocator, and Apple's, have no type of their own
    return isinstance(error, RuntimeError) and any(text in told for text in SHORT)


def run_note(device: str, dtype: torch.dtype, weights: str, told: Mapping[str, Any]) -> dict[str, Any]:
    """Where and with what a model ran, and the options that it was told, for the record.

    >>> noted("cpu", torch.float32, "a/b", {"steps": 4})
    {'device': 'cpu', 'dtype': 'float32', 'weights': 'a/b', 'steps': 4}
    """
    return {"device": device, "dtype": str(dtype).removeprefix("torch."), "weights": weights, **told}


def free_memory() -> None:
    """What a model held is given back; call it once nothing refers to the model."""
    gc.collect()
    if torch.cuda.is_available():
        torch.cuda.empty_cache()
    elif torch.backends.mps.is_available():
        torch.mps.empty_cache()


def _quiet(here: bool) -> None:
    """No bars while weights that are here are read; fetching gigabytes is worth one."""
    if here and importlib.util.find_spec("transformers"):
        from transformers.utils import logging

        logging.disable_progress_bar()


def _absent(what: str) -> str:
    return f"holds the weights of {what} and is not on this machine"


def _line(error: Exception) -> str:
    """The first sentence of an error."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return f"{type(error).__name__}: {lines[0][:160]}" if lines else type(error).__name__


@cache
def _stop_asking() -> bool:
    """Whether the hub cannot be asked; its library then looks at what is here only, at once and without trying."""
    from huggingface_hub import constants

    if not constants.HF_HUB_OFFLINE and not _reachable():
        constants.HF_HUB_OFFLINE = True
    return bool(constants.HF_HUB_OFFLINE)


def _reachable() -> bool:
    """Whether something answers where the hub is; behind a proxy nobody can tell, and it is tried."""
    if any(os.environ.get(name) for name in ("HTTPS_PROXY", "https_proxy", "ALL_PROXY", "all_proxy")):
        return True
    from huggingface_hub import constants

    hub = urlsplit(os.environ.get("HF_ENDPOINT") or constants.ENDPOINT)
    port = hub.port or (80 if hub.scheme == "http" else 443)
    try:
        with socket.create_connection((hub.hostname or "", port), PATIENCE):
            return True
    except OSError:
        return False


# ----------------------------------------------------------------------
# A model's table of physgen.toml -> its values, checked: `[marigold]`, `[diffusion]`, `[lama]` ...


@dataclass(frozen=True)
class WholeNumber:
    """A whole number from `least` on."""

    default: int | None
    """None: as the weights' own configuration has it."""
    least: int = 0

    def fault(self, value: Any) -> str:
        """What is wrong with a value; `""`: nothing."""
        right = isinstance(value, int) and not isinstance(value, bool) and value >= self.least
        return "" if right else f"is not a whole number from {self.least} on"


@dataclass(frozen=True)
class RealNumber:
    """A finite number >= 0."""

    default: float | None

    def fault(self, value: Any) -> str:
        """What is wrong with a value; `""`: nothing."""
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return "" if number and math.isfinite(value) and value >= 0 else "is not a number >= 0"


@dataclass(frozen=True)
class Text:
    """Any text."""

    default: str

    def fault(self, value: Any) -> str:
        """What is wrong with a value; `""`: nothing."""
        return "" if isinstance(value, str) else "is not text"


@dataclass(frozen=True)
class OneOf:
    """One of some words, true and false read as `on` and `off` where those are among them."""

    default: str
    others: tuple[str, ...]

    def fault(self, value: Any) -> str:
        """What is wrong with a value; `""`: nothing."""
        right = (switched(value) if isinstance(value, bool) else value) in (self.default, *self.others)
        return "" if right else f"is not one of {', '.join((self.default, *self.others))}"


def switched(value: Any) -> Any:
    """True and false as words.

    >>> switched(True), switched("auto")
    ('on', 'auto')
    """
    return ("off", "on")[value] if isinstance(value, bool) else value


Option = WholeNumber | RealNumber | Text | OneOf


def read_options(setup: Setup, table: str, known: Mapping[str, Option]) -> dict[str, Any]:
    """Every option of `[table]`, the missing ones by their defaults. Raises InputError with every wrong one.

    >>> read(Setup(options={"steps": 4}), "marigold", {"steps": Whole(None, 1), "seed": Whole(0)})
    {'steps': 4, 'seed': 0}
    """
    problems = []
    for key, value in setup.options.items():
        at = f"{table}.{key}"
        if key not in known:
            problems.append(
                Problem(Place("physgen.toml"), at, f'"{key}"', "means nothing here", suggestion(key, known))
            )
        elif fault := known[key].fault(value):
            default = known[key].default
            fix = "leave it out" if default is None else f"the default is {default!r}"
            problems.append(Problem(Place("physgen.toml"), at, repr(value), fault, fix))
    if problems:
        raise InputError(problems)
    return {key: setup.options.get(key, option.default) for key, option in known.items()}


# ----------------------------------------------------------------------
# Loading of diffusion pipelines from safetensors; nothing is unpickled.


def load_pipeline(kind: Any, weights: str, device: str, dtype: torch.dtype) -> Any:
    """`kind.from_pretrained(weights)` without progress bars, on `device`. `kind`: a diffusers pipeline class."""
    return load_pipeline_on_cpu(kind, weights, dtype).to(device)


def load_pipeline_on_cpu(kind: Any, weights: str, dtype: torch.dtype, **parts: Any) -> Any:
    """The pipeline on the CPU, with `parts` in place of its own components.

    Only safetensors are accepted: other formats are unpickled by the library, which runs code.
    """
    from diffusers.utils import logging

    shown, verbosity = logging.is_progress_bar_enabled(), logging.get_verbosity()
    logging.disable_progress_bar()
    logging.set_verbosity_error()  # it warns of casts that change nothing
    try:
        pipe = kind.from_pretrained(weights, dtype=dtype, use_safetensors=True, **parts)
        for name, part in pipe.components.items():
            if name not in parts and isinstance(part, torch.nn.Module):
                as_dtype(part, dtype)
    finally:
        logging.set_verbosity(verbosity)
        if shown:
            logging.enable_progress_bar()
    pipe.set_progress_bar_config(disable=True)
    return pipe


def as_dtype(part: Any, dtype: torch.dtype) -> Any:
    """A component in `dtype`: older versions of the library ignore `dtype=`."""
    return part if part.dtype == dtype else part.to(dtype)


# ----------------------------------------------------------------------
# A file that is said to be TorchScript -> nothing, or what is wrong with it; looked at without running it.


def check_torchscript(path: Path, flag: str, fix: str) -> None:
    """Raises InputError for a file that is no TorchScript: `flag` is where it was named, `fix` what to do."""
    inside = []
    if path.is_file() and zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            inside = [name.partition("/")[2] for name in archive.namelist()]
    if any(name.startswith("code/") for name in inside) and "constants.pkl" in inside:
        return
    bare = "holds weights without their network" if "data.pkl" in inside else "is none"
    raise InputError.of(flag, f'"{path}"', f"is to be a TorchScript file and {bare}", fix)
