"""Drawn and rendered pictures -> stores that training reads: `gather.py --drawn 8000 -o FOLDER`, `gather.py --pictures DIR -o FOLDER`."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from drawn import draw
from picture import Picture
from store import fill


def _loaded(stems: list[tuple[Path, str]], k: int) -> Picture:
    return Picture.load(*stems[k])


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drawn", type=int, default=0, help="so many drawn pictures")
    parser.add_argument("--first", type=int, default=1000, help="the first one's seed")
    parser.add_argument(
        "--pictures", type=Path, help="a folder of pictures as Picture.save writes them"
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    if args.pictures is None and not args.drawn:
        parser.error("nothing to gather; say --drawn N or --pictures DIR")
    if args.pictures is None:
        count, first, make = args.drawn, args.first, draw
    else:
        names = sorted(
            p.name.removesuffix(".labels.png")
            for p in args.pictures.glob("*.labels.png")
        )
        if not names:
            parser.error(
                f"{args.pictures}: holds no pictures; make some with homes/make.py"
            )
        count, first, make = (
            len(names),
            0,
            partial(_loaded, [(args.pictures, name) for name in names]),
        )
    for there in fill(args.output, count, first, args.jobs, make):
        if there % 200 == 0:
            print(f"{there} of {count}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
