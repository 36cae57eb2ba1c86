"""Ways to draw a truth video with parts of ours or of the paper's compositing taken away, for docs/benchmarks.md."""

from __future__ import annotations

from dataclasses import replace

from physgen.evaluate.fidelity import (
    Truth,
    Ways,
    paper,
    render_own_frames,
    true_light,
    ways,
)


def ablations(truth: Truth) -> Ways:
    """The measure's own ways, and those with parts taken away."""
    scene, maps = truth.scene, truth.maps
    shadowed, clean = maps.background, maps.clean
    assert shadowed is not None
    assert clean is not None
    dull, flat = (
        replace(scene.render, relight=False),
        replace(scene.render, shadows=False),
    )
    own = ways(truth)
    return {
        "ours": own["ours"],
        "ours, true maps": own["ours, true maps"],
        "ours, true maps, no relighting": lambda: render_own_frames(
            truth, replace(scene, render=dull), maps
        ),
        "ours, true maps, no shadows": lambda: render_own_frames(
            truth, replace(scene, render=flat), maps
        ),
        "paper": lambda: paper(truth, shadowed, None),
        "paper, relit": own["paper, relit"],
        "paper, relit, no old shadows": lambda: paper(truth, clean, true_light(truth)),
    }
