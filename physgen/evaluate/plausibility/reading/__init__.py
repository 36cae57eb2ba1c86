"""What somebody hands in -> tracks: one file a format, chosen by what the path holds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from physgen.evaluate.plausibility.reading.asked import Asked
from physgen.evaluate.plausibility.tracks import Tracks
from physgen.problems import InputError

FIX = (
    "give a clip's folder, a scene file, a CSV, MOT's gt.txt, COCO with tracks (*.json), TAP-Vid (*.npz) or a "
    "folder of PNG masks"
)


def read(path: Path, asked: Asked) -> Iterator[Tracks]:
    """Every clip that a path holds. Raises InputError, which says what it is not."""
    if not path.exists():
        raise InputError.of(str(path), "", "is not there", FIX)
    if path.is_dir():
        yield from _folder(path, asked)
        return
    ending = path.suffix.lower()
    if ending in (".yaml", ".yml"):
        from physgen.evaluate.plausibility.reading.clips import from_scene

        yield from_scene(path)
    elif ending == ".csv":
        from physgen.evaluate.plausibility.reading.csv_table import from_csv

        yield from_csv(path, asked)
    elif ending == ".txt":
        from physgen.evaluate.plausibility.reading.mot import from_mot

        yield from_mot(path, asked)
    elif ending == ".json":
        from physgen.evaluate.plausibility.reading.coco import from_coco

        yield from from_coco(path, asked)
    elif ending == ".npz":
        from physgen.evaluate.plausibility.reading.archives import from_archive

        yield from_archive(path, asked)
    else:
        raise InputError.of(str(path), f'"{ending or path.name}"', "is no kind of tracks", FIX)


def _folder(path: Path, asked: Asked) -> Iterator[Tracks]:
    from physgen.batch.clips import clip_folders
    from physgen.evaluate.plausibility.reading.pictures import from_pictures, pictures_in

    for name, ending in (("gt.txt", ""), ("gt/gt.txt", ""), ("annotations.json", ""), ("tapvid.npz", "")):
        if (path / (name + ending)).is_file():
            yield from read(path / (name + ending), asked)
            return
    if (path / "scene.yaml").is_file():
        yield from read(path / "scene.yaml", asked)
        return
    if not (path / "manifest.json").exists() and pictures_in(path):
        yield from_pictures(path, asked)
        return
    try:
        folders = clip_folders([path])
    except InputError:
        raise InputError.of(str(path), "", "holds no clip and no tracks", FIX) from None
    from physgen.evaluate.plausibility.reading.clips import from_clip

    for folder in folders:
        yield from_clip(folder)
