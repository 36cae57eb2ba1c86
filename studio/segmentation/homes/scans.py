"""Scanned household objects as things: the meshes of `PHYSGEN_MATERIAL`/models3d, reduced, with their textures or a print of ours."""

from __future__ import annotations

import os
from functools import cache, lru_cache
from pathlib import Path

import cv2
import numpy as np

from studio.segmentation.homes import prints
from studio.segmentation.homes.parts import FINISHES, Part, Thing, standing
from studio.segmentation.homes.prints import Rng
from studio.segmentation.homes.solids import Solid, turn

TRIANGLES = 6000
"""Of a reduced mesh, about."""
TEXTURE = 192
"""px of a texture's longer side."""
SLIM = 2.5
"""Ratio of height to width from which a scan may also lie on its side."""


@cache
def scans() -> list[Path]:
    """The meshes; needs PHYSGEN_MATERIAL."""
    found = sorted((Path(os.environ["PHYSGEN_MATERIAL"]) / "models3d").glob("*.ply"))
    if not found:
        raise FileNotFoundError("PHYSGEN_MATERIAL/models3d holds no meshes")
    return found


def scan(rng: Rng) -> Thing:
    """One scanned object, upright or lying."""
    path = scans()[int(rng.integers(len(scans())))]
    solid = read(path)
    size = np.ptp(solid.vertices, axis=0)
    if rng.random() < (0.5 if size[2] > SLIM * min(size[:2]) else 0.1):
        solid = solid.moved(
            turn=turn("x" if rng.random() < 0.5 else "y", float(rng.choice([90, -90])))
        )
    solid = solid.moved(
        turn=turn("z", float(rng.uniform(0, 360))), scale=float(rng.uniform(0.8, 1.25))
    )
    texture = path.with_suffix(".jpg")
    if texture.exists():
        image, finish = (
            picture(texture),
            str(rng.choice(["matt", "satin", "satin", "glossy"])),
        )
    else:
        image = (
            prints.pattern(rng)
            if rng.random() < 0.6
            else prints.plain(prints.colour(rng))
        )
        finish = str(rng.choice(FINISHES[:4]))
    return standing("scan", [Part(solid, finish, image)])


@lru_cache(maxsize=128)
def picture(path: Path) -> np.ndarray:
    """(H, W, 3) linear reflectance."""
    image = cv2.imread(str(path))[..., ::-1]
    scale = min(1.0, TEXTURE / max(image.shape[:2]))
    return prints.linear(
        cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    )


@lru_cache(maxsize=128)
def read(path: Path) -> Solid:
    """A binary little-endian PLY with x, y, z, u, v and triangles, reduced to about `TRIANGLES`."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    counts = {
        words[1]: int(words[2])
        for words in map(str.split, head.decode().splitlines())
        if words[0] == "element"
    }
    corner = np.dtype("<f4")
    split = counts["vertex"] * 5 * 4
    rows = np.frombuffer(body[:split], corner).reshape(-1, 5).astype(float)
    faces = np.frombuffer(body[split:], np.dtype([("n", "u1"), ("v", "<i4", 3)]))[
        "v"
    ].astype(int)
    return reduced(Solid(rows[:, :3], rows[:, 3:], faces))


def reduced(solid: Solid, most: int = TRIANGLES) -> Solid:
    """Vertices that lie in one cell of space and of the texture become one; cells grow until few enough are left."""
    cell = float(np.ptp(solid.vertices, axis=0).max()) / 200
    found = solid
    while len(found.faces) > most:
        key = np.hstack(
            [np.floor(solid.vertices / cell), np.floor(solid.uv * 24)]
        ).astype(int)
        _, first, owner = np.unique(key, axis=0, return_index=True, return_inverse=True)
        faces = owner.reshape(-1)[solid.faces]
        whole = (
            (faces[:, 0] != faces[:, 1])
            & (faces[:, 1] != faces[:, 2])
            & (faces[:, 0] != faces[:, 2])
        )
        found = Solid(solid.vertices[first], solid.uv[first], faces[whole])
        cell *= 1.35
    return found
