from __future__ import annotations

import pytest

from physgen.materials import kind, materials, nouns


def test_rows_are_physical_and_sourced():
    rows = list(materials())
    assert len(rows) >= 70
    for row in rows:
        assert 0.005 < row.density < 25
        assert 0 < row.friction <= 1.5
        assert 0 <= row.elasticity < 1
        assert 0 < row.rolling <= 0.1
        assert 0 <= row.gloss <= 1
        assert row.source
        assert row.surface


def test_nouns_are_physical_and_sourced():
    """A thing's mass is its material's density times a share of its volume that can be."""
    rows = list(nouns())
    assert len(rows) >= 340
    for what, words in rows:
        assert what.source, what.noun
        assert words, what.noun
        assert what.material.name != "unknown"
        assert 0.0002 < what.filled < 2, what.noun
        assert 0.0003 < what.density < 12, what.noun
        assert what.box is None or all(0.05 <= side <= 5000 for side in what.box)
        assert all(word.isascii() and word == word.lower() for word in words)


def test_every_word_finds_its_row():
    for what, words in nouns():
        for word in words:
            assert kind(word).noun == what.noun, word


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("steel", 7.7, 8.0), ("aluminium", 2.6, 2.8), ("glass", 2.4, 2.6), ("lead", 11.2, 11.4),
        ("gold", 19.2, 19.4), ("cork", 0.2, 0.3), ("ice", 0.91, 0.93), ("granite", 2.6, 2.8),
        ("hardwood", 0.6, 0.8), ("balsa", 0.1, 0.2), ("nylon", 1.1, 1.2), ("copper", 8.9, 9.0),
    ],
)  # fmt: skip
def test_densities_are_those_of_textbooks(name: str, low: float, high: float):
    (row,) = (row for row in materials() if row.name == name)
    assert low <= row.density <= high


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
        ("kitchen knives", "kitchen knife", "stainless steel"),
        ("2 wine glasses", "wine glass", "glass"),
        ("loaves of bread", "loaf of bread", "bread"),
        ("teacup", "cup", "ceramic"),
        ("tin of tomatoes", "tin", "steel"),
        ("red apple on a plate", "apple", "fruit"),
        ("orange", "orange", "fruit"),
        ("orange ball", "ball", "rubber"),
        ("cork", "cork", "cork"),
        ("cork ball", "ball", "cork"),
        ("glass marble", "marble", "glass"),
        ("foam rubber ball", "rubber ball", "foam rubber"),
        ("wooden spoon", "wooden spoon", "wood"),
        ("block (oak)", "block", "hardwood"),
        ("ball made of steel", "ball", "steel"),
        ("box of chocolates", "box", "cardboard"),
        ("silver phone", "phone", "glass"),
        ("silver fork", "fork", "silver"),
        ("paper clip", "paper clip", "steel"),
        ("contraption", "", "unknown"),
        ("iron", "iron", "plastic"),
        ("iron ball", "iron ball", "iron"),
        ("cannonball", "iron ball", "iron"),
        ("stainless steel ball", "steel ball", "stainless steel"),
        ("wheel of cheese", "wheel of cheese", "cheese"),
        ("wheel", "wheel", "rubber"),
        ("apricot", "apricot", "fruit"),
        ("plum tomatoes", "plum tomato", "vegetable"),
        ("barbell", "barbell", "steel"),
        ("duplo brick", "duplo brick", "abs"),
        ("chestnuts", "chestnut", "vegetable"),
        ("tv", "tv", "plastic"),
        ("tv remote", "remote control", "plastic"),
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


def test_what_another_material_does_to_a_thing():
    """A steel ball is solid, a steel mug has thin walls, a plastic fork is a fork."""
    assert kind("steel ball").filled == 1
    assert kind("plastic ball").hollowed(70).filled < 0.2
    assert 0.3 < kind("steel mug").density / kind("mug").density < 1
    assert kind("plastic fork").material.name == "plastic"
    assert kind("wooden fork").filled == kind("fork").filled
    assert kind("wooden elephant").filled == 1


@pytest.mark.parametrize(
    "label", ["marble", "glass ball", "steel ball", "ball bearing"]
)
def test_hard_polished_balls_bounce_well_and_vessels_do_not(label: str):
    assert kind(label).material.elasticity == 0.9
    assert kind("drinking glass").material.elasticity < 0.7
    assert kind("wooden marble").material.elasticity < 0.6


def test_a_surface_has_a_source_of_its_own():
    mug, tennis, steel = (
        kind(label).material.surface for label in ("mug", "tennis ball", "steel ball")
    )
    assert mug == "estimate"
    assert "ITF" in tennis
    assert "Newton" not in steel
    assert "friction: ETB" in steel
    assert "CRC" not in mug + tennis + steel
