"""Pictures -> features, by a function of the user: `package.module:factory` or `file.py:factory`.

The factory takes nothing and gives a callable that takes (N, H, W, 3) uint8 sRGB and gives (N, D) numbers, as an array
or a tensor. It is a program: name only what you trust.
"""

from __future__ import annotations

import importlib
import importlib.util
import sysconfig
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.backends.roles import F64, U8, Features
from physgen.problems import InputError
from physgen.registry import Setup

FLAG = "--features"
GET = "write --features module:PACKAGE.MODULE:FACTORY, or module:FILE.py:FACTORY"
MEND = "mend it there"


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
        self._run: Callable[[U8], Any] = self._own(build)
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
        except InputError:
            raise
        except Exception as error:
            raise self._wrong(f"cannot be imported ({_said(error)})") from error

    def _own(self, call: Callable[..., Any], *arguments: Any) -> Any:
        """Result of user code. Raises InputError with its exception and line."""
        try:
            return call(*arguments)
        except MemoryError:
            raise
        except Exception as error:
            raise self._wrong(f"fails: {_said(error)}", MEND) from error

    def _wrong(self, what: str, fix: str = GET) -> InputError:
        return InputError.of(FLAG, f'"module:{self._said}"', what, fix)

    def __call__(self, pictures: U8) -> F64:
        """(N, H, W, 3) sRGB -> (N, D)."""
        found: NDArray[Any] = self._own(lambda: _array(self._run(pictures)))
        if (
            found.ndim != 2
            or len(found) != len(pictures)
            or not found.shape[1]
            or found.dtype.kind not in "fiub"
        ):
            raise self._wrong(
                f"answers {found.dtype} {found.shape} to {len(pictures)} pictures, not one row each"
            )
        return np.asarray(found, np.float64)

    def note(self) -> Mapping[str, Any]:
        """For the record."""
        return {"name": self._said}


def _array(answer: Any) -> NDArray[Any]:
    """Of an array, or a tensor wherever it is."""
    return np.asarray(answer.detach().cpu().numpy() if hasattr(answer, "detach") else answer)


def _said(error: Exception) -> str:
    """What was raised, and where.

    >>> _said(ValueError("no weights"))
    'ValueError: no weights'
    """
    what = " ".join(f"{type(error).__name__}: {error}".rstrip(": ").split())
    frames = traceback.extract_tb(error.__traceback__)
    others = (__file__, "importlib", "site-packages", sysconfig.get_path("stdlib"))
    own = [frame for frame in frames if not any(part in frame.filename for part in others)]
    return f"{what}, at {Path(own[-1].filename).name}:{own[-1].lineno}" if own else what


def own(setup: Setup) -> Features:
    """The backend `module`."""
    return Own(setup)
