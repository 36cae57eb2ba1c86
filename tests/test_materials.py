from __future__ import annotations

import pytest

from physgen.materials import kind, materials


def test_rows_are_physical_and_sourced():
    rows = list(materials())
    assert len(rows) >= 15
    for row in rows:
        assert 0.005 < row.density < 25
        assert 0 < row.friction <= 1.5
        assert 0 <= row.elasticity < 1
        assert row.source


@pytest.mark.parametrize(
    ("label", "noun", "material"),
    [
        ("billiard", "billiard ball", "phenolic"),
        ("Billiard Ball", "billiard ball", "phenolic"),
        ("table tennis ball", "table tennis ball", "plastic"),
        ("tennis balls", "tennis ball", "rubber"),
        ("white cuboid", "block", "wood"),
        ("silicone block", "block", "silicone"),
        ("wooden block", "block", "wood"),
        ("toy car", "toy car", "plastic"),
        ("thing", "", "unknown"),
        ("", "", "unknown"),
        ("football", "football", "leather"),
        ("contraption", "", "unknown"),
    ],
)
def test_words_find_their_rows(label: str, noun: str, material: str):
    found = kind(label)
    assert (found.noun, found.material.name) == (noun, material)


def test_another_material_is_solid_and_has_no_ordinary_weight():
    ball, wooden = kind("tennis ball"), kind("wooden tennis ball")
    assert ball.mass == 57.7
    assert wooden.mass is None
    assert wooden.filled == 1
