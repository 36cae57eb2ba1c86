"""An output folder that appears under its final name only when everything in it is written."""

from __future__ import annotations

import errno
import json
import re
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from physgen.problems import InputError
from physgen.report.leftovers import in_use, sweep_once
from physgen.whole import partial

TRIES = 20
CLIPS = {"video.mp4", "trajectory.npz", "report.html", "truth", "events", "conditioning"}
"""What lies in folders of clips, of which anybody may have one."""
OURS = re.compile(
    r"manifest\.json|trajectory\.npz|report\.html|refinement\.png|fan\.csv"
    r"|(video|unrefined)\.(mp4|gif|webp)|(frames|unrefined)/\d{5}\.png|truth/.+"
)
"""Files of clips, where no manifest tells."""


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
            _instead(beside, final, old)
        except BaseException:
            shutil.rmtree(beside, ignore_errors=True)
            if old.exists() and not final.exists():
                old.rename(final)
            raise
    shutil.rmtree(old, ignore_errors=True)


def _instead(beside: Path, final: Path, old: Path) -> None:
    """`beside` becomes `final`, which becomes `old`, also where another command does the same now."""
    for left in range(TRIES, 0, -1):
        try:
            if final.exists():
                shutil.rmtree(old, ignore_errors=True)
                final.rename(old)
            beside.rename(final)
            return
        except OSError as error:
            if left == 1 or error.errno not in (errno.ENOENT, errno.ENOTEMPTY, errno.EEXIST):
                raise


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


def made(folder: Path) -> list[str]:
    """Files below a folder that an earlier run made and tells of, beside its manifest; none where nobody can tell."""
    try:
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        return [str(name) for name in manifest["files"]] if manifest["manifest"] == 1 else []
    except (OSError, ValueError, KeyError, TypeError):
        return []


def seems_clip(names: Iterable[str]) -> bool:
    """Whether what is called so in a folder is plainly a clip's, where its manifest was lost."""
    there = set(names)
    return "clip.json" not in there and len(there & CLIPS) > 1  # which a data set has


def _strangers(folder: Path) -> list[str] | None:
    """Files of an earlier run's folder that the run did not write; None for a folder that no run made."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return []
    try:
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        own = {"manifest.json", *manifest["files"]} if manifest["manifest"] == 1 else None
    except OSError:
        return None
    except (ValueError, KeyError, TypeError):  # ours, and damaged: a machine that lost its power left it so
        own = None
    if own is None:
        names = [p.relative_to(folder).as_posix() for p in sorted(folder.rglob("*")) if not p.is_dir()]
        return None if any(OURS.fullmatch(name) is None for name in names) else []
    files = (p.relative_to(folder).as_posix() for p in sorted(folder.rglob("*")) if not p.is_dir())
    return [name for name in files if name not in own]
