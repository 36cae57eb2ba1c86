"""A clip's manifest and its scene as it is now -> the scene as the run had it, with every value of then."""

from __future__ import annotations

import tempfile
from pathlib import Path

from physgen import pipeline
from physgen.batch.verify.told import Told
from physgen.scene.model import Scene
from physgen.scene.write import scene_text

FILES = ("image", "assets")
"""Keys that name files: those that the scene reads now are taken, so a manifest cannot have any other read."""
DONE = ("extends", "variants")
"""Keys that a resolved scene has behind it."""


def recorded(told: Told, scene: Scene) -> Scene:
    """Raises InputError where this physgen cannot read it, or the scene has no photo now and had one."""
    document = {key: value for key, value in told.document.items() if key not in (*FILES, *DONE)}
    for key, path in zip(FILES, (scene.image, scene.assets), strict=True):
        if path is not None and key in told.document:
            document[key] = str(path)
    with tempfile.TemporaryDirectory(prefix="physgen-") as folder:
        path = Path(folder) / "recorded.yaml"
        path.write_text(scene_text(document), encoding="utf-8")
        return pipeline.load(path, allow_outside=True)
