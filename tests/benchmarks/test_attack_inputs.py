"""Inputs of benchmarks/attack.py, and the faults that it recognises."""

from __future__ import annotations

import random
from pathlib import Path

import attack_faults
import hand_mistakes
import numpy as np
import odd_photos
import pytest
from PIL import Image

SCENE = hand_mistakes.ROOT / "scenes" / "wall-ball" / "scene.yaml"
SEEDS = 5


@pytest.mark.parametrize("mistake", dict.fromkeys(hand_mistakes.TEXT_MISTAKES))
def test_text_mistakes_change_a_scene(mistake: hand_mistakes.TextMistake) -> None:
    text = SCENE.read_text("utf-8")
    texts = {mistake(text, random.Random(seed)) for seed in range(SEEDS)}
    assert texts != {text}


def test_tree_mistakes_accept_each_scene() -> None:
    for mistake in dict.fromkeys(hand_mistakes.TREE_MISTAKES):
        for seed in range(SEEDS):
            chance = random.Random(seed)
            text = hand_mistakes.choose_scene(chance).read_text("utf-8")
            mistake(hand_mistakes.yaml.safe_load(text), chance)


@pytest.mark.parametrize(
    "container", dict.fromkeys(container for container, _ in odd_photos.CONTAINERS)
)
def test_containers_store_any_size(container: odd_photos.Container) -> None:
    for seed, size in enumerate([(1, 1), (64, 40), (1, 9)]):
        image = Image.new("RGB", size, (40, 90, 160))
        data = odd_photos.store(container, image, random.Random(seed))
        assert isinstance(data, bytes)


def test_same_seed_writes_same_input(tmp_path: Path) -> None:
    for seed in range(SEEDS):
        contents = []
        for name in ("first", "second"):
            folder = tmp_path / f"{seed}-{name}"
            folder.mkdir()
            hand_mistakes.write_mistaken_scene(folder, random.Random(seed))
            odd_photos.write_odd_photo(folder, random.Random(seed + 1))
            files = sorted(path for path in folder.rglob("*") if path.is_file())
            contents.append([(path.name, path.read_bytes()) for path in files])
        assert contents[0] == contents[1]


def test_faults_of_messages(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("physgen: 1\nsize: [2, 2]\n")
    sound = ["a.yaml:2:7: size: is small; enlarge it"]
    assert attack_faults.wrong_places(sound, tmp_path) == []
    assert attack_faults.wrong_places(["a.yaml:9:1: x; y"], tmp_path)
    assert attack_faults.wrong_places(["a.yaml:2:40: x; y"], tmp_path)
    assert attack_faults.repeated_messages(sound) == []
    assert attack_faults.repeated_messages(sound * 2)
    assert attack_faults.invalid_json(["check", "--json"], "no problems")


def test_departure_needs_all_moving_bodies() -> None:
    resting = np.zeros((8, 1, 3)) + 50.0
    leaving = resting.copy()
    leaving[:, 0, 0] += 1000.0 * np.arange(8)
    both = np.concatenate([resting, leaving], axis=1)
    crossing = resting.copy()
    crossing[:, 0, 0] += np.arange(8)
    assert attack_faults.has_left(both, (100, 100))
    assert not attack_faults.has_left(resting, (100, 100))
    assert not attack_faults.has_left(
        np.concatenate([both, crossing], axis=1), (100, 100)
    )
