"""Photos of random homes into a folder: STEM.png, STEM.labels.png, STEM.normals.png, STEM.shadow.png, STEM.json.

    python studio/segmentation/homes/make.py --family train --count 2000 --seed 0 -o DIR --jobs 2
    python studio/segmentation/homes/make.py --family homes --count 24 --seed 0 -o DIR --size 384 --samples 48
    python studio/segmentation/homes/make.py --store DIR      # DIR's photos into studio/segmentation/validation
    python studio/segmentation/homes/make.py --sheet DIR      # DIR/sheet.png, outlines drawn

What is there already is not made again. A photo whose making fails is told and left out.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))
VALIDATION = ROOT / "studio/segmentation/validation"
MAPS = ("labels", "normals", "shadow")


def write(folder: Path, stem: str, photo: object) -> None:
    """The photo last, so that what has one is complete."""
    from studio.darkroom import png

    png(folder / f"{stem}.labels.png", photo.labels)
    png(folder / f"{stem}.normals.png", np.clip(np.round(photo.normals * 127 + 128), 0, 255).astype(np.uint8))
    png(folder / f"{stem}.shadow.png", np.round(photo.shadow * 255).astype(np.uint8))
    (folder / f"{stem}.json").write_text(
        json.dumps({"kinds": photo.kinds, "truncated": photo.truncated}) + "\n"
    )
    png(folder / f"{stem}.png", photo.rgb)


def work(arguments: argparse.Namespace, first: int, step: int) -> None:
    """Every `step`-th seed from `first` on."""
    from studio.optics import dr
    from studio.segmentation.homes.photograph import photograph

    if arguments.jobs > 1:
        dr.set_thread_count(1)
    for seed in range(arguments.seed + first, arguments.seed + arguments.count, step):
        stem, start = f"{arguments.family}-{seed:06d}", time.monotonic()
        if (arguments.out / f"{stem}.png").exists():
            continue
        try:
            photo = photograph(seed, arguments.family, arguments.size, arguments.samples)
        except Exception as problem:
            print(f"{stem}: {type(problem).__name__}: {problem}", flush=True)
            continue
        write(arguments.out, stem, photo)
        print(f"{stem}: {len(photo.kinds)} things, {time.monotonic() - start:.1f} s", flush=True)
        del photo
        gc.collect()  # scenes that linger would join in the next one's kernel


def store(folder: Path, target: Path = VALIDATION) -> None:
    """A folder's photos as JPEG of quality 90, their labels as 16 bit PNG (65535 = unsaid), their kinds in one file."""
    from studio.darkroom import png

    target.mkdir(parents=True, exist_ok=True)
    told = {}
    for path in sorted(folder.glob("homes-??????.png")):
        labels = cv2.imread(str(path.with_suffix(".labels.png")), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(target / f"{path.stem}.jpg"), cv2.imread(str(path)), [cv2.IMWRITE_JPEG_QUALITY, 90])
        png(target / f"{path.stem}.labels.png", labels)
        told[path.stem] = json.loads(path.with_suffix(".json").read_text())
    lines = ",\n".join(f'  "{name}": {json.dumps(facts)}' for name, facts in told.items())
    (target / "homes.json").write_text("{\n" + lines + "\n}\n")


def sheet(folder: Path, most: int = 48, tile: int = 256) -> Path:
    """Photos beside each other, every thing outlined in a colour of its own."""
    tiles = []
    paths = [
        p
        for p in sorted(folder.iterdir())
        if p.suffix in (".png", ".jpg") and "." not in p.stem and p.stem != "sheet"
    ]
    for path in paths[:most]:
        image = cv2.imread(str(path))
        labels = cv2.imread(str(path.with_suffix(".labels.png")), cv2.IMREAD_UNCHANGED)
        for k in np.unique(labels):
            if k in (0, 65535):
                continue
            code = cv2.cvtColor(np.uint8([[[k * 47 % 180, 255, 255]]]), cv2.COLOR_HSV2BGR)[0, 0].tolist()
            lines, _ = cv2.findContours((labels == k).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(image, lines, -1, code, 1)
        scale = tile / max(image.shape[:2])
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        image = np.pad(image, [(0, tile - image.shape[0]), (0, tile - image.shape[1]), (0, 0)])
        tiles.append(image)
    across = max(1, round(len(tiles) ** 0.5 * 1.2))
    tiles += [np.zeros((tile, tile, 3), np.uint8)] * (-len(tiles) % across)
    rows = [np.concatenate(tiles[k : k + across], 1) for k in range(0, len(tiles), across)]
    cv2.imwrite(str(folder / "sheet.png"), np.concatenate(rows))
    return folder / "sheet.png"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--family", choices=["train", "homes"], default="train")
    parser.add_argument("--count", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0, help="the first photo's")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/homes"))
    parser.add_argument("--size", type=int, default=256, help="px of the longer side")
    parser.add_argument("--samples", type=int, default=12, help="rays a pixel")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--store", type=Path, metavar="DIR")
    parser.add_argument("--sheet", type=Path, metavar="DIR")
    parser.add_argument("--job", type=int, default=None, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.store or arguments.sheet:
        store(arguments.store) if arguments.store else print(sheet(arguments.sheet))
        return
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.jobs == 1 or arguments.job is not None:
        work(arguments, arguments.job or 0, arguments.jobs)
        return
    command = [sys.executable, *sys.argv]
    started = [
        subprocess.Popen([*command, "--job", str(k)], env=dict(os.environ)) for k in range(arguments.jobs)
    ]
    sys.exit(max(process.wait() for process in started))


if __name__ == "__main__":
    main()
