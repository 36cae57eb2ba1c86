"""How long a gallery of 1,000 and of 5,000 clips takes to open, search, sort and lay out, in headless Chromium.

Clips are folders with the manifest of one drawn scene each, a sweep over two keys; each has a poster of its
own, of 16 real films in turn. `pictures`: beside the page, or inside it as data URIs. Files are in the system's cache.
"""

from __future__ import annotations

import base64
import hashlib
import json
import sys
import time
from pathlib import Path
from statistics import median

import cv2
import numpy as np

from physgen.export.video import Format, open_video
from physgen.report.clips import clips_in
from physgen.report.films import poster
from physgen.report.gallery import gallery_page, write_gallery

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from browser import launched  # noqa: E402

COUNTS = (1000, 5000)
RUNS = 5
SIZE, FPS, FRAMES = (480, 320), 30, 60
LABELS = ("billiard ball", "wooden block", "tin can", "domino", "cup", "egg", "marble")
OPENED = """() => {
  const [gone] = performance.getEntriesByType('navigation');
  const paint = performance.getEntriesByName('first-contentful-paint')[0];
  return [gone.loadEventEnd, paint ? paint.startTime : NaN].map(ms => ms / 1000);
}"""
DRAWN = "new Promise(done => requestAnimationFrame(() => setTimeout(done)))"


def film(path: Path, seed: int) -> None:
    """A photo of the project with a disc that moves over it."""
    photos = sorted((ROOT / "scenes").glob("*/photo.png"))
    photo = cv2.resize(cv2.imread(str(photos[seed % len(photos)]))[:, :, ::-1], SIZE)
    with open_video(path.parent, Format.MP4, SIZE, FPS) as write:
        for k in range(FRAMES):
            frame = np.ascontiguousarray(photo)
            cv2.circle(
                frame, (20 + 7 * k, 60 + (k - 30) ** 2 // 5), 18, (240, 200, 60), -1
            )
            write(frame)


def folders(home: Path, count: int, films: list[Path]) -> None:
    """As many output folders, and the pictures of each where the gallery looks for them."""
    made = [poster(path) for path in films]
    beside = home / "index.files"
    beside.mkdir(parents=True)
    side = round(count**0.5)
    for k in range(count):
        folder = home / f"clip-{k:05d}"
        folder.mkdir()
        mass, friction = 10.0 + 5 * (k // side), round(0.01 * (k % side), 2)
        objects = {
            f"thing-{j}": {
                "label": LABELS[(k + j) % len(LABELS)],
                "mass": mass,
                "friction": friction,
                "velocity": [0, 0],
            }
            for j in range(9)
        }
        (folder / "video.mp4").hardlink_to(films[k % len(films)])
        seal = hashlib.sha256(str(k).encode()).hexdigest()
        manifest = {
            "manifest": 1,
            "scene": f"clip-{k:05d}",
            "variant": None,
            "overrides": [f"objects.*.mass={mass}", f"objects.*.friction={friction}"],
            "inputs": {},
            "warnings": [{"text": "scene.yaml:3:1: warning: rests on nothing"}]
            * (k % 50 == 0),
            "video": {"size": SIZE, "fps": FPS},
            "files": {"video.mp4": seal, "report.html": ""},
            "samples": [seal] * FRAMES,
            "frames": [seal] * FRAMES,
            "document": {
                "world": {"duration": 2, "gravity": [0, 980]},
                "objects": objects,
            },
        }
        (folder / "manifest.json").write_text(json.dumps(manifest))
        (beside / f"{seal[:20]}.poster.webp").write_bytes(made[k % len(made)])


def inside(home: Path) -> None:
    """The same page with its posters as data URIs."""
    clips = clips_in([home])
    beside = home / "index.files"
    held = [
        "data:image/webp;base64,"
        + base64.b64encode((beside / f"{c.seal}.poster.webp").read_bytes()).decode()
        for c in clips
    ]
    (home / "inside.html").write_text(gallery_page(clips, held, home, "inside"))


def opened(browser: object, page: Path, view: str) -> dict[str, float]:
    """Seconds until the page had loaded and something was seen, from nothing; then what asking it for things takes."""
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    tab = context.new_page()
    began = time.perf_counter()
    tab.goto(f"{page.as_uri()}#view={view}")
    tab.evaluate(DRAWN)
    shown = time.perf_counter() - began
    loaded, painted = tab.evaluate(OPENED)
    row = {"opened": shown, "loaded": loaded, "painted": painted}
    if view == "cards":
        took = f"async () => {{ const t = Date.now(); %s; await {DRAWN}; return (Date.now() - t) / 1000; }}"
        find = "document.querySelector('[data-part=%s]')"
        ask = f"const s = {find % 'search'}; s.value = 'clip-0042'; s.dispatchEvent(new Event('input'))"
        order = f"const s = {find % 'sort'}; s.value = '=name'; s.dispatchEvent(new Event('change'))"
        sort = f"{order}; {find % 'desc'}.click()"
        row["search"] = tab.evaluate(took % ask)
        tab.evaluate("() => document.querySelector('[data-part=reset]').click()")
        row["sort"] = tab.evaluate(took % sort)
    context.close()
    return row


def gallery(folder: Path) -> list[dict]:
    """One row a size and way to hold the pictures; medians of some runs."""
    films = []
    for seed in range(16):
        (folder / f"film-{seed}").mkdir()
        films.append(folder / f"film-{seed}" / "video.mp4")
        film(films[-1], seed)
    began = time.process_time()
    size = np.mean([len(poster(path)) for path in films]) / 1000
    rows = []
    for count in COUNTS:
        home = folder / str(count)
        folders(home, count, films)
        began = time.process_time()
        write_gallery([home], home / "index.html", title="benchmark")
        made = time.process_time() - began
        inside(home)
        for name, where, view in (
            ("index", "beside", "cards"),
            ("inside", "inside", "cards"),
            ("index", "beside", "grid"),
        ):
            page = home / f"{name}.html"
            with launched() as browser:
                runs = [opened(browser, page, view) for _ in range(RUNS)]
            row = {key: round(median(run[key] for run in runs), 3) for key in runs[0]}
            megabytes = round(page.stat().st_size / 1e6, 2)
            rows.append(
                {
                    "clips": count,
                    "view": view,
                    "pictures": where,
                    "made": round(made, 2),
                    "mb": megabytes,
                    **row,
                }
            )
    return [{**row, "poster_kb": round(size, 1)} for row in rows]
