"""Cache of one scene's decoded maps and sprites, in its assets folder.

`perceive` makes the cache of a photo, and `render` adds what it draws from, so that
neither a first clip nor a second one repeats the work. The name of an entry is a hash of
all that it depends on, the bytes of the photo and its maps among them: a changed file
never gives an old result. An entry holds arrays and plain data only, and classes of a
fixed list: a cache that came with a stranger's scene runs no code.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.files import MOST_PIXELS, partial
from physgen.geometry.polygon import Pose
from physgen.geometry.shadows import ShadowSetting, Silhouette
from physgen.maps import PHOTO, Percepts, percepts_of, stored_pictures
from physgen.photometry import DistantLight
from physgen.pipeline.cache_keys import CODE, code_version, key
from physgen.render.ball import Ball, Border, Pattern
from physgen.render.shadow_decomposition import CastShadow, LitBackground
from physgen.render.sprites import Relief, Sides, Sprite
from physgen.render.stage import Mirror, ShadowBody, Stage
from physgen.render.wheel_sprites import WheelSprite
from physgen.report.record import file_hash
from physgen.scene.files import CACHE_FOLDER
from physgen.scene.saving import named_assets, named_photo

Array = NDArray[Any]
Digest = Callable[[Path], str]
"""Returns the hash of a file."""
Range = tuple[float, float]
CLASSES: Mapping[str, type] = {
    one.__name__: one
    for one in (
        Ball, Border, CastShadow, DistantLight, LitBackground, Mirror, Pattern, Pose,
        Relief, ShadowBody, ShadowSetting, Sides, Silhouette, Sprite, Stage,
        WheelSprite,
    )
}  # fmt: skip
"""Classes of cached values, by name."""
TREE = "tree"
"""Name of the plain data among the arrays of an entry."""
DAMAGED = (
    OSError, ValueError, LookupError, TypeError, AttributeError, EOFError,
    RecursionError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""Errors of an entry that is not as it was written; it is made again."""


class AssetCache:
    """The cache in an assets folder, if it has one."""

    def __init__(self, assets: Path | None) -> None:
        self._folder = None if assets is None else assets / CACHE_FOLDER

    @property
    def exists(self) -> bool:
        """Return whether `perceive` made a cache."""
        folder = self._folder
        if folder is None or folder.is_symlink():
            return False
        return folder.is_dir()

    def create(self) -> None:
        """Make the folder, and clear it. Nothing is raised if it cannot be written."""
        if self._folder is None or self._folder.is_symlink():
            return
        with suppress(OSError):
            self._folder.mkdir(exist_ok=True)
            for entry in self._folder.glob("*.npz"):
                entry.unlink()

    def entry(
        self, kind: str, files: Sequence[Path], digest: Digest, *parts: Any
    ) -> str:
        """Return the key of an entry.

        `files` are the photo and the maps, whose hashes `digest` returns; `parts` is
        what else the entry depends on. Raises OSError.
        """
        contents = [(file.name, digest(file)) for file in files]
        return key(kind, code_version(CODE), contents, *parts)

    def load_percepts(
        self, files: Sequence[Path], digest: Digest, maps: Mapping[str, Range]
    ) -> Percepts | None:
        """Return the maps of these files, if they are in the cache; see `read_percepts`."""
        try:
            pictures = self.load(self.entry("maps", files, digest))
        except OSError:
            return None
        if not isinstance(pictures, dict) or PHOTO not in pictures:
            return None
        return percepts_of(pictures[PHOTO], pictures.get, maps)

    def load_stage(self, entry: str) -> Stage | None:
        """Return the stage of a key, if it is in the cache."""
        stage = self.load(entry)
        return stage if isinstance(stage, Stage) else None

    def load(self, key: str) -> Any:
        """Return the value of a key; None if it is not in the cache, or damaged."""
        if self._folder is None:
            return None
        try:
            with np.load(self._folder / f"{key}.npz", allow_pickle=False) as entry:
                arrays = [entry[str(k)] for k in range(len(entry.files) - 1)]
                tree = json.loads(entry[TREE].tobytes())
            return decode_value(tree, arrays)
        except DAMAGED:
            return None

    def save(self, key: str, value: Any) -> None:
        """Write the value of a key in place of the other entry of its kind.

        Nothing is written without the folder, or if the disk is full.
        """
        if self._folder is None or not self.exists:
            return
        entry = self._folder / f"{key}.npz"
        arrays: list[Array] = []
        text = json.dumps(encode_value(value, arrays))
        stored: dict[str, Any] = {str(k): array for k, array in enumerate(arrays)}
        stored[TREE] = np.frombuffer(text.encode(), np.uint8)
        beside = partial(entry)
        with suppress(OSError):
            for other in self._folder.glob(f"{key.partition('-')[0]}-*.npz"):
                other.unlink()
            try:
                with beside.open("wb") as stream:
                    np.savez(stream, **stored)
                beside.replace(entry)
            finally:
                beside.unlink(missing_ok=True)


def make_cache(percepts: Percepts, text: str, target: Path | None) -> None:
    """Put the maps of a scene that was just written into the cache in its assets folder.

    `text` is that of the scene, and `target` its file; None: it has none. Large photos
    get no cache: it would take more room than all else.
    """
    folder, data = Path() if target is None else target.parent, text.encode("utf-8")
    assets, photo = named_assets(data, folder), named_photo(data, folder)
    if assets is None or photo is None or percepts.labels.size > MOST_PIXELS:
        return
    cache = AssetCache(assets)
    cache.create()
    with suppress(OSError):
        files = [photo, *sorted(assets.glob("*.png"))]
        pictures = stored_pictures(percepts)[0] | {PHOTO: percepts.rgb}
        cache.save(cache.entry("maps", files, file_hash), pictures)


def encode_value(value: Any, arrays: list[Array]) -> Any:
    """Return a value as JSON data; its arrays are appended to `arrays`.

    Raises TypeError for a class that is not in `CLASSES`.
    """
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, np.ndarray):
        return {"array": _number_of(value, arrays)}
    if isinstance(value, np.generic):
        return {"scalar": _number_of(np.asarray(value), arrays)}
    if isinstance(value, slice):
        return {"slice": [value.start, value.stop, value.step]}
    if isinstance(value, dict):
        pairs = [[k, encode_value(one, arrays)] for k, one in value.items()]
        return {"dict": pairs}
    name = type(value).__name__
    if isinstance(value, (list, tuple)):
        items = [encode_value(one, arrays) for one in value]
        return {"items": items, "class": _known_sequence(value, name)}
    if is_dataclass(value) and CLASSES.get(name) is type(value):
        parts = {
            one.name: encode_value(getattr(value, one.name), arrays)
            for one in fields(value)
        }
        return {"fields": parts, "class": name}
    raise TypeError(f"{name} is not a class of the cache")


def _number_of(array: Array, arrays: list[Array]) -> int:
    """Return the place of an array in the list, to which it is added once."""
    if array.dtype.hasobject:
        raise TypeError("an array of objects is not plain data")
    for k, other in enumerate(arrays):
        if other is array:
            return k
    arrays.append(array)
    return len(arrays) - 1


def _known_sequence(value: Any, name: str) -> str:
    """Return the class of a list or tuple. Raises TypeError if it is unknown."""
    if type(value) in (list, tuple) or CLASSES.get(name) is type(value):
        return name
    raise TypeError(f"{name} is not a class of the cache")


def decode_value(data: Any, arrays: list[Array]) -> Any:
    """Return the value of JSON data that `encode_value` made.

    Raises KeyError, TypeError or IndexError if the data is damaged.
    """
    if not isinstance(data, dict):
        return data
    for form, decode in FORMS.items():
        if form in data:
            return decode(data, arrays)
    raise KeyError("the form of a value")


def _decode_items(data: Mapping[str, Any], arrays: list[Array]) -> Any:
    items = [decode_value(one, arrays) for one in data["items"]]
    if data["class"] == "list":
        return items
    if data["class"] == "tuple":
        return tuple(items)
    return CLASSES[data["class"]](*items)


def _decode_fields(data: Mapping[str, Any], arrays: list[Array]) -> Any:
    parts = {name: decode_value(one, arrays) for name, one in data["fields"].items()}
    return CLASSES[data["class"]](**parts)


def _decode_dict(data: Mapping[str, Any], arrays: list[Array]) -> Any:
    return {key: decode_value(one, arrays) for key, one in data["dict"]}


FORMS: Mapping[str, Callable[[Mapping[str, Any], list[Array]], Any]] = {
    "array": lambda data, arrays: arrays[data["array"]],
    "scalar": lambda data, arrays: arrays[data["scalar"]][()],
    "slice": lambda data, arrays: slice(*data["slice"]),
    "items": _decode_items,
    "fields": _decode_fields,
    "dict": _decode_dict,
}
"""What makes a value of JSON data, by the key of its form."""
