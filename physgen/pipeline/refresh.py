"""A scene perceived again: values of its file stay, prompted objects are found anew."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from physgen import registry
from physgen.compile.compile import compile_scene
from physgen.maps import Keep, read_percepts
from physgen.perceive.document import DOUBTFUL, relabel_objects, write_scene
from physgen.perceive.perceive import Progress, fit_objects, no_progress, perceive
from physgen.perceive.refresh import (
    doubtful_lines,
    find_table_values,
    layers_set_by_user,
    matching_guess,
    merge_documents,
    replace_walls,
    start_refresh,
    walls_of_guess,
)
from physgen.perceive.roles import Detections, Name
from physgen.perceive.scale import DEFAULT_SCALE
from physgen.perceive.segment.prompts import segmenter, weak_prompts
from physgen.photos import read_photo
from physgen.problems import InputError, Place, Problem, Severity
from physgen.registry import Backends
from physgen.report.perception import check_sheet, write_sheet
from physgen.scene.load import load, raw_document
from physgen.scene.scene import View


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
    crew: Backends | None = None,
    asked: Sequence[str] = (),
    progress: Progress = no_progress,
    warn: Callable[[Problem], None] = lambda problem: None,
    keep: Keep = lambda kept: None,
) -> str:
    """A scene's photo perceived again -> the new scene's text; writes as `perceive` does. Raises InputError.

    What the file says stays, its comments do not. Objects with a `prompt` are found again; new `boxes` and `points`
    take the place of what they cover, and `warn` is told of objects that they swallow. Numbers that nobody has set
    follow the labels, those in the file and the new `labels`, which are `NAME=TEXT`.
    """
    crew = crew or Backends()
    crew.begin(warn)
    scene = load(path, allow_outside=allow_outside)
    if scene.image is None:
        raise InputError.of("--refresh", f'"{path}"', "shows no photo", "name one with image:")
    check_sheet(sheet, scene.image)
    maps = read_percepts(scene.image, scene.assets, scene.maps)
    kept = compile_scene(scene, None if maps is None else maps.labels).labels
    kept_names = {item.name for item in scene.objects}
    photo = read_photo(scene.image)
    told = start_refresh(photo.rgb, scene.objects, kept, boxes, points, segmenter(crew, asked))
    crew.release("segment")
    for problem in weak_prompts(told.found):
        warn(problem)
    for name in told.gone:
        expected = "is part of what was pointed at and has gone"
        fix = "leave the box or point out if it should stay"
        warn(Problem(Place(str(path)), f"objects.{name}", "", expected, fix, Severity.WARNING))
    old = raw_document(path, allow_outside)
    things = fit_objects(photo.rgb, told.found)[0]
    called = {i: name for i, name in told.found.object_names.items() if name in old["objects"]}
    named, renamed = relabel_objects(things, labels, called)
    # only what the table gives can be told from what a person wrote
    physics, guessed = registry.make("physics"), registry.make("label")(photo.rgb, told.found.labels, things)
    known = {called[thing.id]: thing for thing in things if thing.id in called}
    table = registry.find("physics").name
    ours = find_table_values(old, photo.rgb, known, guessed, physics, table)
    new_labels = {called[thing.id]: thing.label for thing in named if thing.id in renamed}
    names = {**told.found.names, **{t.id: Name(t.label, 1.0) for t in named if t.id in renamed}}
    layered = layers_set_by_user(old, kept, {item.name: k for k, item in enumerate(scene.objects, 1)})
    layer_of = {i: layered[name] for i, name in called.items() if name in layered}
    per_meter = scene.world.pixels_per_meter
    perceived = perceive(
        photo.rgb,
        replace(told.found, names=names, layers=layer_of),
        crew=crew,
        view=scene.world.view,
        pixels_per_meter=None if ours.scale or per_meter == DEFAULT_SCALE else per_meter,
        progress=progress,
    )
    document = merge_documents(old, perceived.document, told, ours, new_labels, layered)
    fresh = {name for name in document["objects"] if name not in kept_names} | told.corrected
    walls = old.get("boundaries", {})
    boundary = registry.make("boundary")
    before = fit_objects(photo.rgb, Detections(kept, "kept", {}, {}))[0]
    settings = [boundary(photo.rgb, kept, before, view) for view in View]
    made = matching_guess(walls, settings)
    turned = made is not None and made.view is not scene.world.view
    if made is not None and (turned or fresh or told.gone):
        document["boundaries"] = replace_walls(
            walls, walls_of_guess(walls, made), perceived.document["boundaries"]
        )
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
    elif per_meter == DEFAULT_SCALE and perceived.document["world"]["pixels_per_meter"] != DEFAULT_SCALE:
        better = perceived.document["world"]["pixels_per_meter"]
        comments["world.pixels_per_meter"] = (
            f"as it was, for what is set to move; the things here say {better:g}, which masses go by"
        )
    lines = doubtful_lines(path.read_text(encoding="utf-8-sig"), document["objects"])
    if lines and document["objects"]:
        comments[f"objects.{next(iter(document['objects']))}"] = "\n".join([DOUBTFUL, *lines])
    header = "Perceived again: objects with a prompt were looked for anew, all else is as it was"
    _, *fell = perceived.header.split("\n")  # who took over from whom
    header = "\n".join([header, *fell])
    perceived = replace(perceived, document=document, comments=comments, header=header)
    if sheet is not None:
        write_sheet(sheet, perceived, keep)
    image = scene.image if photo.plain else None
    return write_scene(perceived, image, scene.image.stem, output, assets, keep)


def _at(document: Mapping[str, Any], key: str) -> object:
    """What stands at a dotted key; None where nothing does."""
    value: Any = document
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value
