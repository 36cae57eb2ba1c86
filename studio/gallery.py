"""docs/gallery.md and its pictures: scenes and what physgen makes of it, beside the truth where it was filmed; and
the pictures of the README.

python studio/gallery.py            # all scenes; needs no Mitsuba
"""

import sys
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]
from physgen import pipeline, registry  # noqa: E402
from physgen.evaluate.fidelity import render_own_frames, truths  # noqa: E402
from physgen.photos import read_image  # noqa: E402
from physgen.render.overlay import annotate_frames  # noqa: E402
from physgen.render.stage import Frame  # noqa: E402
from physgen.scene.scene import Overlay  # noqa: E402
from physgen.simulate.engine import simulate  # noqa: E402

LEFT_OUT = (
    "cans",
    "cups",
    "kitchen",
    "marbles",
    "pendulum",
    "pyramid",
    "ramp",
    "seesaw",
    "shelf",
    "toy-car",
)
"""Scenes for tests and measures, whose clips a reviewer would not take for filmed ones: `make demo` leaves them out, too."""
COLUMNS = 6
WIDE = 240  # px of one picture


def frames(
    scene_file: Path, times: np.ndarray, variant: str | None = None
) -> list[Frame]:
    """The scene as physgen renders it at `times` (s, from 0)."""
    scene = pipeline.load(scene_file, variant=variant)
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    return list(
        pipeline.render(
            pipeline.stage(scene, compiled, maps), simulate(compiled.world, times)
        )
    )


def row(pictures: list[np.ndarray]) -> np.ndarray:
    """Pictures side by side, WIDE px each, with a hair of white between them."""
    height = round(WIDE * pictures[0].shape[0] / pictures[0].shape[1])
    small = [
        cv2.resize(p, (WIDE, height), interpolation=cv2.INTER_AREA) for p in pictures
    ]
    return np.hstack(
        [np.pad(p, ((0, 4), (0, 4), (0, 0)), constant_values=255) for p in small]
    )


def sheet(name: str) -> np.ndarray:
    """A scene's contact sheet: physgen's frames, below those of its truth video at the same poses where it was filmed."""
    file, told = (
        ROOT / "scenes" / name / "scene.yaml",
        ROOT / "studio/truth" / name / "film/film.json",
    )
    if not told.exists():
        times = np.linspace(0, pipeline.load(file).world.duration * 0.95, COLUMNS)
        return row([f.rgb for f in frames(file, times)])
    (truth,) = truths(ROOT / "studio/truth", [name])
    drawn = [truth.maps.rgb, *render_own_frames(truth, truth.scene, truth.maps)]
    pick = [0, *(1 + np.linspace(0, len(drawn) - 2, COLUMNS - 1)).astype(int)]
    true = [
        truth.maps.rgb,
        *(read_image(told.parent / f"{k:02}.webp") for k in pick[1:]),
    ]
    return np.vstack([row(true), row([drawn[k] for k in pick])])


HERO, HERO_WIDE, HERO_FPS, HERO_SECONDS = "billiards", 640, 20, 2
"""Scene, width in px, frames a second and length of the README's animation."""
HOLD = 16
"""Frames for which its photo, and the outlines with the push, stand still."""
FOUND = {"billiards": True, "dominoes": True, "pendulum": False, "cans": False}
"""Photos of the README that suit, and that do not."""


def hero() -> list[np.ndarray]:
    """The photo, its outlines and push, and the video, one after the other."""
    scene = pipeline.load(ROOT / "scenes" / HERO / "scene.yaml")
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    trajectory = simulate(compiled.world, np.arange(0, HERO_SECONDS, 1 / HERO_FPS))
    drawn = list(pipeline.render(pipeline.stage(scene, compiled, maps), trajectory))
    marked = next(
        annotate_frames(
            iter(drawn[:1]),
            compiled.world,
            trajectory,
            (Overlay.OUTLINES, Overlay.VELOCITY),
        )
    )
    every = [drawn[0].rgb] * HOLD + [marked.rgb] * HOLD + [frame.rgb for frame in drawn]
    size = HERO_WIDE, round(HERO_WIDE * scene.size[1] / scene.size[0])
    return [cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) for rgb in every]


def found(name: str) -> np.ndarray:
    """The photo with the outlines of the objects that perception finds."""
    rgb = read_image(ROOT / "scenes" / name / "photo.png")
    labels, picture = registry.make("segment")(rgb).labels, rgb.copy()
    for k in range(1, int(labels.max()) + 1):
        loops, _ = cv2.findContours(
            (labels == k).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(picture, loops, -1, (255, 255, 255), 7)
        cv2.drawContours(picture, loops, -1, (0, 120, 255), 4)
    return _square(picture)


def readme() -> None:
    """docs/hero.webp and docs/found.webp."""
    first, *others = map(Image.fromarray, hero())
    first.save(
        ROOT / "docs/hero.webp", "WEBP", save_all=True, append_images=others, duration=1000 // HERO_FPS,
        loop=0, quality=60, method=6,
    )  # fmt: skip
    Image.fromarray(row([found(name) for name in FOUND])).save(
        ROOT / "docs/found.webp", "WEBP", quality=82, method=6
    )


def main() -> None:
    readme()
    folder = ROOT / "docs/gallery"
    folder.mkdir(exist_ok=True)
    lines = [
        "# Bundled scenes",
        "",
        "<!-- Written by `python studio/gallery.py`; do not edit. -->",
        "",
        "The photos are our own (`studio/README.md`), so that physgen's videos can be compared with the truth,",
        "path-traced by Mitsuba and shown above ours where it was made. Each scene is a folder of `scenes/`, which has more scenes.",
        "",
    ]
    names = {p.parent.name for p in (ROOT / "scenes").glob("*/scene.yaml")}
    for name in sorted(names - {*LEFT_OUT}):
        picture = sheet(name)
        Image.fromarray(picture).save(
            folder / f"{name}.webp", "WEBP", quality=82, method=6
        )
        story = [
            line[2:]
            for line in (ROOT / "scenes" / name / "scene.yaml")
            .read_text()
            .splitlines()[:8]
            if line.startswith("# ")
        ]
        text = " ".join(
            line
            for line in story
            if "$schema" not in line and "studio/sets" not in line
        )
        lines += [
            f"## {name}",
            "",
            text,
            "",
            f"![{name}](gallery/{name}.webp)",
            "",
        ]
    (ROOT / "docs/gallery.md").write_text("\n".join(lines).rstrip() + "\n")


def _square(photo: np.ndarray) -> np.ndarray:
    """The middle of a photo."""
    height, width = photo.shape[:2]
    side = min(height, width)
    y, x = (height - side) // 2, (width - side) // 2
    return cv2.resize(
        photo[y : y + side, x : x + side], (512, 512), interpolation=cv2.INTER_AREA
    )


if __name__ == "__main__":
    main()
