"""A clip's labels -> a picture of each over its frame; each is read from its file as others read it."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from pycocotools import mask as rle
from pycocotools.coco import COCO

from physgen.export.flow import HIDDEN, OUTSIDE

U8 = NDArray[np.uint8]
LETTER, WIDE = 17, 640
"""px of letters, and of the pictures that they are drawn on; larger on larger ones."""
INKS = [
    tuple(int(c) for c in row)
    for row in cv2.cvtColor(
        np.array([[[(k * 67) % 180, 190, 255] for k in range(64)]], np.uint8),
        cv2.COLOR_HSV2RGB,
    )[0]
]


@dataclass(frozen=True)
class Shown:
    """A clip's labels, and the frame of it that is looked at."""

    home: Path
    index: int
    rgb: U8

    def file(self, name: str) -> Path:
        return self.home / name.format(self.index)

    def read(self, name: str) -> NDArray[np.generic]:
        """Of the frame; (H, W) or (H, W, 3) R, G, B."""
        found = cv2.imread(str(self.file(name)), cv2.IMREAD_UNCHANGED)
        return found if found.ndim == 2 else found[..., ::-1]

    def table(self, name: str) -> list[dict]:
        """Rows of a CSV file."""
        with self.file(name).open(encoding="utf-8") as file:
            return list(csv.DictReader(file))

    def json(self, name: str) -> dict:
        return json.loads(self.file(name).read_text(encoding="utf-8"))


def ink(number: int) -> tuple[int, int, int]:
    """sRGB of an id."""
    return INKS[number % len(INKS)]


def tinted(
    rgb: U8, mask: NDArray[np.bool_], colour: Sequence[int], share: float = 0.5
) -> None:
    rgb[mask] = (rgb[mask] * (1 - share) + np.array(colour) * share).astype(np.uint8)


def coloured(rgb: U8, ids: NDArray[np.integer], share: float = 0.5) -> U8:
    """Each id in its ink."""
    shown = rgb.copy()
    for number in np.unique(ids[ids > 0]).tolist():
        tinted(shown, ids == number, ink(number), share)
    return shown


def pen(rgb: U8) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    picture = Image.fromarray(np.ascontiguousarray(rgb))
    return picture, ImageDraw.Draw(picture)


def said(
    draw: ImageDraw.ImageDraw,
    at: tuple[float, float],
    text: str,
    colour: Sequence[int] = (255, 255, 255),
) -> None:
    font = ImageFont.load_default(LETTER * draw.im.size[0] / WIDE)
    draw.text(at, text, tuple(colour), font, stroke_width=2, stroke_fill=(20, 20, 20))


# ---- a picture of each format --------------------------------------------------------------------------------------


def frames(clip: Shown) -> Iterator[tuple[str, U8]]:
    yield "frames", np.asarray(clip.read("frames/{:05d}.png"), np.uint8)


def coco(clip: Shown) -> Iterator[tuple[str, U8]]:
    with redirect_stdout(StringIO()):
        told = COCO(str(clip.home / "coco/annotations.json"))
    rows = told.loadAnns(told.getAnnIds(imgIds=[clip.index + 1]))
    hidden = [
        row
        for row in told.dataset["hidden_annotations"]
        if row["image_id"] == clip.index + 1
    ]
    shown, whole = clip.rgb.copy(), clip.rgb.copy()
    for row in rows:
        tinted(shown, rle.decode(row["segmentation"]) > 0, ink(row["track_id"]))
    for row in rows + hidden:
        all_of_it = rle.decode(row["amodal_segmentation"])
        edges, _ = cv2.findContours(all_of_it, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        seen = (
            rle.decode(row["segmentation"]) if "segmentation" in row else 0 * all_of_it
        )
        tinted(whole, (all_of_it > 0) & (seen == 0), ink(row["track_id"]), 0.75)
        cv2.drawContours(whole, edges, -1, ink(row["track_id"]), 1)
    yield "coco: masks", shown
    picture, draw = pen(whole)
    for row in rows + hidden:
        if row["visible_fraction"] < 0.995:
            said(
                draw,
                tuple(row["amodal_bbox"][:2]),
                f"{row['visible_fraction']:.0%}",
                ink(row["track_id"]),
            )
    yield "coco: whole masks, visible share", np.asarray(picture)


def palette(name: str, masks: str) -> Callable[[Shown], Iterator[tuple[str, U8]]]:
    def show(clip: Shown) -> Iterator[tuple[str, U8]]:
        (path,) = clip.home.glob(f"{name}/{masks}/*/{clip.index:05d}.png")
        picture = np.asarray(Image.open(path).convert("RGB"))
        yield (
            name,
            np.where(
                picture.any(axis=2)[..., None], picture // 2 + clip.rgb // 2, clip.rgb
            ),
        )

    return show


def flo(clip: Shown) -> Iterator[tuple[str, U8]]:
    moved = cv2.readOpticalFlow(str(clip.file("flo/forward/{:05d}.flo")))
    told = clip.read("flo/visible/forward/{:05d}.png")
    shown = clip.rgb.copy()
    tinted(shown, told == HIDDEN, (255, 40, 40), 0.8)
    tinted(shown, told == OUTSIDE, (60, 90, 255), 0.8)
    picture, draw = pen(shown)
    for y in range(8, moved.shape[0], 16):
        for x in range(8, moved.shape[1], 16):
            u, v = moved[y, x].tolist()
            if np.hypot(u, v) > 0.5:
                draw.line((x, y, x + u, y + v), (255, 235, 60), 2)
                draw.ellipse((x - 2, y - 2, x + 2, y + 2), (255, 235, 60))
    yield "flo: the way; red: hidden next, blue: gone", np.asarray(picture)


def depth(clip: Shown) -> Iterator[tuple[str, U8]]:
    codes = clip.read("depth/{:05d}.png").astype(np.float32)
    low, high = np.percentile(codes, (0.5, 99.5))
    near = (255 * np.clip((high - codes) / max(high - low, 1), 0, 1)).astype(np.uint8)
    yield (
        "depth: bright is near",
        cv2.applyColorMap(near, cv2.COLORMAP_MAGMA)[..., ::-1],
    )


def normals(clip: Shown) -> Iterator[tuple[str, U8]]:
    yield "normals", (clip.read("normals/{:05d}.png") >> 8).astype(np.uint8)


def events(clip: Shown) -> Iterator[tuple[str, U8]]:
    told = clip.json("events/events.json")
    picture, draw = pen(clip.rgb)
    for event in told["events"]:
        place = event.get("place", {}).get("video")
        if (
            event["kind"] in ("collision", "push", "rest")
            and place
            and event["frame"] <= clip.index
        ):
            x, y = place
            colour = {"collision": (255, 80, 60), "push": (90, 200, 255)}.get(
                event["kind"], (120, 255, 120)
            )
            draw.ellipse((x - 5, y - 5, x + 5, y + 5), outline=colour, width=2)
    yield "events so far: red blows, blue pushes, green rests", np.asarray(picture)


def trajectory(clip: Shown) -> Iterator[tuple[str, U8]]:
    picture, draw = pen(clip.rgb)
    ways: dict[str, list[tuple[float, float]]] = {}
    for row in clip.table("trajectory/trajectory.csv"):
        ways.setdefault(row["object"], []).append(
            (float(row["video_x"]), float(row["video_y"]))
        )
    for k, way in enumerate(ways.values(), 1):
        draw.line(way, ink(k), 2)
        x, y = way[clip.index]
        draw.ellipse((x - 4, y - 4, x + 4, y + 4), ink(k))
    yield "trajectory: centres of mass", np.asarray(picture)


def physics(clip: Shown) -> Iterator[tuple[str, U8]]:
    rows = {
        row["object"]: row
        for row in clip.table("trajectory/trajectory.csv")
        if row["frame"] == str(clip.index)
    }
    picture, draw = pen(clip.rgb // 2)
    for k, item in enumerate(clip.json("physics/physics.json")["objects"], 1):
        at = (
            float(rows[item["name"]]["video_x"]) - 24,
            float(rows[item["name"]]["video_y"]) - 8,
        )
        said(
            draw,
            at,
            "fixed" if item["mass"] is None else f"{item['mass']:.4g} g",
            ink(k),
        )
    yield "physics: masses", np.asarray(picture)


PANELS: dict[str, Callable[[Shown], Iterator[tuple[str, U8]]]] = {
    "frames": frames,
    "coco": coco,
    "davis": palette("davis", "Annotations/Full-Resolution"),
    "flo": flo,
    "depth": depth,
    "normals": normals,
    "events": events,
    "trajectory": trajectory,
    "physics": physics,
}
