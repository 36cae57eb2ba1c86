"""An output folder that appears under its final name only when everything in it is written."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from physgen.problems import InputError
from physgen.report.leftovers import in_use, sweep_once
from physgen.whole import partial


@contextmanager
def whole_folder(final: Path) -> Iterator[Path]:
    """A fresh folder beside `final`, renamed to it at the end; removed, and `final` left as it was, on any error."""
    final.parent.mkdir(parents=True, exist_ok=True)
    sweep_once(final.parent)
    beside = partial(final)
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir()
    old = partial(final, "old")
    with in_use(beside):
        try:
            yield beside
            if final.exists():
                final.rename(old)
            beside.rename(final)
        except BaseException:
            shutil.rmtree(beside, ignore_errors=True)
            if old.exists() and not final.exists():
                old.rename(final)
            raise
    shutil.rmtree(old, ignore_errors=True)


def output_folder(out: Path, name: str) -> Path:
    """`out/<name>`; refuses a folder that holds anything but what an earlier run of ours wrote: nothing is lost."""
    if out.exists() and not out.is_dir():
        raise InputError.of(str(out), "", "is a file", "name a folder with -o")
    final = out / name
    strange = _strangers(final)
    if strange is None:
        fix = "choose another folder with -o"
        raise InputError.of(str(final), "", "is there already and was not made by physgen", fix)
    if strange:
        found = ", ".join(strange[:3]) + (", ..." if len(strange) > 3 else "")
        fix = "move it out, or choose another folder with -o"
        raise InputError.of(
            str(final), "", f"would be replaced, and holds {found}, which physgen did not make", fix
        )
    return final


def _strangers(folder: Path) -> list[str] | None:
    """Files of an earlier run's folder that the run did not write; None for a folder that no run made."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return []
    try:
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        own = {"manifest.json", *manifest["files"]} if manifest["manifest"] == 1 else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
    if own is None:
        return None
    files = (p.relative_to(folder).as_posix() for p in sorted(folder.rglob("*")) if not p.is_dir())
    return [name for name in files if name not in own]
