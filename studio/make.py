"""Render the studio's scenes: photos, truth, truth videos, clips. `python studio/make.py --help`."""

import argparse
import importlib
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path[:0] = [str(ROOT / "studio"), str(ROOT / "studio" / "sets"), str(ROOT)]


def names() -> list[str]:
    """Every scene of studio/sets, by file."""
    return sorted(
        path.stem.replace("_", "-") for path in (ROOT / "studio/sets").glob("[a-z]*.py")
    )


def differences(out: Path) -> None:
    """How far photos are from the stored ones: on another kind of processor, by noise."""
    import cv2
    import numpy as np

    for new in sorted(out.glob("scenes/*/photo.png")):
        was, now = cv2.imread(str(ROOT / new.relative_to(out))), cv2.imread(str(new))
        if was is not None and was.shape == now.shape:
            off = np.abs(was.astype(float) - now).mean()
            print(
                f"{new.parent.name}: {off:.3f} grey levels from the stored photo, in the mean"
            )


def look(stage: object, path: Path, scale: float, rays: float) -> None:
    """The photo alone, small and quick."""
    from darkroom import denoise, develop, png
    from exposure import Studio, picture
    from photograph import scaled

    studio = Studio(stage, scaled(stage.camera, scale * 0.5))
    seen = picture(studio, studio.scene()[0], max(4, round(16 * rays)))
    png(
        path,
        develop(
            denoise(seen.light, seen.albedo, seen.normals),
            stage.exposure,
            stage.vignette,
        ),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "scenes", nargs="*", help=f"names of scenes; all without ({', '.join(names())})"
    )
    parser.add_argument(
        "--only",
        choices=["photo", "truth", "story", "wide", "video", "clips"],
        action="append",
        help="only these; all without (truth: maps and light beside the photo as it is; story: the scene file alone)",
    )
    parser.add_argument(
        "--scale",
        type=float,
        default=1.0,
        help="size of the pictures, 0.5 for a quick look",
    )
    parser.add_argument(
        "--rays",
        type=float,
        default=1.0,
        help="times the usual rays a pixel, 0.1 for a quick look",
    )
    parser.add_argument(
        "--look",
        type=Path,
        metavar="FILE",
        help="a quick look at the first scene's photo: half size, few rays; nothing else",
    )
    parser.add_argument(
        "--keep-shading",
        action="store_true",
        help="with --only truth: shading stays as it is",
    )
    parser.add_argument(
        "-o",
        dest="out",
        type=Path,
        default=ROOT,
        help="where scenes/ and studio/truth/ are written",
    )
    args = parser.parse_args()
    wanted = args.only or ["photo", "wide", "video", "clips"]
    start = time.monotonic()
    from film import clips, film
    from photograph import WIDE, photograph, remeasure, retell, widen
    from records import Quality

    if args.look:
        if not args.scenes:
            parser.error("--look needs the name of a scene")
        look(
            importlib.import_module(args.scenes[0].replace("-", "_")).stage(),
            args.look,
            args.scale,
            args.rays,
        )
        return
    folders = args.out / "scenes", args.out / "studio/truth"
    for name in args.scenes or names():
        stage = importlib.import_module(name.replace("-", "_")).stage()
        if "photo" in wanted:
            photograph(stage, *folders, Quality().times(args.rays), args.scale)
        if "truth" in wanted:
            remeasure(
                stage,
                *folders,
                Quality().times(args.rays),
                args.scale,
                not args.keep_shading,
            )
        if "story" in wanted:
            retell(stage, *folders)
        if "wide" in wanted:
            widen(stage, folders[1], WIDE.times(args.rays), args.scale)
        if "video" in wanted:
            film(stage, *folders, max(4, round(64 * args.rays)), args.scale)
        if "clips" in wanted:
            clips(
                stage,
                *folders,
                max(4, round(32 * args.rays)),
                round(256 * args.scale),
                args.scale,
            )
    if args.out.resolve() != ROOT:
        differences(args.out)
    print(f"all in {(time.monotonic() - start) / 60:.1f} minutes")


if __name__ == "__main__":
    main()
