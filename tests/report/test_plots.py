"""Figures for papers: what is drawn is what was simulated, read back from SVG, PNG and PDF by other readers."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pypdf
import pytest
from PIL import Image

from physgen import pipeline
from physgen.cli.main import main
from physgen.report.figures import units

SVG = "{http://www.w3.org/2000/svg}"
SPEED, RISE, GRAVITY = 150.0, -180.0, 400.0
THROW = f"""\
physgen: 1
size: [200, 150]
world: {{gravity: [0, {GRAVITY}], duration: 0.75}}
objects:
  ball: {{shape: {{circle: {{center: [30, 90], radius: 8}}}}, mass: 100, velocity: [{SPEED}, {RISE}]}}
render: {{fps: 32}}
"""
DROP = """\
physgen: 1
size: [160, 120]
world: {duration: 1.0, gravity: [0, 800], pixels_per_meter: 200}
objects:
  ball: {shape: {circle: {center: [80, 40], radius: 10}}, mass: 50, elasticity: 0.5}
  crate: {shape: {box: {center: [30, 90], size: [20, 20]}}, mass: 20}
boundaries:
  floor: {segment: [[-100, 100], [300, 100]], elasticity: 1}
forces: [{object: crate, impulse: [400, 0]}]
render: {fps: 24}
"""

BALL = "{ball: {shape: {circle: {center: [30, 50], radius: 8}}, mass: 100}}"
PUSH = "forces: [{object: ball, impulse: [10000, 0]}]"


def scene(tmp_path: Path, text: str, name: str = "lesson") -> str:
    path = tmp_path / f"{name}.yaml"
    path.write_text(text)
    return str(path)


def drawn(kind: str, path: str, output: Path, *more: str) -> ET.Element:
    assert main(["plot", kind, path, "-o", str(output), *more]) == 0
    return ET.parse(output).getroot()


def points(element: ET.Element) -> np.ndarray:
    """(K, 2): of the last path in a group; what lies below it is its rim."""
    d = element.findall(f".//{SVG}path")[-1].get("d")
    return np.array(re.findall(r"[ML] ([-\d.e]+) ([-\d.e]+)", d), float)


def named(root: ET.Element, name: str) -> ET.Element:
    return next(element for element in root.iter(f"{SVG}g") if element.get("id") == name)


def area(root: ET.Element) -> tuple[np.ndarray, np.ndarray]:
    """Upper left and lower right of the first axes."""
    corners = points(named(root, "area"))
    return corners.min(axis=0), corners.max(axis=0)


def test_a_path_in_the_figure_is_the_parabola_of_the_throw(tmp_path: Path) -> None:
    root = drawn("trajectory", scene(tmp_path, THROW), tmp_path / "throw.svg")
    low, high = area(root)  # the canvas: 200 x 150 px, from half a pixel before the first one's centre
    path = (points(named(root, "path-ball")) - low) / (high - low) * [200, 150] - 0.5
    t = (path[:, 0] - 30) / SPEED
    assert np.ptp(t) > 0.7
    assert np.abs(path[:, 1] - (90 + RISE * t + GRAVITY * t**2 / 2)).max() < 0.05


def test_unknown_objects_are_refused(tmp_path: Path, capsys) -> None:
    path = scene(tmp_path, THROW)
    assert main(["plot", "trajectory", path, "--objects", "ball,moon", "-o", str(tmp_path / "a.png")]) == 2
    assert '"moon" is no object of the scene; the scene has ball' in capsys.readouterr().err
    assert not (tmp_path / "a.png").exists()


def test_a_push_at_the_start_is_counted_once() -> None:
    """An impulse J at t = 0 gives J²/2m, at once and for good: the top of the stack and the line above it are that."""
    from physgen.report.figures import stacked

    pushed = f"{{physgen: 1, size: [200, 100], world: {{gravity: [0, 0], duration: 0.2}}, objects: {BALL}, {PUSH}}}"
    with tempfile.TemporaryDirectory() as folder:
        compiled = pipeline.compile(pipeline.load(scene(Path(folder), pushed)), None)
    layers, top = stacked(pipeline.simulate(compiled.world))
    assert top == pytest.approx(10000**2 / 200, rel=1e-9)
    assert layers.sum(axis=0) == pytest.approx(top, rel=1e-9)


def test_energy_falls_and_rises_as_it_must_and_its_sum_is_level(tmp_path: Path) -> None:
    root = drawn("energy", scene(tmp_path, THROW), tmp_path / "energy.svg")
    across, up = points(named(root, "kinetic")).T
    t = 0.75 * (across - across[0]) / np.ptp(across)
    kinetic = SPEED**2 + (RISE + GRAVITY * t) ** 2
    slope, offset = np.polyfit(kinetic, up, 1)
    assert np.abs(slope * kinetic + offset - up).max() < 0.1
    total = points(named(root, "sum"))[:, 1]
    assert np.ptp(total) < 0.02
    bottom = area(root)[1][1]
    assert abs(offset - bottom) < 0.1  # no energy is at the axis


def test_frames_of_a_strip_are_those_of_the_video_pixel_for_pixel(tmp_path: Path) -> None:
    path = scene(tmp_path, DROP)
    assert main(["plot", "strip", path, "--frames", "4,11,23", "-o", str(tmp_path / "strip.png")]) == 0
    assert main(["render", path, "-o", str(tmp_path / "out"), "--format", "png"]) == 0
    strip = np.asarray(Image.open(tmp_path / "strip.png").convert("RGB"))
    for frame in (4, 11, 23):
        picture = np.asarray(Image.open(tmp_path / f"out/lesson/frames/{frame:05d}.png"))
        spots = np.argwhere((strip[: len(strip) - 119, : strip.shape[1] - 159] == picture[0, 0]).all(axis=2))
        assert any(np.array_equal(strip[y : y + 120, x : x + 160], picture) for y, x in spots)
    red = (strip[..., 0] > 200) & (strip[..., 1] < 40) & (strip[..., 2] < 60)
    assert red[:, :160].sum() > 50  # the crate's arrow
    assert not red[:120, 200:].any()


def test_a_strip_in_a_pdf_holds_frames_whole_and_its_letters(tmp_path: Path) -> None:
    path = scene(tmp_path, DROP)
    assert (
        main(["plot", "strip", path, "--frames", "9,", "-o", str(tmp_path / "strip.pdf"), "--width", "84"])
        == 0
    )
    assert main(["render", path, "-o", str(tmp_path / "out"), "--format", "png"]) == 0
    [page] = pypdf.PdfReader(tmp_path / "strip.pdf").pages
    assert abs(float(page.mediabox.width) - 84 / 25.4 * 72) < 1
    shown = [np.asarray(image.image.convert("RGB")) for image in page.images]
    for frame in (0, 9):
        picture = np.asarray(Image.open(tmp_path / f"out/lesson/frames/{frame:05d}.png"))
        # a PDF may hold a picture upside down, and turn it as it is drawn
        assert any(np.array_equal(rows, picture) for one in shown for rows in (one, one[::-1]))
    assert "input" in page.extract_text()
    assert "0.38 s" in page.extract_text()
    fonts = [font.get_object() for font in page["/Resources"]["/Font"].get_object().values()]
    for font in fonts:
        below = font["/DescendantFonts"][0].get_object() if "/DescendantFonts" in font else font
        assert "/FontFile2" in below["/FontDescriptor"]


@pytest.mark.parametrize(("kind", "ending"), [("energy", "svg"), ("trajectory", "pdf"), ("strip", "png")])
def test_two_runs_give_the_same_bytes(tmp_path: Path, kind: str, ending: str) -> None:
    path, files = scene(tmp_path, DROP), [tmp_path / f"{k}.{ending}" for k in (1, 2)]
    for file in files:
        assert (
            main(["plot", kind, path, "-o", str(file), *(["--frames", "2"] if kind == "strip" else [])]) == 0
        )
    one, other = (file.read_bytes() for file in files)
    assert one == other
    assert b"CreationDate" not in one
    assert b"dc:date" not in one


def test_widths_are_what_is_asked_for(tmp_path: Path) -> None:
    path, out = scene(tmp_path, DROP, "$x$ <b> 滑り台"), tmp_path / "a.png"
    for kind in ("energy", "trajectory", "strip"):
        assert main(["plot", kind, path, "-o", str(out), "--width", "84"]) == 0
        wide = Image.open(out).width
        assert abs(wide - 992) <= 1 or (kind == "strip" and wide > 6 * 160)


def test_wrong_flags_are_answered_and_nothing_is_written(tmp_path: Path, capsys) -> None:
    path = scene(tmp_path, DROP)
    for more, said in (
        (
            ["strip", path, "-o", str(tmp_path / "a.jpg")],
            "is no name for a figure; end it in .png, .svg or .pdf",
        ),
        (
            ["strip", path, "--frames", "0,99", "-o", str(tmp_path / "a.png")],
            "is not among 24 frames; count from 0 to 23",
        ),
        (["energy", path, "--variant", "all", "-o", str(tmp_path / "a.png")], "names more than one"),
    ):
        assert main(["plot", *more]) == 2
        assert said in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["lesson.yaml"]


def test_without_matplotlib_one_line_says_how_to_get_it(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert main(["plot", "energy", scene(tmp_path, DROP), "-o", str(tmp_path / "a.png")]) == 2
    assert 'matplotlib, which is not installed; pip install "physgen[plots]"' in capsys.readouterr().err


def test_only_plots_need_matplotlib() -> None:
    rooms = "cli.main, pipeline.plotting, report.figures"
    imports = ", ".join(f"physgen.{room}" for room in rooms.split(", "))
    code = f"import sys, {imports}; print({{'matplotlib'}} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "set()\n"


def test_units_are_those_of_textbooks(tmp_path: Path) -> None:
    with_scale, without = (pipeline.load(scene(tmp_path, text)) for text in (DROP, THROW))
    assert units(with_scale) == (("m", 200), ("J", 1000 * 200**2))
    assert units(without) == (("px", 1), ("g·px²/s²", 1))
