"""A folder of diffusion weights -> the pipeline that they are of, on its device; nothing in it is unpickled."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import diffusers.utils.logging
import torch
import transformers.utils.logging


def opened(kind: Any, weights: str, device: str, dtype: torch.dtype) -> Any:
    """`kind.from_pretrained(weights)`, silent, on `device`. `kind`: a pipeline of diffusers, or what chooses one.

    The weights are to be safetensors: the library would else unpickle, which runs code.
    """
    with ExitStack() as silence:
        for library in (diffusers, transformers):
            silence.enter_context(_silent(library.utils.logging))
        pipe = kind.from_pretrained(weights, dtype=dtype, use_safetensors=True).to(device)
    if pipe.dtype != dtype:  # a library of before `dtype=`, which passed over it
        pipe = pipe.to(dtype)
    pipe.set_progress_bar_config(disable=True)
    return pipe


@contextmanager
def _silent(logging: Any) -> Iterator[None]:
    """Without a library's bars of progress."""
    shown = logging.is_progress_bar_enabled()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        if shown:
            logging.enable_progress_bar()
