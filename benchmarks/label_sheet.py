"""Every label of one clip over its frame, on a sheet to be looked at; each is read from its file as others read it.

    python benchmarks/label_sheet.py                          # scenes/kitchen -> out/labels.png
    python benchmarks/label_sheet.py billiards --at 0.3 -o sheet.png --set render.motion_blur=0.5

Normals and depth are the studio's true ones, since bundled scenes have none.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from label_panels import PANELS, WIDE, Shown, said
from PIL import Image, ImageDraw

from physgen import pipeline
from physgen.export.formats import FORMATS
from physgen.maps import write_assets
from physgen.photos import read_image

ROOT = Path(__file__).resolve().parent.parent
COLUMNS, GAP = 4, 6


def mapped(name: str, folder: Path) -> Path:
    """A bundled scene with the studio's depth and normals."""
    shutil.copytree(ROOT / "scenes" / name, folder / name)
    truth = ROOT / "studio/truth" / name
    path, told = (
        folder / name / "scene.yaml",
        json.loads((truth / "truth.json").read_text()),
    )
    maps = pipeline.percepts(pipeline.load(path))
    assert maps is not None
    near, far = told["depth"]["near"], told["depth"]["far"]
    raw = cv2.imread(str(truth / "depth.png"), cv2.IMREAD_UNCHANGED).astype(np.float32)
    turned = (read_image(truth / "normals.webp").astype(np.float32) - 128) / 127
    maps = replace(
        maps,
        depth=np.asarray(near + raw / 65534 * (far - near), np.float32),
        normals=turned,
    )
    ranges = write_assets(maps, folder / name / "photo.assets")
    text = path.read_text(encoding="utf-8")
    path.write_text(
        text.replace(
            "\nobjects:", f"\nmaps: {{depth: {list(ranges['depth'])}}}\nobjects:", 1
        )
    )
    return path


def sheet(home: Path, part: float) -> Image.Image:
    """Of a clip's labels, at a part of it."""
    names = sorted((home / "frames").iterdir())
    index = min(round(part * len(names)), len(names) - 2)
    clip = Shown(home, index, read_image(names[index]))
    panels = [panel for show in PANELS.values() for panel in show(clip)]
    height = round(WIDE * clip.rgb.shape[0] / clip.rgb.shape[1])
    rows = -(-len(panels) // COLUMNS)
    made = Image.new(
        "RGB",
        (COLUMNS * (WIDE + GAP) - GAP, rows * (height + GAP) - GAP),
        (255, 255, 255),
    )
    for k, (title, rgb) in enumerate(panels):
        picture = Image.fromarray(np.asarray(rgb, np.uint8)).resize(
            (WIDE, height), Image.Resampling.LANCZOS
        )
        said(ImageDraw.Draw(picture), (8, 5), title)
        made.paste(picture, (k % COLUMNS * (WIDE + GAP), k // COLUMNS * (height + GAP)))
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "scene",
        nargs="?",
        default="kitchen",
        help="a folder of scenes/; default: kitchen",
    )
    parser.add_argument("--at", type=float, default=0.45, help="part of the clip")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/labels.png"))
    options = parser.parse_args()
    every = [kind.name for kind in FORMATS]
    assert set(PANELS) == set(every), "each format has a picture"
    with tempfile.TemporaryDirectory() as folder:
        scene = mapped(options.scene, Path(folder))
        home = pipeline.render_scene(
            scene,
            Path(folder) / "out",
            overrides=options.set,
            formats=(),
            page=pipeline.Page.NONE,
            export=every,
        )
        options.output.parent.mkdir(parents=True, exist_ok=True)
        sheet(home, options.at).save(options.output)
    print(options.output)


if __name__ == "__main__":
    main()
