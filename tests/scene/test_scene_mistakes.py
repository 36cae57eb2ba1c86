"""Mistakes that people make in a scene file: each is answered at its place, with what was meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from physgen.cli.main import main
from physgen.problems import InputError, Problem, by_place
from physgen.scene.load import OpenedScene

HEAD = "physgen: 1\nsize: [512, 512]\n"
BALL = HEAD + "objects:\n  ball:\n    shape: {circle: {center: [50, 50], radius: 9}}\n"
MISTAKES: dict[str, tuple[str, list[tuple[int, int, str, str]]]] = {
    "key three deep": (
        HEAD
        + (
            "objects:\n ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
            "   mass: 3\n"
        ),
        [(6, 4, "", "4")],
    ),
    "key five deep": (BALL + "     mass: 3\n", [(6, 6, "", "4")]),
    "objects not indented": (
        HEAD + "objects:\nball:\n  shape: {circle: {center: [50, 50], radius: 9}}\n",
        [(3, 9, "objects", ""), (4, 1, "ball", "objects")],
    ),
    "keys of an object not indented": (
        HEAD + "objects:\n  ball:\n  shape: {circle: {center: [50, 50], radius: 9}}\n",
        [
            (4, 8, "objects.ball", ""),
            (5, 11, "objects.shape.circle", "objects.NAME.shape"),
        ],
    ),
    "tab before a key": (BALL + "\tmass: 3\n", [(6, 1, "", "")]),
    "curly quotes": (
        BALL + "    label: “ball”\n    mass: ‘3’\n",
        [(7, 11, "objects.ball.mass", "3")],
    ),
    "no space, Windows line ends": (
        (
            "physgen: 1\r\nsize: [512, 512]\r\nobjects:\r\n  ball:\r\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\r\n"
            "    mass:3\r\n    friction: 1\r\n"
        ),
        [(6, 5, "", "mass: 3")],
    ),
    "Windows line ends": (
        (
            "physgen: 1\r\nsize: [512, 512]\r\nobjects:\r\n  ball:\r\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\r\n"
            "    mass: heavy\r\n"
        ),
        [(6, 11, "objects.ball.mass", "")],
    ),
    "Mac line ends": (
        (
            "physgen: 1\rsize: [512, 512]\robjects:\r  ball:\r    shape: "
            "{circle: {center: [50, 50], radius: 9}}\r    mass: heavy\r"
        ),
        [(6, 11, "objects.ball.mass", "")],
    ),
    "unit spelt out": (
        BALL + "    mass: 170 grams\n",
        [(6, 11, "objects.ball.mass", "170 g")],
    ),
    "unit in the plural": (
        BALL + "    mass: 170 kgs\n",
        [(6, 11, "objects.ball.mass", "170 kg")],
    ),
    "wrong unit": (BALL + "    mass: 170 px\n", [(6, 11, "objects.ball.mass", "")]),
    "decimal comma": (BALL + "    mass: 1,5\n", [(6, 11, "objects.ball.mass", "1.5")]),
    "decimal comma and unit": (
        BALL + "    mass: 1,5 grams\n",
        [(6, 11, "objects.ball.mass", "1.5 g")],
    ),
    "number in quotes": (
        BALL + '    mass: "170"\n',
        [(6, 11, "objects.ball.mass", "170")],
    ),
    "list without brackets": (
        BALL + "    velocity: 100, 0\n",
        [(6, 15, "objects.ball.velocity", "[100, 0]")],
    ),
    "list in parentheses": (
        BALL + "    velocity: (100, 0)\n",
        [(6, 15, "objects.ball.velocity", "[100, 0]")],
    ),
    "list without comma": (
        BALL + "    velocity: [100 0]\n",
        [(6, 15, "objects.ball.velocity", "[100, 0]")],
    ),
    "mapping for a list": (
        BALL + "    velocity: {x: 100, y: 0}\n",
        [(6, 15, "objects.ball.velocity", "")],
    ),
    "one number in a list": (
        BALL + "    velocity: [100]\n",
        [(6, 15, "objects.ball.velocity", "")],
    ),
    "empty vector": (BALL + "    velocity: \n", [(6, 14, "objects.ball.velocity", "")]),
    "bracket not closed": (
        BALL + "    velocity: [100, 0\n    mass: 3\n",
        [(6, 15, "", "")],
    ),
    "bracket not opened": (
        BALL + "    velocity: 100, 0]\n",
        [(6, 15, "objects.ball.velocity", "[100, 0]")],
    ),
    "shape twice": (
        BALL + "    shape: {circle: {center: [50, 50], radius: 9}}\n",
        [(6, 5, "objects.ball.shape", "")],
    ),
    "object twice": (BALL + "  ball:\n    mass: 3\n", [(6, 3, "objects.ball", "")]),
    "gravity at the top": (
        HEAD
        + (
            "gravity: [0, 980]\nobjects:\n  ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(3, 1, "gravity", "world")],
    ),
    "fps and duration at the top": (
        HEAD
        + (
            "fps: 30\nduration: 2\nobjects:\n  ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(3, 1, "fps", "render"), (4, 1, "duration", "world")],
    ),
    "keys of others in world": (
        HEAD
        + (
            "world: {fps: 30, mass: 3}\nobjects:\n  ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(3, 9, "world.fps", "render"), (3, 18, "world.mass", "objects.NAME")],
    ),
    "keys of world in render": (
        HEAD
        + (
            "render: {duration: 3, gravity: 2}\nobjects:\n  ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(3, 10, "render.duration", "world"), (3, 23, "render.gravity", "world")],
    ),
    "radius beside shape": (
        BALL + "    radius: 5\n    center: [1, 1]\n",
        [
            (6, 5, "objects.ball.radius", "objects.NAME.shape.circle"),
            (7, 5, "objects.ball.center", "objects.NAME.shape.circle"),
        ],
    ),
    "circle beside shape": (
        HEAD + "objects:\n  ball: {circle: {center: [50, 50], radius: 9}, mass: 3}\n",
        [(4, 10, "objects.ball.circle", "objects.NAME.shape")],
    ),
    "circle without numbers": (
        HEAD + "objects:\n  ball: {shape: circle, mass: 3}\n",
        [(4, 17, "objects.ball.shape", "")],
    ),
    "list for a circle": (
        HEAD + "objects:\n  ball: {shape: {circle: [50, 50, 9]}}\n",
        [(4, 26, "objects.ball.shape.circle", "")],
    ),
    "circle without center": (
        HEAD + "objects:\n  ball: {shape: {circle: {radius: 9}}}\n",
        [(4, 26, "objects.ball.shape.circle.center", "")],
    ),
    "objects as a list": (
        HEAD
        + (
            "objects:\n  - name: ball\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(4, 3, "objects", "")],
    ),
    "space in a name": (
        HEAD
        + "objects:\n  my ball: {shape: {circle: {center: [50, 50], radius: 9}}}\n",
        [(4, 3, 'objects."my ball"', "")],
    ),
    "name with a digit first": (
        HEAD
        + (
            "objects:\n"
            "  Ball_1: {shape: {circle: {center: [50, 50], radius: 9}}}\n"
            "  1ball: {shape: {circle: {center: [50, 50], radius: 9}}}\n"
        ),
        [(5, 3, "objects.1ball", "")],
    ),
    "one force without list": (
        BALL + "forces: {object: ball, impulse: [1, 0]}\n",
        [(6, 9, "forces", "")],
    ),
    "one force without dash": (
        BALL + "forces:\n  object: ball\n  impulse: [1, 0]\n",
        [(7, 3, "forces", "")],
    ),
    "capital in a reference": (
        BALL + "forces:\n  - object: Ball\n    impulse: [1, 0]\n",
        [(7, 13, "forces[0].object", "ball")],
    ),
    "objects of a force": (
        BALL + "forces:\n  - objects: [ball]\n    impulse: [1, 0]\n",
        [(7, 5, "forces[0].objects", "object")],
    ),
    "unknown joint": (
        BALL + "joints:\n  s: {objects: [ball], hoist: [1, 2]}\n",
        [(7, 24, "joints.s.hoist", "pivot")],
    ),
    "one name without list": (
        BALL + "joints:\n  s: {objects: ball, pivot: [1, 2]}\n",
        [(7, 16, "joints.s.objects", "[ball]")],
    ),
    "bodies of a joint": (
        BALL + "joints:\n  s: {bodies: [ball], pivot: [1, 2]}\n",
        [(7, 6, "joints.s.objects", ""), (7, 7, "joints.s.bodies", "objects")],
    ),
    "world as an object": (
        BALL + "joints:\n  s: {objects: [ball, world], pivot: [1, 2]}\n",
        [(7, 23, "joints.s.objects[1]", "")],
    ),
    "unknown keys of an object": (
        BALL + "    colour: red\n    name: x\n",
        [(6, 5, "objects.ball.colour", ""), (7, 5, "objects.ball.name", "label")],
    ),
    "motion fixed": (
        BALL + "    motion: fixed\n",
        [(6, 13, "objects.ball.motion", "")],
    ),
    "capital in a word": (
        BALL + "    motion: Static\n",
        [(6, 13, "objects.ball.motion", "static")],
    ),
    "static as a key": (
        BALL + "    static: true\n",
        [(6, 5, "objects.ball.static", "motion: static")],
    ),
    "list for a boundary": (
        BALL + "boundaries:\n  floor: [[0, 457], [512, 457]]\n",
        [(7, 10, "boundaries.floor", "")],
    ),
    "flat list for a segment": (
        BALL + "boundaries:\n  floor: {segment: [0, 457, 512, 457]}\n",
        [(7, 20, "boundaries.floor.segment", "")],
    ),
    "boundary without line": (
        BALL + "boundaries:\n  floor: {y: 457}\n",
        [(7, 10, "boundaries.floor", ""), (7, 11, "boundaries.floor.y", "")],
    ),
    "nested variant": (
        BALL + "variants:\n  heavy:\n    objects:\n      ball:\n        mass: 3\n",
        [(10, 9, "objects.ball", "")],
    ),
    "variant without objects": (
        BALL + "variants:\n  heavy: {ball.mass: 3}\n",
        [(7, 11, "ball.mass", "objects.ball.mass")],
    ),
    "variants as a list": (
        BALL + "variants:\n  - heavy: {objects.ball.mass: 3}\n",
        [(7, 3, "variants", "")],
    ),
    "duration in words": (
        BALL + "world:\n  duration: 2 seconds\n",
        [(7, 13, "world.duration", "2 s")],
    ),
    "unknown view": (BALL + "world:\n  view: left\n", [(7, 9, "world.view", "")]),
    "gravity off": (BALL + "world:\n  gravity: off\n", [(7, 12, "world.gravity", "")]),
    "direction up": (
        BALL + "light: {direction: up}\n",
        [(6, 20, "light.direction", "")],
    ),
    "camera follows nobody": (
        BALL + "render: {camera: {follow: bal}}\n",
        [(6, 27, "render.camera.follow", "ball")],
    ),
    "overlay without list": (
        BALL + "render: {overlay: velocity}\n",
        [(6, 19, "render.overlay", "[velocity]")],
    ),
    "no for false": (
        BALL + "render: {shadows: no}\n",
        [(6, 19, "render.shadows", "false")],
    ),
    "size with x": (
        (
            "physgen: 1\nsize: 512x512\nobjects:\n  ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(2, 7, "size", "[512, 512]")],
    ),
    "size with a fraction": (
        (
            "physgen: 1\nsize: [512.5, 512]\nobjects:\n  ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(2, 8, "size[0]", "")],
    ),
    "version in quotes": (
        (
            'physgen: "1"\nsize: [512, 512]\nobjects:\n  ball:\n'
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(1, 10, "physgen", "1")],
    ),
    "no version": (
        (
            "size: [512, 512]\nobjects:\n  ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(1, 1, "physgen", "1")],
    ),
    "capital keys": (
        (
            "Physgen: 1\nSize: [512, 512]\nobjects:\n  ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(1, 1, "Physgen", "physgen"), (2, 1, "Size", "size")],
    ),
    "equals sign": (
        (
            "physgen = 1\nsize: [512, 512]\nobjects:\n  ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(1, 1, "", "")],
    ),
    "comment without space": (
        BALL
        + (
            "    # mass\n  # comment at odd place\n    mass: 3 #comment\n"
            "    friction: 0.3# comment\n"
        ),
        [(9, 15, "objects.ball.friction", "0.3")],
    ),
    "value in a comment": (
        BALL + "    label: ball #1\n    mass: #170\n",
        [(7, 10, "objects.ball.mass", "")],
    ),
    "label in a comment": (
        BALL + "    label: #1 ball\n",
        [(6, 11, "objects.ball.label", "")],
    ),
    "colon in a label": (BALL + "    label: it's: a ball\n", [(6, 16, "", "")]),
    "apostrophe in quotes": (BALL + "    label: 'it's a ball'\n", [(6, 15, "", "")]),
    "quotes in quotes": (BALL + '    label: "say "hi" now"\n', [(6, 17, "", "")]),
    "semicolon": (
        BALL + "    mass: 170;\n    friction: 0.3\n",
        [(6, 11, "objects.ball.mass", "170")],
    ),
    "commas at line ends": (
        BALL + "    mass: 3,\n    friction: 0.3,\n",
        [(6, 11, "objects.ball.mass", "3"), (7, 15, "objects.ball.friction", "0.3")],
    ),
    "JSON with a word": (
        (
            '{"physgen": 1, "size": [512, 512], "objects": {"ball": {"sha'
            'pe": {"circle": {"center": [50, 50], "radius": 9}}, "mass": '
            "heavy,}}}"
        ),
        [(1, 121, "objects.ball.mass", "")],
    ),
    "JSON without comma": (
        '{"physgen": 1, "size": [512, 512] "objects": {}}',
        [(1, 35, "", "")],
    ),
    "slashes for a comment": (
        (
            "// a comment\nphysgen: 1\nsize: [512, 512]\nobjects:\n"
            "  ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(1, 1, "", "")],
    ),
    "percent": (
        BALL + "    friction: 30%\n",
        [(6, 15, "objects.ball.friction", "0.3")],
    ),
    "out of range": (
        BALL + "    friction: -0.3\n    elasticity: 12\n",
        [(6, 15, "objects.ball.friction", ""), (7, 17, "objects.ball.elasticity", "")],
    ),
    "revolutions": (
        BALL + "    spin: 2 rev/s\n",
        [(6, 11, "objects.ball.spin", "2 turn/s")],
    ),
    "degrees without second": (
        BALL + "    spin: 90°\n",
        [(6, 11, "objects.ball.spin", "90 °/s")],
    ),
    "file for a mask": (
        BALL + "    mask: ball.png\n",
        [(6, 11, "objects.ball.mask", "")],
    ),
    "photo and size": (
        HEAD
        + (
            "image: photo.png\nobjects:\n  ball:\n"
            "    shape: {circle: {center: [50, 50], radius: 9}}\n"
        ),
        [(2, 1, "size", ""), (3, 8, "image", "")],
    ),
    "length for a speed": (
        BALL + "    velocity: [1 m/s, 0 m]\n",
        [(6, 23, "objects.ball.velocity[1]", "0 m/s")],
    ),
    "four numbers for a place": (
        BALL + "    place: [1, 2, 3, 4]\n",
        [(6, 12, "objects.ball.place", "")],
    ),
    "key twice in capitals": (
        BALL + "    mass: 3\n    Mass: 4\n",
        [(7, 5, "objects.ball.Mass", "mass")],
    ),
    "section twice": (
        BALL + "objects:\n  box:\n    shape: {box: {center: [1, 1], size: [3, 3]}}\n",
        [(6, 1, "objects", "")],
    ),
    "two documents": (BALL + "    mass: 3\n---\nphysgen: 1\n", [(7, 1, "", "")]),
    "anchor": (BALL + "    mass: &m 3\n    friction: *m\n", [(6, 11, "", "")]),
    "tag": (BALL + "    mass: !!float 3\n", [(6, 11, "", "")]),
    "infinity": (BALL + "    mass: .inf\n", [(6, 11, "objects.ball.mass", "")]),
    "underscore in a number": (
        BALL + "    mass: 1_000\n",
        [(6, 11, "objects.ball.mass", "1000")],
    ),
    "Arabic digit": (BALL + "    mass: ٣\n", [(6, 11, "objects.ball.mass", "3")]),
    "wide digit": (BALL + "    mass: ３\n", [(6, 11, "objects.ball.mass", "3")]),
    "true minus": (
        BALL + "    velocity: [−100, 0]\n",
        [(6, 16, "objects.ball.velocity[0]", "-100")],
    ),
    "no-break space": (
        BALL + "  \xa0 mass: 3\n",
        [(6, 3, 'objects."\\u00a0 mass"', ""), (6, 11, 'objects."\\u00a0 mass"', "")],
    ),
    "wide colon": (BALL + "    mass： 3\n", [(6, 5, "", "")]),
    "wide comma": (
        BALL + "    velocity: [100， 0]\n",
        [(6, 15, "objects.ball.velocity", "[100, 0]")],
    ),
    "dash before a key": (BALL + "    - mass: 3\n", [(6, 5, "", "4")]),
    "key between two depths": (BALL + "   mass: 3\n", [(6, 4, "", "4")]),
    "wind without drag": (
        BALL + "fields:\n  breeze: {wind: 300 px/s}\n",
        [(7, 11, "fields.breeze.drag", "")],
    ),
    "unknown field": (
        BALL + "fields:\n  breeze: {vortex: [3, 3]}\n",
        [(7, 12, "fields.breeze.vortex", "wind")],
    ),
    "object of a field": (
        BALL + "fields:\n  breeze: {wind: [3, 3], drag: 1, object: ball}\n",
        [(7, 35, "fields.breeze.object", "objects")],
    ),
    "push for impulse": (
        BALL + "forces:\n- {object: ball, push: [3, 3]}\n",
        [(7, 18, "forces[0].push", "impulse")],
    ),
    "word for a point": (
        BALL + "forces:\n- {object: ball, impulse: [3, 3], at: center}\n",
        [(7, 39, "forces[0].at", "")],
    ),
    "list for a torque": (
        BALL
        + "forces:\n- {object: ball, impulse: 3}\n- {object: ball, torque: [3, 3]}\n",
        [(8, 26, "forces[1].torque", "")],
    ),
    "force for forces": (
        BALL + "force:\n- {object: ball, impulse: [3, 3]}\n",
        [(6, 1, "force", "forces")],
    ),
    "object for objects": (
        HEAD + "object:\n  ball:\n    shape: {circle: {center: [50, 50], radius: 9}}\n",
        [(3, 1, "object", "objects")],
    ),
    "world in an object": (
        BALL + "    world: {gravity: [0, 1]}\n",
        [(6, 5, "objects.ball.world", "")],
    ),
    "word for friction": (
        BALL + "    friction: low\n",
        [(6, 15, "objects.ball.friction", "")],
    ),
    "width and height": (
        HEAD
        + (
            "objects:\n  ball:\n    shape:\n"
            "      box: {center: [1, 1], width: 3, height: 3}\n"
        ),
        [
            (6, 12, "objects.ball.shape.box.size", ""),
            (6, 29, "objects.ball.shape.box.width", "size"),
            (6, 39, "objects.ball.shape.box.height", "size"),
        ],
    ),
    "rectangle": (
        HEAD
        + (
            "objects:\n  ball:\n    shape:\n"
            "      rectangle: {center: [1, 1], size: [3, 3]}\n"
        ),
        [(6, 7, "objects.ball.shape.rectangle", "box")],
    ),
    "flat list for a polygon": (
        HEAD + "objects:\n  ball:\n    shape: {polygon: [1, 1, 2, 2, 3, 5]}\n",
        [(5, 23, "objects.ball.shape.polygon[0]", "")],
    ),
    "three numbers for a corner": (
        HEAD + "objects:\n  ball:\n    shape: {polygon: [[1, 1], [2, 2, 2], [3, 5]]}\n",
        [(5, 31, "objects.ball.shape.polygon[1]", "")],
    ),
    "word for objects": (HEAD + "objects: ball\n", [(3, 10, "objects", "")]),
    "misspelt backend": (
        BALL + "refine: {backend: animatedif}\n",
        [(6, 19, "refine.backend", "")],
    ),
    "frames per second spelt": (
        BALL + "render:\n  fps: 30 fps\n",
        [(7, 8, "render.fps", "30 Hz")],
    ),
    "unknown word": (BALL + "yes: 1\n", [(6, 1, "yes", "")]),
    "no colon": (BALL + "    mass 3\n    friction: 1\n", [(6, 5, "", "")]),
    "equals sign in an object": (BALL + "    mass = 3\n", [(6, 5, "", "")]),
    "two colons": (BALL + "    mass:: 3\n", [(6, 5, 'objects.ball."mass:"', "mass")]),
    "quote not closed": (BALL + "    'mass: 3\n    friction: 1\n", [(6, 5, "", "")]),
}
"""Name -> the text, and of each problem: line, column, path, and a word that the fix contains."""
ACCEPTED = {
    "byte order mark": "\ufeff" + BALL,
    "tab behind a colon": BALL + "    mass:\t3\n",
    "no space before a unit": BALL + "    mass: 170g\n    velocity: [1.2m/s, 0]\n",
    "no-break space before a unit": BALL + "    mass: 3\u00a0g\n",
    "comments at odd places": BALL + "# a\n  # b\n      # c\n    mass: 3 # d\n",
    "version as a float": BALL.replace("physgen: 1", "physgen: 1.0"),
    "Windows line ends": BALL.replace("\n", "\r\n"),
    "one number for a vector": BALL + "    velocity: 100\n",
}


def problems_of(text: str) -> list[Problem]:
    """Return the problems of a file with this text, and of its variants."""
    path = Path("scene.yaml")
    path.write_bytes(text.encode())
    try:
        opened = OpenedScene(path)
        problems = list(opened.variant_problems)
        opened.scene()
    except InputError as error:
        return error.problems
    return by_place(problems)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run in a folder of its own."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", MISTAKES)
def test_mistake_is_answered_at_its_place(name: str) -> None:
    text, expected = MISTAKES[name]
    problems = problems_of(text)
    places = [(p.place.line, p.place.column, p.path) for p in problems]
    assert places == [(line, column, path) for line, column, path, _ in expected]
    for problem, (_, _, _, word) in zip(problems, expected, strict=True):
        assert word in problem.fix


def test_decimal_comma_and_tab_are_named() -> None:
    comma, tab = BALL + "    friction: 0,5\n", BALL + "\tmass: 1\n"
    (problem,) = problems_of(comma)
    assert (problem.code, problem.fix) == ("decimal-comma", "write a point: 0.5")
    (problem,) = problems_of(tab)
    assert "a tab indents this line" in problem.expected


@pytest.mark.parametrize("name", ACCEPTED)
def test_harmless_oddity_is_accepted(name: str) -> None:
    assert problems_of(ACCEPTED[name]) == []


@pytest.mark.parametrize("name", ["key three deep", "nested variant", "out of range"])
def test_check_of_mistake_exits_with_two(name: str) -> None:
    Path("scene.yaml").write_text(MISTAKES[name][0])
    assert main(["check", "scene.yaml"]) == 2


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        ("velocity: 100", (100, 0)),
        ("velocity: 1 m/s", (100, 0)),
        ("velocity: -100", (-100, 0)),
        ("velocity: [100, 0]", (100, 0)),
    ],
)
def test_one_number_is_a_vector(text: str, ends: tuple[float, float]) -> None:
    Path("scene.yaml").write_text(f"{BALL}    {text}\n")
    assert OpenedScene("scene.yaml").scene().objects[0].velocity == ends


@pytest.mark.parametrize("gravity", ["980", "9.8 m/s²", "[0, 980]"])
def test_one_number_of_gravity_points_down(gravity: str) -> None:
    Path("scene.yaml").write_text(f"{BALL}world: {{gravity: {gravity}}}\n")
    x, y = OpenedScene("scene.yaml").scene().world.gravity
    assert (x, y) == pytest.approx((0, 980))
