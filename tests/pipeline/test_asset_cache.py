"""The cache in an assets folder: it changes no byte of a clip, and is never stale."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, fields, replace
from enum import Enum
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args, get_type_hints

import cv2
import numpy as np
import pytest

from physgen.maps import Percepts
from physgen.pipeline import stages
from physgen.pipeline.asset_cache import (
    CLASSES,
    AssetCache,
    decode_value,
    encode_value,
    make_cache,
)
from physgen.pipeline.stages import Stages
from physgen.render.sprites import Sprite
from physgen.render.squash import Squashes
from physgen.render.stage import Stage

ROOT = Path(__file__).resolve().parents[2]
SCENES = ("toy-car", "cups")
"""A vehicle with wheels; objects in front of each other, with shadows."""


def copied(name: str, folder: Path) -> Path:
    """Copy a bundled scene, with a cache of its maps; return its file."""
    shutil.copytree(ROOT / "scenes" / name, folder / name)
    scene = folder / name / "scene.yaml"
    percepts = stages.percepts(stages.load(scene))
    assert percepts is not None
    make_cache(percepts, scene.read_text(), scene)
    return scene


def cache_files(scene: Path) -> list[Path]:
    return sorted((scene.parent / "photo.assets" / "cache").iterdir())


@dataclass(frozen=True)
class Drawn:
    """What a clip is made of."""

    percepts: Percepts
    stage: Stage


def drawn(scene: Path, *, reads_cache: bool) -> Drawn:
    """Return maps and stage of a scene, in a process that knows nothing else."""
    own = Stages(reads_assets_cache=reads_cache)
    loaded = own.load(scene, (), None, allow_outside=False)
    maps = own.maps(loaded)
    assert maps.percepts is not None
    made = own.stage(loaded, own.compile(loaded, maps), maps)
    return Drawn(maps.percepts, made)


def plain(value: Any) -> Any:
    """Return a value as JSON data and the bytes of its arrays."""
    arrays: list[Any] = []
    tree = encode_value(value, arrays)
    return tree, [(one.dtype, one.shape, one.tobytes()) for one in arrays]


def equal_maps(one: Percepts, other: Percepts) -> bool:
    return all(
        np.array_equal(getattr(one, part.name), getattr(other, part.name))
        for part in fields(Percepts)
        if getattr(one, part.name) is not None or getattr(other, part.name) is not None
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_cached_maps_and_sprites_are_the_same(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = copied(name, tmp_path)
    without = drawn(scene, reads_cache=False)
    assert [one.name.partition("-")[0] for one in cache_files(scene)] == ["maps"]
    first = drawn(scene, reads_cache=True)
    kinds = [one.name.partition("-")[0] for one in cache_files(scene)]
    assert kinds == ["maps", "stage"]
    for work in ("stage", "percepts"):
        monkeypatch.setattr(stages, work, None)  # nothing is done twice
    second = drawn(scene, reads_cache=True)
    for one in (first, second):
        assert equal_maps(one.percepts, without.percepts)
        assert plain(one.stage) == plain(without.stage)


@pytest.mark.slow
@pytest.mark.parametrize("changed", ["photo.png", "photo.assets/background.png"])
def test_changed_files_give_no_old_result(changed: str, tmp_path: Path) -> None:
    scene = copied("cups", tmp_path)
    before = drawn(scene, reads_cache=True)
    old_files = cache_files(scene)
    file = scene.parent / changed
    picture = np.asarray(cv2.imread(str(file)))
    cv2.imwrite(str(file), picture // 2 + 20)
    now = drawn(scene, reads_cache=True)
    true = drawn(scene, reads_cache=False)
    assert equal_maps(now.percepts, true.percepts)
    assert plain(now.stage) == plain(true.stage) != plain(before.stage)
    new_files = cache_files(scene)
    assert len(new_files) == len(old_files) == 2
    assert new_files[1] != old_files[1]


@pytest.mark.slow
def test_moved_objects_and_light_give_no_old_sprites(tmp_path: Path) -> None:
    scene = copied("toy-car", tmp_path)
    before = drawn(scene, reads_cache=True)
    text = scene.read_text()
    assert "ambient:" in text
    ambient = text.partition("ambient: ")[2].split()[0].rstrip(",}")
    scene.write_text(text.replace(f"ambient: {ambient}", "ambient: 0.2"))
    now, true = (drawn(scene, reads_cache=cached) for cached in (True, False))
    assert plain(now.stage) == plain(true.stage) != plain(before.stage)


def entry_of(folder: Path, value: Any) -> Path:
    cache = AssetCache(folder)
    cache.create()
    cache.save("stage-1", value)
    return folder / "cache" / "stage-1.npz"


VALUE = {"a": (1, [2.5, None]), "b": np.arange(6.0).reshape(2, 3), "c": slice(1, 2)}


def test_damaged_entries_count_as_missing(tmp_path: Path) -> None:
    file = entry_of(tmp_path, VALUE)
    data = file.read_bytes()
    assert plain(AssetCache(tmp_path).load("stage-1")) == plain(VALUE)
    middle = bytearray(data)
    middle[len(data) // 2] ^= 255
    for damaged in (b"", data[: len(data) // 2], bytes(middle)):
        file.write_bytes(damaged)
        assert AssetCache(tmp_path).load("stage-1") is None
    assert AssetCache(tmp_path).load("stage-2") is None


def test_entries_run_no_code(tmp_path: Path) -> None:
    file = entry_of(tmp_path, VALUE)
    tree = np.frombuffer(b'{"items": ["id"], "class": "system"}', np.uint8)
    np.savez(file, tree=tree)
    assert AssetCache(tmp_path).load("stage-1") is None
    pickled: dict[str, Any] = {"0": [{}]}
    np.savez(file, tree=np.frombuffer(b'{"array": 0}', np.uint8), **pickled)
    assert AssetCache(tmp_path).load("stage-1") is None


def test_entries_of_another_form_count_as_missing(tmp_path: Path) -> None:
    file = entry_of(tmp_path, VALUE)
    nested = b"[" * 100_000 + b"]" * 100_000
    for tree in (b'{"fields": [], "class": "Sprite"}', nested, b"7", b'{"array": 9}'):
        np.savez(file, tree=np.frombuffer(tree, np.uint8))
        loaded = AssetCache(tmp_path).load_stage("stage-1")
        assert loaded is None


def test_unknown_classes_are_not_encoded() -> None:
    for value in (Path(), {1, 2}, np.array([{}]), SimpleNamespace()):
        with pytest.raises(TypeError):
            encode_value(value, [])


def classes_of(hint: Any) -> set[type]:
    """Return the dataclasses and named tuples that values of a type are made of."""
    inner = set().union(*map(classes_of, get_args(hint)))
    if not isinstance(hint, type) or hint.__module__.partition(".")[0] != "physgen":
        return inner
    parts = get_type_hints(hint).values() if not issubclass(hint, Enum) else ()
    return inner | {hint} | set().union(*map(classes_of, parts))


def test_the_cache_knows_all_classes_of_a_stage() -> None:
    # A film adds its impacts to the stage, and they are never cached.
    needed = classes_of(Stage) - {Squashes}
    assert Sprite in needed
    assert {one.__name__: one for one in needed}.items() <= CLASSES.items()


def test_shared_arrays_stay_shared() -> None:
    picture = np.zeros((2, 2))
    arrays: list[Any] = []
    one, other = decode_value(encode_value([picture, picture], arrays), arrays)
    assert len(arrays) == 1
    assert one is other


def test_folders_without_a_cache_get_none(tmp_path: Path) -> None:
    AssetCache(tmp_path).save("stage-1", VALUE)
    outside = tmp_path / "outside"
    outside.mkdir()
    (tmp_path / "cache").symlink_to(outside)
    AssetCache(tmp_path).save("stage-1", VALUE)
    AssetCache(tmp_path).create()
    assert not list(outside.iterdir())
    assert not AssetCache(tmp_path).exists


def test_cached_sprites_know_whether_noise_was_removed(tmp_path: Path) -> None:
    """A preview without grain must not leave its sprites to a render with grain."""
    path = copied("toy-car", tmp_path)
    pictures = []
    for has_noise in (True, False):
        warm = Stages(reads_assets_cache=True)
        scene = warm.load(path, (), None, False)
        maps = replace(warm.maps(scene), has_noise=has_noise)
        assert maps.percepts is not None
        if not has_noise:
            flat = maps.percepts.rgb // 8 * 8
            maps = replace(maps, percepts=replace(maps.percepts, rgb=flat))
        stage = warm.stage(scene, warm.compile(scene, maps), maps)
        pictures.append(stage.sprites[0].light)
    assert not np.array_equal(*pictures)
