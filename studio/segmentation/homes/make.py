"""Photos of random homes into a folder: STEM.png, STEM.labels.png, STEM.normals.png, STEM.shadow.png, STEM.json.

    python studio/segmentation/homes/make.py --count 2000 --seed 0 -o DIR --jobs 2

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

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))


def write(folder: Path, stem: str, photo: object) -> None:
    """The photo last, so that what has one is complete."""
    from studio.darkroom import png

    png(folder / f"{stem}.labels.png", photo.labels)
    png(
        folder / f"{stem}.normals.png",
        np.clip(np.round(photo.normals * 127 + 128), 0, 255).astype(np.uint8),
    )
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
        stem, start = f"home-{seed:06d}", time.monotonic()
        if (arguments.out / f"{stem}.png").exists():
            continue
        try:
            photo = photograph(seed, arguments.size, arguments.samples)
        except Exception as problem:
            print(f"{stem}: {type(problem).__name__}: {problem}", flush=True)
            continue
        write(arguments.out, stem, photo)
        print(
            f"{stem}: {len(photo.kinds)} things, {time.monotonic() - start:.1f} s",
            flush=True,
        )
        del photo
        gc.collect()  # scenes that linger would join in the next one's kernel


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0, help="the first photo's")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/homes"))
    parser.add_argument("--size", type=int, default=256, help="px of the longer side")
    parser.add_argument("--samples", type=int, default=12, help="rays a pixel")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--job", type=int, default=None, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.jobs == 1 or arguments.job is not None:
        work(arguments, arguments.job or 0, arguments.jobs)
        return
    command = [sys.executable, *sys.argv]
    started = [
        subprocess.Popen([*command, "--job", str(k)], env=dict(os.environ))
        for k in range(arguments.jobs)
    ]
    sys.exit(max(process.wait() for process in started))


if __name__ == "__main__":
    main()
