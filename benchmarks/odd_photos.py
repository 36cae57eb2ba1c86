"""Photos of odd kinds: sizes, contents, file formats, metadata, damages and names.

`write_odd_photo` draws a small picture of one of `CONTENTS`, stores it in one of
`CONTAINERS`, damages it now and then, and gives it a name that people use.
"""

from __future__ import annotations

import io
import random
import struct
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageCms, PngImagePlugin

U8 = NDArray[np.uint8]
Content = Callable[[int, int, random.Random], U8]
"""(width, height, chance) -> (height, width, 3)."""
Container = Callable[[Image.Image, random.Random], bytes]

ROOT = Path(__file__).resolve().parent.parent
ORIENTATION = 0x0112
"""Tag of EXIF (CIPA DC-008, 4.6.4)."""
SIZES = (
    (1, 1), (1, 2), (2, 1), (3, 3), (8, 8), (1, 300), (300, 1), (17, 300), (16, 16), (31, 64),
    (9000, 3), (3, 9000), (2000, 40), (600, 60), (60, 400),
)  # fmt: skip
"""Width and height, px, of pictures that are no photos."""
USUAL_SIZES = (64, 240)
"""px: limits of a side of all others; perception of larger ones takes long."""
NAMES = (
    "my photo", "it's", 'a "b"', "two\nlines", "фото", "写真", "🙂", "100%", "%s%d", "-photo", "--help",
    "a;b", "a&b", "$HOME", "`id`", "#1", "a:b", "a, b", "{x}", "[1]", "*", "?", ".hidden", "a.b.c",
    "photo.", " photo", "photo ", "e\u0301", "\u202egnp", "null", "123", "x" * 200, "CON", "~", "a\tb",
    "- a", "! b", "& c", "@d", "'", "a # b", "\udcff",
)  # fmt: skip
"""Names of files, without suffix; the last one is not UTF-8."""


# Contents


def photograph(width: int, height: int, chance: random.Random) -> U8:
    """A bundled photo, made small."""
    file = chance.choice(sorted(ROOT.glob("scenes/*/photo.png")))
    return cv2.resize(cv2.imread(str(file)), (width, height))[:, :, ::-1]


def one_colour(width: int, height: int, chance: random.Random) -> U8:
    """Black, white, grey or any colour."""
    levels = chance.choice(((0,) * 3, (255,) * 3, (128,) * 3, (200, 30, 90)))
    return np.full((height, width, 3), levels, np.uint8)


def noise(width: int, height: int, chance: random.Random) -> U8:
    """White noise, of colours or of greys."""
    channels = chance.choice((1, 3))
    generator = np.random.default_rng(chance.randrange(2**32))
    levels = generator.integers(0, 256, (height, width, channels), np.uint8)
    return np.repeat(levels, 3 // channels, axis=2)


def dark(width: int, height: int, chance: random.Random) -> U8:
    """A photo with almost no light."""
    share = chance.choice((0.005, 0.02, 0.06))
    return (photograph(width, height, chance) * share).astype(np.uint8)


def bright(width: int, height: int, chance: random.Random) -> U8:
    """A photo that is overexposed."""
    lift = chance.choice((150, 220, 250))
    lighter = photograph(width, height, chance).astype(int) + lift
    return np.minimum(lighter, 255).astype(np.uint8)


def grey(width: int, height: int, chance: random.Random) -> U8:
    """A photo without colours."""
    levels = cv2.cvtColor(photograph(width, height, chance), cv2.COLOR_RGB2GRAY)
    return np.repeat(levels[:, :, None], 3, axis=2)


def blurred(width: int, height: int, chance: random.Random) -> U8:
    """A photo out of focus."""
    return cv2.GaussianBlur(photograph(width, height, chance), (0, 0), 12)


def screenshot(width: int, height: int, chance: random.Random) -> U8:
    """Lines of text on a plain ground."""
    ground = chance.choice((255, 30))
    picture = np.full((height, width, 3), ground, np.uint8)
    ink = (255 - ground,) * 3
    for line in range(14, height, 14):
        words = "".join(chance.choices("etaoin shrdlu  ", k=60))
        cv2.putText(picture, words, (4, line), cv2.FONT_HERSHEY_PLAIN, 0.8, ink)
    return picture


def drawing(width: int, height: int, chance: random.Random) -> U8:
    """Outlines of figures on paper."""
    picture = np.full((height, width, 3), 250, np.uint8)
    for _ in range(chance.choice((1, 5, 40))):
        centre = (chance.randrange(width), chance.randrange(height))
        radius = chance.randrange(1, max(2, min(width, height) // 4))
        thickness = chance.choice((1, 2, -1))
        ink = tuple(chance.randrange(200) for _ in range(3))
        cv2.circle(picture, centre, radius, ink, thickness)
    return picture


def pattern(width: int, height: int, chance: random.Random) -> U8:
    """Stripes or squares that repeat."""
    y, x = np.mgrid[:height, :width]
    period = chance.choice((1, 2, 5, 16, 40))
    is_light = (
        x // period % 2 if chance.random() < 0.4 else (x // period + y // period) % 2
    )
    return np.repeat((is_light * 255).astype(np.uint8)[:, :, None], 3, axis=2)


def gradient(width: int, height: int, chance: random.Random) -> U8:
    """A sky, from light to dark."""
    levels = np.linspace(*chance.choice(((0, 255), (255, 0), (100, 110))), height)
    picture = np.broadcast_to(levels[:, None, None], (height, width, 3))
    return np.ascontiguousarray(picture, np.uint8)


def copies(width: int, height: int, chance: random.Random) -> U8:
    """One photo, several times side by side."""
    tile = photograph(max(width // 3, 1), max(height // 2, 1), chance)
    tiled = np.tile(tile, (3, 4, 1))[:height, :width]
    return np.ascontiguousarray(tiled)


def framed(width: int, height: int, chance: random.Random) -> U8:
    """A photo with a broad border, as scans and posts have it."""
    picture = photograph(width, height, chance).copy()
    border = max(1, min(width, height) // 5)
    level = chance.choice((0, 255))
    picture[:border] = picture[-border:] = level
    picture[:, :border] = picture[:, -border:] = level
    return picture


CONTENTS: tuple[Content, ...] = (
    photograph, photograph, photograph, one_colour, noise, dark, bright, grey, blurred,
    screenshot, drawing, pattern, gradient, copies, framed,
)  # fmt: skip


# Containers


def save(image: Image.Image, kind: str, **options: object) -> bytes:
    """Return the bytes of a picture in a format of Pillow's."""
    stream = io.BytesIO()
    image.save(stream, kind, **options)
    return stream.getvalue()


def png(image: Image.Image, chance: random.Random) -> bytes:
    return save(image, "PNG")


def png_of_few_bits(image: Image.Image, chance: random.Random) -> bytes:
    """1, 2, 4 or 8 bits: black and white, greys or a palette."""
    colours = chance.choice((2, 4, 16, 256))
    if colours == 2 and chance.random() < 0.5:
        return save(image.convert("1"), "PNG")
    return save(image.quantize(colours), "PNG")


def png_of_palette_with_transparency(
    image: Image.Image, chance: random.Random
) -> bytes:
    transparency = chance.choice((0, bytes(16), bytes(range(0, 256, 16))))
    return save(image.quantize(16), "PNG", transparency=transparency)


def png_of_16_bits(image: Image.Image, chance: random.Random) -> bytes:
    channels = chance.choice((1, 3, 4))
    levels = np.asarray(image).astype(np.uint16) * 257
    if channels == 4:
        alpha = np.full(levels.shape[:2], chance.choice((0, 30_000, 65_535)), np.uint16)
        levels = np.dstack([levels, alpha])
    return cv2.imencode(".png", levels[:, :, :channels])[1].tobytes()


def png_with_alpha(image: Image.Image, chance: random.Random) -> bytes:
    """Transparent everywhere, almost so, or in parts."""
    alpha = Image.new("L", image.size, chance.choice((0, 0, 1, 128)))
    if chance.random() < 0.3:
        alpha = image.convert("L")
    mode = chance.choice(("RGB", "L"))
    picture = image.convert(mode)
    picture.putalpha(alpha)
    return save(picture, "PNG")


def png_with_colour_chunk(image: Image.Image, chance: random.Random) -> bytes:
    """gAMA, cHRM, cICP, sRGB, sBIT or tRNS, with usual and senseless values."""
    gamma = chance.choice((45_455, 100_000, 55_556, 1, 0, 2**32 - 1))
    white = chance.choice((31_270, 0, 2**31))
    primaries = chance.choice((1, 9, 12, 0, 255))
    transfer = chance.choice((13, 1, 8, 16, 18, 255))
    chunks = {
        b"gAMA": struct.pack(">I", gamma),
        b"cHRM": struct.pack(">8I", white, 32_900, 64_000, 33_000, 30_000, 60_000, 15_000, 6_000),
        b"cICP": bytes((primaries, transfer, chance.choice((0, 0, 1)), chance.choice((0, 1)))),
        b"sRGB": bytes((chance.choice((0, 3, 9)),)),
        b"sBIT": bytes((chance.choice((0, 5, 8, 200)),) * 3),
        b"tRNS": struct.pack(">3H", 0, 0, 0),
        b"gAM\xff": b"",
        b"eXIf": chance.choice((b"", b"II*\0", b"MM\0*" + b"\xff" * 20)),
    }  # fmt: skip
    names = chance.sample(list(chunks), chance.choice((1, 1, 2)))
    return with_chunks(save(image, "PNG"), {name: chunks[name] for name in names})


def with_chunks(data: bytes, chunks: dict[bytes, bytes]) -> bytes:
    """Insert chunks behind the header of a PNG, which ends at byte 33."""
    inserted = b""
    for name, body in chunks.items():
        checksum = zlib.crc32(name + body)
        inserted += struct.pack(">I", len(body)) + name + body
        inserted += struct.pack(">I", checksum)
    return data[:33] + inserted + data[33:]


def png_with_texts(image: Image.Image, chance: random.Random) -> bytes:
    """Long comments, and a time in the future."""
    info = PngImagePlugin.PngInfo()
    info.add_text("Comment", "x" * chance.choice((0, 10, 100_000)), zip=True)
    info.add_itxt("Titel", "ü\n{}%s")
    info.add(b"tIME", bytes((255,) * 7))
    return save(image, "PNG", pnginfo=info)


def animated_png(image: Image.Image, chance: random.Random) -> bytes:
    return save(image, "PNG", save_all=True, append_images=turned(image, chance))


def jpeg(image: Image.Image, chance: random.Random) -> bytes:
    """Any quality, subsampling and order."""
    quality = chance.choice((1, 20, 90, 100))
    return save(image, "JPEG", quality=quality, progressive=chance.random() < 0.5)


def grey_jpeg(image: Image.Image, chance: random.Random) -> bytes:
    return save(image.convert("L"), "JPEG")


def cmyk_jpeg(image: Image.Image, chance: random.Random) -> bytes:
    options = {}
    if chance.random() < 0.5:
        options["icc_profile"] = odd_profile(chance)
    return save(image.convert("CMYK"), "JPEG", **options)


def jpeg_with_orientation(image: Image.Image, chance: random.Random) -> bytes:
    """Orientations 1 to 8, and some that do not exist."""
    exif = Image.Exif()
    exif[ORIENTATION] = chance.choice((1, 2, 3, 4, 5, 6, 7, 8, 0, 9, 65_535))
    return save(image, "JPEG", exif=exif)


def file_with_orientation(image: Image.Image, chance: random.Random) -> bytes:
    exif = Image.Exif()
    exif[ORIENTATION] = chance.choice((2, 3, 5, 6, 8))
    return save(image, chance.choice(("PNG", "WEBP", "TIFF")), exif=exif)


def jpeg_with_damaged_exif(image: Image.Image, chance: random.Random) -> bytes:
    bodies = (b"Exif\0\0", b"Exif\0\0II*\0\xff\xff\xff\xff", b"Exif\0\0" + bytes(60))
    return save(image, "JPEG", exif=chance.choice(bodies))


def file_with_profile(image: Image.Image, chance: random.Random) -> bytes:
    kind = chance.choice(("PNG", "JPEG", "WEBP", "TIFF"))
    if chance.random() < 0.3:
        image = image.convert("L")
    return save(image, kind, icc_profile=odd_profile(chance))


def odd_profile(chance: random.Random) -> bytes:
    """A profile of another kind of colours, cut off, empty or of noise."""
    profile = sound_profile(chance.choice(("sRGB", "LAB", "XYZ")))
    length = chance.randrange(len(profile))
    return chance.choice((
        profile, profile[:length], b"x", bytes(128), chance.randbytes(600),
        profile[:16] + b"CMYK" + profile[20:], profile[:16] + b"GRAY" + profile[20:],
        profile[:40] + chance.randbytes(200) + profile[240:],
    ))  # fmt: skip


@cache
def sound_profile(space: str) -> bytes:
    return ImageCms.ImageCmsProfile(ImageCms.createProfile(space)).tobytes()


def tiff(image: Image.Image, chance: random.Random) -> bytes:
    """Any compression and mode."""
    compression = chance.choice(
        ("raw", "tiff_lzw", "tiff_adobe_deflate", "packbits", "jpeg")
    )
    modes = (
        ("RGB",)
        if compression == "jpeg"
        else ("RGB", "L", "1", "RGBA", "CMYK", "LAB", "F", "I;16")
    )
    mode = chance.choice(modes)
    picture = image.convert(mode) if mode != "I;16" else wide(image)
    return save(picture, "TIFF", compression=compression)


def wide(image: Image.Image) -> Image.Image:
    """Return a grey picture of 16 bits."""
    return Image.fromarray(np.asarray(image.convert("L")).astype(np.uint16) * 257)


def tiff_of_pages(image: Image.Image, chance: random.Random) -> bytes:
    """Several pages, the first of which may be the smallest."""
    pages = turned(image, chance)
    if chance.random() < 0.5:
        small = image.resize((max(1, image.width // 4), max(1, image.height // 4)))
        return save(small, "TIFF", save_all=True, append_images=[image, *pages])
    return save(image, "TIFF", save_all=True, append_images=pages)


def gif(image: Image.Image, chance: random.Random) -> bytes:
    """Still, animated or transparent."""
    few = image.quantize(chance.choice((2, 64, 256)))
    frames = [frame.quantize(64) for frame in turned(image, chance)]
    ways: tuple[dict[str, object], ...] = (
        {},
        {"save_all": True, "append_images": frames, "duration": 0},
        {"transparency": 0},
    )
    return save(few, "GIF", **chance.choice(ways))


def webp(image: Image.Image, chance: random.Random) -> bytes:
    """Lossless or not, animated or not, with or without opacity."""
    picture = image
    if chance.random() < 0.4:
        picture = image.convert("RGBA")
        picture.putalpha(chance.choice((0, 100, 255)))
    options: dict[str, object] = {"lossless": chance.random() < 0.5}
    if chance.random() < 0.4:
        options |= {"save_all": True, "append_images": turned(picture, chance)}
    return save(picture, "WEBP", **options)


def avif(image: Image.Image, chance: random.Random) -> bytes:
    return save(image, "AVIF")


def other_format(image: Image.Image, chance: random.Random) -> bytes:
    """Formats that perceive reads or refuses."""
    kind = chance.choice(
        (
            "BMP",
            "PPM",
            "TGA",
            "ICO",
            "JPEG2000",
            "PDF",
            "PCX",
            "SGI",
            "DDS",
            "QOI",
            "ICNS",
            "EPS",
        )
    )
    if kind in ("ICO", "ICNS"):
        image = image.resize((64, 64))
    return save(image, kind)


def no_picture(image: Image.Image, chance: random.Random) -> bytes:
    """Other files: text, drawings as text, programs, video, nothing."""
    return chance.choice((
        b"", b"\0", b"hello\n", b"<svg xmlns='http://www.w3.org/2000/svg'/>", b"%PDF-1.4\n",
        b"<!doctype html><title>404</title>", b"physgen: 1\n", b"\x7fELF" + bytes(100),
        b"\0\0\0\x18ftypheic" + bytes(60), b"\0\0\0\x0cJXL \r\n\x87\n", b"RIFF\x04\0\0\0WEBP",
        b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xe0", b"GIF89a", b"BM", b"II*\0", b"P6 1 1 255\n",
        b"P6 99999 99999 255\n", b"P3\n2 2\n255\n1 2 3", b"8BPS\0\1" + bytes(50),
    ))  # fmt: skip


def turned(image: Image.Image, chance: random.Random) -> list[Image.Image]:
    """Return further frames of an animation, of the same size."""
    return [image.rotate(90 * k) for k in range(1, chance.choice((2, 4)))]


CONTAINERS: tuple[tuple[Container, str], ...] = (
    (png, "png"), (png, "png"), (png, "png"), (png_of_few_bits, "png"),
    (png_of_palette_with_transparency, "png"), (png_of_16_bits, "png"), (png_with_alpha, "png"),
    (png_with_colour_chunk, "png"), (png_with_colour_chunk, "png"), (png_with_texts, "png"),
    (animated_png, "png"), (jpeg, "jpg"), (grey_jpeg, "jpeg"), (cmyk_jpeg, "jpg"),
    (jpeg_with_orientation, "jpg"), (jpeg_with_orientation, "JPG"), (file_with_orientation, "png"),
    (jpeg_with_damaged_exif, "jpg"), (file_with_profile, "png"), (file_with_profile, "jpg"),
    (tiff, "tif"), (tiff_of_pages, "tiff"), (gif, "gif"), (webp, "webp"), (avif, "avif"),
    (other_format, "bmp"), (no_picture, "jpg"),
)  # fmt: skip
SUFFIXES = (
    "png",
    "jpg",
    "PNG",
    "JPEG",
    "tif",
    "gif",
    "webp",
    "heic",
    "txt",
    "yaml",
    "mp4",
    "",
)


# A photo


def write_odd_photo(folder: Path, chance: random.Random) -> str:
    """Write a photo into a folder and return its name."""
    kind = chance.randrange(20)
    if kind == 0:
        return odd_file(folder, chance)
    width, height = odd_size(chance)
    content = chance.choice(CONTENTS)(width, height, chance)
    container, suffix = chance.choice(CONTAINERS)
    if kind < 6:
        container, suffix = png, "png"
    image = Image.fromarray(np.ascontiguousarray(content))
    data = store(container, image, chance)
    if chance.random() < 0.1:
        data = damage(data, chance)
    if chance.random() < 0.08:
        suffix = chance.choice(SUFFIXES)
    stem = chance.choice(NAMES) if chance.random() < 0.3 else "photo"
    name = f"{stem}.{suffix}" if suffix else stem
    (folder / name).write_bytes(data)
    return name


def odd_size(chance: random.Random) -> tuple[int, int]:
    """Return width and height in px."""
    if chance.random() < 0.2:
        return chance.choice(SIZES)
    return chance.randint(*USUAL_SIZES), chance.randint(*USUAL_SIZES)


def store(container: Container, image: Image.Image, chance: random.Random) -> bytes:
    """Return the file's bytes; of PNG if the format cannot hold such a picture."""
    try:
        return container(image, chance)
    except (OSError, ValueError, cv2.error):
        return save(image, "PNG")


def damage(data: bytes, chance: random.Random) -> bytes:
    """Cut the file off, change some bytes, or append others."""
    changed = bytearray(data)
    way = chance.randrange(4)
    if way < 2:
        return data[: chance.randrange(len(data) + 1)]
    if way == 2:
        return data + chance.randbytes(100)
    for _ in range(chance.choice((1, 10, 100))):
        if changed:
            changed[chance.randrange(len(changed))] = chance.randrange(256)
    return bytes(changed)


def odd_file(folder: Path, chance: random.Random) -> str:
    """Write a folder, a link or a file without permission in place of a photo."""
    name = "photo.png"
    path = folder / name
    sound = save(Image.fromarray(photograph(160, 120, chance)), "PNG")
    way = chance.randrange(7)
    if way == 0:
        path.mkdir()
    elif way == 1:
        path.symlink_to("nowhere.png")
    elif way == 2:
        path.symlink_to(name)
    elif way == 3:
        (folder / "original.png").write_bytes(sound)
        path.symlink_to("original.png")
    elif way == 4:
        (folder / "album").mkdir()
        (folder / "album" / name).write_bytes(sound)
        path.symlink_to("album")
    elif way == 5:
        path.write_bytes(sound)
        return chance.choice(
            (f"./{name}", f"{name}/", f"../home/{name}", f"nowhere/{name}")
        )
    else:
        path.write_bytes(sound)
        path.chmod(0)
    return name
