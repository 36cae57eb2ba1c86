"""Cache of one scene's decoded maps and sprites, in its assets folder.

`perceive` creates the cache of a photo, and `render` adds the prepared stage, so that
neither the first clip nor later clips repeat the work. The name of an entry is a hash
of all its inputs, including the bytes of the photo and its maps: a changed file never
leads to an old result. An entry consists of arrays, plain data, and classes of a fixed
list: a cache in a scene of unknown origin runs no code.
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
from physgen.render.ball import Ball
from physgen.render.ball_patterns import Border, Pattern
from physgen.render.block_tops import BlockTop
from physgen.render.foot_halos import FootHalo
from physgen.render.shadow_decomposition import CastShadow, LitBackground
from physgen.render.sprites import Gloss, Relief, Sides, Sprite
from physgen.render.stage import Mirror, ShadowBody, Stage
from physgen.render.standing_shade import StandingShade
from physgen.render.wheel_sprites import WheelSprite
from physgen.report.record import file_hash
from physgen.scene.files import CACHE_FOLDER
from physgen.scene.saving import named_assets, named_photo

Array = NDArray[Any]
Digest = Callable[[Path], str]
"""Function from a file to its hash."""
Range = tuple[float, float]
CLASSES: Mapping[str, type] = {
    one.__name__: one
    for one in (
        Ball, BlockTop, Border, CastShadow, DistantLight, FootHalo, Gloss,
        LitBackground, Mirror, Pattern, Pose, Relief, ShadowBody, ShadowSetting, Sides,
        Silhouette, Sprite, Stage, StandingShade, WheelSprite,
    )
}  # fmt: skip
"""Classes of cached values, by name."""
TREE = "tree"
"""Name of the plain data among the arrays of an entry."""
DAMAGED = (
    OSError, ValueError, LookupError, TypeError, AttributeError, EOFError,
    RecursionError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""Errors of a damaged entry; it is computed again."""


class AssetCache:
    """The cache in an assets folder, if it has one."""

    def __init__(self, assets: Path | None) -> None:
        self._folder = None if assets is None else assets / CACHE_FOLDER

    @property
    def exists(self) -> bool:
        """Check whether `perceive` created a cache."""
        folder = self._folder
        if folder is None or folder.is_symlink():
            return False
        return folder.is_dir()

    def create(self) -> None:
        """Create the folder and clear it; without write permission, do nothing."""
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

        `files` are the photo and the maps, `digest` returns their hashes, and `parts`
        are all other inputs of the entry. Raises OSError.
        """
        contents = [(file.name, digest(file)) for file in files]
        return key(kind, code_version(CODE), contents, *parts)

    def load_percepts(
        self, files: Sequence[Path], digest: Digest, maps: Mapping[str, Range]
    ) -> Percepts | None:
        """Load the maps of these files, if they are in the cache; see
        `read_percepts`.
        """
        try:
            pictures = self.load(self.entry("maps", files, digest))
        except OSError:
            return None
        if not isinstance(pictures, dict) or PHOTO not in pictures:
            return None
        return percepts_of(pictures[PHOTO], pictures.get, maps)

    def load_stage(self, entry: str) -> Stage | None:
        """Load the stage of a key, if it is in the cache."""
        stage = self.load(entry)
        if isinstance(stage, Stage):
            return stage
        return None

    def load(self, key: str) -> Any:
        """Load the value of a key; None if it is missing or damaged."""
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

        Without the folder, or on a full disk, do nothing.
        """
        if self._folder is None or not self.exists:
            return
        entry = self._folder / f"{key}.npz"
        arrays: list[Array] = []
        text = json.dumps(encode_value(value, arrays))
        contents: dict[str, Any] = {str(k): array for k, array in enumerate(arrays)}
        contents[TREE] = np.frombuffer(text.encode(), np.uint8)
        # A reader never sees a partly written entry: the file gets its name when it is
        # complete.
        temporary_file = partial(entry)
        with suppress(OSError):
            for other in self._folder.glob(f"{key.partition('-')[0]}-*.npz"):
                other.unlink()
            try:
                with temporary_file.open("wb") as stream:
                    np.savez(stream, **contents)
                temporary_file.replace(entry)
            finally:
                temporary_file.unlink(missing_ok=True)


def make_cache(percepts: Percepts, text: str, target: Path | None) -> None:
    """Write the maps of a new scene into the cache of its assets folder.

    `text` is the text of the scene, and `target` its file or None. Large photos get no
    cache, which would be larger than all other files of the scene.
    """
    if target is None:
        folder = Path()
    else:
        folder = target.parent
    data = text.encode("utf-8")
    assets = named_assets(data, folder)
    photo = named_photo(data, folder)
    if assets is None or photo is None or percepts.labels.size > MOST_PIXELS:
        return
    cache = AssetCache(assets)
    cache.create()
    # A full disk must not spoil the scene: the cache can be computed again.
    with suppress(OSError):
        files = [photo, *sorted(assets.glob("*.png"))]
        pictures = stored_pictures(percepts)[0] | {PHOTO: percepts.rgb}
        cache.save(cache.entry("maps", files, file_hash), pictures)


def encode_value(value: Any, arrays: list[Array]) -> Any:
    """Return a value as JSON data; its arrays are appended to `arrays`.

    Raises TypeError for a class outside `CLASSES`.
    """
    if value is None or type(value) in (bool, int, float, str):
        return value
    # Arrays are stored beside the JSON text, by number: as text they would lose digits
    # and time.
    if isinstance(value, np.ndarray):
        return {"array": _number_of(value, arrays)}
    if isinstance(value, np.generic):
        return {"scalar": _number_of(np.asarray(value), arrays)}
    if isinstance(value, slice):
        return {"slice": [value.start, value.stop, value.step]}
    if isinstance(value, dict):
        pairs = [[k, encode_value(item, arrays)] for k, item in value.items()]
        return {"dict": pairs}
    name = type(value).__name__
    if isinstance(value, (list, tuple)):
        items = [encode_value(item, arrays) for item in value]
        return {"items": items, "class": _known_sequence(value, name)}
    # Only classes of the list are accepted, since their constructors run while an entry
    # of unknown origin is read.
    if is_dataclass(value) and CLASSES.get(name) is type(value):
        parts = {}
        for item in fields(value):
            parts[item.name] = encode_value(getattr(value, item.name), arrays)
        return {"fields": parts, "class": name}
    raise TypeError(f"{name} is not a class of the cache")


def _number_of(array: Array, arrays: list[Array]) -> int:
    """Return the index of an array in the list; add the array if it is new."""
    if array.dtype.hasobject:
        raise TypeError("an array of objects is not plain data")
    # Sprites share arrays: each is stored once and shared again after loading.
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
    """Decode JSON data of `encode_value`.

    Raises KeyError, TypeError or IndexError if the data is damaged.
    """
    if not isinstance(data, dict):
        return data
    for form, decode in FORMS.items():
        if form in data:
            return decode(data, arrays)
    raise KeyError("the form of a value")


def _decode_items(data: Mapping[str, Any], arrays: list[Array]) -> Any:
    """Decode a list, a tuple or a named tuple."""
    items = [decode_value(item, arrays) for item in data["items"]]
    if data["class"] == "list":
        return items
    if data["class"] == "tuple":
        return tuple(items)
    return CLASSES[data["class"]](*items)


def _decode_fields(data: Mapping[str, Any], arrays: list[Array]) -> Any:
    """Decode a dataclass."""
    parts = {name: decode_value(item, arrays) for name, item in data["fields"].items()}
    return CLASSES[data["class"]](**parts)


def _decode_dict(data: Mapping[str, Any], arrays: list[Array]) -> Any:
    """Decode a dictionary."""
    return {key: decode_value(item, arrays) for key, item in data["dict"]}


FORMS: Mapping[str, Callable[[Mapping[str, Any], list[Array]], Any]] = {
    "array": lambda data, arrays: arrays[data["array"]],
    "scalar": lambda data, arrays: arrays[data["scalar"]][()],
    "slice": lambda data, arrays: slice(*data["slice"]),
    "items": _decode_items,
    "fields": _decode_fields,
    "dict": _decode_dict,
}
"""Decoders of JSON data by the key of its form."""
