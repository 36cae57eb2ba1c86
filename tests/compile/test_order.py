"""No number depends on the order in which a file names its things."""

from __future__ import annotations

import random
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physgen import pipeline
from physgen.scene.document import Source, read, to_plain_data
from physgen.scene.write import scene_text
from physgen.text import natural

FULL = Path(__file__).parents[1] / "scene" / "full.yaml"
SECTIONS = ("objects", "boundaries", "joints", "fields", "variants")


def differences(one: Any, other: Any, path: str = "") -> list[str]:
    """Where two values are not the same to the last bit, arrays and dataclasses looked into."""
    if isinstance(one, np.ndarray):
        same = (
            isinstance(other, np.ndarray)
            and one.dtype == other.dtype
            and np.array_equal(one, other)
        )
        return [] if same else [path]
    if is_dataclass(one):
        names = [f.name for f in fields(one) if f.compare]
        return [
            d
            for name in names
            for d in differences(
                getattr(one, name), getattr(other, name), f"{path}.{name}"
            )
        ]
    if isinstance(one, tuple):
        if len(one) != len(other):
            return [path]
        pairs = zip(one, other, strict=True)
        return [
            d
            for k, pair in enumerate(pairs)
            for d in differences(*pair, f"{path}[{k}]")
        ]
    return [] if one == other else [path]


@pytest.mark.parametrize("seed", range(5))
def test_shuffled_keys_are_the_same_scene_and_world(seed: int, tmp_path: Path) -> None:
    document = to_plain_data(
        read(FULL.read_text(encoding="utf-8"), Source("full.yaml", Path()))
    )
    document["objects"]["ring"]["motion"] = {
        "path": [[0, 26.25, 18.75], [1, 40, 20, 45]]
    }
    document["objects"]["kite-10"] = dict(document["objects"]["kite"], layer=2)
    document["objects"]["kite-9"] = {
        "mask": {"polygon": [[20, 300], [60, 300], [40, 340]]}
    }
    document["objects"]["kite-8"] = {
        "mask": {"polygon": [[40, 300], [60, 300], [60, 340], [40, 340]]}
    }
    path = tmp_path / "scene.yaml"
    path.write_text(scene_text(document))
    first = pipeline.load(path)
    for section in SECTIONS:
        names = list(document[section])
        random.Random(seed).shuffle(names)
        document[section] = {name: document[section][name] for name in names}
    path.write_text(scene_text(document))
    second = pipeline.load(path)
    assert list(second.document["objects"]) == list(document["objects"])
    assert [item.name for item in second.objects] == sorted(
        document["objects"], key=natural
    )
    assert [item.name for item in second.objects][-4:] == [
        "kite-8",
        "kite-9",
        "kite-10",
        "ring",
    ]
    assert first.variants == second.variants or set(first.variants) == set(
        second.variants
    )
    assert differences(first, second) == []
    one, other = (pipeline.compile(scene, None) for scene in (first, second))
    assert differences(one.world, other.world) == []
    assert np.array_equal(one.labels, other.labels)
    assert [
        str(p).partition(": ")[2]
        for p in sorted(pipeline.lint(first, one), key=lambda p: p.path)
    ] == [
        str(p).partition(": ")[2]
        for p in sorted(pipeline.lint(second, other), key=lambda p: p.path)
    ]
