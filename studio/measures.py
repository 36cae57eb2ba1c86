"""How hard a photo is to see through: contrast at outlines, what touches, clutter, size, light; from stored truth."""

import json
from pathlib import Path

import cv2
import numpy as np

LOOK = 2.5  # px to either side of an outline
FAINT = 10.0  # CIE 1976 colour difference below which an outline is hard to see


def measure(scene: Path, truth: Path) -> dict:
    """One scene's numbers. `scene`: its folder of scenes/; `truth`: its folder of studio/truth/."""
    photo = cv2.imread(str(scene / "photo.png"))
    labels = cv2.imread(str(scene / "photo.assets/masks.png"), cv2.IMREAD_UNCHANGED)
    told = json.loads((truth / "truth.json").read_text())
    steps = outline_steps(photo, labels)
    areas = [np.sum(labels == entry["id"]) for entry in told["objects"]]
    return {
        "objects": len(areas),
        "touching_pairs": touching(labels),
        "size_px": round(float(np.median(np.sqrt(areas))), 1),
        "smallest_px": round(float(np.sqrt(min(areas))), 1),
        "outline_contrast": round(float(np.median(steps)), 1),
        "faint_outline": round(float(np.mean(steps < FAINT)), 3),
        "clutter": round(clutter(photo, labels), 4),
        "brightness": round(
            float(np.median(cv2.cvtColor(photo, cv2.COLOR_BGR2LAB)[..., 0]) / 2.55), 1
        ),
        "hardness": round(
            told["light"]["intensity"]
            / max(told["light"]["intensity"] + told["light"]["ambient"], 1e-9),
            2,
        ),
    }


def outline_steps(photo: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Colour difference (CIE 1976) across the outlines of all things, one number a pixel of outline."""
    lab = cv2.cvtColor(
        (cv2.GaussianBlur(photo, (0, 0), 0.8) / 255).astype(np.float32),
        cv2.COLOR_BGR2LAB,
    )
    found = []
    for key in np.unique(labels[labels > 0]):
        inside = (labels == key).astype(np.uint8)
        away = cv2.distanceTransform(
            1 - inside, cv2.DIST_L2, 5
        ) - cv2.distanceTransform(inside, cv2.DIST_L2, 5)
        dy, dx = np.gradient(cv2.GaussianBlur(away, (0, 0), 1.5))
        length = np.maximum(np.hypot(dx, dy), 1e-6)
        y, x = np.nonzero((inside > 0) & (away >= -1))
        ux, uy = dx[y, x] / length[y, x], dy[y, x] / length[y, x]
        out, back = (
            _sample(lab, x + s * LOOK * ux, y + s * LOOK * uy) for s in (1, -1)
        )
        found.append(np.linalg.norm(out - back, axis=-1))
    return np.concatenate(found)


def _sample(values: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    grid = x.astype(np.float32)[None], y.astype(np.float32)[None]
    return cv2.remap(values, *grid, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[
        0
    ]


def touching(labels: np.ndarray, near: int = 2, least: int = 4) -> int:
    """Pairs of things that come within `near` px of each other along at least `least` px."""
    pairs = set()
    for key in np.unique(labels[labels > 0]):
        rim = (
            cv2.dilate(
                (labels == key).astype(np.uint8), np.ones((2 * near + 1,) * 2, np.uint8)
            )
            > 0
        )
        beside, count = np.unique(
            labels[rim & (labels > 0) & (labels != key)], return_counts=True
        )
        pairs |= {
            frozenset((int(key), int(k)))
            for k, n in zip(beside, count, strict=True)
            if n >= least * near
        }
    return len(pairs)


def clutter(photo: np.ndarray, labels: np.ndarray) -> float:
    """Share of the background's pixels that lie on an edge (Canny)."""
    clear = cv2.dilate((labels > 0).astype(np.uint8), np.ones((9, 9), np.uint8)) == 0
    return float((cv2.Canny(photo, 40, 100)[clear] > 0).mean())


HALVES = ("tune", "test")
MEANS = (
    "objects",
    "touching_pairs",
    "size_px",
    "outline_contrast",
    "faint_outline",
    "clutter",
    "brightness",
    "hardness",
)


def halves(split: dict, rows: dict[str, dict]) -> dict[str, dict]:
    """Means of the two halves of the split."""
    return {
        half: {
            key: round(float(np.mean([rows[name][key] for name in split[half]])), 3)
            for key in MEANS
        }
        for half in HALVES
    }
