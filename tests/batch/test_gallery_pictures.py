"""Pictures of a gallery are made where the clips are: the same as the gallery makes by itself, and no others."""

from __future__ import annotations

import shutil
from pathlib import Path

from physgen.cli.main import main
from physgen.files import machine_id
from physgen.report.gallery import keep_pictures, write_gallery

BALL = """\
physgen: 1
size: [32, 24]
world: {duration: 0.1}
objects:
  ball: {shape: {circle: {center: [12, 12], radius: 5}}}
render: {fps: 20}
variants: {slow: {objects.ball.velocity: [9, 0]}, fast: {objects.ball.velocity: [90, 0]}}
"""


def pictures(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (out / "index.files").iterdir()}


def rendered(folder: Path, variant: str, scene: str = BALL) -> Path:
    (folder / "scene.yaml").write_text(scene)
    flags = ["--variant", variant, "--report", "none"]
    assert (
        main(["render", str(folder / "scene.yaml"), "-o", str(folder / "out"), *flags])
        == 0
    )
    return folder / "out"


def test_the_same_as_the_gallery_makes(tmp_path: Path) -> None:
    out = rendered(tmp_path, "all")
    made, page = pictures(out), (out / "index.html").read_text()
    assert len(made) == 3 * 2 + 1, "a photo and a result each, and the list of clips"
    shutil.rmtree(out / "index.files")
    write_gallery([out], out / "index.html")
    assert pictures(out) == made
    assert (out / "index.html").read_text() == page


def test_the_gallery_only_finds_them(tmp_path: Path) -> None:
    out = rendered(tmp_path, "slow")
    assert not (out / "index.files").exists()  # a single clip has no gallery
    home = next(path for path in out.iterdir() if path.is_dir())
    keep_pictures(home, out / "index.html")
    photos = list((out / "index.files").iterdir())
    before = [path.stat().st_mtime_ns for path in photos]
    assert len(photos) == 1
    write_gallery([out], out / "index.html")
    assert [path.stat().st_mtime_ns for path in photos] == before


def test_what_a_killed_worker_left_goes(tmp_path: Path) -> None:
    out = rendered(tmp_path, "all")
    picture = next((out / "index.files").iterdir())

    half = picture.with_name(
        f".{picture.name}.4194303-{machine_id()}.part"
    )  # above any process number
    half.write_bytes(b"RIFF")
    rendered(tmp_path, "all", BALL.replace("radius: 5", "radius: 6"))
    assert not half.exists()
    assert len(pictures(out)) == 3 * 2 + 1
