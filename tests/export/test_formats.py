"""The registry of formats, refused requests, and labels of an earlier run."""

from __future__ import annotations

import pytest
from labelled import hall

from physgen.cli.export import NAMES
from physgen.cli.main import main
from physgen.export import formats
from physgen.export.formats import FORMATS


def crowd(count: int) -> str:
    places = [(8 * (k % 40) + 4, 8 * (k // 40) + 4) for k in range(count)]
    rows = [
        f"  o{k}: {{motion: static, shape: {{circle: {{center: [{x}, {y}], radius: 3}}}}}}"
        for k, (x, y) in enumerate(places)
    ]
    head = "physgen: 1\nsize: [320, 216]\nworld: {view: top, duration: 0.1}\nrender: {frames: 1}\nobjects:\n"
    return head + "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    ("name", "count", "most"), [("davis", 255, 254), ("youtubevos", 255, 254), ("mots", 1000, 999)]
)
def test_too_many_objects(name: str, count: int, most: int, tmp_path, capsys) -> None:
    scene = tmp_path / "crowd.yaml"
    scene.write_text(crowd(count), encoding="utf-8")
    assert main(["export", str(scene), "--format", name, "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert (
        f"objects: {count:,} objects are more than the format {name} can number, which is {most}; take coco"
        in said
    )
    assert not (tmp_path / "out/crowd").exists()


def test_without_pycocotools(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(formats, "find_spec", lambda name: None)
    assert (
        main(["export", str(hall(tmp_path)), "--format", "coco,mot,mots", "-o", str(tmp_path / "out")]) == 2
    )
    said = capsys.readouterr().err
    for name in ("coco", "mots"):
        assert f'"{name}" needs pycocotools, which is not installed; pip install "physgen[labels]"' in said
    assert not (tmp_path / "out").exists()


def test_labels_that_are_there_are_not_lost(tmp_path, capsys) -> None:
    scene, out = str(hall(tmp_path)), tmp_path / "out"
    few = ["--set", "render.frames=2", "-o", str(out)]
    assert main(["export", scene, "--format", "davis,mot", *few]) == 0
    there = sorted(path for path in out.rglob("*") if path.is_file())
    assert main(["export", scene, "--format", "mot,frames", *few]) == 2
    said = capsys.readouterr().err
    assert (
        f"{out / 'hall'}: holds davis of an earlier run, which would go; name all formats at once, or" in said
    )
    assert sorted(path for path in out.rglob("*") if path.is_file()) == there
    assert main(["export", scene, "--format", "frames,mot,davis", *few]) == 0
    assert (out / "hall/frames/00001.png").exists()
    film = tmp_path / "film"
    assert main(["render", scene, "--set", "render.frames=2", "--report", "none", "-o", str(film)]) == 0
    assert main(["export", scene, "--format", "mot", "--set", "render.frames=2", "-o", str(film)]) == 2
    assert "holds video.mp4 of an earlier run" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("formats", "said"),
    [
        ("flo:3", '"flo:3" takes no number; write "flo"'),
        ("tapvid:", '"tapvid:" has no number of points from 1 to 1,000,000; write e.g. "tapvid:512"'),
        ("tapvid:2e3", '"tapvid:2e3" has no number of points'),
        ("tapvid:1000001", '"tapvid:1000001" has no number of points'),
        ("tapvid:5,tapvid:6", '"tapvid:6" is tapvid once more; write it once'),
        ("tapvit:5", '"tapvit:5" is no format; did you mean "tapvid"?'),
    ],
)
def test_numbers_that_no_format_takes(formats: str, said: str, tmp_path, capsys) -> None:
    assert main(["export", str(hall(tmp_path)), "--format", formats, "-o", str(tmp_path / "out")]) == 2
    assert f"--format: {said}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_help_names_the_formats_there_are() -> None:
    assert tuple(kind.name for kind in FORMATS) == NAMES
