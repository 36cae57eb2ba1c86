"""What the page draws of a photo: put together it is the photo again, and no motion changes it."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import yaml
from browser import lay, picture
from PIL import Image

from physgen import pipeline
from physgen.edit.live import Live
from physgen.edit.operations import apply_operations
from physgen.edit.pictures import Pictures, photo_png

Copy = Callable[[str], Path]


def changed(text: str, *edits: str) -> str:
    """A text with `key=value` set, for dotted keys."""
    pairs = [edit.partition("=")[::2] for edit in edits]
    ops = [
        {"set": key.split("."), "value": yaml.safe_load(value)} for key, value in pairs
    ]
    return apply_operations(text, ops).text


def test_background_shadows_and_objects_are_the_photo_again(copied: Copy) -> None:
    """Read by another decoder and put together by hand, at t = 0: within a few levels of the photo, everywhere."""
    path = copied("kitchen")
    live = Live(path)
    pictures, look = Pictures(live), live.look(path.read_text())
    assert look.picture is not None
    assert look.motion is not None
    seen, thrown = (
        pictures.look(look.picture),
        pictures.shadows(look.picture, look.motion["key"]),
    )
    assert seen is not None
    assert thrown is not None
    photo = np.asarray(Image.open(path.parent / "photo.png").convert("RGB"), np.float32)
    canvas = picture(seen["background"])[..., :3].astype(np.float32)
    assert canvas.shape == photo.shape
    bare = canvas.copy()
    for row in thrown["shadows"]:
        first = row["keys"][0]
        if "src" in first:
            lay(canvas, first)
    shaded = canvas.copy()
    for row in seen["sprites"]:
        lay(canvas, row)
    assert np.abs(canvas - photo).mean() < 2.5
    assert np.abs(shaded - photo).mean() > 4 * np.abs(canvas - photo).mean(), (
        "objects are pictures of their own"
    )
    assert np.abs(bare - shaded).max() > 25, "shadows are, too"
    assert [seen["names"][row["body"]] for row in seen["sprites"]] != []
    assert sorted(seen["names"]) == sorted(look.scene["objects"])  # type: ignore[index]


@pytest.mark.slow
def test_shadows_go_with_the_motion_that_throws_them(copied: Copy) -> None:
    """The shadow of a ball lies where its sample says; of one that was put elsewhere, there."""
    path = copied("billiards")
    live, text = Live(path), path.read_text()
    pictures = Pictures(live)
    middle = {}
    for x in (300, 340):
        look = live.look(
            changed(
                text,
                f"objects.cue-ball.place=[{x}, 500]",
                "objects.cue-ball.velocity=[0, 0]",
            )
        )
        assert look.picture is not None
        assert look.motion is not None
        told = pictures.shadows(look.picture, look.motion["key"])
        assert told is not None
        names = pictures.look(look.picture)["names"]  # type: ignore[index]
        (row,) = (row for row in told["shadows"] if names[row["body"]] == "cue-ball")
        middle[x] = row["keys"][0]["at"]
        assert told["motion"] == look.motion["key"]
    # its picture slides with the ball from where the photo has it
    assert middle[300] == middle[340]
    assert pictures.shadows("gone", "gone") is None


def test_a_scene_without_a_photo_is_drawn_flat(copied: Copy) -> None:
    path = copied("physics/11-head-on")
    live, text = Live(path), path.read_text()
    look = live.look(text)
    seen = Pictures(live).look(look.picture or "")
    assert seen is not None
    assert len(seen["sprites"]) == len(seen["names"]) > 1
    paper = np.asarray(Image.open(BytesIO(photo_png(live.state(text)))))
    scene = pipeline.load(path)
    assert paper.shape == (scene.size[1], scene.size[0], 3)
