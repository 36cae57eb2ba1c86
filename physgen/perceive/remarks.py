"""What was perceived -> the comments of a scene: where each guess came from, and a push to try."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from physgen.outline.outline import mass_properties
from physgen.perceive import words
from physgen.perceive.found import SMALLEST, Found
from physgen.perceive.roles import LightGuess, Matter, Setting, Shadows, Thing
from physgen.scene.model import View

GRAVITY = 9.8
"""m/s², as a scene has it unless it says something else."""


def comments(
    found: Found,
    things: Sequence[Thing],
    left_out: int,
    setting: Setting,
    light: LightGuess,
    shadows: Shadows,
) -> dict[str, str]:
    """Sentences about where each guess came from."""
    told = {
        "given": "from the masks given",
        "pointed at": "where you pointed",
        "coco": "from the annotations",
        "kept": "as the scene had them, and where you pointed",
    }
    how = told.get(found.source, f"found by {found.source}")
    specks = f"; {left_out} specks of under {SMALLEST} px left out" if left_out else ""
    said = {
        "world.view": f"side or top: {setting.reason} (confidence {setting.confidence:g})",
        "objects": f"{words.counted({t.id: t.label for t in things})}, {how}, counted from left to right{specks}",
        "light": f"{light.reason} (confidence {light.confidence:g})"
        if shadows.clean is None
        else f"{shadows.reason} (confidence {shadows.confidence:g})",
    }
    if setting.view is View.TOP:
        said["world.table"] = "nobody can see friction: 0 lets things glide for ever, 0.2 is cloth"
    for wall in setting.walls:
        said[f"boundaries.{wall.name}"] = wall.reason
    return said


def push(
    found: Found,
    setting: Setting,
    things: Sequence[Thing],
    called: Mapping[int, str],
    matter: Mapping[int, Matter],
    pixels_per_meter: float,
) -> str:
    """A force to try: a sure thing far from the others, pushed towards them as fast as it would fall its size."""
    loose = [t for t in things if not t.cut and t.id not in setting.held] or list(things)
    sure = {t.id: found.confidence.get(t.id, 1.0) for t in loose}
    movable = [t for t in loose if sure[t.id] >= 0.8 * max(sure.values())]
    centers = np.array([mass_properties(t.outline).center for t in movable])
    away = centers - centers.mean(0)
    if setting.view is View.SIDE:
        away[:, 1] = 0
    k = int(np.argmax((away**2).sum(1)))
    length = float(np.hypot(*away[k]))
    towards = -away[k] / length if length > 1 else np.array([1.0, 0.0])
    size = mass_properties(movable[k].outline).area ** 0.5
    speed = float(f"{(2 * GRAVITY * pixels_per_meter * size) ** 0.5:.1g}")
    kick = matter[movable[k].id].mass * speed
    x, y = (float(f"{kick * c:.2g}") if abs(c) > 0.01 else 0.0 for c in towards)
    return (
        f"to set something going, replace [] by a list such as (impulse in g px/s, here {speed:g} px/s):\n"
        f"  - {{object: {called[movable[k].id]}, impulse: [{x:g}, {y:g}]}}"
    )
