"""The whole trip in the browser, from a photo to a saved scene: docs/editor.gif, and docs/editor-yaml.webp beside it.

    python benchmarks/editor_trip.py

A photo of ours is perceived by `physgen edit`, its toy car pushed, two cubes that were taken for one object cut apart,
named, and all of it saved. tests/edit/test_edit_trip_browser.py makes the same steps and holds what comes of it against
`physgen simulate`. Chromium draws; pictures are this machine's fonts, so they are looked at, not compared.
"""

from __future__ import annotations

import argparse
import io
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "edit")]
from desk import Desk, launched, seated  # noqa: E402

PHOTO = ROOT / "scenes" / "toy-car" / "photo.png"
GIF = ROOT / "docs" / "editor.gif"
LARGEST = 2_500_000
"""Bytes of the GIF."""
VIEW = {"width": 1100, "height": 720}
WIDTH, STRIP = 880, 44
"""Of a frame, and of the words below it, px."""
COLOURS, FLAT = 240, 24
"""Of a GIF, and those of the page itself among them."""
Film = Callable[[str, int], None]
"""Takes a picture of the page, with words below it and for so many ms."""


def silent(words: str, ms: int) -> None:
    """No film."""


@contextmanager
def edited(photo: Path) -> Iterator[str]:
    """`physgen edit` of a photo in a process of its own; its address."""
    out = str(photo.parent / "out")
    command = [
        sys.executable,
        "-m",
        "physgen",
        "edit",
        str(photo),
        "--no-browser",
        "--json",
        "-o",
        out,
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())["address"]
        finally:
            process.terminate()


def trip(desk: Desk, film: Film = silent, scale: float = 1.0) -> None:
    """Push, correct, name, save; places are px of a photo of 512 px times `scale`."""
    page = desk.page

    def px(*points: Sequence[float]) -> list[tuple[float, float]]:
        return [((x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5) for x, y in points]

    car, block = thing_at(desk, *px((60, 410))), thing_at(desk, *px((362, 400)))
    film(
        "physgen edit photo.png: objects found, masses estimated; edit any of it", 2200
    )
    desk.panel("todo")
    film("To do: what the photo left in doubt", 1800)

    desk.panel("object")
    desk.tool("push")
    pushed(desk, px((75, 405), (205, 405)), film)
    desk.settled()
    played(desk, film, "The simulated motion")

    film("The two cubes move as one object: they were found as one", 1600)
    desk.tool("mask")
    desk.choose(block)
    page.wait_for_function("() => !document.querySelector('.mask-strip').hidden")
    desk.drawn()
    page.wait_for_timeout(300)
    film("Mask: the pixels of the object", 1400)
    page.click("[data-way=split]")
    (a, b), mouse = px((326, 386), (398, 388)), page.mouse
    mouse.move(*desk.at(a))
    mouse.down()
    for part in (0.35, 0.7, 1.0):
        mouse.move(*desk.at([p + part * (q - p) for p, q in zip(a, b, strict=True)]))
        desk.drawn()
        film("Cut: draw a line across it", 180)
    film("Cut: draw a line across it", 500)
    mouse.up()
    desk.settled()
    page.wait_for_function("() => !document.querySelector('.mask-strip.busy')")
    page.wait_for_function("() => window.editor.stage.drawn()")
    film("Two objects: shapes, masses and the background follow", 1800)

    for number, place in enumerate(px((364, 365), (362, 408)), 1):
        desk.choose(thing_at(desk, place))
        page.fill(".mask-label input", "wooden cube")
        page.press(".mask-label input", "Enter")
        desk.settled()
        page.wait_for_function("() => !document.querySelector('.mask-strip.busy')")
        film(f"Type a label, and mass and friction follow ({number} of 2)", 900)

    desk.tool("push")
    desk.choose(car)
    desk.panel("yaml")
    desk.drawn()
    played(desk, film, "Now each cube moves by itself")
    film("The same as text, edited either way", 1600)
    page.keyboard.press("Control+s")
    page.wait_for_function("() => window.editor.state.file.saved")
    page.wait_for_function(
        "() => document.querySelector('[data-part=saved]').textContent === 'saved'"
    )
    film("Saved: a YAML file that a person could have written", 2400)


def thing_at(desk: Desk, point: Sequence[float]) -> str:
    """The name of the object at a point of the photo."""
    found = desk.page.evaluate(
        "p => { window.editor.player.rewind(); return window.editor.stage.hit(p, {kinds: ['object']}); }",
        list(point),
    )
    assert found, f"nothing at {point}"
    return str(found["name"])


def pushed(desk: Desk, way: Sequence[Sequence[float]], film: Film) -> None:
    """A drag, with pictures on its way."""
    (a, b), mouse = way, desk.page.mouse
    mouse.move(*desk.at(a))
    film("Push: drag from an object", 900)
    mouse.down()
    for part in (0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0):
        mouse.move(
            *desk.at([p + part * (q - p) for p, q in zip(a, b, strict=True)]), steps=2
        )
        if film is not silent:
            desk.page.wait_for_timeout(220)
        film("Push: the arrow is the velocity; the path shows at once", 140)
    film("Push: the arrow is the velocity; the path shows at once", 900)
    mouse.up()


def played(desk: Desk, film: Film, words: str) -> None:
    """The motion, as fast as it is, at ten pictures a second."""
    if film is silent:
        return
    desk.page.wait_for_timeout(600)
    desk.page.evaluate(
        "() => { document.querySelector('[data-part=status]').textContent = ''; }"
    )
    for k in range(16):
        desk.page.evaluate(
            "t => { window.editor.player.pause(); window.editor.player.seek(t); }",
            k / 10,
        )
        desk.drawn()
        film(words, 100)
    film(words, 700)
    desk.page.evaluate("() => window.editor.player.rewind()")
    desk.drawn()


# ---- the film


class Reel:
    """Pictures of a page, put together as a GIF of few colours in which only what changes is written."""

    def __init__(self, desk: Desk) -> None:
        self.desk = desk
        self.frames: list[Image.Image] = []
        self.times: list[int] = []
        self.font = ImageFont.truetype("DejaVuSans.ttf", 19)

    def __call__(self, words: str, ms: int) -> None:
        """A picture with words below it, shown for so long."""
        shot = Image.open(io.BytesIO(self.desk.page.screenshot())).convert("RGB")
        shot = shot.resize(
            (WIDTH, round(shot.height * WIDTH / shot.width)), Image.Resampling.LANCZOS
        )
        frame = Image.new("RGB", (WIDTH, shot.height + STRIP), (22, 26, 32))
        frame.paste(shot, (0, 0))
        ImageDraw.Draw(frame).text(
            (16, shot.height + STRIP / 2), words, "#f2f4f6", self.font, "lm"
        )
        if self.frames and frame.tobytes() == self.frames[-1].tobytes():
            self.times[-1] += ms
            return
        self.frames.append(frame)
        self.times.append(ms)

    def write(self, path: Path) -> None:
        """One palette for all, no dither: flat colours pack well, and nothing shimmers."""
        palette = palette_of(self.frames)
        small = [
            frame.quantize(palette=palette, dither=Image.Dither.NONE)
            for frame in self.frames
        ]
        small[0].save(
            path,
            save_all=True,
            append_images=small[1:],
            duration=self.times,
            loop=0,
            optimize=False,
        )


def palette_of(frames: Sequence[Image.Image]) -> Image.Image:
    """The page's own colours, and others by the root of how common they are: a small car has its reds."""
    seen = np.concatenate(
        [np.asarray(frame)[::2, ::2].reshape(-1, 3) for frame in frames[::3]]
    )
    colours, counts = np.unique(seen, axis=0, return_counts=True)
    flat = colours[np.argsort(counts)[-FLAT:]]
    pixels = np.repeat(colours, np.ceil(np.sqrt(counts)).astype(int), axis=0)
    wide = 1024
    pixels = pixels[: len(pixels) // wide * wide].reshape(-1, wide, 3)
    palette = Image.fromarray(pixels).quantize(
        COLOURS - FLAT, Image.Quantize.MEDIANCUT, kmeans=4
    )
    palette.putpalette(
        [*palette.getpalette()[: 3 * (COLOURS - FLAT)], *flat.ravel().tolist()]
    )
    return palette


POINTER = """() => {
  const made = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  const line = document.createElementNS('http://www.w3.org/2000/svg', 'path');
  made.setAttribute('viewBox', '0 0 20 28');
  line.setAttribute('d', 'M2 1v21l5.5-5 3.5 8.5 3.6-1.5-3.5-8.4h7.4z');
  for (const [name, value] of [['fill', '#fff'], ['stroke', '#000'], ['stroke-width', '1.6']])
    line.setAttribute(name, value);
  made.append(line);
  const look = {position: 'fixed', zIndex: 99, left: 0, top: 0, width: '20px', height: '28px'};
  Object.assign(made.style, look, {pointerEvents: 'none'});
  document.body.append(made);
  addEventListener('pointermove', event => {
    made.style.transform = `translate(${event.clientX - 2}px, ${event.clientY - 1}px)`;
  }, true);
}"""
"""A browser without a screen draws none."""


def picture(desk: Desk, path: Path) -> None:
    """An error at its line."""
    page = desk.page
    desk.panel("yaml")
    desk.put_caret("velocity: [", after=len("velocity: ["))
    page.keyboard.type("fast")
    page.wait_for_selector(".yaml-number.wrong")
    taken(desk, path)


def taken(desk: Desk, path: Path) -> None:
    """The page as a WebP."""
    desk.page.mouse.move(560, 560)
    desk.page.evaluate(
        "() => { document.querySelector('[data-part=status]').textContent = ''; }"
    )
    desk.page.wait_for_timeout(600)
    shot = Image.open(io.BytesIO(desk.page.screenshot())).convert("RGB")
    shot.save(path, quality=88, method=6)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=GIF,
        help="the GIF, the picture beside it; default: docs/editor.gif",
    )
    options = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder, launched() as browser:
        photo = Path(shutil.copy(PHOTO, Path(folder) / "photo.png"))
        with (
            edited(photo) as address,
            seated(browser, address, viewport=VIEW, color_scheme="light") as desk,
        ):
            desk.page.evaluate(POINTER)
            desk.page.mouse.move(560, 560)
            desk.page.wait_for_timeout(1500)
            reel = Reel(desk)
            trip(desk, reel)
            picture(desk, options.output.with_name("editor-yaml.webp"))
            assert desk.errors == [], desk.errors
    reel.write(options.output)
    size = options.output.stat().st_size
    print(
        f"{options.output}: {len(reel.frames)} frames, {sum(reel.times) / 1000:.1f} s, {size:,} bytes"
    )
    return int(size > LARGEST)


if __name__ == "__main__":
    raise SystemExit(main())
