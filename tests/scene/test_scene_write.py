"""Data -> text -> the same data; and text that a person likes to read."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physgen.scene.document import Source, read, to_plain_data
from physgen.scene.load import load
from physgen.scene.write import scene_text

NUMBERS = st.one_of(
    st.integers(-(10**30), 10**30),
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from([-0.0, 1e22, 5e-324]),
)
WORDS = r"""on true null ~ 1e6 .inf 0x1 #a ' " ... --- ...a &a *a !a %a @a `a [ { a,b ? : << = a\b"""
ODD = [
    "- a",
    "a: b",
    "a #b",
    "a\nb",
    " a",
    "a ",
    "\t",
    "\x85",
    "\u2028",
    "\ufeff",
    "\U0001f600",
    "\0",
    "ü b",
    "9" * 400,
]
TEXTS = st.one_of(st.text(max_size=20), st.sampled_from([*WORDS.split(), *ODD]))
VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, TEXTS),
    lambda inner: st.one_of(
        st.lists(inner, max_size=5),
        st.dictionaries(TEXTS, inner, max_size=4),
        st.lists(st.lists(NUMBERS, max_size=3), max_size=40),
    ),
    max_leaves=20,
)


def again(text: str) -> Any:
    return to_plain_data(read(text, Source("x", Path())))


@settings(max_examples=100)
@given(
    st.dictionaries(
        st.one_of(
            st.sampled_from(["objects", "forces", "world", "variants", "light"]), TEXTS
        ),
        VALUES,
        max_size=4,
    ),
    st.dictionaries(
        st.sampled_from(
            ["objects", "world", "forces", "forces[0]", "objects.on", "light"]
        ),
        st.text(max_size=150),
    ),
    st.text(max_size=30),
)
def test_round_trip(
    document: dict[str, Any], comments: dict[str, str], header: str
) -> None:
    text = scene_text(document, comments, header)
    assert repr(again(text)) == repr(ordered(again(text), document))
    assert again(text) == document
    assert math.inf not in again(text).values()


def ordered(found: Any, written: Any) -> Any:
    """What was written, in the order in which it was found: types and signs of zero are compared by repr."""
    if isinstance(found, dict):
        return {key: ordered(found[key], written[key]) for key in found}
    if isinstance(found, list):
        return [ordered(a, b) for a, b in zip(found, written, strict=True)]
    return written


def test_how_it_looks() -> None:
    document = {
        "physgen": 1,
        "image": "photo.png",
        "world": {"view": "top", "gravity": (0, 0), "table": {"friction": 0.2}},
        "objects": {
            "cue-ball": {
                "label": "billiard ball",
                "mask": np.int64(1),
                "shape": {
                    "circle": {
                        "center": np.array([470.5, 257.0]),
                        "radius": np.float64(30.2),
                    }
                },
                "mass": 170,
                "from": {"mass": "table 0.4"},
            },
            "8": {
                "label": "yes: no",
                "mask": {"polygon": [[n, n * n] for n in range(40)]},
            },
        },
        "boundaries": {"floor": {"segment": [[0, 457], [512, 457]], "friction": 0.6}},
        "forces": [{"object": "cue-ball", "impulse": [-1.0e6, 0]}],
        "joints": {"hinge": {"pivot": [256, 40], "objects": ["cue-ball"]}},
        "fields": {"breeze": {"drag": 0.002, "wind": [300, 0]}},
        "light": {"direction": [0.3, -0.6, 0.74]},
        "variants": {
            "hard": {"objects.cue-ball.velocity": [-900, 0], "objects.*.label": "on"}
        },
    }
    comments = {
        "objects.cue-ball.mass": "from the table of materials",
        "objects.cue-ball": "the white one",
        "boundaries.floor": "a guess\nfrom the lowest points",
        "forces[0]": "the break",
    }
    assert (
        scene_text(
            document,
            comments,
            "Written by physgen perceive photo.png.\nEdit freely.",
            "photo.assets/scene-1.schema.json",
        )
        == """\
# yaml-language-server: $schema=photo.assets/scene-1.schema.json
# Written by physgen perceive photo.png.
# Edit freely.
physgen: 1
image: photo.png
world:
  view: top
  gravity: [0, 0]
  table: {friction: 0.2}
objects:
  cue-ball:  # the white one
    label: billiard ball
    mask: 1
    shape: {circle: {center: [470.5, 257.0], radius: 30.2}}
    mass: 170  # from the table of materials
    from: {mass: table 0.4}
  "8":
    label: "yes: no"
    mask:
      polygon: [[0, 0], [1, 1], [2, 4], [3, 9], [4, 16], [5, 25], [6, 36], [7, 49], [8, 64], [9, 81], [10, 100],
        [11, 121], [12, 144], [13, 169], [14, 196], [15, 225], [16, 256], [17, 289], [18, 324], [19, 361],
        [20, 400], [21, 441], [22, 484], [23, 529], [24, 576], [25, 625], [26, 676], [27, 729], [28, 784],
        [29, 841], [30, 900], [31, 961], [32, 1024], [33, 1089], [34, 1156], [35, 1225], [36, 1296], [37, 1369],
        [38, 1444], [39, 1521]]
boundaries:
  # a guess
  # from the lowest points
  floor: {segment: [[0, 457], [512, 457]], friction: 0.6}
forces:
  - {object: cue-ball, impulse: [-1.0e6, 0]}  # the break
joints:
  hinge: {objects: [cue-ball], pivot: [256, 40]}
fields:
  breeze: {wind: [300, 0], drag: 0.002}
light: {direction: [0.3, -0.6, 0.74]}
variants:
  hard: {objects.cue-ball.velocity: [-900, 0], objects.*.label: on}
"""
    )


@pytest.mark.parametrize(
    "value", [math.nan, math.inf, -math.inf, object(), {1: 2}, {"k" * 2000: 1}]
)
def test_what_no_scene_can_hold(value: Any) -> None:
    with pytest.raises(ValueError):
        scene_text({"world": value})


def test_a_resolved_scene_loads_as_the_same_scene(tmp_path: Path) -> None:
    text = Path(__file__).parent.joinpath("full.yaml").read_text()
    (tmp_path / "a.yaml").write_text(text)
    first = load(tmp_path / "a.yaml")
    (tmp_path / "a.yaml").write_text(scene_text(first.document))
    second = load(tmp_path / "a.yaml")
    assert second == first
    assert second.document == first.document
    assert scene_text(second.document) == scene_text(first.document)
