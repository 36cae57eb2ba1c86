"""The stages from a photo to a scene file, and from a scene file to an output folder."""

from __future__ import annotations

from physgen.pipeline.clip import Page, RenderOptions, output_name, render_scene
from physgen.pipeline.perceiving import import_physgen, perceive
from physgen.pipeline.refining import Refiners
from physgen.pipeline.rendered_clip import Clip, render_clip
from physgen.pipeline.stages import (
    Stages,
    compile,
    fan,
    filled,
    lint,
    load,
    percepts,
    render,
    shot,
    simulate,
    stage,
)
from physgen.problems import Warn, ignore_warning
from physgen.progress import Progress, silent

__all__ = [
    "Clip", "Page", "Progress", "Refiners", "RenderOptions", "Stages", "Warn", "compile", "fan", "filled",
    "ignore_warning", "import_physgen", "lint", "load", "output_name", "perceive", "percepts", "render", "render_clip",
    "render_scene", "shot", "silent", "simulate", "stage",
]  # fmt: skip
