"""Procedural textures of workshops, gardens, warehouses and fairs: (H, W, 3) linear reflectance out."""

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from textures import cloud, noise, srgb


def worn(
    colour: np.ndarray,
    height: int,
    width: int,
    seed: int,
    uneven: float = 0.06,
    grime: float = 0.25,
) -> np.ndarray:
    """Any painted or bare surface with a past: broad unevenness, blotches of dirt, fine scratches."""
    rng = np.random.default_rng(seed)
    shade = 1 + uneven * cloud(height, width, (height / 3, width / 3), 5, rng, 0.6)
    dirt = (
        np.clip(cloud(height, width, (height / 2, width / 2), 6, rng, 0.7) - 0.6, 0, 2)
        * grime
    )
    lines = np.zeros((height, width), np.float32)
    for _ in range(60):
        x, y, a = rng.uniform(0, width), rng.uniform(0, height), rng.uniform(0, np.pi)
        reach = rng.exponential(0.06) * width
        end = int(x + reach * np.cos(a)), int(y + reach * np.sin(a))
        cv2.line(
            lines, (int(x), int(y)), end, float(rng.uniform(0.05, 0.3)), 1, cv2.LINE_AA
        )
    tone = np.clip(shade * (1 - 0.5 * np.clip(dirt, 0, 1)), 0.3, 1.5)[..., None]
    return np.clip(colour * tone * (1 + 0.35 * lines[..., None]), 0, 0.9)


def pegboard(
    height: int, width: int, colour: np.ndarray, pitch: int, seed: int = 0
) -> np.ndarray:
    """Painted hardboard with round holes every `pitch` texels."""
    board = worn(colour, height, width, seed, 0.03, 0.15)
    y, x = np.mgrid[:height, :width]
    away = np.hypot((x + 0.5) % pitch - pitch / 2, (y + 0.5) % pitch - pitch / 2)
    hole = np.clip(pitch * 0.13 - away + 0.5, 0, 1)[..., None]
    return board * (1 - hole) + hole * srgb(22, 20, 18)


def workbench(height: int, width: int, boards: np.ndarray, seed: int = 0) -> np.ndarray:
    """A wooden top that was worked on: `boards` with saw cuts, drips of paint, glue rings and dark oil."""
    rng = np.random.default_rng(seed)
    oil = np.clip(
        cloud(height, width, (height / 2, width / 5), 5, rng, 0.6) - 0.7, 0, 1.5
    )[..., None]
    skin = boards * (1 - 0.35 * oil)
    marks = np.zeros((height, width), np.float32)
    for _ in range(90):
        x, y, a = (
            rng.uniform(0, width),
            rng.uniform(0, height),
            rng.normal(0, 0.5) + np.pi / 2 * rng.integers(2),
        )
        reach = rng.exponential(30)
        end = int(x + reach * np.cos(a)), int(y + reach * np.sin(a))
        cv2.line(
            marks, (int(x), int(y)), end, float(rng.uniform(0.2, 0.7)), 1, cv2.LINE_AA
        )
    skin = skin * (1 - 0.55 * marks[..., None])
    for _ in range(26):
        spot = np.zeros((height, width), np.float32)
        cv2.circle(
            spot,
            (int(rng.uniform(0, width)), int(rng.uniform(0, height))),
            int(rng.uniform(1, 5)),
            1.0,
            -1,
            cv2.LINE_AA,
        )
        drip = srgb(
            *[(214, 210, 198), (150, 60, 46), (60, 84, 110), (40, 38, 36)][
                rng.integers(4)
            ]
        )
        skin = skin * (1 - spot[..., None]) + drip * spot[..., None]
    return skin


def cork(height: int, width: int, seed: int = 0) -> np.ndarray:
    """Pressed cork: lumps of many browns with dark crumbs between."""
    rng = np.random.default_rng(seed)
    lumps = noise(height, width, (9, 9), rng) + 0.6 * noise(height, width, (4, 4), rng)
    crumbs = np.clip(noise(height, width, (3, 3), rng) - 1.3, 0, 1)[..., None]
    return (
        srgb(190, 146, 100)
        * (1 + 0.13 * lumps[..., None]).clip(0.5, 1.5)
        * (1 - 0.6 * crumbs)
    )


def plies(height: int, width: int, layers: int, seed: int = 0) -> np.ndarray:
    """The edge of plywood: veneers whose fibres run along (pale) and across (dark, porous)."""
    rng = np.random.default_rng(seed)
    row = (np.arange(height) + 0.5) / height * layers
    across = (row.astype(int) % 2)[:, None]
    fibre = cloud(height, width, (1.5, width / 20), 3, rng, 0.7)
    pores = noise(height, width, (1.2, 2.0), rng)
    tone = np.where(across, 0.62 + 0.10 * pores, 0.95 + 0.06 * fibre)
    glue = (np.abs(row % 1 - 0.02) < 0.07)[:, None] * 0.25
    return srgb(206, 168, 122) * np.clip(tone - glue, 0.2, 1.1)[..., None]


def lettering(size: tuple[int, int], lines: list[tuple]) -> np.ndarray:
    """(H, W) ink 0..1: `lines` of (text, x, y, height) as shares of width, height and height, centred at x, y."""
    plate = Image.new("L", size, 0)
    draw = ImageDraw.Draw(plate)
    for words, x, y, tall in lines:
        draw.text(
            (x * size[0], y * size[1]),
            words,
            255,
            ImageFont.load_default(tall * size[1]),
            anchor="mm",
            stroke_width=1,
        )
    return np.asarray(plate, np.float32) / 255


def stone(
    height: int,
    width: int,
    colour: np.ndarray,
    seed: int = 0,
    speckle: float = 0.12,
    lichen: float = 0.4,
) -> np.ndarray:
    """Weathered stone or concrete: crystals, damp patches, pits, pale lichen."""
    rng = np.random.default_rng(seed)
    grain = noise(height, width, (1.5, 1.5), rng) + 0.8 * noise(
        height, width, (4, 4), rng
    )
    damp = cloud(height, width, (height / 3, width / 3), 6, rng, 0.6)
    pits = np.clip(noise(height, width, (4, 5), rng) - 1.9, 0, 1)
    skin = (
        colour
        * np.clip(1 + speckle * grain + 0.13 * damp - 0.5 * pits, 0.2, 1.7)[..., None]
    )
    crust = (
        np.clip(
            cloud(height, width, (height / 8, width / 8), 5, rng, 0.7) - 1.5, 0, 0.8
        )[..., None]
        * lichen
    )
    moss = (
        np.clip(cloud(height, width, (height / 4, width / 4), 6, rng, 0.7) - 1.3, 0, 1)[
            ..., None
        ]
        * lichen
    )
    return (skin * (1 - crust) + crust * srgb(190, 188, 160)) * (
        1 - moss
    ) + moss * srgb(84, 92, 58)


def paving(
    height: int, width: int, colour: np.ndarray, rows: int, columns: int, seed: int = 0
) -> np.ndarray:
    """Stone slabs, each of its own tone, with earth and moss in the joints."""
    rng = np.random.default_rng(seed)
    skin = stone(height, width, colour, seed)
    y, x = np.mgrid[:height, :width]
    wave = 2.5 * cloud(height, width, (60, 60), 4, rng)
    across, along = (x + wave) / width * columns, (y + wave) / height * rows
    tones = (
        1
        + rng.normal(0, 0.07, (rows, columns, 1))
        + rng.normal(0, 0.015, (rows, columns, 3))
    )
    skin = skin * tones[along.astype(int) % rows, across.astype(int) % columns]
    edge = np.minimum(
        np.abs(across - np.round(across)) * width / columns,
        np.abs(along - np.round(along)) * height / rows,
    )
    gap = np.clip(1.6 - edge / 4, 0, 1)[..., None]
    earth = srgb(58, 56, 40) * (1 + 0.25 * noise(height, width, (3, 3), rng))[
        ..., None
    ].clip(0.3, 1.6)
    return skin * (1 - gap) + earth * gap


def foliage(
    height: int, width: int, dark: np.ndarray, light: np.ndarray, seed: int = 0
) -> np.ndarray:
    """A hedge from afar: leaves over leaves, holes of shade between them."""
    rng = np.random.default_rng(seed)
    mass = cloud(height, width, (height / 4, width / 8), 3, rng)
    leaves = noise(height, width, (7, 7), rng) + 0.7 * noise(
        height, width, (3.5, 3.5), rng
    )
    tone = 1 / (1 + np.exp(-(0.9 * mass + 0.9 * leaves)))
    hue = 1 + 0.1 * noise(height, width, (30, 30), rng)[..., None] * np.array(
        [1.0, 0.2, -0.6]
    )
    return np.clip((dark + (light - dark) * tone[..., None]) * hue, 0.004, 0.6)


def end_grain(
    size: int, dark: np.ndarray, light: np.ndarray, rings: float, seed: int = 0
) -> np.ndarray:
    """The sawn end of a log: rings, radial cracks; the pith in the middle of row 0."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0 : 1 : size * 1j, 0 : 1 : size * 1j]
    right, up = x - 0.5, y
    radius = np.hypot(right, up) + 0.02 * cloud(
        size, size, (size / 3, size / 3), 3, rng
    )
    angle = np.arctan2(up, right)
    phase = radius * rings % 1
    ring = np.where(phase < 0.8, phase / 0.8, (1 - phase) / 0.2) ** 1.5
    tone = 0.75 - 0.4 * ring + 0.08 * noise(size, size, (2, 2), rng)
    cracks = np.zeros((size, size))
    for _ in range(7):
        off = (
            np.abs(
                angle
                - rng.uniform(0.1, 3.0)
                + 0.03 * cloud(size, size, (size / 6, size / 6), 3, rng)
            )
            * radius
        )
        reach = rng.uniform(0.3, 0.9)
        cracks = np.maximum(
            cracks,
            np.clip(1.2 - off * size / 1.6, 0, 1) * (radius < reach) * (radius > 0.05),
        )
    return (dark + (light - dark) * np.clip(tone, 0, 1)[..., None]) * (
        1 - 0.75 * cracks[..., None]
    )


def brickwork(
    height: int,
    width: int,
    rows: int,
    columns: int,
    colour: np.ndarray,
    mortar: np.ndarray,
    seed: int = 0,
) -> np.ndarray:
    """Bricks in running bond, each of its own tone."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    along = y / height * rows
    across = x / width * columns + 0.5 * (along.astype(int) % 2)
    tones = rng.normal(1, 0.12, (rows, columns + 1, 1)) * (
        1 + rng.normal(0, 0.03, (rows, columns + 1, 3))
    )
    skin = colour * tones[along.astype(int) % rows, across.astype(int) % (columns + 1)]
    skin = (
        skin
        * np.clip(1 + 0.1 * cloud(height, width, (12, 12), 3, rng, 0.8), 0.4, 1.6)[
            ..., None
        ]
    )
    gap = np.minimum((along % 1) / rows * height, (across % 1) / columns * width)
    joint = np.clip(0.09 * height / rows - gap + 0.5, 0, 1)[..., None]
    return (skin * (1 - joint) + mortar * joint) * (
        1 + 0.05 * cloud(height, width, (height / 3, width / 3), 4, rng)
    )[..., None]


def tin_label(
    title: str,
    below: str,
    ground: np.ndarray,
    ink: np.ndarray,
    fruit: np.ndarray,
    seed: int,
) -> np.ndarray:
    """The paper once around a tin, (512, 1280): a front at each half, row 0 at the foot; faded, scuffed."""
    height, half = 512, 640
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0 : 1 : height * 1j, 0 : half / height : half * 1j]
    skin = np.broadcast_to(ground, (height, half, 3)).copy()

    def print_on(cover: np.ndarray, colour: np.ndarray) -> None:
        skin[:] = skin + (colour - skin) * np.clip(cover, 0, 1)[..., None]

    cream = srgb(216, 204, 170)
    print_on((np.abs(y - 0.5) > 0.40) * 1.0, ink)
    print_on((np.abs(np.abs(y - 0.5) - 0.385) < 0.012) * 1.0, cream)
    middle = half / height / 2
    oval = np.hypot((x - middle) / 0.50, (y - 0.36) / 0.19)
    print_on((1 - oval) * 60, cream)
    print_on(
        lettering((half, height), [(title, 0.5, 0.36, min(0.17, 1.1 / len(title)))]),
        ink,
    )
    for k in range(5):
        spot = np.hypot(x - middle - 0.17 * (k - 2), (y - 0.70 - 0.03 * (k % 2)))
        print_on((0.105 - spot) * 90, fruit * (0.75 + 0.1 * k))
        print_on(
            (
                0.022
                - np.hypot(
                    x - middle - 0.17 * (k - 2) + 0.035, y - 0.66 - 0.03 * (k % 2)
                )
            )
            * 60,
            cream,
        )
    print_on(
        lettering(
            (half, height),
            [(below, 0.5, 0.945, 0.05), ("NET WT 400 g", 0.5, 0.055, 0.045)],
        ),
        cream,
    )
    skin = np.concatenate([skin, skin], 1)
    scuff = (
        np.clip(cloud(height, 2 * half, (160, 200), 6, rng, 0.75) - 1.4, 0, 1)[
            ..., None
        ]
        * 0.6
    )
    age = 1 + 0.06 * cloud(height, 2 * half, (200, 200), 4, rng)[..., None]
    return np.clip(
        (skin * (1 - scuff) + scuff * srgb(206, 198, 180)) * age * 0.92, 0, 0.8
    )[::-1]


def stitched(size: int, seed: int = 0) -> np.ndarray:
    """A worn leather ball for a sphere, (size, 2 size): a seam with red stitches along a baseball's curve."""
    rng = np.random.default_rng(seed)
    latitude = (0.5 - (np.arange(size) + 0.5) / size) * np.pi
    longitude = (np.arange(2 * size) + 0.5) / size * np.pi
    z = np.sin(latitude)[:, None] + 0 * longitude
    x, y = (
        np.cos(latitude)[:, None] * np.cos(longitude),
        np.cos(latitude)[:, None] * np.sin(longitude),
    )
    curve = np.linspace(0, 2 * np.pi, 217)[:-1]
    a = 0.44
    seam = np.stack(
        [
            a * np.cos(3 * curve) + (1 - a) * np.cos(curve),
            a * np.sin(3 * curve) - (1 - a) * np.sin(curve),
        ],
        1,
    )
    seam = np.column_stack([seam, 2 * np.sqrt(a * (1 - a)) * np.sin(2 * curve)])
    seam /= np.linalg.norm(seam, axis=1, keepdims=True)
    near = np.einsum("hwc,kc->hwk", np.stack([x, y, z], -1)[::2, ::2], seam)
    away = cv2.resize(
        np.arccos(np.clip(near.max(-1), -1, 1)).astype(np.float32), (2 * size, size)
    )
    number = cv2.resize(
        near.argmax(-1).astype(np.float32),
        (2 * size, size),
        interpolation=cv2.INTER_NEAREST,
    )
    hide = (
        srgb(196, 184, 160)
        * (1 + 0.07 * cloud(size, 2 * size, (size / 3, size / 3), 5, rng, 0.6))[
            ..., None
        ]
    )
    dirt = (
        np.clip(cloud(size, 2 * size, (size / 3, size / 3), 5, rng, 0.7) - 0.5, 0, 1.4)[
            ..., None
        ]
        * 0.4
    )
    hide = hide * (1 - dirt) + dirt * srgb(104, 84, 62)
    thread = ((away > 0.02) & (away < 0.11) & (number % 4 < 2))[..., None] * 0.85
    hide = hide * (1 - thread) + thread * srgb(158, 36, 32)
    return hide * (1 - 0.6 * (away < 0.014)[..., None])


def fairground(height: int, width: int, seed: int = 0) -> np.ndarray:
    """A fair at night from afar, radiance: strings of coloured bulbs, lit stalls, a wheel; row 0 is the lowest."""
    rng = np.random.default_rng(seed)
    scene = np.zeros((height, width, 3), np.float32)
    scene += np.linspace(0.012, 0.03, height)[:, None, None] * np.array([0.5, 0.6, 1.1])
    colours = np.array(
        [
            (1, 0.62, 0.25),
            (1, 0.2, 0.1),
            (0.25, 0.85, 0.35),
            (0.25, 0.45, 1),
            (1, 0.78, 0.5),
            (1, 0.35, 0.65),
        ]
    )
    for k in range(9):  # stalls: lit from under their roofs
        left, tall = (
            (k + rng.uniform(0, 0.6)) / 9 * width,
            rng.uniform(0.08, 0.16) * height,
        )
        rows, columns = (
            slice(int(0.80 * height - tall), int(0.80 * height)),
            slice(int(left), int(left + 0.05 * width)),
        )
        fade = np.linspace(1, 0.15, rows.stop - rows.start)[:, None, None] ** 2
        scene[rows, columns] += 0.16 * fade * colours[rng.choice([0, 4, 0, 1])]
    middle, radius = (0.76 * width, 0.36 * height), 0.27 * height
    spots = [
        (
            middle[0] + radius * np.cos(t),
            middle[1] + radius * np.sin(t),
            colours[k % 2 * 4],
        )
        for k, t in enumerate(np.linspace(0, 2 * np.pi, 25)[:-1])
    ]
    for _ in range(4):
        y0, sag, lag = (
            rng.uniform(0.08, 0.5) * height,
            rng.uniform(0.08, 0.2) * height,
            rng.uniform(0, 1),
        )
        for t in np.linspace(0, 1, 17) + rng.uniform(0, 0.06):
            drop = sag * np.sin(np.pi * ((2 * t + lag) % 1))
            spots.append(
                (
                    (t + rng.normal(0, 0.004)) * width,
                    y0 + drop + rng.normal(0, 4),
                    colours[rng.integers(6)],
                )
            )
    for x, y, colour in spots:
        disc = np.zeros((height, width), np.float32)
        cv2.circle(disc, (int(x), int(y)), max(2, height // 110), 1.0, -1, cv2.LINE_AA)
        scene += disc[..., None] * colour * rng.uniform(2, 9)
    return scene[::-1]


def kraft(height: int, width: int, seed: int = 0) -> np.ndarray:
    """Brown corrugated board: fibres, faint flutes, scuffs."""
    rng = np.random.default_rng(seed)
    tone = np.array([186, 146, 104]) + rng.normal(0, 6) + rng.normal(0, 2, 3)
    fibre = 0.5 * noise(height, width, (2, 5), rng) + 0.5 * cloud(
        height, width, (6, 12), 3, rng, 0.8
    )
    flutes = np.sin(np.arange(width) / width * 2 * np.pi * 52)[None] * 0.015
    broad = cloud(height, width, (height / 2, width / 2), 4, rng)
    return (
        worn(srgb(*tone), height, width, seed, 0.02, 0.2)
        * (1 + 0.05 * fibre + flutes + 0.04 * broad)[..., None]
    )


def carton(size: tuple[float, float], seed: int, marks: str = "") -> np.ndarray:
    """The front of a cardboard box of `size` m, row 0 at its foot: tape, worn edges, a label, printed marks."""
    scale = 1100
    width, height = (round(v * scale) for v in size)
    rng = np.random.default_rng(seed)
    skin = kraft(height, width, seed)
    y, x = np.mgrid[:height, :width]

    def cover(mask: np.ndarray, colour: np.ndarray) -> None:
        skin[:] = skin + (colour - skin) * np.clip(mask, 0, 1)[..., None]

    edge = (
        np.minimum(np.minimum(x, width - 1 - x), np.minimum(y, height - 1 - y)) / scale
    )
    rough = 0.004 * cloud(height, width, (40, 40), 4, rng)
    cover(np.clip(1 - (edge + rough) / 0.006, 0, 1) * 0.35, srgb(214, 186, 150))
    tape = srgb(186, 146, 92) if seed % 3 else srgb(206, 190, 160)
    middle = width / 2 + rng.normal(0, 3)
    for reach, side in ((rng.uniform(0.05, 0.075), 0), (rng.uniform(0.04, 0.07), 1)):
        down = (y if side == 0 else height - 1 - y) / scale
        jag = 0.001 * np.sin(x * 1.3)
        cover(
            0.75 * (np.abs(x - middle) < 0.025 * scale) * (down < reach + jag),
            tape * 0.9,
        )
    if marks:
        words = marks.split("|")
        lines = [(word, 0.30, 0.70 + 0.13 * k, 0.10) for k, word in enumerate(words)]
        ink = srgb(150, 40, 32) if seed % 2 else srgb(44, 40, 38)
        cover(0.8 * lettering((width, height), lines), ink)
        for left in (0.82, 0.90):  # this way up
            right, up = (x - left * width) / scale, (0.80 * height - y) / scale
            shaft = (np.abs(right) < 0.0025) & (np.abs(up) < 0.02)
            head = (up > 0.012) & (np.abs(right) < (0.026 - up) * 0.8)
            cover(0.8 * (shaft | head), ink)
    tall, wide = 0.075 * scale, 0.105 * scale
    left, top = rng.uniform(0.08, 0.2) * width, rng.uniform(0.22, 0.3) * height
    if seed % 2:
        left = width - wide - left
    turn = rng.normal(0, 0.03)
    u = ((x - left) * np.cos(turn) + (y - top) * np.sin(turn)) / wide
    v = ((y - top) * np.cos(turn) - (x - left) * np.sin(turn)) / tall
    inside = (u > 0) & (u < 1) & (v > 0) & (v < 1)
    cover(inside * 0.95, srgb(206, 206, 200))
    bars = np.repeat(rng.random(60) < 0.5, 4)[np.clip(u * 240, 0, 239).astype(int)]
    cover(
        inside * bars * (np.abs(v - 0.76) < 0.14) * (np.abs(u - 0.5) < 0.42) * 0.9,
        srgb(30, 30, 32),
    )
    for row, stretch in ((0.12, 0.5), (0.22, 0.7), (0.31, 0.62), (0.40, 0.3)):
        dots = np.repeat(rng.random(60) < 0.75, 4)[np.clip(u * 240, 0, 239).astype(int)]
        cover(
            inside
            * dots
            * (np.abs(v - row) < 0.022)
            * (u > 0.08)
            * (u < 0.08 + stretch)
            * 0.8,
            srgb(40, 40, 44),
        )
    return np.clip(skin, 0.01, 0.8)[::-1]
