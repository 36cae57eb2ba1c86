"""A vision-language model of transformers on this machine; one loaded model serves all roles."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

import torch
from PIL import Image
from transformers import AutoModelForImageTextToText, AutoProcessor
from transformers.utils import logging

from physgen.perceive.backends.models import device_of, dtype_of, free_memory, load_weights
from physgen.perceive.backends.vlm_client import Query, Reply, Settings, Turn, plain_line, server_schema
from physgen.problems import InputError
from physgen.registry import Setup

DEFAULT_TOKENS = 1024
"""Of an answer, at most, where `max_tokens` is not set."""


@dataclass
class _Loaded:
    """A loaded model and the count of its users."""

    model: Any
    processor: Any
    device: str
    users: int = 0
    busy: Lock = field(default_factory=Lock)


_LOADED: dict[tuple[str, str, str], _Loaded] = {}


def load(settings: Settings, setup: Setup) -> LocalModel:
    """The model, shared with other roles that use it. Raises InputError where it cannot be loaded."""
    device = device_of(setup)
    dtype = dtype_of(setup, device)
    key = settings.model, device, str(dtype)
    if key not in _LOADED:

        def read(weights: str) -> _Loaded:
            logging.disable_progress_bar()  # the command line shows progress
            logging.set_verbosity_error()
            processor = AutoProcessor.from_pretrained(weights, trust_remote_code=False)
            model = AutoModelForImageTextToText.from_pretrained(
                weights, dtype=dtype, trust_remote_code=False, use_safetensors=True
            )
            model = model.to(device).eval()
            return _Loaded(model, processor, device)

        _LOADED[key] = load_weights(read, settings.model, "a vision-language model")
    _LOADED[key].users += 1
    return LocalModel(key, settings)


class LocalModel:
    """One role's use of a loaded model."""

    def __init__(self, key: tuple[str, str, str], settings: Settings) -> None:
        self._key = key
        self._settings = settings

    def complete(self, query: Query, turns: Sequence[Turn], seed: int) -> Reply:
        """The reply to a question, after `turns` about unusable answers. Raises InputError."""
        loaded_model, settings = _LOADED[self._key], self._settings
        with loaded_model.busy, self._failures(query):
            talk = loaded_model.processor.apply_chat_template(
                _messages(query, turns),
                tokenize=True, return_dict=True, return_tensors="pt", add_generation_prompt=True,
            )  # fmt: skip
            talk = talk.to(loaded_model.device, loaded_model.model.dtype)
            torch.manual_seed(seed)
            how = (
                {"do_sample": True, "temperature": settings.temperature}
                if settings.temperature
                else {"do_sample": False}
            )
            most = settings.max_tokens or DEFAULT_TOKENS
            with torch.inference_mode():
                output = loaded_model.model.generate(**talk, max_new_tokens=most, **how)
            start = talk["input_ids"].shape[1]
            count = output.shape[1] - start
            text = loaded_model.processor.decode(output[0][start:], skip_special_tokens=True)
        return Reply(text, start, count, cut=count >= most)

    def close(self) -> None:
        """Free the memory when no other role uses the model."""
        shared = _LOADED.get(self._key)
        if shared is None:
            return
        shared.users -= 1
        if shared.users <= 0:
            del _LOADED[self._key], shared
            free_memory()

    @contextmanager
    def _failures(self, query: Query) -> Any:
        """Failures as one message: models raise errors of every type for pictures that they cannot take."""
        settings = self._settings
        found = f"the model {settings.model}, asked for {settings.role} of {query.about},"
        try:
            yield
        except InputError:
            raise
        except torch.cuda.OutOfMemoryError:
            fix = "write --device cpu or --dtype bfloat16, or choose a smaller one"
            raise InputError.of("--backend", found, "does not fit into the GPU's memory", fix) from None
        except Exception as error:
            what = f"fails ({type(error).__name__}: {plain_line(str(error), 160)})"
            fix = "choose a chat model that takes pictures and has a chat template, or ask a server"
            raise InputError.of("--backend", found, what, fix) from error


def _messages(query: Query, turns: Sequence[Turn]) -> list[dict[str, Any]]:
    """Messages for a chat template; the schema is part of the text, since decoding is not constrained by it."""
    content: list[dict[str, Any]] = [
        {"type": "image", "image": Image.open(io.BytesIO(picture)).convert("RGB")}
        for picture in query.pictures
    ]
    schema = json.dumps(server_schema(query.schema))
    content.append({"type": "text", "text": f"{query.text}\n\nThe JSON schema of the answer:\n{schema}"})
    talk: list[dict[str, Any]] = [{"role": "user", "content": content}]
    return talk + [{"role": turn.role, "content": [{"type": "text", "text": turn.text}]} for turn in turns]
