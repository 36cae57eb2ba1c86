"""Environment, `[vlm]` of physgen.toml and what stands after `vlm:` -> which model to ask, and how."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

from physgen.backends import Setup, choose
from physgen.problems import InputError, Problem

URL, MODEL, KEY, OPENAI_KEY = "PHYSGEN_VLM_URL", "PHYSGEN_VLM_MODEL", "PHYSGEN_VLM_KEY", "OPENAI_API_KEY"
OPENAI = "api.openai.com"
WARM = 0.7
"""Temperature where several samples are asked for: at 0 they would be one."""
LIMITS: Mapping[str, tuple[type, float, float]] = {
    "samples": (int, 1, 25),
    "attempts": (int, 1, 10),
    "retries": (int, 0, 20),
    "timeout": (float, 0.05, 3600),
    "parallel": (int, 1, 64),
    "max_tokens": (int, 16, 1_000_000),
    "temperature": (float, 0, 2),
    "price_in": (float, 0, 1e6),
    "price_out": (float, 0, 1e6),
}
"""Numbers of the table: whether whole, the least and the greatest."""
TEXTS = ("url", "model")
SWITCHES = ("cache",)


@dataclass(frozen=True)
class Settings:
    """Whom to ask, and how."""

    role: str
    """For messages: `physics`."""
    model: str
    """The server's name for it; a hub id or a path where there is no `url`."""
    url: str = ""
    """Of an OpenAI-compatible server; `""`: the model runs here, in transformers."""
    key: str = field(default="", repr=False)
    samples: int = 1
    """Answers to each question; their median counts, their spread tells how sure it is."""
    attempts: int = 3
    """How often a question is asked, at most, until its answer makes sense."""
    retries: int = 2
    """How often a request is sent again when the server fails, is busy or does not answer."""
    timeout: float = 90.0
    """s of silence after which a request is given up."""
    parallel: int = 4
    """Requests that a server gets at the same time."""
    max_tokens: int | None = None
    """Of an answer, at most; None: what the server allows, 1024 here."""
    temperature: float = 0.0
    cache: bool = True
    price_in: float | None = None
    """Money for a million tokens of question."""
    price_out: float | None = None
    """Money for a million tokens of answer."""

    @property
    def where(self) -> str:
        """The server as messages show it, without what a URL may hide: user, password, query; `""`: here."""
        parts = urlsplit(self.url)
        host = parts.netloc.rpartition("@")[2]
        return f"{parts.scheme}://{host}{parts.path}" if host else ""


def settings(role: str, setup: Setup) -> Settings:
    """Environment over file. Raises InputError with everything that is missing or wrong."""
    options, problems = dict(setup.options), list(_odd(setup.options))
    url = os.environ.get(URL) or str(options.get("url", ""))
    model = setup.weights or os.environ.get(MODEL) or str(options.get("model", ""))
    who = f"{role}=vlm"
    if not url and not setup.weights:
        fix = (
            f"set {URL} and {MODEL} for an OpenAI-compatible server (its key in {KEY}), or write url and model "
            f"below [vlm] in physgen.toml, or write {who}:PATH for a transformers model on this machine"
        )
        problems += _problem(who, "has no model to ask", fix)
    elif url and (urlsplit(url).scheme not in ("http", "https") or not urlsplit(url).hostname):
        problems += _problem(
            who, f"is given a {URL} that is no address", "write e.g. http://localhost:8000/v1"
        )
    elif url and not model:
        fix = f"set {MODEL}, or write {who}:MODEL, as the server calls it"
        problems += _problem(who, "is told a server and no model", fix)
    if problems:
        raise InputError(problems)
    told = {name: LIMITS[name][0](options[name]) for name in LIMITS if name in options}
    several = told.get("samples", 1) > 1
    told["temperature"] = (told.get("temperature", 0) or WARM) if several else 0.0
    return Settings(role, model, url, _key(url), cache=bool(options.get("cache", True)), **told)


def _key(url: str) -> str:
    """OpenAI's own key goes to OpenAI, or to where the environment points; a file found in a folder is no such word."""
    if key := os.environ.get(KEY):
        return key.strip()
    if os.environ.get(URL) or urlsplit(url).hostname == OPENAI:
        return os.environ.get(OPENAI_KEY, "").strip()
    return ""


def _odd(options: Mapping[str, Any]) -> list[Problem]:
    """What is wrong with the table `[vlm]`."""
    known = (*TEXTS, *LIMITS, *SWITCHES)
    problems: list[Problem] = []
    for name, value in options.items():
        if "key" in name.lower() or (name == "url" and "@" in urlsplit(str(value)).netloc):
            fix = f"set the environment variable {KEY} instead, and make a new key if others saw the file"
            problems += _problem(f"[vlm] {name}", "is a secret in a file", fix)
        elif name not in known:
            problems += _problem(f"[vlm] {name}", "means nothing here", choose(name, known))
        elif name in LIMITS:
            kind, least, most = LIMITS[name]
            number = isinstance(value, int | float if kind is float else int) and not isinstance(value, bool)
            if not number or not least <= value <= most:
                what = "a whole number" if kind is int else "a number"
                problems += _problem(
                    f"[vlm] {name}", f"is {value!r}, not {what} from {least:g} to {most:g}", f"write {what}"
                )
        elif not isinstance(value, bool if name in SWITCHES else str):
            what = "true or false" if name in SWITCHES else "text"
            problems += _problem(f"[vlm] {name}", f"is {value!r}, not {what}", f"write {what}")
    return problems


def _problem(found: str, expected: str, fix: str) -> list[Problem]:
    place = "physgen.toml" if found.startswith("[") else "--backend"
    return InputError.of(place, found, expected, fix).problems
