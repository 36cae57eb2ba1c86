"""Estimate the parameters of a scene from tracks, with intervals."""

from __future__ import annotations

from collections.abc import Sequence

from physgen.compile.compile import CompiledScene
from physgen.fit.intervals import Fit, fit_with_intervals
from physgen.fit.parameters import Kind, Starts, free_parameters
from physgen.fit.residuals import Model
from physgen.fit.search import find_numbers
from physgen.fit.starts import estimate_starts
from physgen.fit.tracks import Tracks
from physgen.messages import Message
from physgen.problems import InputError
from physgen.progress import Progress, silent
from physgen.scene.scene import Scene


def fit_scene(
    scene: Scene,
    compiled_scene: CompiledScene,
    tracks: Tracks,
    kinds: Sequence[Kind],
    seed: int = 0,
    progress: Progress = silent,
) -> Fit:
    """Fit parameters of these kinds, so that the scene moves like its tracks.

    Raises InputError.
    """
    starts = estimate_starts(compiled_scene, tracks, kinds)
    parameters = free_parameters(scene, tracks, kinds, starts)
    if not parameters:
        raise _nothing_free(scene, tracks, kinds, starts)
    model = Model(scene, compiled_scene, tracks, starts, parameters)
    numbers = find_numbers(model, seed, progress)
    return fit_with_intervals(model, numbers)


def absent_kinds(
    scene: Scene, compiled_scene: CompiledScene, tracks: Tracks, kinds: Sequence[Kind]
) -> tuple[Kind, ...]:
    """Return the kinds without a parameter in this scene and clip."""
    starts = estimate_starts(compiled_scene, tracks, kinds)
    # All kinds are requested together, since gravity replaces its direction.
    parameters = free_parameters(scene, tracks, kinds, starts)
    free_kinds = {parameter.kind for parameter in parameters}
    return tuple(kind for kind in kinds if kind not in free_kinds)


def _nothing_free(
    scene: Scene, tracks: Tracks, kinds: Sequence[Kind], starts: Starts
) -> InputError:
    """Return the refusal of kinds without a parameter, with the possible kinds."""
    choices = []
    for kind in Kind:
        if free_parameters(scene, tracks, [kind], starts):
            choices.append(kind.value)
    fix = "give a scene and a clip with dynamic objects"
    if choices:
        fix = f"choose from {', '.join(choices)}"
    names = ",".join(kind.value for kind in kinds)
    return Message.FIT_NOTHING_FREE.error("free", names, fix=fix)
