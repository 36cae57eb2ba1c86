"""What was perceived -> assets on disk and the scene's text, with paths that hold from where it will lie."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from physgen import __version__
from physgen.perceive.found import Perceived
from physgen.percepts.maps import Keep, silent, write_assets, write_png
from physgen.problems import InputError
from physgen.resources import resource
from physgen.scene.files import MAPS
from physgen.scene.write import scene_text
from physgen.whole import write_kept, write_whole

RECORD = "perceived.json"
"""Who did each step of perceiving, with what, how long it took and what it cost."""
SCHEMA = "scene-1.schema.json"
"""Copied into the assets, so that editors complete and check the scene wherever it lies, offline too."""


def lay_out(
    perceived: Perceived,
    photo: Path | None,
    name: str,
    output: Path | None,
    assets: Path | None = None,
    keep: Keep = silent,
) -> str:
    """Write the assets, and the scene file where `output` is given; returns the scene's text.

    Assets go to `OUTPUT-STEM.assets/` beside the scene, or `NAME.assets/` in the current folder, unless `assets` says
    otherwise. `photo` is its file, copied into them from outside the scene's folder; None where no scene can name the
    file as it is: it is then written as `NAME.png`. Files that are there and differ are kept as `NAME~`
    (`keep` is told). Raises InputError when the assets would lie outside the scene's folder.
    """
    folder = output.parent if output else Path()
    if assets is None:
        assets = folder / f"{output.stem if output else name}.assets"
    if not assets.resolve().is_relative_to(folder.resolve()):
        where = "beside -o" if output else "in the current folder"
        raise InputError.of(
            "--assets", f'"{assets}"', "lies outside the scene's folder", f"name a folder {where}"
        )
    if output is not None:
        folder.mkdir(parents=True, exist_ok=True)
    ranges = write_assets(perceived.percepts, assets, keep)
    if photo is None:
        photo = assets / _own(f"{name}.png")
        write_png(photo, perceived.percepts.rgb, keep)
    elif not photo.resolve().is_relative_to(folder.resolve()):
        copy = assets / _own(photo.name)
        if not (copy.exists() and copy.samefile(photo)):
            write_kept(copy, photo.read_bytes(), keep)
        photo = copy
    placed: dict[str, Any] = {
        "physgen": 1,
        "image": _relative(photo, folder),
        "assets": _relative(assets, folder),
        **{
            key: value
            for key, value in perceived.document.items()
            if key not in ("physgen", "image", "assets", "maps")
        },
    }
    if ranges:
        placed["maps"] = {name: list(bounds) for name, bounds in ranges.items()}
    schema = assets / SCHEMA
    write_kept(schema, resource("schemas", SCHEMA).read_bytes(), keep)
    if perceived.record:  # it tells of this run: an earlier one's is not worth keeping
        told = {"physgen": __version__, "steps": list(perceived.record)}
        write_whole(assets / RECORD, json.dumps(told, indent=1, ensure_ascii=False).encode() + b"\n")
    else:
        (assets / RECORD).unlink(missing_ok=True)  # of an earlier run with models
    text = scene_text(placed, perceived.comments, perceived.header, _relative(schema, folder))
    if output is not None:
        write_kept(output, text.encode("utf-8"), keep)
    return text


def _own(name: str) -> str:
    """The photo's name among the assets: none that a map has."""
    return f"photo-{name}" if Path(name).stem.lower() in MAPS else name


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
