"""Packs made to hurt -> one message each, nothing written, nothing outside the folder."""

from __future__ import annotations

import io
import json
import os
import stat
import struct
import tempfile
import tracemalloc
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from physgen.problems import InputError, Limit
from physgen.scene import unpack as reader
from physgen.scene.pack import pack_scene
from physgen.scene.unpack import unpack_to

SCENE = b"physgen: 1\nsize: [64, 48]\nobjects: {}\n"
PAGE = json.dumps({"pack": 1, "scene": "a/scene.yaml"}).encode()
Member = tuple[str | zipfile.ZipInfo, bytes]


def png(width: int = 8, height: int = 8) -> bytes:
    """A picture as far as its header; decoding it is nobody's business here."""
    parts = ((b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)), (b"IDAT", zlib.compress(b"\0")))
    chunks = [struct.pack(">I", len(d)) + t + d + struct.pack(">I", zlib.crc32(t + d)) for t, d in parts]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks) + struct.pack(">I4sI", 0, b"IEND", zlib.crc32(b"IEND"))


def zipped(*members: Member, how: int = zipfile.ZIP_STORED) -> bytes:
    out = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(out, "w", how) as archive:
        warnings.simplefilter("ignore")  # of names that are there twice
        for name, data in members:
            archive.writestr(name, data)
    return out.getvalue()


def pack(*members: Member, how: int = zipfile.ZIP_STORED) -> bytes:
    return zipped(("pack.json", PAGE), ("a/scene.yaml", SCENE), *members, how=how)


def entry(name: str, mode: int) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.create_system, info.external_attr = 3, mode << 16
    return info


def zeroed() -> bytes:
    """A name with a byte that ends it for some."""
    return pack(("a/xqx.png", png())).replace(b"a/xqx.png", b"a/x\0x.png")


def encrypted() -> bytes:
    data = bytearray(pack(("a/p.png", png())))
    at = data.rindex(b"PK\x01\x02")
    data[at + 8] |= 1
    return bytes(data)


def shrunk() -> bytes:
    """Says that a picture is smaller than it is."""
    data, size = bytearray(pack(("a/p.png", png()))), struct.pack("<I", len(png()))
    at = data.rindex(b"PK\x01\x02")
    assert data[at + 24 : at + 28] == size
    data[at + 24 : at + 28] = struct.pack("<I", 20)
    return bytes(data)


def renamed() -> bytes:
    """Called another name where it lies than in the list."""
    return pack(("a/pp.png", png())).replace(b"a/pp.png", b"../p.png", 1)


def page(**told: object) -> bytes:
    return zipped(("pack.json", json.dumps(told).encode()), ("a/scene.yaml", SCENE), ("scene.yaml", SCENE))


CASES: dict[str, tuple[Callable[[], bytes], str]] = {
    "nothing": (lambda: b"", "is no pack"),
    "no pack": (lambda: zipped(("a.txt", b"a")), "has no pack.json"),
    "cut": (lambda: pack()[:-9], "is damaged"),
    "up": (lambda: pack(("../p.png", png())), "is no plain name"),
    "absolute": (lambda: pack(("/tmp/p.png", png())), "is no plain name"),
    "drive": (lambda: pack(("C:/p.png", png())), "is no plain name"),
    "backslash": (lambda: pack(("a\\p.png", png())), "is no plain name"),
    "bell": (lambda: pack(("a/\x07.png", png())), "is no plain name"),
    "zero": (zeroed, "is no plain name"),
    "long": (lambda: pack((f"a/{'x' * 300}.png", png())), "is no plain name"),
    "link": (lambda: pack((entry("a/p.png", stat.S_IFLNK | 0o777), b"/etc/passwd")), "is a link"),
    "twice": (lambda: pack(("a/p.png", png()), ("a/p.png", png())), "is there twice"),
    "file and folder": (lambda: pack(("a/b", png()), ("a/b/c.png", png())), "is there twice"),
    "encrypted": (encrypted, "is encrypted"),
    "method": (lambda: pack(("a/p.png", png()), how=zipfile.ZIP_BZIP2), "compressed in another way"),
    "two names": (renamed, "is damaged"),
    "lies about its size": (shrunk, "is damaged"),
    "sum": (lambda: pack().replace(b"[64, 48]", b"[64, 49]"), "is damaged"),
    "neither": (lambda: pack(("a/run.sh", b"rm -rf /")), "is not a picture that can be read"),
    "huge picture": (lambda: pack(("a/p.png", png(20_000, 20_000))), "is over 100 megapixels"),
    "bomb": (
        lambda: pack(("a/b.yaml", b" " * (8 * 2**20 + 1)), how=zipfile.ZIP_DEFLATED),
        "is larger than 8 MiB",
    ),
    "long page": (
        lambda: zipped(("pack.json", b" " * 2**17), ("a/scene.yaml", SCENE)),
        "is larger than 64 kiB",
    ),
    "deep page": (
        lambda: zipped(("pack.json", b"[" * 60_000), ("a/scene.yaml", SCENE)),
        "cannot be understood",
    ),
    "version": (lambda: page(pack=2, scene="a/scene.yaml"), "version 2"),
    "scene": (lambda: page(pack=1, scene="b/scene.yaml"), "is no scene file in a folder"),
    "bare scene": (  # it might extend what lies beside the pack's folder
        lambda: page(pack=1, scene="scene.yaml"),
        "is no scene file in a folder",
    ),
    "many": (lambda: pack(*((f"a/{k}.png", b"") for k in range(2_001))), "2,003 files are over"),
    "deep": (lambda: pack((f"a/{'b/' * 500}p.png", png())), "is no plain name"),
    "very many": (lambda: pack(*((f"a/{k}.png", b"") for k in range(5_000))), "lists more than 2,000 files"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_message_and_nothing_left(case: str, tmp_path: Path) -> None:
    make, said = CASES[case]
    assert said in (refusal(make(), tmp_path / "new") or "")
    assert list(tmp_path.iterdir()) == []


def test_only_what_begins_as_a_pack_is_read(tmp_path: Path) -> None:
    pipe, large, other = (tmp_path / name for name in "plo")
    os.mkfifo(pipe)  # nobody writes into it
    for path, begin in ((other, b"physgen: 1"), (large, b"PK\3\4")):
        with path.open("wb") as file:
            file.write(begin)
            file.truncate(2**31 + 1 if path == large else 2**30)
    tracemalloc.start()
    for path, said in (
        (pipe, "is no pack"),
        (other, "is no pack"),
        (large, "is larger"),
        (tmp_path, "is no pack"),
        (tmp_path / "none", "no such file"),
    ):
        with pytest.raises(InputError, match=said):
            reader.read_pack(path)
    assert tracemalloc.get_traced_memory()[1] < 2**22
    tracemalloc.stop()


def test_what_another_tool_zipped_is_read(tmp_path: Path) -> None:
    data = pack(("b/", b""), ("b/p.png", png()), how=zipfile.ZIP_DEFLATED)
    scene = unpack_to(data, tmp_path / "new")
    assert scene.read_bytes() == SCENE
    assert sorted(p.name for p in (tmp_path / "new").rglob("*")) == ["a", "b", "p.png", "scene.yaml"]


def test_all_files_together_and_each_picture_are_bounded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = pack(*((f"a/{k}.png", png() + b"\0" * 1000) for k in range(9)))
    monkeypatch.setattr(Limit.PACK, "most", 5000)
    with pytest.raises(InputError, match=r"^the pack: is larger than 2 GiB; "):
        unpack_to(data, tmp_path / "new")
    monkeypatch.setattr(Limit.PACK, "most", 2**30)
    monkeypatch.setattr(Limit.PICTURE, "most", 2**10)
    with pytest.raises(InputError, match=r'^the pack: "a/0.png" is larger than 1 kiB; '):
        unpack_to(data, tmp_path / "new")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(reader, "image_size", full)
    with pytest.raises(OSError, match="No space left"):
        unpack_to(pack(("a/p.png", png())), tmp_path / "new")
    assert list(tmp_path.iterdir()) == []


def test_folders_that_are_in_use_are_left_alone(tmp_path: Path) -> None:
    full = tmp_path / "full"
    full.mkdir()
    (full / "mine").write_text("mine")
    with pytest.raises(InputError) as caught:
        unpack_to(pack(), full)
    assert str(caught.value) == f"{full}: is there already, and not empty; name another folder with -o"
    with pytest.raises(InputError):
        unpack_to(pack(), full / "mine")
    assert [p.name for p in tmp_path.rglob("*")] == ["full", "mine"]


def refusal(data: bytes, folder: Path) -> str | None:
    """The one message with which a pack is refused; None where it is unpacked."""
    try:
        unpack_to(data, folder)
    except InputError as error:
        (problem,) = error.problems
        return str(problem)
    return None


PART = st.sampled_from(["..", ".", "", "a", "A", "b.png", "C:", "\\", "\0", "é", "e\u0301", " ", "~", "con"])
NAME = st.one_of(st.text(max_size=12), st.lists(PART | st.text(max_size=3), max_size=5).map("/".join))


@given(names=st.lists(NAME, min_size=1, max_size=4))
def test_no_name_leads_out(names: list[str]) -> None:
    try:
        data = pack(*((name, b"" if name.endswith("/") else png()) for name in names))
    except (UnicodeEncodeError, ValueError, IndexError):  # no zip has such a name
        return
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        home = root / "home"
        if (said := refusal(data, home / "new")) is not None:
            assert said.isprintable()
            assert list(root.iterdir()) == []
            return
        assert {path.name for path in root.iterdir()} == {"home"}
        assert {path.name for path in home.iterdir()} == {"new"}
        found = {path.relative_to(home / "new").as_posix() for path in home.rglob("*") if path.is_file()}
        written = (zipfile.ZipInfo(name).filename for name in names)  # what a writer makes of a zero byte
        files = {name for name in written if not name.endswith("/")}
        assert found == {"a/scene.yaml", *files}


def test_a_pack_is_no_scene_file(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_bytes(pack())
    with pytest.raises(InputError) as caught:
        pack_scene(path)
    assert str(caught.value) == f"{path}: is a pack or a zip, not a scene file; physgen unpack it"
