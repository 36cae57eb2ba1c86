"""The photo's scale from what is in it."""

from __future__ import annotations

import numpy as np
import pytest

from physgen.geometry.polygon import Disc, Outline, Region, Ring
from physgen.geometry.scale import (
    MIN_SCALE_CONFIDENCE,
    Scale,
    assumed_scale,
    photo_scale,
    push_speed,
    scale_entry,
    slow_motion,
)
from physgen.materials import kind
from physgen.perceive.roles import PhotoObject


def told(
    *things: tuple[str, Outline], cut: bool = False, sure: float = 1.0
) -> Scale | None:
    numbered = [
        PhotoObject(k, outline, label, cut) for k, (label, outline) in enumerate(things)
    ]
    kinds = {thing.id: kind(thing.label) for thing in numbered}
    return photo_scale(numbered, kinds, dict.fromkeys(kinds, sure))


def disc(width: float) -> Disc:
    return Disc(np.zeros(2), width / 2)


def box(width: float, height: float) -> Region:
    return Region(
        (Ring(np.array([[0, 0], [width, 0], [width, height], [0, height]], float)),)
    )


def test_billiard_balls_tell_the_scale():
    found = told(*[("billiard ball", disc(40 + e)) for e in (-0.4, 0, 0.3)])
    assert found is not None
    assert found.pixels_per_meter == pytest.approx(700, rel=0.01)
    assert found.confidence > 0.9
    assert "3 x billiard ball (57.15 mm)" in found.reason


def test_what_tells_nothing():
    assert told(("ball", disc(40)), ("wooden block", box(30, 30))) is None
    assert told(("billiard ball", disc(40)), cut=True) is None
    assert told(("billiard ball", disc(40)), sure=0.5) is None
    assert (
        told(("domino", box(40, 39))) is None
        or told(("domino", box(40, 39))).confidence < MIN_SCALE_CONFIDENCE
    )
    assert told(("plank", box(400, 20))) is None


def test_agreement_makes_it_surer_and_disagreement_less_sure():
    """At 1000 px/m."""
    mug, apple, egg = ("mug", box(82, 95)), ("apple", disc(75)), ("egg", box(44, 57))
    one, three = told(mug), told(mug, apple, egg)
    assert one is not None
    assert three is not None
    assert three.confidence > one.confidence > MIN_SCALE_CONFIDENCE
    assert three.pixels_per_meter == pytest.approx(1000, rel=0.05)
    apart = told(mug, ("apple", disc(150)))
    assert apart is not None
    assert apart.confidence < MIN_SCALE_CONFIDENCE


def test_a_person_s_number_wins_and_an_unsure_one_is_only_mentioned():
    sure, unsure = Scale(700, 0.9, "from balls"), Scale(640, 0.3, "from a bottle")
    assert scale_entry(512, 500, sure)[0] == 500
    assert scale_entry(512, None, sure)[0] == 700
    value, sentence = scale_entry(512, None, unsure)
    assert value == assumed_scale(512) == 1024
    assert "640" in sentence
    assert scale_entry(512, None, None)[0] == 1024


@pytest.mark.parametrize("meters", [0.1, 0.5, 2.0, 30.0])
def test_a_push_can_be_watched_at_any_scale(meters):
    """Speeds and times go with the root of a length, as for ships and their models (Froude)."""
    side = 800
    speed, small = (
        push_speed(side, side / size) / side * size for size in (meters, meters / 4)
    )
    assert speed == pytest.approx(2 * small, rel=0.1)
    slow = slow_motion(side, side / meters)
    crossing = slow * side / push_speed(side, side / meters)
    assert crossing > 1
    assert slow == 1 or crossing < 2.2
