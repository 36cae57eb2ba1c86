"""A file that is said to be TorchScript -> nothing, or what is wrong with it; looked at without running it."""

from __future__ import annotations

import zipfile
from pathlib import Path

from physgen.problems import InputError


def scripted(path: Path, flag: str, fix: str) -> None:
    """Raises InputError for a file that is no TorchScript: `flag` is where it was named, `fix` what to do."""
    inside = []
    if path.is_file() and zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            inside = [name.partition("/")[2] for name in archive.namelist()]
    if any(name.startswith("code/") for name in inside) and "constants.pkl" in inside:
        return
    bare = "holds weights without their network" if "data.pkl" in inside else "is none"
    raise InputError.of(flag, f'"{path}"', f"is to be a TorchScript file and {bare}", fix)
