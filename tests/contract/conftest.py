"""Tiny models by row, for the tests of what needs weights: those of every `tiny_*.py` beside this file."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from physgen.registry import Setup


class Tiny:
    """(role, name) -> the path of a tiny model, built when first asked for."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._built: dict[tuple[str, str], Path] = {}
        self.builders: dict[tuple[str, str], Callable[[Path], Any]] = {}
        self.options: dict[str, Any] = {}
        for path in sorted(Path(__file__).parent.glob("tiny_*.py")):
            module = importlib.import_module(f"tests.contract.{path.stem}")
            self.builders |= module.MODELS
            self.options |= getattr(module, "OPTIONS", {})

    def __contains__(self, row: tuple[str, str]) -> bool:
        return row in self.builders

    def __getitem__(self, row: tuple[str, str]) -> Path:
        if row not in self._built:
            self._built[row] = self.builders[row](self._root / "-".join(row))
        return self._built[row]

    def setup(self, role: str, name: str, **more: Any) -> Setup:
        """What the row's factory is told to run on its tiny model."""
        return Setup(
            str(self[role, name]), "cpu", options={**self.options.get(name, {}), **more}
        )


@pytest.fixture(scope="session")
def video(tiny: Tiny, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Any]:
    """Kind of weights, options -> a video model that runs on tiny ones; with the same options, the same model."""
    from physgen import registry

    variants = {}
    for module in ("tiny_video", "tiny_wan", "tiny_ltx"):
        variants |= importlib.import_module(f"tests.contract.{module}").VARIANTS
    root, paths, made = tmp_path_factory.mktemp("video"), {}, {}

    def model(variant: str, dtype: str = "auto", **options: Any) -> Any:
        row, build = variants[variant]
        if variant not in paths:
            paths[variant] = build(root / variant)
        key = (variant, dtype, *sorted(options.items()))
        if key not in made:
            made[key] = registry.make(
                "refine", row, Setup(paths[variant], "cpu", dtype, options)
            )
        return made[key]

    return model


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Tiny:
    if importlib.util.find_spec("torch"):
        import torch

        torch.set_num_threads(1)  # handing out such small work costs more than the work
    return Tiny(tmp_path_factory.mktemp("tiny"))
