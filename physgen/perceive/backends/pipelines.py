"""A folder of diffusion weights -> the pipeline that they are of, on its device; nothing in it is unpickled."""

from __future__ import annotations

from typing import Any

import torch
from diffusers.utils import logging


def opened(kind: Any, weights: str, device: str, dtype: torch.dtype) -> Any:
    """`kind.from_pretrained(weights)`, silent, on `device`. `kind`: a pipeline of diffusers, or what chooses one."""
    return unmoved(kind, weights, dtype).to(device)


def unmoved(kind: Any, weights: str, dtype: torch.dtype, **parts: Any) -> Any:
    """The same on the processor, with `parts` in place of those that the weights would bring.

    The weights are to be safetensors: the library would else unpickle, which runs code.
    """
    shown, said = logging.is_progress_bar_enabled(), logging.get_verbosity()
    logging.disable_progress_bar()
    logging.set_verbosity_error()  # it warns of casts that change nothing
    try:
        pipe = kind.from_pretrained(weights, dtype=dtype, use_safetensors=True, **parts)
        for name, part in pipe.components.items():
            if name not in parts and isinstance(part, torch.nn.Module):
                typed(part, dtype)
    finally:
        logging.set_verbosity(said)
        if shown:
            logging.enable_progress_bar()
    pipe.set_progress_bar_config(disable=True)
    return pipe


def typed(part: Any, dtype: torch.dtype) -> Any:
    """A part in `dtype`: a library of before `dtype=` has passed over it."""
    return part if part.dtype == dtype else part.to(dtype)
