"""Load model backends: device, number type, weights and pipelines.

Every model backend loads its weights through `load_weights`, so that missing weights
are reported in one way, before any other work starts.
"""

from __future__ import annotations

import gc
import importlib.util
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, TypeVar

import torch

from physgen.messages import Message
from physgen.problems import InputError
from physgen.registry import Setup, describe_error, find
from physgen.weights import in_hub_cache

T = TypeVar("T")

DTYPES = {
    "float32": torch.float32,
    "float16": torch.float16,
    "bfloat16": torch.bfloat16,
}
HUB_TIMEOUT = 3.0
"""s: the longest wait for an answer of the hub.

Its own library retries for about 20 s.
"""
OUT_OF_MEMORY = (
    "can't allocate memory",
    "defaultcpuallocator: not enough memory",
    "out of memory",
)
"""Parts of error messages in lower case.

The allocators of the CPU and of Apple's GPU raise plain RuntimeErrors, so that only the
text tells a lack of memory.
"""
HUB_ID = re.compile(r"[\w.-]+/[\w.-]+")


@dataclass(frozen=True)
class Flag:
    """The command-line flag for the weights, in messages."""

    name: str
    form: str


BACKEND = Flag("--backend", "ROLE=NAME:PATH")


def weight_ids(
    role: str, name: str, setup: Setup, flag: Flag = BACKEND
) -> tuple[str, ...]:
    """Return one hub id or path for each weights entry of the backend's registry row.

    A backend with two entries takes `A,B`; `A` and `,B` replace only one of them.
    Raises InputError if the text names more ids than the row has entries.
    """
    defaults = [weights.id for weights in find(role, name).weights]
    if len(defaults) > 1:
        ids = [part.strip() for part in setup.weights.split(",")]
    else:
        ids = [setup.weights]
    if len(ids) > len(defaults):
        raise Message.TOO_MANY_WEIGHTS.error(
            flag.name,
            f'"{setup.weights}"',
            name=name,
            count=len(ids),
            most=len(defaults),
        )
    ids += [""] * (len(defaults) - len(ids))
    return tuple(
        weights_id or default for weights_id, default in zip(ids, defaults, strict=True)
    )


def device_of(setup: Setup) -> str:
    """Return the device of the setup, or for "auto" the fastest device present.

    Raises InputError if the device is unknown or not present.

    >>> device_of(Setup(device="cpu"))
    'cpu'
    """
    name = setup.device
    count = {
        "cpu": 1,
        "cuda": torch.cuda.device_count(),
        "mps": int(torch.backends.mps.is_available()),
    }
    best = next(kind for kind in ("cuda", "mps", "cpu") if count[kind])
    kind, _, number = name.partition(":")
    # "cuda:1" needs two GPUs: a device number must be below the count.
    is_present = count.get(kind, 0) > (int(number) if number.isdigit() else 0) and (
        number.isdigit() or not number
    )
    if name != "auto" and not is_present:
        culprit = f'device "{name}"'
        if kind not in count:
            raise Message.NOT_A_DEVICE.error("physgen.toml", culprit, best=best)
        message = Message.DEVICE_MISSING
        version = torch.__version__
        raise message.error("physgen.toml", culprit, version=version, best=best)
    if name == "auto":
        return best
    return name


def dtype_of(setup: Setup, device: str) -> torch.dtype:
    """Return the number type of the setup.

    The type "auto" means float32 on a CPU, and bfloat16 or float16 on a GPU.

    >>> dtype_of(Setup(), "cpu")
    torch.float32
    """
    if setup.dtype == "auto":
        if not device.startswith("cuda"):
            return torch.float32
        if torch.cuda.is_bf16_supported():
            return torch.bfloat16
        return torch.float16
    return DTYPES[setup.dtype]


def load_weights(
    load: Callable[[str], T], weights: str, name: str, flag: Flag = BACKEND
) -> T:
    """Call `load` with a hub id, a folder or a file and return its result.

    `weights` may begin with `~`. `name` names the model in messages, e.g. `SAM`. Raises
    InputError with the id or path and a fix if the weights are missing, broken or of
    another model, or if memory runs out.
    """

    path = Path(weights).expanduser()
    local = path.exists()
    get = f"run hf download {weights}, or write {flag.form}"

    def error(message: Message, **values: object) -> InputError:
        return message.error(flag.name, f'"{weights}"', model=name, **values)

    if not local and not HUB_ID.fullmatch(weights):
        raise error(Message.WEIGHTS_NOT_A_FILE, form=flag.form)
    if not local and _hub_is_offline() and not in_hub_cache(weights):
        raise error(Message.WEIGHTS_OFFLINE, fix=get)
    if (local or in_hub_cache(weights)) and importlib.util.find_spec("transformers"):
        from transformers.utils import logging

        # A progress bar is useful for downloads only.
        logging.disable_progress_bar()
    try:
        return load(str(path) if local else weights)
    except InputError:
        raise
    except Exception as error_:
        # Libraries raise errors of every type if a file is not a model.
        cause = describe_error(error_)
        if is_out_of_memory(error_):
            raise error(Message.WEIGHTS_TOO_LARGE, cause=cause) from error_
        if not local and isinstance(error_, OSError):
            raise error(Message.WEIGHTS_ABSENT, cause=cause, fix=get) from error_
        if local:
            fix = "fetch it again"
        else:
            fix = get
        raise error(Message.WEIGHTS_BROKEN, cause=cause, fix=fix) from error_


def is_out_of_memory(error: BaseException) -> bool:
    """Return whether an error is a lack of memory on any device."""
    if isinstance(error, MemoryError | torch.cuda.OutOfMemoryError):
        return True
    text = str(error).lower()
    return isinstance(error, RuntimeError) and any(
        part in text for part in OUT_OF_MEMORY
    )


def run_note(
    device: str, dtype: torch.dtype, weights: str, options: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the device, number type, weights and options of a run for its record.

    >>> run_note("cpu", torch.float32, "a/b", {"steps": 4})
    {'device': 'cpu', 'dtype': 'float32', 'weights': 'a/b', 'steps': 4}
    """
    return {
        "device": device,
        "dtype": str(dtype).removeprefix("torch."),
        "weights": weights,
        **options,
    }


def free_memory() -> None:
    """Release the memory of unreferenced models."""
    gc.collect()
    if torch.cuda.is_available():
        torch.cuda.empty_cache()
    elif torch.backends.mps.is_available():
        torch.mps.empty_cache()


class ModelBackend:
    """A backend with one model: `_load` loads it at its first use, and `close` frees
    it.
    """

    def __init__(
        self, setup: Setup, weights: str, name: str, options: dict[str, Any]
    ) -> None:
        """Raises InputError if the weights are missing or the device is unknown.

        `name` names the model in messages.
        """
        self._weights, self._what, self._options = weights, name, options
        self._device = device_of(setup)
        self._dtype = self._number_type(setup)
        # Report missing weights now rather than after minutes of other work.
        load_weights(lambda _: None, weights, name)

    @cached_property
    def _model(self) -> Any:
        return load_weights(self._load, self._weights, self._what)

    def _load(self, weights: str) -> Any:
        raise NotImplementedError

    def _number_type(self, setup: Setup) -> torch.dtype:
        return dtype_of(setup, self._device)

    def load(self) -> None:
        """Load the model now."""
        _ = self._model

    def close(self) -> None:
        """Free the model."""
        self.__dict__.pop("_model", None)
        free_memory()

    def note(self) -> Mapping[str, Any]:
        """Return the device, number type, weights and options for the record."""
        return run_note(self._device, self._dtype, self._weights, self._options)


@cache
def _hub_is_offline() -> bool:
    """Return whether the hub is out of reach.

    In that case its library is set to offline, so that it does not retry.
    """
    from huggingface_hub import constants
    from huggingface_hub.utils import get_session

    if not constants.HF_HUB_OFFLINE:
        try:
            get_session().head(constants.ENDPOINT, timeout=HUB_TIMEOUT)
        # The errors come from the hub's library or from its HTTP library.
        except Exception:
            constants.HF_HUB_OFFLINE = True
    return bool(constants.HF_HUB_OFFLINE)


def load_pipeline(kind: Any, weights: str, device: str, dtype: torch.dtype) -> Any:
    """Load a diffusers pipeline of class `kind` on `device`, without progress bars."""
    return load_pipeline_on_cpu(kind, weights, dtype).to(device)


def load_pipeline_on_cpu(
    kind: Any, weights: str, dtype: torch.dtype, **parts: Any
) -> Any:
    """Load a diffusers pipeline on the CPU, with `parts` in place of its own
    components.

    Only safetensors files are accepted: the library unpickles other formats, which runs
    code.
    """
    from diffusers.utils import logging

    has_progress_bar = logging.is_progress_bar_enabled()
    verbosity = logging.get_verbosity()
    logging.disable_progress_bar()
    # The library warns of casts that change nothing.
    logging.set_verbosity_error()
    try:
        pipe = kind.from_pretrained(weights, dtype=dtype, use_safetensors=True, **parts)
        for name, part in pipe.components.items():
            if name not in parts and isinstance(part, torch.nn.Module):
                as_dtype(part, dtype)
    finally:
        logging.set_verbosity(verbosity)
        if has_progress_bar:
            logging.enable_progress_bar()
    pipe.set_progress_bar_config(disable=True)
    return pipe


def as_dtype(part: Any, dtype: torch.dtype) -> Any:
    """Convert a component to `dtype`, since older library versions ignore `dtype=`."""
    if part.dtype == dtype:
        return part
    return part.to(dtype)
