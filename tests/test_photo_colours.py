"""Colours that a picture describes without a profile, compared with the formulas of PNG and H.273 worked out here."""

from __future__ import annotations

import struct
from pathlib import Path

import icc_profiles as profiles
import numpy as np
import pytest
from PIL import Image
from test_photos import (
    ADOBE_TO_XYZ,
    P3_TO_XYZ,
    XYZ_TO_SRGB,
    chunked,
    far,
    levels,
    linear,
    srgb,
    write16,
)

from physgen.cli.main import main
from physgen.colour_spaces import PRIMARIES
from physgen.photos import read_photo

F64 = np.ndarray
H, W = 23, 34
BT2020_TO_XYZ = np.array(
    [
        [0.6369580, 0.1446169, 0.1688810],
        [0.2627002, 0.6779981, 0.0593017],
        [0.0, 0.0280727, 1.0609851],
    ]
)
"""At D65, as ITU-R BT.2087 prints it."""
P3_CHROMATICITIES = (31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)
ADOBE_CHROMATICITIES = (31270, 32900, 64000, 33000, 21000, 71000, 15000, 6000)
SRGB_CHROMATICITIES = (31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
"""White, red, green, blue, x and y, times 100,000."""


@pytest.fixture
def numbers() -> F64:
    """(H, W, 3) stored values 0..1, with black, white and every hue; they are integers of 8 bits."""
    y, x = np.mgrid[0:H, 0:W]
    ramp = np.stack([x / (W - 1), y / (H - 1), 1 - (x + y) / (H + W - 2)], axis=-1)
    ramp[:4, :4], ramp[-4:, -4:], ramp[:4, -4:] = 0, 1, [1, 0, 0]
    return np.round(ramp * 255) / 255


def written(path: Path, numbers: F64, *chunks: tuple[bytes, bytes]) -> Path:
    """A PNG of 8 bits with chunks before its pixels, the last one first."""
    Image.fromarray(levels(numbers)).save(path)
    for kind, body in chunks:
        chunked(path, kind, body)
    return path


def gama(gamma: float) -> tuple[bytes, bytes]:
    return b"gAMA", struct.pack(">I", round(gamma * 100_000))


def chrm(values: tuple[int, ...]) -> tuple[bytes, bytes]:
    return b"cHRM", struct.pack(">8I", *values)


def cicp(primaries: int, transfer: int, matrix: int = 0, full: int = 1):
    return b"cICP", bytes([primaries, transfer, matrix, full])


def inverse_bt709(v: F64) -> F64:
    return np.where(v < 0.0812429, v / 4.5, ((v + 0.0992968) / 1.0992968) ** (1 / 0.45))


def to_srgb(light: F64, to_xyz: F64) -> F64:
    return srgb(light @ (XYZ_TO_SRGB @ to_xyz).T)


# ---- gAMA and cHRM ----


@pytest.mark.parametrize("gamma", [1.0, 1 / 1.8, 1 / 1.4, 1 / 2.6])
@pytest.mark.parametrize("is_deep", [False, True])
def test_gamma_chunk_is_applied(
    numbers: F64, tmp_path: Path, gamma: float, is_deep: bool
) -> None:
    path = tmp_path / "a.png"
    if is_deep:
        chunked(write16(path, numbers), *gama(gamma))
    else:
        written(path, numbers, gama(gamma))
    photo = read_photo(path)
    assert far(photo.rgb, levels(srgb(numbers ** (1 / gamma)))) <= 1
    assert photo.readable
    assert not photo.plain


def test_gamma_of_dark_16_bits_is_exact(tmp_path: Path) -> None:
    dark = np.tile(np.linspace(0, 0.02, 300), (4, 1))
    path = chunked(write16(tmp_path / "a.png", dark), *gama(1.0))
    stored = np.round(dark * 65535) / 65535
    expected = np.repeat(levels(srgb(stored))[..., None], 3, axis=2)
    assert far(read_photo(path).rgb, expected) <= 1


@pytest.mark.parametrize("mode", ["L", "LA", "P", "RGBA", "1"])
def test_gamma_chunk_applies_to_every_mode(tmp_path: Path, mode: str) -> None:
    grey = np.tile(np.arange(0, 256, 5).astype(np.uint8), (4, 1))
    image = Image.fromarray(grey)
    image = image.convert("RGB").convert(mode) if mode != "1" else image.convert("1")
    image.save(tmp_path / "a.png")
    stored = np.asarray(image.convert("RGB")) / 255
    chunked(tmp_path / "a.png", *gama(1.0))
    assert far(read_photo(tmp_path / "a.png").rgb, levels(srgb(stored))) <= 1


def test_opacity_is_not_bent_by_gamma(tmp_path: Path) -> None:
    alpha = np.tile(np.arange(0, 256, 5).astype(np.uint8), (4, 1))
    black = np.dstack([np.zeros((*alpha.shape, 3), np.uint8), alpha])
    Image.fromarray(black).save(tmp_path / "a.png")
    chunked(tmp_path / "a.png", *gama(1.0))
    expected = levels(srgb(1 - np.repeat(alpha[..., None], 3, axis=2) / 255))
    assert far(read_photo(tmp_path / "a.png").rgb, expected) <= 1


@pytest.mark.parametrize("gamma", [0.45455, 0.45, 0.0])
def test_gamma_of_srgb_keeps_every_number(
    numbers: F64, tmp_path: Path, gamma: float
) -> None:
    chunks = [gama(gamma), chrm(SRGB_CHROMATICITIES)]
    for count in (1, 2):
        photo = read_photo(written(tmp_path / "a.png", numbers, *chunks[:count]))
        assert np.array_equal(photo.rgb, levels(numbers))
        assert photo.plain


@pytest.mark.parametrize(
    ("values", "to_xyz"),
    [(P3_CHROMATICITIES, P3_TO_XYZ), (ADOBE_CHROMATICITIES, ADOBE_TO_XYZ)],
)
def test_chromaticities_are_applied(
    numbers: F64, tmp_path: Path, values: tuple[int, ...], to_xyz: F64
) -> None:
    path = written(tmp_path / "a.png", numbers, gama(1 / 1.8), chrm(values))
    assert far(read_photo(path).rgb, levels(to_srgb(numbers**1.8, to_xyz))) <= 1
    path = written(tmp_path / "a.png", numbers, chrm(values))
    assert far(read_photo(path).rgb, levels(to_srgb(linear(numbers), to_xyz))) <= 1


def test_white_stays_white_under_any_white_point(tmp_path: Path) -> None:
    for white in ((34567, 35850), (28315, 29711), (44757, 40745)):
        path = tmp_path / "a.png"
        Image.new("RGB", (4, 4), "white").save(path)
        chunked(path, *chrm((*white, *SRGB_CHROMATICITIES[2:])))
        assert far(read_photo(path).rgb, np.full((4, 4, 3), 255, np.uint8)) <= 1


@pytest.mark.parametrize("values", [(0,) * 8, (31270, 32900) * 4, (31270, 0) * 4])
def test_impossible_chromaticities_are_reported(
    numbers: F64, tmp_path: Path, values: tuple[int, ...]
) -> None:
    photo = read_photo(written(tmp_path / "a.png", numbers, chrm(values)))
    assert np.array_equal(photo.rgb, levels(numbers))
    assert not photo.readable


# ---- cICP ----

CODED = {
    "Display P3": (12, 13, lambda v: to_srgb(linear(v), P3_TO_XYZ)),
    "BT.709": (1, 1, lambda v: srgb(inverse_bt709(v))),
    "BT.2020": (9, 14, lambda v: to_srgb(inverse_bt709(v), BT2020_TO_XYZ)),
    "linear P3": (12, 8, lambda v: to_srgb(v, P3_TO_XYZ)),
    "gamma 2.2": (1, 4, lambda v: srgb(v**2.2)),
    "gamma 2.8": (1, 5, lambda v: srgb(v**2.8)),
}


@pytest.mark.parametrize("name", CODED)
def test_coded_spaces_by_their_formulas(
    numbers: F64, tmp_path: Path, name: str
) -> None:
    primaries, transfer, meant = CODED[name]
    path = written(tmp_path / "a.png", numbers, cicp(primaries, transfer))
    photo = read_photo(path)
    assert far(photo.rgb, levels(meant(numbers))) <= 1
    assert photo.readable
    assert not photo.plain


def test_coded_srgb_is_plain(numbers: F64, tmp_path: Path) -> None:
    photo = read_photo(written(tmp_path / "a.png", numbers, cicp(1, 13)))
    assert np.array_equal(photo.rgb, levels(numbers))
    assert photo.plain


@pytest.mark.parametrize("is_deep", [False, True])
def test_narrow_range_is_stretched(numbers: F64, tmp_path: Path, is_deep: bool) -> None:
    path = tmp_path / "a.png"
    stored = (16 + 219 * numbers) / 255
    if is_deep:
        stored = 256 * (16 + 219 * numbers) / 65535
        chunked(write16(path, stored), *cicp(1, 13, full=0))
        assert far(read_photo(path).rgb, levels(numbers)) == 0
    else:
        written(path, stored, cicp(1, 13, full=0))
        exact = np.clip((np.round(stored * 255) - 16) / 219, 0, 1)
        assert far(read_photo(path).rgb, levels(exact)) <= 1


@pytest.mark.parametrize("transfer", [16, 18])
def test_high_dynamic_range_is_refused(
    numbers: F64,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    transfer: int,
) -> None:
    path = written(tmp_path / "a.png", numbers, cicp(9, transfer))
    assert main(["perceive", str(path), "-o", str(tmp_path / "s.yaml")]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{path}: ")
    assert not (tmp_path / "s.yaml").exists()


@pytest.mark.parametrize("chunk", [cicp(3, 13), cicp(1, 77), cicp(1, 13, matrix=1)])
def test_unknown_codes_are_reported_and_passed_over(
    numbers: F64, tmp_path: Path, chunk: tuple[bytes, bytes]
) -> None:
    photo = read_photo(written(tmp_path / "a.png", numbers, gama(1.0), chunk))
    assert far(photo.rgb, levels(srgb(numbers))) <= 1
    assert not photo.readable


def test_white_of_every_coded_space_is_white(tmp_path: Path) -> None:
    for primaries in PRIMARIES:
        path = written(tmp_path / "a.png", np.ones((4, 4, 3)), cicp(primaries, 13))
        assert far(read_photo(path).rgb, np.full((4, 4, 3), 255, np.uint8)) <= 1


# ---- precedence ----


def test_precedence_of_png_is_kept(numbers: F64, tmp_path: Path) -> None:
    """cICP goes before iCCP, that before sRGB, and that before gAMA and cHRM (PNG, section 13.13)."""
    path, stored = tmp_path / "a.png", levels(numbers)
    adobe = profiles.rgb(profiles.ADOBE, profiles.gamma(563 / 256))
    adobe_levels = levels(to_srgb(numbers ** (563 / 256), ADOBE_TO_XYZ))
    low = [gama(1.0), chrm(P3_CHROMATICITIES)]

    def save(profile: bytes | None, *chunks: tuple[bytes, bytes]) -> np.ndarray:
        options = {} if profile is None else {"icc_profile": profile}
        Image.fromarray(stored).save(path, **options)
        for kind, body in chunks:
            chunked(path, kind, body)
        return read_photo(path).rgb

    assert far(save(None, *low, (b"sRGB", b"\0")), stored) == 0
    assert far(save(adobe, *low), adobe_levels) <= 2
    p3_levels = levels(to_srgb(linear(numbers), P3_TO_XYZ))
    assert far(save(adobe, *low, cicp(12, 13)), p3_levels) <= 1
    assert far(save(None, *low, (b"sRGB", b"\0"), cicp(12, 13)), p3_levels) <= 1
    assert far(save(adobe, *low, cicp(77, 13)), adobe_levels) <= 2


@pytest.mark.slow
def test_converted_photo_becomes_a_scene(tmp_path: Path) -> None:
    y, x = np.mgrid[0:60, 0:80]
    inside = np.hypot(x - 40, y - 30) < 16
    picture = np.where(inside[..., None], (0.7, 0.2, 0.2), (0.6, 0.62, 0.65))
    path = written(tmp_path / "render.png", linear(picture), gama(1.0))
    Image.fromarray(inside.astype(np.uint8)).save(tmp_path / "m.png")
    scene = tmp_path / "s.yaml"
    masks = str(tmp_path / "m.png")
    assert main(["perceive", str(path), "--masks", masks, "-o", str(scene)]) == 0
    copy = np.asarray(Image.open(tmp_path / "s.assets" / "render.png"))
    assert far(copy, levels(srgb(np.round(linear(picture) * 255) / 255))) <= 1
    assert main(["check", str(scene)]) == 0
