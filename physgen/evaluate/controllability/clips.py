"""A folder of clips, as `sweep` makes them -> pushes of one object and what they did, from manifests and motions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path as File
from typing import Any

import numpy as np

from physgen.batch.clips import checked_folders, find_clips
from physgen.evaluate.controllability.outcomes import Path, Push, outcome, path_of
from physgen.evaluate.controllability.sweep import Swept
from physgen.problems import InputError
from physgen.registry import suggestion
from physgen.scene.scene import View
from physgen.simulate.trajectory import read_trajectory

NONE = 1e-9
"""px/s: what is no push."""


def swept_clips(folder: File, name: str | None) -> Swept:
    """Raises InputError where there are fewer than two clips, or none that pushes the object.

    The push is the object's velocity at t = 0, its impulses and its forces of a duration, over its mass, together.
    """
    documents = [
        (found.folder, found.told["document"])
        for found in find_clips(checked_folders([folder]))
        if found.told is not None
    ]
    documents = [(place, told) for place, told in documents if told.get("objects")]
    if len(documents) < 2:
        found = f"holds {len(documents)} clips" if documents else "holds no clips"
        fix = "name a scene, or a folder that physgen sweep made"
        raise InputError.of(str(folder), "", found, fix)
    if name is None:
        shared = set.intersection(*(set(told["objects"]) for _, told in documents))
        if not shared:
            found = f"{documents[0][0].name} and others"
            fix = "name a folder with clips of one scene, as physgen sweep makes them"
            raise InputError.of(str(folder), found, "have no object in common", fix)
        if any(set(told["objects"]) != shared for _, told in documents):
            fix = f"name a folder with clips of one scene, or an object of all with --object {min(shared)}"
            raise InputError.of(str(folder), "", "holds clips with other objects: of several scenes", fix)
        name = next(_differing(documents), next(iter(documents[0][1]["objects"])))
    paths: list[tuple[Push, Path]] = []
    for place, told in documents:
        if name not in told["objects"]:
            fix = suggestion(name, told["objects"])
            raise InputError.of("--object", f'"{name}"', f"is no object of {place}", fix)
        try:
            trajectory = read_trajectory(place / "trajectory.npz")
            paths.append((_push(told, name, place), path_of(trajectory, name)))
        except (OSError, ValueError, KeyError) as error:
            fix = "make the clip again: physgen render or sweep"
            raise InputError.of(str(place / "trajectory.npz"), "", f"cannot be read ({error})", fix) from None
    still = next((path for push, path in paths if push.size < NONE), None)
    times = paths[0][1].times
    for (place, _), (_, path) in zip(documents, paths, strict=True):
        if len(path.times) != len(times) or not np.allclose(path.times, times):
            expected = f"has other sample times than {documents[0][0].name}"
            fix = "compare clips of one duration and one number of frames"
            raise InputError.of(str(place), "", expected, fix)
    pushed = [(push, path) for push, path in paths if push.size >= NONE]
    if len(pushed) < 2:
        fix = "sweep its velocity or an impulse, e.g. objects.NAME.velocity='[100, 0],[200, 0]'"
        raise InputError.of(str(folder), "", f"pushes {name} in {len(pushed)} of its clips", fix)
    first = documents[0][1]
    outcomes = tuple(outcome(push, path, still) for push, path in pushed)
    world = first.get("world") or {}
    view = View(world["view"]) if world.get("view") in ("side", "top") else None
    return Swept(folder.resolve().name, name, view, outcomes, still, None)


def _differing(documents: list[tuple[File, Mapping[str, Any]]]) -> Iterator[str]:
    """Objects that are not pushed alike in all clips."""
    for name in documents[0][1]["objects"]:
        told = {repr(_loads(document, name)) for _, document in documents if name in document["objects"]}
        if len(told) > 1:
            yield name


def _loads(document: Mapping[str, Any], name: str) -> Any:
    forces = [one for one in document.get("forces") or () if one.get("object") == name]
    return document["objects"][name].get("velocity"), forces


def _push(document: Mapping[str, Any], name: str, place: File) -> Push:
    velocity, forces = _loads(document, name)
    total = np.array(velocity if velocity is not None else (0.0, 0.0), np.float64)
    given = np.zeros(2)
    for one in forces:
        if "impulse" in one:
            given += np.array(one["impulse"], np.float64)
        elif "force" in one and one.get("duration") is not None:
            given += float(one["duration"]) * np.array(one["force"], np.float64)
    if given.any():
        mass = document["objects"][name].get("mass")
        if not mass:
            fix = f"give it a mass: --set objects.{name}.mass=100"
            raise InputError.of(str(place), f"objects.{name}", "has a density, and is pushed by forces", fix)
        total += given / mass
    return Push(float(total[0]), float(total[1]))
