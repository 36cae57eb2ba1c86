"""The registry of formats, refused requests, and labels of an earlier run."""

from __future__ import annotations

from labelled import hall

from physgen.cli.export import NAMES
from physgen.cli.main import main
from physgen.export import formats
from physgen.export.formats import FORMATS
from physgen.files import install


def crowd(count: int) -> str:
    places = [(8 * (k % 40) + 4, 8 * (k // 40) + 4) for k in range(count)]
    rows = [
        f"  o{k}: {{motion: static, shape: {{circle: {{center: [{x}, {y}], radius: 3}}}}}}"
        for k, (x, y) in enumerate(places)
    ]
    head = "physgen: 1\nsize: [320, 216]\nworld: {view: top, duration: 0.1}\nrender: {frames: 1}\nobjects:\n"
    return head + "\n".join(rows) + "\n"


def test_too_many_objects(tmp_path, capsys) -> None:
    scene = tmp_path / "crowd.yaml"
    scene.write_text(crowd(255), encoding="utf-8")
    assert (
        main(["export", str(scene), "--format", "davis", "-o", str(tmp_path / "out")])
        == 2
    )
    said = capsys.readouterr().err
    assert (
        "objects: 255 objects are more than davis can number: 254; choose coco" in said
    )
    assert not (tmp_path / "out/crowd").exists()


def test_without_pycocotools(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(formats, "find_spec", lambda name: None)
    assert (
        main(
            [
                "export",
                str(hall(tmp_path)),
                "--format",
                "coco,flo",
                "-o",
                str(tmp_path / "out"),
            ]
        )
        == 2
    )
    said = capsys.readouterr().err
    assert (
        f'"coco" needs pycocotools, which is not installed; {install("labels")}' in said
    )
    assert not (tmp_path / "out").exists()


def test_labels_that_are_there_are_not_lost(tmp_path, capsys) -> None:
    scene, out = str(hall(tmp_path)), tmp_path / "out"
    few = ["--set", "render.frames=2", "-o", str(out)]
    assert main(["export", scene, "--format", "davis,flo", *few]) == 0
    there = sorted(path for path in out.rglob("*") if path.is_file())
    assert main(["export", scene, "--format", "flo,frames", *few]) == 2
    said = capsys.readouterr().err
    assert (
        f"{out / 'hall'}: has davis of an earlier run, which would be removed; name all formats at once, or"
        in said
    )
    assert sorted(path for path in out.rglob("*") if path.is_file()) == there
    assert main(["export", scene, "--format", "frames,flo,davis", *few]) == 0
    assert (out / "hall/frames/00001.png").exists()
    film = tmp_path / "film"
    assert (
        main(
            [
                "render",
                scene,
                "--set",
                "render.frames=2",
                "--report",
                "none",
                "-o",
                str(film),
            ]
        )
        == 0
    )
    assert (
        main(
            [
                "export",
                scene,
                "--format",
                "flo",
                "--set",
                "render.frames=2",
                "-o",
                str(film),
            ]
        )
        == 2
    )
    assert "has video.mp4 of an earlier run" in capsys.readouterr().err


def test_a_name_that_is_no_format(tmp_path, capsys) -> None:
    assert (
        main(
            [
                "export",
                str(hall(tmp_path)),
                "--format",
                "davos,zip",
                "-o",
                str(tmp_path / "out"),
            ]
        )
        == 2
    )
    said = capsys.readouterr().err
    assert '--format: "davos" is not a format; did you mean "davis"?' in said
    assert '--format: "zip" is not a format; write frames, flo' in said
    assert not (tmp_path / "out").exists()


def test_the_help_names_the_formats_there_are() -> None:
    assert tuple(kind.name for kind in FORMATS) == NAMES
