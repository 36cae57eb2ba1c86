"""A scene perceived again: what its file says stays, what prompts mean is found anew."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from physgen import backends
from physgen.compile.assemble import compile_scene
from physgen.crew import Crew
from physgen.perceive.again import again, doubts, merged
from physgen.perceive.asking import segmenter
from physgen.perceive.derived import derived, set_layers
from physgen.perceive.found import Found
from physgen.perceive.given import weak
from physgen.perceive.lay_out import lay_out
from physgen.perceive.relaid import laid, made_for, relaid
from physgen.perceive.renaming import renamed_things
from physgen.perceive.roles import Name
from physgen.perceive.scale import DEFAULT
from physgen.perceive.scene import Progress, outlined, perceive, silent
from physgen.perceive.words import DOUBTFUL
from physgen.percepts.maps import Keep, read_percepts
from physgen.percepts.photo import read_photo
from physgen.problems import InputError, Place, Problem, Severity
from physgen.report.perceived import check_sheet, write_sheet
from physgen.scene.build import load, written
from physgen.scene.model import View


def refresh(
    path: Path,
    output: Path,
    *,
    boxes: Sequence[tuple[float, float, float, float]] = (),
    points: Sequence[tuple[float, float]] = (),
    labels: Sequence[str] = (),
    sheet: Path | None = None,
    allow_outside: bool = False,
    assets: Path | None = None,
    crew: Crew | None = None,
    asked: Sequence[str] = (),
    progress: Progress = silent,
    warn: Callable[[Problem], None] = lambda problem: None,
    keep: Keep = lambda kept: None,
) -> str:
    """A scene's photo perceived again -> the new scene's text; writes as `perceive` does. Raises InputError.

    What the file says stays, its comments do not. Objects with a `prompt` are found again; new `boxes` and `points`
    take the place of what they cover, and `warn` is told of objects that they swallow. Numbers that nobody has set
    follow the labels, those in the file and the new `labels`, which are `NAME=TEXT`.
    """
    crew = crew or Crew()
    crew.begin(warn)
    scene = load(path, allow_outside=allow_outside)
    if scene.image is None:
        raise InputError.of("--refresh", f'"{path}"', "shows no photo", "name one with image:")
    check_sheet(sheet, scene.image)
    maps = read_percepts(scene.image, scene.assets, scene.maps)
    kept = compile_scene(scene, None if maps is None else maps.labels).labels
    kept_names = {item.name for item in scene.objects}
    photo = read_photo(scene.image)
    told = again(photo.rgb, scene.objects, kept, boxes, points, segmenter(crew, asked))
    crew.release("segment")
    for problem in weak(told.found):
        warn(problem)
    for name in told.gone:
        expected = "is part of what was pointed at and has gone"
        fix = "leave the box or point out if it should stay"
        warn(Problem(Place(str(path)), f"objects.{name}", "", expected, fix, Severity.WARNING))
    old = written(path, allow_outside)
    things = outlined(photo.rgb, told.found)[0]
    called = {i: name for i, name in told.found.called.items() if name in old["objects"]}
    named, renamed = renamed_things(things, labels, called)
    # only what the table gives can be told from what a person wrote
    physics, guessed = backends.make("physics"), backends.make("label")(photo.rgb, told.found.labels, things)
    known = {called[thing.id]: thing for thing in things if thing.id in called}
    table = backends.find("physics").name
    ours = derived(old, photo.rgb, known, guessed, physics, table)
    new_labels = {called[thing.id]: thing.label for thing in named if thing.id in renamed}
    names = {**told.found.names, **{t.id: Name(t.label, 1.0) for t in named if t.id in renamed}}
    layered = set_layers(old, kept, {item.name: k for k, item in enumerate(scene.objects, 1)})
    layer_of = {i: layered[name] for i, name in called.items() if name in layered}
    per_meter = scene.world.pixels_per_meter
    perceived = perceive(
        photo.rgb,
        replace(told.found, names=names, layers=layer_of),
        crew=crew,
        view=scene.world.view,
        pixels_per_meter=None if ours.scale or per_meter == DEFAULT else per_meter,
        progress=progress,
    )
    document = merged(old, perceived.document, told, ours, new_labels, layered)
    fresh = {name for name in document["objects"] if name not in kept_names} | told.corrected
    walls = old.get("boundaries", {})
    boundary = backends.make("boundary")
    before = outlined(photo.rgb, Found(kept, "kept", {}, {}))[0]
    settings = [boundary(photo.rgb, kept, before, view) for view in View]
    made = made_for(walls, settings)
    turned = made is not None and made.view is not scene.world.view
    if made is not None and (turned or fresh or told.gone):
        document["boundaries"] = relaid(walls, laid(walls, made), perceived.document["boundaries"])
    if turned and (table_of := perceived.document["world"].get("table")):
        document["world"] = {"table": table_of, **document["world"]}
    elif turned and document["world"].get("table") == {"friction": 0}:
        document["world"] = {key: value for key, value in document["world"].items() if key != "table"}
    if maps is not None:
        # the scene's own light lifted shadows, or did not
        clean = None if maps.clean is None else perceived.percepts.clean
        depth = maps.depth if perceived.percepts.depth is None else perceived.percepts.depth
        perceived = replace(perceived, percepts=replace(perceived.percepts, clean=clean, depth=depth))
    table_said = {f"objects.{name}.{key}" for name, keys in ours.keys.items() for key in keys}
    layers_said = {f"objects.{name}.layer" for name in document["objects"] if name not in layered}
    comments = {
        key: text for key, text in perceived.comments.items()
        if (key.split(".")[1] in fresh or key in table_said | layers_said
            if key.startswith("objects.") else _at(document, key) == _at(perceived.document, key))
    }  # fmt: skip
    weighed = {name: item.get("mass") for name, item in perceived.document["objects"].items()}
    if any(item.get("mass") != weighed.get(name) for name, item in document["objects"].items()):
        comments.pop("forces", None)  # the push was reckoned with other masses
    if ours.scale:
        comments["world.pixels_per_meter"] = perceived.comments["world.pixels_per_meter"]
    elif per_meter == DEFAULT and perceived.document["world"]["pixels_per_meter"] != DEFAULT:
        better = perceived.document["world"]["pixels_per_meter"]
        comments["world.pixels_per_meter"] = (
            f"as it was, for what is set to move; the things here say {better:g}, which masses go by"
        )
    lines = doubts(path.read_text(encoding="utf-8-sig"), document["objects"])
    if lines and document["objects"]:
        comments[f"objects.{next(iter(document['objects']))}"] = "\n".join([DOUBTFUL, *lines])
    header = "Perceived again: objects with a prompt were looked for anew, all else is as it was"
    _, *fell = perceived.header.split("\n")  # who took over from whom
    header = "\n".join([header, *fell])
    perceived = replace(perceived, document=document, comments=comments, header=header)
    if sheet is not None:
        write_sheet(sheet, perceived, keep)
    image = scene.image if photo.plain else None
    return lay_out(perceived, image, scene.image.stem, output, assets, keep)


def _at(document: Mapping[str, Any], key: str) -> object:
    """What stands at a dotted key; None where nothing does."""
    value: Any = document
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value
