"""Where a photo was taken, and by which camera, stays in the photo: markers in its metadata, and a search for them."""

from __future__ import annotations

import base64
import io
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pillow_heif
import pytest
from PIL import Image, PngImagePlugin, TiffImagePlugin
from PIL.TiffImagePlugin import IFDRational
from test_photos import chunked

from physgen.cli.main import main

pillow_heif.register_heif_opener()
MARKER = "Zq7SerialX"
"""Part of every marker."""
SECONDS = 291_234_567
"""Numerator of the seconds of latitude."""
NAMES = ["a.jpg", "a.png", "a.webp", "a.tif", "a.heic", "a.avif"]
PNG_CHUNKS = {b"IHDR", b"PLTE", b"IDAT", b"IEND", b"acTL", b"fcTL", b"fdAT", b"pHYs"}
"""What a PNG may contain: no text, EXIF or private data."""


def exif_data() -> bytes:
    """GPS position, serial numbers, owner and maker note."""
    exif = Image.Exif()
    exif[0x010F] = f"{MARKER} make"
    exif[0x010E] = f"{MARKER} description"
    exif[0x013B] = f"{MARKER} artist"
    exif[0xC62F] = f"{MARKER} camera serial"
    private = exif.get_ifd(0x8769)
    private[0xA430], private[0xA431] = f"{MARKER} owner", f"{MARKER} body"
    private[0xA435], private[0xA420] = f"{MARKER} lens", f"{MARKER} unique id"
    private[0x927C] = f"{MARKER} maker note".encode()
    private[0x9286] = b"ASCII\0\0\0" + f"{MARKER} comment".encode()
    gps = exif.get_ifd(0x8825)
    gps[1], gps[3] = "N", "E"
    gps[2] = (48, 51, IFDRational(SECONDS, 10**7))
    gps[4] = (2, 17, IFDRational(SECONDS, 10**7))
    gps[0x1B] = f"{MARKER} processing".encode()
    gps[0x1C] = f"{MARKER} area".encode()
    return exif.tobytes()


def xmp_data() -> bytes:
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
        'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description '
        'xmlns:exif="http://ns.adobe.com/exif/1.0/" '
        f'exif:GPSLatitude="{MARKER} north"/></rdf:RDF></x:xmpmeta>'
    ).encode()


def iptc_data() -> bytes:
    city = f"{MARKER} city".encode()
    record = b"\x1c\x02\x5a" + struct.pack(">H", len(city)) + city
    head = b"Photoshop 3.0\x008BIM\x04\x04\0\0" + struct.pack(">I", len(record))
    return head + record + b"\0" * (len(record) % 2)


def segment(code: int, body: bytes) -> bytes:
    return bytes([0xFF, code]) + struct.pack(">H", len(body) + 2) + body


def save_with_markers(path: Path, image: Image.Image) -> Path:
    """A photo with a marker in each place that its format has for metadata."""
    exif, xmp, suffix = exif_data(), xmp_data(), path.suffix
    if suffix == ".jpg":
        image.save(path, exif=exif, xmp=xmp, quality=97, comment=f"{MARKER} comment")
        data = path.read_bytes()
        more = segment(0xED, iptc_data()) + segment(0xEB, f"{MARKER} app11".encode())
        # phones put a short film behind the picture
        path.write_bytes(data[:2] + more + data[2:] + f"{MARKER} film".encode())
    elif suffix == ".png":
        text = PngImagePlugin.PngInfo()
        text.add_text("Serial", f"{MARKER} plain")
        text.add_text("Packed", f"{MARKER} packed" * 9, zip=True)
        text.add_itxt("XML:com.adobe.xmp", xmp.decode())
        image.save(path, exif=exif, pnginfo=text)
        chunked(path, b"prVt", f"{MARKER} private".encode())
        path.write_bytes(path.read_bytes() + f"{MARKER} behind".encode())
    elif suffix == ".tif":
        tags = TiffImagePlugin.ImageFileDirectory_v2()
        tags[700], tags[33723] = xmp, iptc_data()
        tags[270], tags[315], tags[50735] = (f"{MARKER} {k}" for k in range(3))
        image.save(path, tiffinfo=tags, exif=exif)
    else:
        image.save(path, exif=exif, xmp=xmp, quality=95)
    return path


def leaks(data: bytes, place: str) -> Iterator[str]:
    """Places of markers in a file, in what it embeds, and in what it packs."""
    texts = [
        MARKER.encode(),
        MARKER.encode("utf-16-le"),
        MARKER.encode().hex().encode(),
    ]
    texts += [struct.pack(order, SECONDS) for order in ("<I", ">I")]
    texts.append(str(SECONDS).encode())
    if any(text in data for text in texts):
        yield place
    for number, text in enumerate(re.findall(rb"base64,([A-Za-z0-9+/=]{20,})", data)):
        yield from leaks(base64.b64decode(text), f"{place}: base64 {number}")
    if data[:2] == b"PK":
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            for name in archive.namelist():
                yield from leaks(archive.read(name), f"{place}: {name}")
    if data[:2] == b"\x1f\x8b":
        yield from leaks(zlib.decompress(data, 31), f"{place}: gzip")
    if data[:4] == b"\x89PNG":
        yield from (f"{place}: {kind!r}" for kind in chunks(data) - PNG_CHUNKS)
    if data[:2] == b"\xff\xd8" or data[8:12] == b"WEBP":
        with Image.open(io.BytesIO(data)) as image:
            if image.getexif() or {"xmp", "exif", "comment"} & image.info.keys():
                yield f"{place}: metadata"


def chunks(data: bytes) -> set[bytes]:
    kinds, start = set(), 8
    while start + 8 <= len(data):
        kinds.add(data[start + 4 : start + 8])
        start += 12 + int.from_bytes(data[start : start + 4], "big")
    return kinds


def leaks_below(folder: Path) -> list[str]:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    assert files
    return [place for path in files for place in leaks(path.read_bytes(), str(path))]


@pytest.fixture
def image(tmp_path: Path) -> Image.Image:
    """A ball before a wall, whose mask is beside it."""
    y, x = np.mgrid[0:60, 0:80]
    inside = np.hypot(x - 40, y - 30) < 14
    rgb = np.where(inside[..., None], (180, 50, 50), (150, 158, 165)).astype(np.uint8)
    Image.fromarray(inside.astype(np.uint8)).save(tmp_path / "m.png")
    return Image.fromarray(rgb)


@pytest.mark.parametrize("name", NAMES)
def test_search_finds_every_marker(
    image: Image.Image, tmp_path: Path, name: str
) -> None:
    path = save_with_markers(tmp_path / name, image)
    data = path.read_bytes()
    assert data.count(MARKER.encode()) >= (2 if name in ("a.heic", "a.avif") else 3)
    assert list(leaks(data, name))
    page = b"<img src='data:image/png;base64," + base64.b64encode(data) + b"'>"
    assert list(leaks(page, "page"))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_assets_have_no_metadata_of_photo(
    image: Image.Image, tmp_path: Path, name: str
) -> None:
    """From another folder, so that the scene gets a copy of the photo."""
    photo = save_with_markers(tmp_path / name, image)
    scene = tmp_path / "work" / "s.yaml"
    command = ["perceive", str(photo), "--masks", str(tmp_path / "m.png")]
    assert main([*command, "-o", str(scene)]) == 0
    assert leaks_below(scene.parent) == []
    assert "image: s.assets/a.png" in scene.read_text()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.webp"])
def test_results_have_no_metadata_of_photo(
    image: Image.Image, tmp_path: Path, name: str
) -> None:
    """A scene that names the photo itself, with all that is made of it."""
    work = tmp_path / "work"
    work.mkdir()
    photo = save_with_markers(work / name, image)
    scene, out = work / "s.yaml", tmp_path / "out"
    masks = ["--masks", str(tmp_path / "m.png")]
    assert main(["perceive", str(photo), *masks, "-o", str(scene)]) == 0
    assert f"image: {name}" in scene.read_text()
    render = ["render", str(scene), "--set", "world.duration=0.1", "-o", str(out)]
    kinds = ["--format", "mp4,gif,webp,png", "--export", "frames,coco,normals,physics"]
    assert main([*render, *kinds]) == 0
    assert main(["gallery", str(out), "-o", str(tmp_path / "page.html")]) == 0
    split = ["--split", "train=1"]
    assert main(["dataset", str(out), "-o", str(tmp_path / "data"), *split]) == 0
    photo.unlink()
    assert leaks_below(tmp_path) == []
