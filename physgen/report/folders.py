"""Complete output folders atomically, and remove the remains of killed runs."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from physgen.files import check_writable, machine_id, partial
from physgen.messages import Message
from physgen.operating_system import is_running
from physgen.report.record import TIMING
from physgen.text import listed

_LEFT = re.compile(
    r"\.(?P<name>.+)\.(?P<process>\d{1,10})-(?P<machine>[0-9a-f]{8})\.(?P<kind>part|old)"
)
_SWEPT: set[Path] = set()


@contextmanager
def clean_up_after_error(out: Path) -> Iterator[None]:
    """Remove leftovers of the block's processes after an error."""
    try:
        yield
    except BaseException:
        remove_leftovers(out)
        raise


def remove_leftovers(out: Path) -> None:
    """Remove leftovers of dead processes of this machine in `out`.

    Move old results of an interrupted replacement back.
    """
    for path in leftovers(out):
        # Another process may remove the same files.
        with suppress(OSError):
            final = _final_folder(path)
            if final is not None:
                path.rename(final)
            elif path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def leftovers(out: Path) -> list[Path]:
    """Return the leftovers of dead processes of this machine in `out`, sorted."""
    try:
        with os.scandir(out) as entries:
            names = sorted(entry.name for entry in entries)
    except OSError:
        return []
    paths = []
    for name in names:
        match = _LEFT.fullmatch(name)
        # Process ids of other machines in a shared folder mean nothing here.
        if match is None or match["machine"] != machine_id():
            continue
        if not is_running(int(match["process"])):
            paths.append(out / name)
    return paths


def unused_leftovers(out: Path) -> list[Path]:
    """Return the leftovers without old results, which `remove_leftovers` moves back."""
    return [path for path in leftovers(out) if _final_folder(path) is None]


def _final_folder(leftover: Path) -> Path | None:
    """Return the final path of a moved old folder, or None for other leftovers."""
    match = _LEFT.fullmatch(leftover.name)
    # A link must not be renamed: its target may be anywhere.
    if match is None or match["kind"] != "old" or leftover.is_symlink():
        return None
    final = leftover.with_name(match["name"])
    if leftover.is_dir() and not final.exists():
        return final
    return None


TRIES = 20
CLIPS = {"video.mp4", "trajectory.npz", "report.html", "truth", "events"}
"""Names in folders of clips."""
OURS = re.compile(
    r"(manifest|timing)\.json|trajectory\.npz|report\.html|refinement\.png|fan\.csv"
    r"|(video|unrefined)\.(mp4|gif|webp)|(frames|unrefined)/\d{5}\.png|truth/.+"
)
"""Files of clips, for folders without a readable manifest."""


@contextmanager
def atomic_folder(final: Path) -> Iterator[Path]:
    """Create a folder beside `final`, and rename it to `final` at the end.

    After an error, remove the new folder and leave `final` unchanged.
    """
    final.parent.mkdir(parents=True, exist_ok=True)
    # Once per process: listing a folder of 100,000 clips takes long.
    if final.parent.resolve() not in _SWEPT:
        _SWEPT.add(final.parent.resolve())
        remove_leftovers(final.parent)
    beside = partial(final)
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir()
    old = partial(final, "old")
    try:
        yield beside
        _replace_folder(beside, final, old)
    except BaseException:
        shutil.rmtree(beside, ignore_errors=True)
        # The earlier result must survive an interruption between both renames.
        if old.exists() and not final.exists():
            old.rename(final)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _replace_folder(new_folder: Path, final: Path, old: Path) -> None:
    """Replace `final` by `new_folder`, and rename `final` to `old`. Another command may do
    the same at the same time.
    """
    for left in range(TRIES, 0, -1):
        try:
            # A folder cannot be replaced in one step: rename the old one first.
            if final.exists():
                shutil.rmtree(old, ignore_errors=True)
                final.rename(old)
            new_folder.rename(final)
            return
        except OSError as error:
            # These errors mean that another command changed the folder in between.
            if left == 1 or error.errno not in (
                errno.ENOENT,
                errno.ENOTEMPTY,
                errno.EEXIST,
            ):
                raise


def output_folder(out: Path, name: str) -> Path:
    """Return `out/<name>`. Raise InputError if the folder contains files of other
    programs, so that nothing is lost.

    Raise OutputError if it is not writable.
    """
    check_writable(out)
    final = out / name
    strange = _strangers(final)
    if strange is None:
        raise Message.FOLDER_OF_OTHERS.error(str(final))
    if strange:
        found = ", ".join(strange[:3]) + (", ..." if len(strange) > 3 else "")
        raise Message.FILES_OF_OTHERS.error(str(final), files=found)
    return final


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the record of an earlier run, or return an empty mapping for a
    damaged one.
    """
    try:
        text = (folder / "manifest.json").read_text(encoding="utf-8")
        manifest: dict[str, Any] = json.loads(text)
        if manifest["manifest"] == 1 and {*manifest["files"]}:
            return manifest
        return {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def lost_files(manifest: Mapping[str, Any], new_files: Iterable[str]) -> str:
    """Return the names of an earlier run's files that the new run does not write;
    `new_files` are its files.

    Return "" if there are none.
    """
    # A whole folder such as `truth` counts as one name.
    kept, there = (
        {str(name).partition("/")[0] for name in names}
        for names in (new_files, manifest.get("files", ()))
    )
    return listed(sorted(there - kept), "and")


def looks_like_clip(names: Iterable[str]) -> bool:
    """Return whether a folder with these names is a clip without a manifest."""
    there = set(names)
    # Clips in data sets have clip.json instead of a manifest.
    return "clip.json" not in there and len(there & CLIPS) > 1


def _strangers(folder: Path) -> list[str] | None:
    """Return the files of other programs in the folder of an earlier run.

    Return None for a folder from another program.
    """
    # A missing or empty folder has nothing to lose.
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return []
    if not (folder / "manifest.json").is_file():
        return None
    names = []
    for p in sorted(folder.rglob("*")):
        if not p.is_dir():
            names.append(p.relative_to(folder).as_posix())
    if manifest := read_manifest(folder):
        return [
            name
            for name in names
            if name not in {"manifest.json", TIMING, *manifest["files"]}
        ]
    # A power failure may leave our files with a damaged manifest.
    if any(OURS.fullmatch(name) is None for name in names):
        return None
    return []
