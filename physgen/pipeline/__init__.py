"""The stages from a photo to a scene file, and from a scene file to an output folder."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

from physgen.problems import Warn, ignore_warning
from physgen.progress import Progress, silent

if TYPE_CHECKING:
    from physgen.pipeline import clip_warnings as clip_warnings
    from physgen.pipeline import pushes as pushes
    from physgen.pipeline import refreshing as refreshing
    from physgen.pipeline import stages as stages
    from physgen.pipeline import story_server as story_server
    from physgen.pipeline.clip import render_scene
    from physgen.pipeline.perceiving import import_physgen, perceive
    from physgen.pipeline.refining import Refiners
    from physgen.pipeline.render_options import Page, RenderOptions, output_name
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

__all__ = [
    "Clip", "Page", "Progress", "Refiners", "RenderOptions", "Stages", "Warn", "compile", "fan", "filled",
    "ignore_warning", "import_physgen", "lint", "load", "output_name", "perceive", "percepts", "render", "render_clip",
    "render_scene", "shot", "silent", "simulate", "stage",
]  # fmt: skip

# A command imports the modules of the stages that it runs, and no others.
__getattr__, *_ = lazy_loader.attach(
    __name__,
    ["clip_warnings", "pushes", "refreshing", "stages", "story_server"],
    {
        "clip": ["render_scene"],
        "render_options": ["Page", "RenderOptions", "output_name"],
        "perceiving": ["import_physgen", "perceive"],
        "refining": ["Refiners"],
        "rendered_clip": ["Clip", "render_clip"],
        "stages": [
            "Stages",
            "compile",
            "fan",
            "filled",
            "lint",
            "load",
            "percepts",
            "render",
            "shot",
            "simulate",
            "stage",
        ],
    },
)
