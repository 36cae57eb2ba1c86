"""One picture stored in every kind of file: read as the same sRGB, by published curves and matrices worked out here."""

from __future__ import annotations

import io
import logging
import struct
import warnings
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import av
import cv2
import icc_profiles as profiles
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageCms

from physgen.cli.main import main
from physgen.perceive.photo_size import shrink_photo
from physgen.photos import read_image, read_photo
from physgen.problems import InputError

F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]

ADOBE_TO_XYZ = np.array(
    [
        [0.5767309, 0.1855540, 0.1881852],
        [0.2973769, 0.6273491, 0.0752741],
        [0.0270343, 0.0706872, 0.9911085],
    ]
)
P3_TO_XYZ = np.array(
    [
        [0.4865709, 0.2656677, 0.1982173],
        [0.2289746, 0.6917385, 0.0792869],
        [0.0, 0.0451134, 1.0439444],
    ]
)
"""At D65, as Lindbloom prints them, the last from SMPTE EG 432-1."""
XYZ_TO_SRGB = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)


def linear(srgb: F64) -> F64:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def srgb(light: F64) -> F64:
    light = np.clip(light, 0, 1)
    return np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055
    )


def levels(shown: F64) -> U8:
    return np.round(shown * 255).astype(np.uint8)


def far(one: U8, other: U8) -> int:
    """The most that two pictures differ by, in levels."""
    assert one.shape == other.shape
    return int(np.abs(one.astype(int) - other).max())


H, W = 23, 34


@pytest.fixture
def true() -> F64:
    """(H, W, 3) sRGB 0..1: every hue, from black to white, no two corners alike."""
    y, x = np.mgrid[0:H, 0:W]
    ramp = np.stack([x / (W - 1), y / (H - 1), 1 - (x + y) / (H + W - 2)], axis=-1)
    ramp[:4, :4], ramp[-4:, -4:], ramp[:4, -4:] = 0, 1, [1, 0, 0]
    return ramp


@pytest.fixture
def shown(true: F64) -> U8:
    return levels(true)


def write16(path: Path, numbers: F64) -> Path:
    """(h, w[, 3 or 4]) 0..1 -> a file of 16 bits a channel, by OpenCV."""
    deep = np.round(numbers * 65535).astype(np.uint16)
    order = {3: [2, 1, 0], 4: [2, 1, 0, 3]}
    assert cv2.imwrite(
        str(path), deep if deep.ndim == 2 else deep[:, :, order[deep.shape[2]]]
    )
    return path


def chunked(path: Path, kind: bytes, body: bytes) -> Path:
    """A PNG with one chunk more, before its pixels."""
    data = path.read_bytes()
    chunk = (
        struct.pack(">I", len(body))
        + kind
        + body
        + struct.pack(">I", zlib.crc32(kind + body))
    )
    path.write_bytes(data[:33] + chunk + data[33:])
    return path


def profiled(path: Path, profile: bytes) -> Path:
    return chunked(path, b"iCCP", b"by hand\0\0" + zlib.compress(profile))


# ---- kinds and depths ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a.png", "a.webp", "a.tif", "a.bmp", "a.ppm"])
def test_colour_of_8_bits(shown: U8, tmp_path: Path, name: str) -> None:
    Image.fromarray(shown).save(
        tmp_path / name, **({"lossless": True} if name == "a.webp" else {})
    )
    photo = read_photo(tmp_path / name)
    assert np.array_equal(photo.rgb, shown)
    assert photo.plain == (name in ("a.png", "a.webp"))  # what a scene may name


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_16_bits_are_rounded_not_cut(true: F64, tmp_path: Path, suffix: str) -> None:
    numbers = np.clip(true + 0.3 / 255, 0, 1)
    path = write16(tmp_path / f"rgb.{suffix}", numbers)
    assert far(read_image(path), levels(np.round(numbers * 65535) / 65535)) == 0
    assert not read_photo(path).plain
    grey = numbers[:, :, 0]
    path = write16(tmp_path / f"grey.{suffix}", grey)
    assert (
        far(
            read_image(path),
            np.repeat(levels(np.round(grey * 65535) / 65535)[..., None], 3, axis=2),
        )
        == 0
    )


@pytest.mark.parametrize("deep", [False, True])
def test_what_lets_light_through_lies_on_white(
    true: F64, tmp_path: Path, deep: bool
) -> None:
    alpha = np.tile(np.linspace(0, 1, W), (H, 1))
    whole = np.concatenate([true, alpha[..., None]], axis=2)
    if deep:
        path = write16(tmp_path / "a.png", whole)
    else:
        whole = np.round(whole * 255) / 255
        path = tmp_path / "a.png"
        Image.fromarray(levels(whole)).save(path)
    a = whole[:, :, 3:]
    photo = read_photo(path)
    assert far(photo.rgb, levels(srgb(linear(whole[:, :, :3]) * a + 1 - a))) <= 1
    assert not photo.plain


def test_palettes_and_colours_that_stand_for_nothing(shown: U8, tmp_path: Path) -> None:
    ids = (np.arange(H * W).reshape(H, W) % 7).astype(np.uint8)
    colours = shown[::3, ::5][1, :7]
    image = Image.fromarray(ids).convert("P")
    image.putpalette(colours.tobytes())
    image.save(tmp_path / "p.png")
    assert np.array_equal(read_image(tmp_path / "p.png"), colours[ids])
    image.save(tmp_path / "t.png", transparency=3)
    over = colours.copy()
    over[3] = 255
    assert np.array_equal(read_image(tmp_path / "t.png"), over[ids])
    image.save(tmp_path / "t.gif", transparency=3)
    assert np.array_equal(read_image(tmp_path / "t.gif"), over[ids])
    key = tuple(int(v) for v in shown[9, 9])
    Image.fromarray(shown).save(tmp_path / "k.png", transparency=key)
    keyed = np.where(
        (shown == shown[9, 9]).all(axis=2, keepdims=True), np.uint8(255), shown
    )
    assert np.array_equal(read_image(tmp_path / "k.png"), keyed)


def test_inks_without_a_profile(tmp_path: Path) -> None:
    amounts = np.array(
        [[0, 0, 0, 0], [255, 0, 0, 0], [0, 51, 102, 0], [10, 20, 30, 128]], np.uint8
    )
    wide = np.repeat(np.repeat(amounts[None], 16, axis=0), 16, axis=1)
    image = Image.frombytes("CMYK", wide.shape[1::-1], wide.tobytes())
    image.save(tmp_path / "c.jpg", quality=100, subsampling=0)
    image.save(tmp_path / "c.tif")
    ink = amounts / 255
    want = levels((1 - ink[:, :3]) * (1 - ink[:, 3:]))
    for name in ("c.jpg", "c.tif"):
        photo = read_photo(tmp_path / name)
        assert far(photo.rgb[8:9, 8::16], want[None]) <= 2, name
        assert not photo.plain


# ---- which way is up ----------------------------------------------------------------------------------------------

SIDES = {1: "tl", 2: "tr", 3: "br", 4: "bl", 5: "lt", 6: "rt", 7: "rb", 8: "lb"}
"""EXIF orientation -> which side of the scene the first row of the file shows, and which its first column."""


def stored(upright: NDArray[np.generic], orientation: int) -> NDArray[np.generic]:
    """What a camera stores of an upright picture."""
    row, column = SIDES[orientation]
    turned = upright if row in "tb" else upright.swapaxes(0, 1)
    turned = turned[::-1] if row in "br" else turned
    return np.ascontiguousarray(turned[:, ::-1] if column in "br" else turned)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_orientation(shown: U8, tmp_path: Path, orientation: int) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    image = Image.fromarray(stored(shown, orientation))
    for name in ("a.png", "a.webp", "a.tif", "a.jpg"):
        path = tmp_path / name
        image.save(
            path,
            exif=exif,
            **({"lossless": True} if name == "a.webp" else {}),
            quality=100,
        )
        photo = read_photo(path)
        assert photo.rgb.shape == shown.shape, name
        if name == "a.jpg":
            corners = np.abs(
                photo.rgb[1:-1:20, 1:-1:31].astype(int) - shown[1:-1:20, 1:-1:31]
            )
            assert corners.max() < 12
        else:
            assert np.array_equal(photo.rgb, shown), name
        assert photo.plain == (
            orientation == 1 and name in ("a.png", "a.webp", "a.jpg")
        ), name
    clear = Image.fromarray(
        stored(np.dstack([shown, np.zeros((H, W), np.uint8)]), orientation)
    )
    clear.save(tmp_path / "clear.png", exif=exif)
    assert (read_photo(tmp_path / "clear.png").rgb == 255).all()


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.webp"])
@pytest.mark.parametrize("exif", [b"Exif\0\0XXXX", b"Exif\0\0II*\0\xff\xff\xff\x7f"])
def test_damaged_exif_data_keep_the_picture(
    name: str, exif: bytes, tmp_path: Path
) -> None:
    rgb = np.random.default_rng(0).integers(0, 255, (24, 32, 3)).astype(np.uint8)
    picture = Image.fromarray(rgb)
    picture.save(tmp_path / name, exif=exif)
    with Image.open(tmp_path / name) as stored:
        expected = np.asarray(stored.convert("RGB"))
    assert np.array_equal(read_photo(tmp_path / name).rgb, expected)


# ---- colour spaces ------------------------------------------------------------------------------------------------


def of_adobe(numbers: F64) -> F64:
    return srgb(numbers ** (563 / 256) @ (XYZ_TO_SRGB @ ADOBE_TO_XYZ).T)


def of_p3(numbers: F64) -> F64:
    return srgb(linear(numbers) @ (XYZ_TO_SRGB @ P3_TO_XYZ).T)


SPACES: dict[str, tuple[bytes, Callable[[F64], F64]]] = {
    "Display P3": (profiles.rgb(profiles.P3, profiles.SRGB_CURVE), of_p3),
    "Adobe RGB": (profiles.rgb(profiles.ADOBE, profiles.gamma(563 / 256)), of_adobe),
    "linear": (profiles.rgb(profiles.SRGB, profiles.LINEAR), srgb),
    "a table": (
        profiles.rgb(profiles.SRGB, profiles.table(np.linspace(0, 1, 1024) ** 1.8)),
        lambda v: srgb(v**1.8),
    ),
}


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("deep", [False, True])
def test_profiles_by_their_published_numbers(
    true: F64, tmp_path: Path, name: str, deep: bool
) -> None:
    profile, meant = SPACES[name]
    codes = 65535 if deep else 255
    numbers = np.round(true * codes) / codes
    path = tmp_path / "a.png"
    if deep:
        profiled(write16(path, numbers), profile)
    else:
        Image.fromarray(levels(numbers)).save(path, icc_profile=profile)
    photo = read_photo(path)
    off = np.abs(photo.rgb.astype(int) - levels(meant(numbers)))
    assert off.max() <= (7 if deep else 2)  # LittleCMS is given 8 bits
    assert (off > 1).mean() < 0.02
    assert photo.readable
    assert not photo.plain


def test_srgb_said_outright_is_plain(shown: U8, tmp_path: Path) -> None:
    for k, profile in enumerate(
        (
            profiles.rgb(profiles.SRGB, profiles.SRGB_CURVE),
            profiles.rgb(
                profiles.SRGB, profiles.table(linear(np.linspace(0, 1, 1024)))
            ),
            ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes(),
        )
    ):
        Image.fromarray(shown).save(tmp_path / f"{k}.png", icc_profile=profile)
        photo = read_photo(tmp_path / f"{k}.png")
        assert np.array_equal(photo.rgb, shown)
        assert photo.plain


@pytest.mark.parametrize("deep", [False, True])
def test_grey_profiles(tmp_path: Path, deep: bool) -> None:
    codes = (
        np.linspace(0, 65535, 256).astype(np.uint16)
        if deep
        else np.arange(256).astype(np.uint8)
    )
    image = np.tile(codes, (3, 1))
    v = codes / codes.max()
    path = tmp_path / "g.png"
    for profile, meant in (
        (profiles.grey(profiles.LINEAR), srgb(v)),
        (profiles.grey(profiles.gamma(461 / 256)), srgb(v ** (461 / 256))),
        (SPACES["linear"][0], srgb(v)),  # a colour profile on a grey picture
    ):
        cv2.imwrite(str(path), image)
        assert (
            far(
                read_image(profiled(path, profile))[0],
                np.repeat(levels(meant)[:, None], 3, axis=1),
            )
            <= 1
        )


def test_a_damaged_profile_is_told_of(
    shown: U8, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = profiles.rgb(profiles.P3, profiles.SRGB_CURVE)
    for k, profile in enumerate(
        (b"x" * 200, good[:140], good.replace(b"RGB ", b"CMYK"), profiles.grey(b"none"))
    ):
        Image.fromarray(shown).save(tmp_path / f"{k}.png", icc_profile=profile)
        photo = read_photo(tmp_path / f"{k}.png")
        assert not photo.readable
        assert np.array_equal(photo.rgb, shown)


# ---- what is refused ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.heic", b"\0\0\0\x18ftypheic" + bytes(60)),
        ("a.cr2", b"II*\0\x10\0\0\0CR\x02\0" + bytes(60)),
        ("a.png", b""),
        ("a.txt", b"hello"),
    ],
)
def test_other_files_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, data: bytes
) -> None:
    (tmp_path / name).write_bytes(data)
    assert main(["perceive", str(tmp_path / name), "-o", str(tmp_path / "s.yaml")]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{tmp_path / name}: is not a picture that can be read")
    assert not (tmp_path / "s.yaml").exists()


def test_unusual_tiffs_are_refused(shown: U8, tmp_path: Path) -> None:
    Image.fromarray(shown[:, :, 0].astype(np.float32)).save(tmp_path / "f.tif")
    with pytest.raises(
        InputError, match="is a TIFF of an unusual kind, which is not read"
    ):
        read_image(tmp_path / "f.tif")
    cv2.imwrite(str(tmp_path / "f3.tif"), shown.astype(np.float32))
    with pytest.raises(InputError, match="is not a picture that can be read"):
        read_image(tmp_path / "f3.tif")
    Image.fromarray(shown).save(
        tmp_path / "nef.tif", tiffinfo={254: 1}
    )  # a thumbnail, as in cameras' raw files
    with pytest.raises(InputError, match="is a camera's raw file, which is not read"):
        read_image(tmp_path / "nef.tif")


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif", "deep.png"])
def test_cut_off_files(
    shown: U8, tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    path = tmp_path / name
    if name == "deep.png":
        write16(path, shown / 255)
    else:
        Image.fromarray(shown).save(path)
    data = path.read_bytes()
    for part in (0.1, 0.5, 0.9):
        path.write_bytes(data[: int(part * len(data))])
        for command in (
            ["perceive", str(path)],
            ["perceive", str(path), "--masks", str(path)],
        ):
            assert main([*command, "-o", str(tmp_path / "s.yaml")]) == 2
            [line] = capfd.readouterr().err.splitlines()
            assert line.startswith(f"{path}: is ")


# ---- the whole line -----------------------------------------------------------------------------------------------


def ball(width: int, height: int) -> tuple[F64, U8]:
    """A red ball before a wall: sRGB 0..1, and its mask."""
    y, x = np.mgrid[0:height, 0:width]
    inside = np.hypot(x - width / 2, y - height / 2) < 0.3 * min(width, height)
    return np.where(
        inside[..., None], (0.7, 0.2, 0.2), (0.6, 0.62, 0.65)
    ), inside.astype(np.uint8)


@pytest.mark.parametrize("size", [(511, 333), (8, 8)])
def test_odd_and_small_sizes_from_photo_to_video(
    tmp_path: Path, size: tuple[int, int]
) -> None:
    picture, mask = ball(*size)
    Image.fromarray(levels(picture)).save(tmp_path / "p.png")
    cv2.imwrite(str(tmp_path / "m.png"), mask)
    scene = tmp_path / "s.yaml"
    assert (
        main(
            [
                "perceive",
                str(tmp_path / "p.png"),
                "--masks",
                str(tmp_path / "m.png"),
                "-o",
                str(scene),
            ]
        )
        == 0
    )
    short = ["--set", "world.duration=0.1"]
    assert (
        main(["render", str(scene), "-o", str(tmp_path), "--format", "mp4,png", *short])
        == 0
    )
    with av.open(str(tmp_path / "s" / "video.mp4")) as container:
        frames = [
            frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)
        ]
    width, height = size
    assert frames[0].shape == (height + height % 2, width + width % 2, 3)
    assert (
        np.abs(frames[0][:height, :width].astype(int) - levels(picture)).mean() < 12
    )  # of 4:2:0
    first = cv2.imread(str(tmp_path / "s" / "frames" / "00000.png"))[:, :, ::-1]
    assert np.array_equal(first, levels(picture))


@pytest.mark.parametrize("side", [1, 5, 8])
def test_photos_too_small_for_an_object(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], side: int
) -> None:
    Image.new("RGB", (side, side), "red").save(tmp_path / "p.png")
    code = main(["perceive", str(tmp_path / "p.png"), "-o", str(tmp_path / "s.yaml")])
    told = capsys.readouterr().err
    if side < 8:
        assert told.count("\n") == 1
        assert told.startswith(f"{tmp_path / 'p.png'}: {side} x {side} px is too small")
        assert code == 2
        assert (
            "is too small to find objects in; use a photo of at least 8 px a side"
            in told
        )
        assert not (tmp_path / "s.yaml").exists()
        assert (
            main(
                [
                    "perceive",
                    str(tmp_path / "p.png"),
                    "--masks",
                    str(tmp_path / "p.png"),
                ]
            )
            == 2
        )
        assert "is too small to find objects in" in capsys.readouterr().err
    else:
        assert code == 0  # it hardly suits
        assert "no region of the photo looks like" in (tmp_path / "s.yaml").read_text()
        assert main(["check", str(tmp_path / "s.yaml")]) == 0


def test_any_photo_becomes_a_scene_of_srgb(tmp_path: Path) -> None:
    picture, mask = ball(80, 60)
    numbers = np.clip(
        srgb(linear(picture) @ np.linalg.inv(XYZ_TO_SRGB @ P3_TO_XYZ).T), 0, 1
    )
    photo = tmp_path / "phone.png"
    Image.fromarray(levels(numbers)).save(photo, icc_profile=SPACES["Display P3"][0])
    cv2.imwrite(str(tmp_path / "m.png"), mask)
    scene = tmp_path / "s.yaml"
    assert (
        main(
            [
                "perceive",
                str(photo),
                "--masks",
                str(tmp_path / "m.png"),
                "-o",
                str(scene),
            ]
        )
        == 0
    )
    copy = cv2.imread(str(tmp_path / "s.assets" / "phone.png"))[:, :, ::-1]
    assert far(copy, levels(picture)) <= 1
    assert "image: s.assets/phone.png" in scene.read_text()


def test_photos_are_made_smaller_in_linear_light() -> None:
    board = np.zeros((400, 600, 3), np.uint8)
    board[::2, ::2] = board[1::2, 1::2] = 255
    small = shrink_photo(board, 300)
    assert small.shape == (200, 300, 3)
    assert (small == round(float(srgb(np.array(0.5))) * 255)).all()
    for level in range(256):
        assert (shrink_photo(np.full((9, 9, 3), level, np.uint8), 3) == level).all()


def stored_tiff(compression: str, pages: int) -> bytes:
    stream = io.BytesIO()
    page = Image.new("RGB", (8, 8), (40, 90, 160))
    others = [page.resize((9, 9))] * (pages - 1)
    page.save(
        stream, "TIFF", compression=compression, save_all=True, append_images=others
    )
    return stream.getvalue()


DAMAGED = {
    "plain": stored_tiff("raw", 1),
    "plain-pages": stored_tiff("raw", 2),
    "lzw": stored_tiff("tiff_lzw", 1),
    "lzw-pages": stored_tiff("tiff_lzw", 2),
    "deflate": stored_tiff("tiff_adobe_deflate", 1),
    "16-bit-png": cv2.imencode(".png", np.full((7, 9, 3), 9_000, np.uint16))[1],
    "16-bit-tiff": cv2.imencode(".tiff", np.full((7, 9, 3), 9_000, np.uint16))[1],
}
"""Small files, which the test damages at each byte."""


@pytest.mark.slow
@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_photos_print_nothing(
    name: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Pillow warns and logs; libtiff and libpng write to stderr themselves."""
    monkeypatch.setattr(logging.root, "handlers", [])
    path, data = tmp_path / "photo", bytes(DAMAGED[name])
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        for index in range(len(data)):
            damaged = bytearray(data)
            damaged[index] ^= 0xFF
            for content in (damaged, data[:index]):
                path.write_bytes(content)
                with suppress(InputError):
                    read_photo(path)
    assert capfd.readouterr().err == ""
