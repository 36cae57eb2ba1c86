"""Textures and bodies of things at home: books, leather and tennis balls, bricks, paving, painted wood.

Sizes and seeds in, (H, W, 3) linear reflectance or meshes out.
"""

import cv2
import numpy as np
from materials import matt, satin
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial import cKDTree
from shapes import rounded_box
from stage import Mesh
from textures import cloud, noise, srgb

# --- balls -----------------------------------------------------------------------------------------------------------


def _globe(width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Longitude (rad) and latitude (rad) of every texel, and its place on the unit sphere (H, W, 3)."""
    latitude = (0.5 - (np.arange(width // 2) + 0.5) / (width // 2)) * np.pi + np.zeros(
        (1, width)
    ).T[:1]
    latitude = np.repeat(latitude.reshape(-1, 1), width, 1)
    longitude = np.repeat(
        ((np.arange(width) + 0.5) / width * 2 * np.pi)[None], width // 2, 0
    )
    place = [
        np.cos(latitude) * np.cos(longitude),
        np.cos(latitude) * np.sin(longitude),
        np.sin(latitude),
    ]
    return longitude, latitude, np.stack(place, -1)


def leather_ball(
    colours: list[np.ndarray], seed: int = 0, width: int = 1024
) -> np.ndarray:
    """Gores of leather from pole to pole in turn of `colours`, sewn with pale thread, scuffed by play."""
    rng = np.random.default_rng(seed)
    longitude, latitude, _ = _globe(width)
    shape = longitude.shape
    gores = 8
    turn = longitude / (2 * np.pi) * gores
    which = np.floor(turn).astype(int) % len(colours)
    seam = (
        np.abs(turn - np.round(turn)) / gores * 2 * np.pi * np.cos(latitude)
    )  # rad from the nearest seam
    skin = np.array(colours)[which]
    grain = cloud(*shape, (7, 7), 3, rng, 0.8)
    age = cloud(*shape, (shape[0] / 4, shape[1] / 6), 5, rng, 0.65)
    skin = skin * np.clip(1 + 0.07 * grain + 0.10 * age, 0.5, 1.5)[..., None]
    scuff = np.clip(0.45 * age + 0.8 * noise(*shape, (5, 16), rng) - 1.5, 0, 1)[
        ..., None
    ]
    skin = skin + (srgb(190, 160, 128) - skin) * 0.45 * scuff
    skin = (
        skin
        * (
            1
            - 0.30 * np.exp(-((seam / 0.09) ** 2))
            - 0.5 * np.exp(-((seam / 0.018) ** 2))
        )[..., None]
    )
    stitch = (
        (np.abs(seam - 0.055) < 0.011)
        & (np.sin(latitude * 78) > -0.2)
        & (np.abs(latitude) < 1.38)
    )
    stitch = cv2.GaussianBlur(stitch.astype(np.float32), (0, 0), 0.8)[..., None]
    skin = skin + (srgb(206, 192, 162) - skin) * 0.8 * stitch
    cap = np.clip((np.abs(latitude) - 1.42) / 0.015, 0, 1)[
        ..., None
    ]  # a round patch on each pole
    return skin + (colours[0] * (1 + 0.07 * grain[..., None]) * 0.9 - skin) * cap


def tennis_ball(seed: int = 0, wear: float = 0.3, width: int = 1024) -> np.ndarray:
    """Yellow felt and the white rubber seam; `wear` is how much court dust has got into it."""
    rng = np.random.default_rng(seed)
    _, _, place = _globe(width)
    shape = place.shape[:2]
    t = np.linspace(0, 2 * np.pi, 1500)
    a, b = 0.75, 0.25
    curve = [
        a * np.cos(t) + b * np.cos(3 * t),
        a * np.sin(t) - b * np.sin(3 * t),
        2 * np.sqrt(a * b) * np.sin(2 * t),
    ]
    away = cKDTree(np.stack(curve, -1)).query(place.reshape(-1, 3))[0].reshape(shape)
    fuzz = noise(*shape, (2, 3), rng) + noise(*shape, (5, 3), rng)
    dust = (
        np.clip(
            cloud(*shape, (shape[0] / 3, shape[1] / 5), 6, rng, 0.7) * 0.5 + 0.4, 0, 1.4
        )[..., None]
        * wear
    )
    felt = srgb(186, 194, 66) * np.clip(1 + 0.10 * fuzz, 0.4, 1.6)[..., None]
    felt = felt + (srgb(128, 112, 84) - felt) * np.clip(dust, 0, 0.8)
    edge = np.clip((0.075 + 0.008 * noise(*shape, (6, 6), rng) - away) / 0.02, 0, 1)[
        ..., None
    ]
    rubber = srgb(206, 204, 192) * (1 - 0.5 * dust)
    shade = 1 - 0.28 * np.exp(-(((away - 0.085) / 0.02) ** 2))
    return (felt + (rubber - felt) * edge) * shade[..., None]


# --- books -----------------------------------------------------------------------------------------------------------


def cloth(
    height: int, width: int, colour: np.ndarray, seed: int = 0, wear: float = 0.25
) -> np.ndarray:
    """Book cloth: weave, rubbed paler patches and edges, a stain or two."""
    rng = np.random.default_rng(seed)
    weave = noise(height, width, (1.4, 5), rng) + noise(height, width, (5, 1.4), rng)
    age = cloud(height, width, (height / 3, width / 1.5), 5, rng, 0.65)
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    rim = np.maximum(
        np.exp(-(1 - np.abs(x)) / 0.07),
        np.exp(-(1 - np.abs(y)) * height / width / 0.10),
    )
    rub = np.clip(
        wear * (rim + 0.20 * age + 0.2 * noise(height, width, (9, 4), rng) * rim),
        0,
        0.8,
    )[..., None]
    body = colour * np.clip(1 + 0.055 * weave + 0.06 * age, 0.5, 1.5)[..., None]
    return body + (body * 0.35 + 0.65 * srgb(176, 160, 136) - body) * rub


def spine(
    size: tuple[float, float],
    colour: np.ndarray,
    title: str,
    author: str = "",
    ink: np.ndarray | None = None,
    bands: list[tuple[float, float, np.ndarray]] = (),
    seed: int = 0,
    wear: float = 0.25,
    tall: int = 900,
    letter: float = 0.5,
) -> np.ndarray:
    """A spine of (width, height) m, read from the top down; `bands` are (from, to, colour) in parts of its height.

    `letter` is the title's size in parts of the width.
    """
    height, width = tall, max(24, round(tall * size[0] / size[1]))
    face = cloth(height, width, colour, seed, wear)
    weave = face / np.maximum(colour, 1e-3)
    for start, end, tone in bands:
        face[round(start * height) : round(end * height)] = (
            tone * weave[round(start * height) : round(end * height)]
        )
    plate = Image.new("L", (height, width), 0)
    draw = ImageDraw.Draw(plate)
    big, small = (
        ImageFont.load_default(width * letter),
        ImageFont.load_default(width * letter * 0.66),
    )
    draw.text((height * 0.16, width * 0.47), title, 255, big, anchor="lm")
    draw.text((height * 0.93, width * 0.48), author, 255, small, anchor="rm")
    glyph = np.rot90(np.asarray(plate, np.float32) / 255, -1)
    rng = np.random.default_rng(seed + 99)
    rubbed = np.clip(0.92 + 0.22 * cloud(height, width, (40, 14), 4, rng, 0.8), 0.35, 1)
    tone = srgb(214, 196, 150) if ink is None else ink
    return face + (tone - face) * (glyph * rubbed)[..., None]


def pages(seed: int = 0) -> np.ndarray:
    """The cut edge of a block of paper: leaves lie along v (256 px), a little uneven."""
    rng = np.random.default_rng(seed)
    leaf = np.repeat(rng.normal(0, 1, (1, 256)), 256, 0) + 0.5 * noise(
        256, 256, (90, 2), rng
    )
    return srgb(216, 204, 178) * np.clip(1 + 0.10 * leaf, 0.6, 1.25)[..., None]


def sheet(grid: np.ndarray, bsdf: dict) -> Mesh:
    """A surface through a (R, C, 3) grid of points; a texture's first row lies on the grid's last one."""
    rows, columns = grid.shape[:2]
    along, across = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    normals = np.cross(along, across)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    middle = grid[rows // 2], grid[:, columns // 2]
    run = [
        np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(m, axis=0), axis=-1))])
        for m in middle
    ]
    uv = np.stack(np.meshgrid(run[0] / run[0][-1], 1 - run[1] / run[1][-1]), -1)
    i = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([i, i + 1, i + columns + 1], 1),
            np.stack([i, i + columns + 1, i + columns], 1),
        ]
    )
    return Mesh(
        grid.reshape(-1, 3), normals.reshape(-1, 3), uv.reshape(-1, 2), faces, bsdf
    )


def book(
    size: tuple[float, float, float],
    printed: np.ndarray,
    board: np.ndarray,
    bulge: float = 0.003,
    shine: float | None = None,
    seed: int = 0,
) -> list[Mesh]:
    """A hardback about the origin, its spine towards the camera: `size` is (thickness, depth, height) m.

    `printed` is the spine's texture, `board` the cover's colour; `shine` is the roughness of printed paper,
    none for cloth.
    """
    thick, depth, height = size

    def skin(tone: np.ndarray) -> dict:
        return matt(tone) if shine is None else satin(tone, shine)

    plate, lip = 0.0026, 0.003
    corner = np.array(
        [[np.sin(a), -np.cos(a)] for a in np.linspace(-np.pi / 2, 0, 6)]
    ) * [0.0022, 0.0022]
    x = np.linspace(-thick / 2 + 0.0022, thick / 2 - 0.0022, 17)
    front = np.stack([x, -bulge * (1 - (2 * x / thick) ** 2) - 0.0022], -1)
    left = np.add(corner, [-thick / 2 + 0.0022, 0])
    right = np.add((corner * [-1, 1])[::-1], [thick / 2 - 0.0022, 0])
    path = np.add(
        np.concatenate([left[:-1], front, right[1:]]), [0, -depth / 2 + 0.0022]
    )
    z = np.array(
        [-height / 2, -height / 2 + 0.0008, 0, height / 2 - 0.0008, height / 2]
    )
    grid = np.zeros((5, len(path), 3))
    grid[..., :2], grid[..., 2] = path, z[:, None]
    grid[[0, -1], :, 1] += 0.0008  # the turned-in ends
    cover = skin(cloth(512, 360, board, seed + 1))
    side = rounded_box(
        (plate, depth - 0.002, height), cover, 0.0008, 0.2, (0.3, 0.4), "y"
    )
    block = rounded_box(
        (thick - 2 * plate, depth - 0.004 - lip, height - 2 * lip),
        matt(pages(seed)),
        0.0004,
        0.03,
        (0, 0),
        "x",
    )

    def shifted(mesh: Mesh, by: tuple[float, float, float]) -> Mesh:
        return Mesh(
            mesh.vertices + np.array(by), mesh.normals, mesh.uv, mesh.faces, mesh.bsdf
        )

    across = (thick - plate) / 2
    return [
        sheet(grid, skin(printed)),
        shifted(side, (-across, 0.001, 0)),
        shifted(side, (across, 0.001, 0)),
        shifted(block, (0, -lip / 2 + 0.002, 0)),
    ]


# --- wood and outlines -----------------------------------------------------------------------------------------------


def rounded(corners: object, times: int = 3) -> np.ndarray:
    """A closed outline, its corners cut round (Chaikin); a corner given twice stays tighter, flat feet stay flat."""
    points = np.asarray(corners, float)
    for _ in range(times):
        onward = np.roll(points, -1, 0)
        points = np.stack(
            [0.75 * points + 0.25 * onward, 0.25 * points + 0.75 * onward], 1
        ).reshape(-1, 2)
    return points[np.linalg.norm(points - np.roll(points, 1, 0), axis=1) > 1e-6]


def painted(
    height: int, width: int, colour: np.ndarray, seed: int = 0, grain: float = 0.05
) -> np.ndarray:
    """Thin paint on wood: the grain (along x) shows through, a few chips and grubby patches."""
    rng = np.random.default_rng(seed)
    fibre = cloud(height, width, (3, width / 5), 3, rng, 0.7)
    dirt = cloud(height, width, (height / 3, width / 3), 5, rng, 0.6)
    shade = np.clip(1 + grain * fibre + 0.05 * dirt, 0.5, 1.4)[..., None]
    chip = (
        np.clip(cloud(height, width, (22, 30), 4, rng, 0.7) - 2.75, 0, 0.15)[..., None]
        / 0.15
    )
    coat = colour * shade
    return coat + (srgb(184, 148, 104) - coat) * 0.8 * chip


# --- masonry ---------------------------------------------------------------------------------------------------------


def bricks(rows: int, columns: int, seed: int = 0, tall: int = 64) -> np.ndarray:
    """Running bond of red stock bricks in pale mortar; a row is `tall` px, a brick with its joint three times as wide.

    It repeats across where `rows` is even.
    """
    rng = np.random.default_rng(seed)
    long = tall * 3
    height, width = rows * tall, columns * long
    wobble = cloud(height, width, (26, 26), 3, rng, 0.7)
    y, x = np.mgrid[:height, :width] + 1.6 * np.stack([wobble, np.roll(wobble, 37, 1)])
    row = np.floor(y / tall).astype(int) % rows
    x = x + (row % 2) * long / 2
    column = np.floor(x / long).astype(int) % columns
    joint = tall * 0.075
    from_edge = np.minimum(
        np.minimum(y % tall, tall - y % tall), np.minimum(x % long, long - x % long)
    )
    brick = np.clip((from_edge - joint) / 2.5, 0, 1)[..., None]
    kinds = np.array(
        [
            [150, 88, 66],
            [166, 100, 72],
            [134, 76, 60],
            [172, 116, 84],
            [116, 72, 62],
            [158, 94, 70],
        ]
    )
    tone = srgb(
        *kinds[rng.integers(len(kinds), size=(rows, columns))].T.reshape(3, -1)
    ).reshape(3, columns, rows)
    body = (
        tone[:, column, row].transpose(1, 2, 0)
        * rng.uniform(0.85, 1.15, (rows, columns))[row, column][..., None]
    )
    pits = np.clip(noise(height, width, (4, 5), rng) - 1.5, 0, 1)
    stain = cloud(height, width, (height / 3, width / 3), 5, rng, 0.6)
    body = (
        body
        * np.clip(
            1 + 0.10 * cloud(height, width, (14, 22), 4, rng, 0.8) - 0.3 * pits,
            0.4,
            1.5,
        )[..., None]
    )
    bloom = np.clip(
        0.25 * stain + 0.15 * noise(height, width, (20, 20), rng) - 0.15, 0, 0.5
    )[..., None]
    body = body + (srgb(190, 176, 160) - body) * 0.5 * bloom
    mortar = (
        srgb(172, 162, 146)
        * np.clip(
            1 + 0.10 * noise(height, width, (3, 3), rng) + 0.05 * stain, 0.5, 1.4
        )[..., None]
    )
    shadow = 1 - 0.25 * np.exp(-(((from_edge - joint) / 3.0) ** 2))[..., None]
    return (mortar + (body - mortar) * brick) * shadow


def concrete(height: int, width: int, colour: np.ndarray, seed: int = 0) -> np.ndarray:
    """Weathered concrete or stone: sand, pebbles, pores, stains and a hair crack."""
    rng = np.random.default_rng(seed)
    sand = noise(height, width, (1.6, 1.6), rng) + 0.8 * noise(
        height, width, (4, 4), rng
    )
    stain = cloud(height, width, (height / 2.5, width / 2.5), 6, rng, 0.65)
    pores = np.clip(noise(height, width, (5, 5), rng) - 2.0, 0, 0.8)
    shade = np.clip(1 + 0.05 * sand + 0.10 * stain - 0.4 * pores, 0.35, 1.5)[..., None]
    tint = 1 + 0.03 * cloud(height, width, (height / 4, width / 4), 4, rng)[
        ..., None
    ] * np.array([1.0, 0.2, -1.0])
    crack = np.abs(cloud(height, width, (height / 2, width / 2), 6, rng, 0.55))
    return (
        colour * shade * tint * (1 - 0.25 * np.exp(-((crack / 0.006) ** 2)))[..., None]
    )


# --- pictures --------------------------------------------------------------------------------------------------------


def seascape(height: int, width: int, seed: int = 0) -> np.ndarray:
    """A print for a wall: sea, two hills and a pale sun, on paper with a white border."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0 : 1 : height * 1j, 0 : 1 : width * 1j]
    air = np.clip(y / 0.6, 0, 1)[..., None]
    art = srgb(128, 156, 168) + (srgb(222, 198, 160) - srgb(128, 156, 168)) * air
    sun = np.hypot((x - 0.64) * width / height, y - 0.42) < 0.075
    art = np.where(sun[..., None], srgb(226, 142, 92), art)
    for crest, rise, tone in (
        (0.56, 0.12, (108, 128, 128)),
        (0.64, 0.09, (72, 94, 92)),
    ):
        line = (
            crest
            - rise * np.sin(3.1 * x + crest * 9)
            + 0.008 * noise(1, width, (1, 20), rng)
        )
        art = np.where((y > line)[..., None], srgb(*tone), art)
    waves = (
        srgb(70, 104, 118)
        * np.clip(1 + 0.12 * noise(height, width, (5, 60), rng), 0.5, 1.5)[..., None]
    )
    art = np.where((y > 0.70)[..., None], waves, art)
    border = (np.minimum(x, 1 - x) * width < 0.07 * width) | (
        np.minimum(y, 1 - y) * height < 0.07 * width
    )
    return np.where(
        border[..., None],
        srgb(222, 216, 202),
        art * (1 + 0.03 * noise(height, width, (2, 2), rng)[..., None]),
    )


def digit(text: str, paper: np.ndarray, ink: np.ndarray, size: int = 256) -> np.ndarray:
    """A number on a round sticker, the right way up where v runs up."""
    plate = Image.new("L", (size, size), 0)
    ImageDraw.Draw(plate).text(
        (size / 2, size * 0.5),
        text,
        255,
        ImageFont.load_default(size * 0.62),
        anchor="mm",
        stroke_width=size // 40,
    )
    glyph = (np.asarray(plate, np.float32) / 255)[::-1, :, None]
    return paper + (ink - paper) * glyph


def mirrored(rgb: np.ndarray) -> np.ndarray:
    """Four of a texture, mirrored so that it repeats without a seam."""
    wide = np.concatenate([rgb, rgb[:, ::-1]], 1)
    return np.concatenate([wide, wide[::-1]], 0)


def join(meshes: list[Mesh]) -> Mesh:
    """One mesh of many with the first one's surface."""
    first = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    faces = np.concatenate(
        [m.faces + start for m, start in zip(meshes, first, strict=False)]
    )
    parts = [
        np.concatenate([getattr(m, k) for m in meshes])
        for k in ("vertices", "normals", "uv")
    ]
    return Mesh(*parts, faces, meshes[0].bsdf)
