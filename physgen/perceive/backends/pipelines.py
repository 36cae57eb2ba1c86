"""Loading of diffusion pipelines from safetensors; nothing is unpickled."""

from __future__ import annotations

from typing import Any

import torch


def opened(kind: Any, weights: str, device: str, dtype: torch.dtype) -> Any:
    """`kind.from_pretrained(weights)` without progress bars, on `device`. `kind`: a diffusers pipeline class."""
    return unmoved(kind, weights, dtype).to(device)


def unmoved(kind: Any, weights: str, dtype: torch.dtype, **parts: Any) -> Any:
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
                typed(part, dtype)
    finally:
        logging.set_verbosity(verbosity)
        if shown:
            logging.enable_progress_bar()
    pipe.set_progress_bar_config(disable=True)
    return pipe


def typed(part: Any, dtype: torch.dtype) -> Any:
    """A component in `dtype`: older versions of the library ignore `dtype=`."""
    return part if part.dtype == dtype else part.to(dtype)
