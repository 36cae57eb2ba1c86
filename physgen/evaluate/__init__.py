"""Measure the distance of the simulation from known facts: the scorecards."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.evaluate import backend_check as backend_check
    from physgen.evaluate import backends as backends
    from physgen.evaluate import clip_frames as clip_frames
    from physgen.evaluate import controllability as controllability
    from physgen.evaluate import fid as fid
    from physgen.evaluate import fidelity as fidelity
    from physgen.evaluate import measure as measure
    from physgen.evaluate import physics as physics
    from physgen.evaluate import plausibility as plausibility
    from physgen.evaluate import properties as properties
    from physgen.evaluate import ratings as ratings
    from physgen.evaluate import runtime as runtime
    from physgen.evaluate import segmentation as segmentation
    from physgen.evaluate import study as study

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    [
        "backend_check",
        "backends",
        "clip_frames",
        "controllability",
        "fid",
        "fidelity",
        "measure",
        "physics",
        "plausibility",
        "properties",
        "ratings",
        "runtime",
        "segmentation",
        "study",
    ],
)
