"""Weights of models on this machine: in folders, and in the cache of the Hugging Face hub."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def weights_present(weights: str) -> bool:
    """Return whether weights are on this machine: at a path, or in the hub's cache."""
    return bool(weights) and (
        Path(weights).expanduser().exists() or in_hub_cache(weights)
    )


def in_hub_cache(weights: str) -> bool:
    """Return whether any file of a hub id has been fetched before."""
    return any((hub_folder(weights) / "snapshots").glob("*/*"))


@contextmanager
def offline_hub() -> Iterator[None]:
    """Keep the hub's library from fetching anything meanwhile."""
    constants = _hub_constants()
    if constants is None:
        yield
        return
    before = constants.HF_HUB_OFFLINE
    constants.HF_HUB_OFFLINE = True
    try:
        yield
    finally:
        constants.HF_HUB_OFFLINE = before


def hub_folder(weights: str) -> Path:
    """Return the folder of a hub id in the hub library's cache.

    A missing folder if the library is not installed.
    """
    constants = _hub_constants()
    if constants is None:
        return Path("/nowhere")
    return Path(constants.HF_HUB_CACHE) / f"models--{weights.replace('/', '--')}"


def _hub_constants() -> Any:
    """Return the module with the settings of the hub's library, or None if it is not installed."""
    try:
        from huggingface_hub import constants
    except ModuleNotFoundError:
        return None
    return constants
