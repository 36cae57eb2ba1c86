"""A question -> what a vision-language model of transformers says on this machine; one model serves all roles."""

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

from physgen.backends import Setup
from physgen.perceive.backends.models import device_of, dtype_of, freed, loaded
from physgen.perceive.backends.vlm_answers import Query, plain, sent
from physgen.perceive.backends.vlm_settings import Settings
from physgen.perceive.backends.vlm_turns import Reply, Turn
from physgen.problems import InputError

TOKENS = 1024
"""Of an answer at most, where nobody says."""


@dataclass
class _Held:
    """A loaded model and how many use it."""

    model: Any
    processor: Any
    device: str
    users: int = 0
    busy: Lock = field(default_factory=Lock)


_HELD: dict[tuple[str, str, str], _Held] = {}


def local(settings: Settings, setup: Setup) -> Local:
    """The model, loaded unless another role has it. Raises InputError where it cannot be."""
    device = device_of(setup)
    dtype = dtype_of(setup, device)
    key = settings.model, device, str(dtype)
    if key not in _HELD:

        def load(weights: str) -> _Held:
            logging.disable_progress_bar()  # what is shown is the command line's say
            logging.set_verbosity_error()
            processor = AutoProcessor.from_pretrained(weights, trust_remote_code=False)
            model = AutoModelForImageTextToText.from_pretrained(
                weights, dtype=dtype, trust_remote_code=False, use_safetensors=True
            )
            model = model.to(device).eval()
            return _Held(model, processor, device)

        _HELD[key] = loaded(load, settings.model, "a vision-language model")
    _HELD[key].users += 1
    return Local(key, settings)


class Local:
    """One role's use of a loaded model."""

    def __init__(self, key: tuple[str, str, str], settings: Settings) -> None:
        self._key = key
        self._settings = settings

    def complete(self, query: Query, turns: Sequence[Turn], seed: int) -> Reply:
        """What it says to a question, after `turns` of wrong answers. Raises InputError."""
        held, told = _HELD[self._key], self._settings
        with held.busy, self._told(query):
            talk = held.processor.apply_chat_template(
                _messages(query, turns),
                tokenize=True, return_dict=True, return_tensors="pt", add_generation_prompt=True,
            )  # fmt: skip
            talk = talk.to(held.device, held.model.dtype)
            torch.manual_seed(seed)
            how = (
                {"do_sample": True, "temperature": told.temperature}
                if told.temperature
                else {"do_sample": False}
            )
            most = told.max_tokens or TOKENS
            with torch.inference_mode():
                said = held.model.generate(**talk, max_new_tokens=most, **how)
            start = talk["input_ids"].shape[1]
            count = said.shape[1] - start
            text = held.processor.decode(said[0][start:], skip_special_tokens=True)
        return Reply(text, start, count, cut=count >= most)

    def close(self) -> None:
        """The memory is given back when no other role uses it."""
        held = _HELD.get(self._key)
        if held is None:
            return
        held.users -= 1
        if held.users <= 0:
            del _HELD[self._key], held
            freed()

    @contextmanager
    def _told(self, query: Query) -> Any:
        """Failures as one message: what models make of pictures that they cannot take is of every type."""
        told = self._settings
        found = f"the model {told.model}, asked for {told.role} of {query.about},"
        try:
            yield
        except InputError:
            raise
        except torch.cuda.OutOfMemoryError:
            fix = "write --device cpu or --dtype bfloat16, or choose a smaller one"
            raise InputError.of("--backend", found, "does not fit into the GPU's memory", fix) from None
        except Exception as error:
            what = f"fails ({type(error).__name__}: {plain(str(error), 160)})"
            fix = "choose a chat model that takes pictures and has a chat template, or ask a server"
            raise InputError.of("--backend", found, what, fix) from error


def _messages(query: Query, turns: Sequence[Turn]) -> list[dict[str, Any]]:
    """As chat templates want them; the schema is said in words, since nothing here forces an answer to keep to it."""
    content: list[dict[str, Any]] = [
        {"type": "image", "image": Image.open(io.BytesIO(picture)).convert("RGB")}
        for picture in query.pictures
    ]
    schema = json.dumps(sent(query.schema))
    content.append({"type": "text", "text": f"{query.text}\n\nThe JSON schema of the answer:\n{schema}"})
    talk: list[dict[str, Any]] = [{"role": "user", "content": content}]
    return talk + [{"role": turn.who, "content": [{"type": "text", "text": turn.text}]} for turn in turns]
