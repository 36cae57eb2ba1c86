"""What another object hid in the photo is there when that one moves away, beside the truth of a drawn scene."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.maps import Percepts, write_assets
from physgen.photometry import decode, encode_u8
from physgen.simulate.engine import simulate

SCENE = """\
physgen: 1
image: photo.png
assets: photo.assets
world: {{view: top, duration: 1, table: {{friction: 0}}}}
objects:
  back: {{mask: 1, shape: {back}}}
  front: {{mask: 2, shape: {{box: {{center: [{x}, 60], size: [40, 90]}}}}, layer: {layer}, velocity: [0, 400]}}
"""
BACK = {
    "ball": "{circle: {center: [80, 60], radius: 30}}",
    "plank": "{box: {center: [80, 60], size: [110, 24]}}",
}


def pictures(kind: str, x: float) -> tuple[np.ndarray, ...]:
    """Linear light of a ground, the object behind alone on it, both objects; the masks' labels."""
    yy, xx = np.mgrid[:120, :160].astype(np.float32)
    ground = np.full((120, 160, 3), 0.4, np.float32)
    if kind == "ball":
        where = np.hypot(xx - 80, yy - 60) <= 30
        paint = (0.1 + 0.15 * np.clip(1 - np.hypot(xx - 70, yy - 50) / 45, 0, 1))[..., None] * np.float32(
            [3, 1, 1]
        )
    else:
        where = (np.abs(xx - 80) <= 55) & (np.abs(yy - 60) <= 12)
        paint = (0.2 + 0.05 * np.sin(yy) + 0.001 * xx)[..., None] * np.float32([1.2, 1, 0.6])
    alone = np.where(where[..., None], paint, ground)
    front = (np.abs(xx - x) <= 20) & (np.abs(yy - 60) <= 45)
    both = np.where(front[..., None], np.float32([0.05, 0.1, 0.5]), alone)
    labels = np.where(front, 2, np.where(where, 1, 0)).astype(np.uint16)
    return ground, alone, both, labels


@pytest.mark.parametrize("kind", BACK)
@pytest.mark.parametrize("layer", [0, 1])
def test_a_hidden_part_is_there_when_the_other_leaves(kind: str, layer: int, tmp_path) -> None:
    x = 104 if kind == "ball" else 80
    ground, alone, both, labels = pictures(kind, x)
    photo, background = encode_u8(both), encode_u8(ground)
    cv2.imwrite(str(tmp_path / "photo.png"), photo[..., ::-1])
    write_assets(
        Percepts(
            rgb=photo, labels=labels, coverage=(labels > 0).astype(np.float32), background=background,
            clean=None, depth=None, normals=None, albedo=None, shading=None,
        ),
        tmp_path / "photo.assets",
    )  # fmt: skip
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE.format(back=BACK[kind], x=x, layer=layer))
    scene = pipeline.load(path)
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    track = simulate(compiled.world, np.array([0.0, 0.9]))
    still = np.repeat(track.poses[:1], 2, axis=0)
    still[1, 1] = [x, 1000, 0]  # the one in front is far away, the other where it was
    first, last = (
        frame.rgb
        for frame in pipeline.render(
            pipeline.stage(scene, compiled, maps), type(track)(**(vars(track) | {"poses": still}))
        )
    )
    assert np.array_equal(first, photo)
    hidden = (labels == 2) & (np.abs(alone - ground).max(axis=2) > 0)
    inner = cv2.erode(hidden.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    off = np.abs(decode(last) - alone)[inner].mean()
    assert off < 0.3 * np.abs(ground - alone)[inner].mean()
