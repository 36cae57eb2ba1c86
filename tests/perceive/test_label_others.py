"""Unsure names follow those of like objects."""

from __future__ import annotations

import numpy as np

from physgen.geometry.polygon import Disc
from physgen.materials import is_living
from physgen.perceive.backends.label_imagenet import name_like_others, name_toys
from physgen.perceive.roles import Name, PhotoObject


def objects(*radii: float) -> dict[int, PhotoObject]:
    """Discs of some radii, px."""
    return {
        i: PhotoObject(i, Disc(np.array([90.0 * i, 50.0]), radius))
        for i, radius in enumerate(radii, 1)
    }


def test_an_unsure_apple_among_apples_is_one() -> None:
    sure = Name("apple", 0.8, (), "imagenet")
    unsure = Name("ball", 0.5, (("apple", 0.27), ("banana", 0.17)), "shape")
    names = name_like_others({1: sure, 2: sure, 3: unsure}, objects(40, 42, 38))
    assert names[3].label == "apple"
    assert 0.27 < names[3].confidence < 0.8
    assert names[1] == sure


def test_an_unsure_name_follows_no_single_object() -> None:
    sure = Name("apple", 0.8, (), "imagenet")
    unsure = Name("ball", 0.5, (("apple", 0.27),), "shape")
    assert name_like_others({1: sure, 3: unsure}, objects(40, 42, 38))[3] == unsure


def test_an_unsure_name_follows_none_of_another_size() -> None:
    sure = Name("apple", 0.8, (), "imagenet")
    unsure = Name("ball", 0.5, (("apple", 0.27),), "shape")
    names = name_like_others({1: sure, 2: sure, 3: unsure}, objects(40, 42, 15))
    assert names[3] == unsure


def test_an_unlikely_name_is_not_taken() -> None:
    sure = Name("apple", 0.8, (), "imagenet")
    unsure = Name("object", 0.2, (("person", 0.3), ("apple", 0.25)), "shape")
    names = name_like_others({1: sure, 2: sure, 3: unsure}, objects(40, 42, 38))
    assert names[3] == unsure


def test_animal_as_large_as_a_model_is_a_toy() -> None:
    """A cow beside a dinosaur of its size; the dog behind them is larger."""
    names = {
        1: Name("dinosaur", 0.9, (), "imagenet"),
        2: Name("cow", 0.8, (), "imagenet"),
        3: Name("dog", 0.8, (), "imagenet"),
        4: Name("person", 0.8, (), "imagenet"),
    }
    named = name_toys(names, objects(40, 45, 90, 42))
    assert [name.label for name in named.values()] == [
        "dinosaur", "toy animal", "dog", "person"
    ]  # fmt: skip
    assert not is_living(named[2].label)


def test_animals_without_a_model_stay_animals() -> None:
    names = {1: Name("cow", 0.8), 2: Name("cow", 0.8)}
    assert name_toys(names, objects(40, 42)) == names
