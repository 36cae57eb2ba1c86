"""Files with several pictures, and the formats of phones."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pillow_heif
import pillow_jxl  # noqa: F401  registers its format with Pillow
import pytest
from PIL import Image
from test_photos import (
    P3_TO_XYZ,
    XYZ_TO_SRGB,
    far,
    levels,
    linear,
    srgb,
    stored,
)

from physgen.cli.main import main
from physgen.files import install
from physgen.phone_formats import jxl_size
from physgen.photos import read_photo
from physgen.problems import InputError

pillow_heif.register_heif_opener()
H, W = 48, 64


@pytest.fixture
def picture() -> np.ndarray:
    """(H, W, 3): flat fields, so that compression keeps their levels; no two corners alike."""
    rgb = np.full((H, W, 3), 128, np.uint8)
    rgb[: H // 2, : W // 2] = 200, 60, 50
    rgb[H // 2 :, : W // 2] = 60, 170, 70
    rgb[: H // 2, W // 2 :] = 70, 80, 190
    return rgb


def fields(rgb: np.ndarray) -> np.ndarray:
    """Levels in the middle of each quarter."""
    height, width = rgb.shape[:2]
    rows, columns = (height // 4, 3 * height // 4), (width // 4, 3 * width // 4)
    return rgb[np.ix_(rows, columns)]


# ---- pages of TIFF ----


def marked(path: Path, kinds: list[int]) -> Path:
    """The NewSubfileType of each page written into the file: bytes of tag 254, which each page has."""
    data = bytearray(path.read_bytes())
    (offset,) = struct.unpack_from("<I", data, 4)
    for kind in kinds:
        (count,) = struct.unpack_from("<H", data, offset)
        for entry in range(offset + 2, offset + 2 + 12 * count, 12):
            if struct.unpack_from("<H", data, entry)[0] == 254:
                struct.pack_into("<HHII", data, entry, 254, 4, 1, kind)
        (offset,) = struct.unpack_from("<I", data, offset + 2 + 12 * count)
    path.write_bytes(data)
    return path


def pages_of(path: Path, pages: list[np.ndarray], kinds: list[int] | None) -> Path:
    images = [Image.fromarray(page) for page in pages]
    options = {} if kinds is None else {"tiffinfo": {254: 0}}
    images[0].save(path, save_all=True, append_images=images[1:], **options)
    return path if kinds is None else marked(path, kinds)


@pytest.mark.parametrize("kinds", [None, [1, 0], [1, 2]])
def test_tiff_with_thumbnail_first_gives_photo(
    picture: np.ndarray, tmp_path: Path, kinds: list[int] | None
) -> None:
    thumbnail = picture[::4, ::4]
    path = pages_of(tmp_path / "a.tif", [thumbnail, picture], kinds)
    assert np.array_equal(read_photo(path).rgb, picture)


def test_marked_copy_of_any_size_is_passed_over(
    picture: np.ndarray, tmp_path: Path
) -> None:
    path = pages_of(tmp_path / "a.tif", [255 - picture, picture], [1, 0])
    assert np.array_equal(read_photo(path).rgb, picture)
    path = pages_of(tmp_path / "a.tif", [255 - picture, picture], [4, 0])
    assert np.array_equal(read_photo(path).rgb, picture)


def test_first_full_page_of_a_document_is_read(
    picture: np.ndarray, tmp_path: Path
) -> None:
    other = 255 - picture
    path = pages_of(tmp_path / "a.tif", [picture, other], [2, 2])
    assert np.array_equal(read_photo(path).rgb, picture)
    pages = [picture, picture[::2, ::2], picture[::4, ::4]]
    assert np.array_equal(
        read_photo(pages_of(tmp_path / "p.tif", pages, None)).rgb, picture
    )
    pages = [picture[:40, :50], picture]
    assert read_photo(pages_of(tmp_path / "q.tif", pages, None)).rgb.shape == (
        40,
        50,
        3,
    )


def test_deep_page_behind_a_thumbnail_keeps_16_bits(
    picture: np.ndarray, tmp_path: Path
) -> None:
    deep = picture.astype(np.uint16) * 257 + 128
    thumbnail = deep[::4, ::4]
    path = tmp_path / "deep.tif"
    assert cv2.imwritemulti(str(path), [thumbnail[..., ::-1], deep[..., ::-1]])
    expected = levels(deep / 65535)
    assert np.array_equal(read_photo(path).rgb, expected)


def test_tiff_of_thumbnails_alone_is_refused(
    picture: np.ndarray, tmp_path: Path
) -> None:
    path = pages_of(tmp_path / "a.tif", [picture[::4, ::4], picture], [1, 1])
    with pytest.raises(InputError):
        read_photo(path)


def planar_tiff(rgb: np.ndarray, order: str) -> bytes:
    """A TIFF (H, W, 3) of 16 bits, each channel in a strip by itself; `order` is < or >."""
    height, width = rgb.shape[:2]
    planes = np.moveaxis(rgb, 2, 0).astype(f"{order}u2").tobytes()
    size = len(planes) // 3
    tags = [(256, width), (257, height), (259, 1), (262, 2), (277, 3), (278, height)]
    behind = 8 + 2 + 12 * (len(tags) + 4) + 4
    start = behind + 6 + 24
    entries = [struct.pack(order + "HHIHH", tag, 3, 1, value, 0) for tag, value in tags]
    entries += [
        struct.pack(order + "HHII", 258, 3, 3, behind),
        struct.pack(order + "HHII", 273, 4, 3, behind + 6),
        struct.pack(order + "HHII", 279, 4, 3, behind + 18),
        struct.pack(order + "HHIHH", 284, 3, 1, 2, 0),
    ]
    entries.sort(key=lambda entry: struct.unpack(order + "H", entry[:2]))
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", 8)
    offsets = [start, start + size, start + 2 * size]
    arrays = struct.pack(order + "3H6I", 16, 16, 16, *offsets, size, size, size)
    count = struct.pack(order + "H", len(entries))
    return head + count + b"".join(entries) + bytes(4) + arrays + planes


@pytest.mark.parametrize("order", ["<", ">"])
def test_deep_tiff_of_separate_planes_is_refused(
    picture: np.ndarray, tmp_path: Path, order: str
) -> None:
    path = tmp_path / "a.tif"
    path.write_bytes(planar_tiff(picture.astype(np.uint16) * 257, order))
    with pytest.raises(InputError):
        read_photo(path)


# ---- formats of phones ----

PHONE_FILES = {
    "a.heic": {"quality": 95, "chroma": 444},
    "a.avif": {"quality": 95, "subsampling": "4:4:4"},
    "a.jxl": {"lossless": True, "use_container": True},
}


@pytest.mark.parametrize("name", PHONE_FILES)
def test_phone_formats_are_read(picture: np.ndarray, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    Image.fromarray(picture).save(path, **PHONE_FILES[name])
    photo = read_photo(path)
    assert photo.rgb.shape == picture.shape
    assert far(fields(photo.rgb), fields(picture)) <= 4
    assert photo.readable
    assert not photo.plain


@pytest.mark.parametrize("name", ["a.heic", "a.avif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_phone_photos_are_upright(
    picture: np.ndarray, tmp_path: Path, name: str, orientation: int
) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    image = Image.fromarray(stored(picture, orientation))
    image.save(tmp_path / name, exif=exif.tobytes(), **PHONE_FILES[name])
    photo = read_photo(tmp_path / name)
    assert photo.rgb.shape == picture.shape
    assert far(fields(photo.rgb), fields(picture)) <= 4


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("has_jpeg", [True, False])
@pytest.mark.filterwarnings("ignore:Using JPEG reconstruction")
def test_jpeg_xl_is_turned_once(
    picture: np.ndarray, tmp_path: Path, orientation: int, has_jpeg: bool
) -> None:
    """A JPEG in a JPEG XL file; without the data that restore the JPEG, the decoder turns the picture itself."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    image = Image.fromarray(stored(picture, orientation))
    image.save(tmp_path / "a.jpg", exif=exif, quality=98, subsampling=0)
    path = tmp_path / "a.jxl"
    with Image.open(tmp_path / "a.jpg") as jpeg:
        jpeg.save(path)
    if not has_jpeg:
        path.write_bytes(without_box(path.read_bytes(), b"jbrd"))
    photo = read_photo(path)
    assert photo.rgb.shape == picture.shape
    assert far(fields(photo.rgb), fields(picture)) <= 4


def without_box(data: bytes, kind: bytes) -> bytes:
    rest, start = b"", 0
    while start < len(data):
        size = struct.unpack_from(">I", data, start)[0] or len(data) - start
        if data[start + 4 : start + 8] != kind:
            rest += data[start : start + size]
        start += size
    return rest


@pytest.mark.parametrize("name", ["a.heic", "a.avif"])
def test_code_points_of_phone_photos_are_applied(
    picture: np.ndarray, tmp_path: Path, name: str
) -> None:
    path = tmp_path / name
    Image.fromarray(picture).save(path, **PHONE_FILES[name])
    data = path.read_bytes()
    start = data.index(b"nclx") + 4
    assert data[start : start + 4] == b"\0\1\0\x0d"
    path.write_bytes(data[: start + 1] + b"\x0c" + data[start + 2 :])
    meant = srgb(linear(picture / 255) @ (XYZ_TO_SRGB @ P3_TO_XYZ).T)
    assert far(fields(read_photo(path).rgb), fields(levels(meant))) <= 4
    path.write_bytes(data[:start] + b"\0\x09\0\x10" + data[start + 4 :])
    with pytest.raises(InputError):
        read_photo(path)


@pytest.mark.parametrize("name", PHONE_FILES)
def test_damaged_phone_photos_get_one_line(
    picture: np.ndarray,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    name: str,
) -> None:
    path = tmp_path / name
    Image.fromarray(picture).save(path, **PHONE_FILES[name])
    data = path.read_bytes()
    for part in (0.1, 0.5, 0.9):
        path.write_bytes(data[: int(part * len(data))])
        assert main(["perceive", str(path), "-o", str(tmp_path / "s.yaml")]) == 2
        [line] = capfd.readouterr().err.splitlines()
        assert line.startswith(f"{path}: ")


@pytest.mark.parametrize("name", ["a.heic", "a.jxl"])
def test_missing_reader_names_its_extra(
    picture: np.ndarray, tmp_path: Path, name: str
) -> None:
    """In a process that cannot import the libraries of the extra."""
    path = tmp_path / name
    Image.fromarray(picture).save(path, **PHONE_FILES[name])
    code = (
        "import sys\n"
        "sys.modules['pillow_heif'] = sys.modules['pillow_jxl'] = None\n"
        "from physgen.cli.main import main\n"
        f"sys.exit(main(['perceive', {str(path)!r}]))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert run.returncode == 2
    [line] = run.stderr.splitlines()
    assert line.startswith(f"{path}: ")
    assert install("phone") in line


@pytest.mark.parametrize(
    "size", [(64, 48), (8, 8), (256, 256), (300, 200), (257, 8), (1000, 3), (640, 360)]
)
@pytest.mark.parametrize("has_container", [False, True])
def test_size_of_jpeg_xl_is_known_before_decoding(
    tmp_path: Path, size: tuple[int, int], has_container: bool
) -> None:
    path = tmp_path / "a.jxl"
    Image.new("RGB", size, "teal").save(path, use_container=has_container)
    assert jxl_size(path) == size


def test_large_jpeg_xl_is_refused_before_decoding(tmp_path: Path) -> None:
    path = tmp_path / "a.jxl"
    Image.new("RGB", (1000, 1000), "teal").save(path)
    side = 1 << 18 | 65_000 - 1  # its two bits of a selector and 18 bits of a side
    bits = 0b10 << 1 | (side & ((1 << 18) - 1)) << 3 | 1 << 21  # as wide as high
    data = bytearray(path.read_bytes())
    data[2:6] = bits.to_bytes(4, "little")
    path.write_bytes(data)
    assert jxl_size(path) == (65_000, 65_000)
    with pytest.raises(InputError, match="65000 x 65000 px"):
        read_photo(path)


@pytest.mark.slow
def test_phone_photo_becomes_a_scene(tmp_path: Path) -> None:
    y, x = np.mgrid[0:60, 0:80]
    inside = np.hypot(x - 40, y - 30) < 16
    rgb = np.where(inside[..., None], (180, 50, 50), (150, 158, 165)).astype(np.uint8)
    Image.fromarray(rgb).save(tmp_path / "IMG_1.HEIC", quality=90)
    Image.fromarray(inside.astype(np.uint8)).save(tmp_path / "m.png")
    scene, masks = tmp_path / "s.yaml", str(tmp_path / "m.png")
    photo = str(tmp_path / "IMG_1.HEIC")
    assert main(["perceive", photo, "--masks", masks, "-o", str(scene)]) == 0
    assert "image: s.assets/IMG_1.png" in scene.read_text()
    assert main(["check", str(scene)]) == 0
