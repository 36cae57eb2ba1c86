"""A folder of diffusion weights -> the pipeline that they are of, on its device; nothing in it is unpickled."""

from __future__ import annotations

from typing import Any

import torch
from diffusers.utils import logging


def opened(kind: Any, weights: str, device: str, dtype: torch.dtype) -> Any:
    """`kind.from_pretrained(weights)`, silent, on `device`. `kind`: a pipeline of diffusers, or what chooses one.

    The weights are to be safetensors: the library would else unpickle, which runs code.
    """
    shown = logging.is_progress_bar_enabled()
    logging.disable_progress_bar()
    try:
        pipe = kind.from_pretrained(weights, dtype=dtype, use_safetensors=True).to(device)
    finally:
        if shown:
            logging.enable_progress_bar()
    if pipe.dtype != dtype:  # a library of before `dtype=`, which passed over it
        pipe = pipe.to(dtype)
    pipe.set_progress_bar_config(disable=True)
    return pipe
