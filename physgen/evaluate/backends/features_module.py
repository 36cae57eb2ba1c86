"""Pictures -> features, by anybody's function: `package.module:factory` or `file.py:factory`.

The factory takes nothing and gives a callable that takes (N, H, W, 3) uint8 sRGB and gives (N, D) numbers, as an array
or a tensor. It is a program: name only what you trust.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from physgen.backends import Setup
from physgen.evaluate.fid.roles import F64, U8, Features
from physgen.problems import InputError

FLAG = "--features"
GET = "write --features module:PACKAGE.MODULE:FACTORY, or module:FILE.py:FACTORY"


class Own:
    """The backend `module`."""

    comparable = False

    def __init__(self, setup: Setup) -> None:
        self._said = setup.weights
        module, sign, factory = setup.weights.rpartition(":")
        if not (sign and module and factory):
            raise self._wrong("names no factory")
        build = getattr(self._module(module), factory, None)
        if not callable(build):
            raise self._wrong(f"has no {factory} that can be called")
        self._run: Callable[[U8], Any] = build()
        if not callable(self._run):
            raise self._wrong(f"gives {type(self._run).__name__}, which cannot be called")

    def _module(self, name: str) -> ModuleType:
        path = Path(name).expanduser()
        try:
            if path.suffix != ".py":
                return importlib.import_module(name)
            spec = importlib.util.spec_from_file_location(f"_features_{path.stem}", path)
            if spec is None or spec.loader is None or not path.is_file():
                raise self._wrong("no such file")
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            return module
        except (ImportError, SyntaxError) as error:
            raise self._wrong(f"cannot be imported ({error})") from error

    def _wrong(self, what: str) -> InputError:
        return InputError.of(FLAG, f'"module:{self._said}"', what, GET)

    def __call__(self, pictures: U8) -> F64:
        """(N, H, W, 3) sRGB -> (N, D)."""
        answer = self._run(pictures)
        if hasattr(answer, "detach"):
            answer = answer.detach().cpu().numpy()
        found = np.asarray(answer)
        if (
            found.ndim != 2
            or len(found) != len(pictures)
            or not found.shape[1]
            or found.dtype.kind not in "fiub"
        ):
            raise self._wrong(
                f"answers {found.dtype} {found.shape} to {len(pictures)} pictures, not one row each"
            )
        return found.astype(np.float64)

    def note(self) -> Mapping[str, Any]:
        """For the record."""
        return {"name": self._said}


def own(setup: Setup) -> Features:
    """The backend `module`."""
    return Own(setup)
