"""`result.json` files of other measures that lie beside clips -> scores by method and by clip.

Of a file, the numbers of its `rows`: a row says whose it is by `method`, and of which scene by `scene`, `clip`,
`video` or `name`; where it does not, the folder that the file lies in does.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from physgen.evaluate.measure import RESULT
from physgen.evaluate.methods import Methods
from physgen.problems import InputError
from physgen.text import natural

SCENE_KEYS = ("scene", "clip", "video", "name")
NO_SCORES = {
    "low", "high", "counts", "count", "answers", "clips", "frames", "pairs", "seed", "row", "rank", "passed", "number",
}  # fmt: skip
"""Parts of names whose numbers say how a score came about, not how good it is."""
NO_ENDINGS = ("_95", "_more", "_sure", "_low", "_high", "_count")
LOWER = ("fid", "kid", "error", "distance", "alde", "seconds", "lpips")
HIGHER = (
    "physical",
    "photo",
    "psnr",
    "ssim",
    "iou",
    "precision",
    "recall",
    "plausible",
    "plausibility",
    "score",
)
"""Last words of names: whether less is better, or more."""
ABOUT_NOUGHT = {"kid"}
"""Distances that are below 0 by chance where two sets are alike."""
TINY = 1e-9
"""What is smaller is rounding."""
DEEP = 3
"""Levels of a row that are looked into."""
OWN = "leaderboard"
MOST_BYTES = 50_000_000


@dataclass
class Score:
    """One number of one measure."""

    name: str
    """Measure and number, as the table's head has them."""
    better: str
    """`low`, `high`, or nothing where it is not known."""
    methods: dict[str, float] = field(default_factory=dict)
    """As measured for a method as a whole."""
    clips: dict[tuple[str, str], float] = field(default_factory=dict)
    """(method, scene) -> of one clip."""

    def of(self, method: str) -> float | None:
        """As measured, else the mean of its clips; None where nothing is known."""
        if method in self.methods:
            return self.methods[method]
        own = [value for (name, _), value in self.clips.items() if name == method]
        return sum(own) / len(own) if own else None

    def best(self, names: Sequence[str]) -> set[str]:
        """Who is ahead, as shown; nobody where one alone is measured, all are alike, or nobody knows what is better."""
        known = {name: float(told(value)) for name in names if (value := self.of(name)) is not None}
        if ABOUT_NOUGHT & set(self.name.split()):  # below 0 it is by chance, and no better than 0
            known = {name: max(value, 0.0) for name, value in known.items()}
        if not self.better or len(set(known.values())) < 2:
            return set()
        top = min(known.values()) if self.better == "low" else max(known.values())
        return {name for name, value in known.items() if value == top}


def told(value: float | None) -> str:
    """Four digits.

    >>> [told(value) for value in (105.7012, 0.93, 4.0, 123456.7, 3e-14, None)]
    ['105.7', '0.9300', '4.000', '123457', '0', '-']
    """
    if value is None:
        return "-"
    if abs(value) < TINY:
        return "0"
    if 1e-4 <= abs(value) < 1e4:
        return f"{value:#.4g}".rstrip(".")
    return f"{value:.0f}" if abs(value) > 1 else f"{value:.3g}"


def scores_of(methods: Methods, more: Sequence[Path] = ()) -> list[Score]:
    """All that lie in the methods' folder, and those of the files or folders `more`, which must be results.

    Raises InputError where one of these is none; a file in the methods' folder that is none is passed over.
    """
    found: dict[str, Score] = {}
    for path, method, scene in _places(methods):
        record = _read(path)
        if record:
            _add(found, record, methods, method, scene)
    for path in more:
        file = path / RESULT if path.is_dir() else path
        record = _read(file)
        if not record:
            fix = f"name a {RESULT} that physgen evaluate -o DIR wrote, or its folder"
            raise InputError.of("--scores", f'"{path}"', "is no result of a measure", fix)
        if not _add(found, record, methods, None, None):
            names = ", ".join(methods.names[:4])
            fix = f'give its rows "method", one of {names}'
            raise InputError.of("--scores", f'"{path}"', "has no number of any of these methods", fix)
    return [score for score in found.values() if score.methods or score.clips]


def _places(methods: Methods) -> Iterator[tuple[Path, str | None, str | None]]:
    """Every result with the method and the scene whose folder it lies in, the whole before its parts."""
    yield methods.folder / RESULT, None, None
    for home in sorted(methods.folder.iterdir(), key=lambda path: natural(path.name)):
        if not home.is_dir() or home.name.startswith("."):
            continue
        method = home.name if home.name in methods.names else None
        yield home / RESULT, method, None
        if method is None:
            continue
        for folder in sorted(home.iterdir(), key=lambda path: natural(path.name)):
            if not folder.is_dir():
                continue
            scene = folder.name if (method, folder.name) in methods.entries else None
            yield folder / RESULT, method, scene
            if scene:
                for inner in sorted(folder.glob(f"*/{RESULT}")):
                    yield inner, method, scene


def _read(path: Path) -> Mapping[str, Any]:
    """Nothing where it is no result of a measure."""
    try:
        if not path.is_file() or path.stat().st_size > MOST_BYTES:
            return {}
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(record, dict) or not isinstance(record.get("rows"), list):
        return {}
    return {} if record.get("measure") == OWN or not isinstance(record.get("measure"), str) else record


def _add(
    found: dict[str, Score],
    record: Mapping[str, Any],
    methods: Methods,
    method: str | None,
    scene: str | None,
) -> bool:
    """Whether there was a number."""
    measure, any_number = str(record["measure"])[:40], False
    rows = [row for row in record["rows"] if isinstance(row, dict)]
    for row in rows:
        whose = method or (row.get("method") if row.get("method") in methods.names else None)
        which = scene or _scene(row, methods)
        if whose is None or (which is None and len(rows) > 1 and method is not None):
            continue  # several rows of one method, none of which is all of it
        if scene is not None and len(rows) > 1:
            continue  # parts of one clip
        for name, value in _numbers(row):
            label = f"{measure}: {name}" + (" (not comparable)" if record.get("comparable") is False else "")
            score = found.setdefault(label, Score(label, _better(name)))
            any_number = True
            if which is None:
                score.methods.setdefault(whose, value)
            else:
                score.clips.setdefault((whose, which), value)
    return any_number


def _scene(row: Mapping[str, Any], methods: Methods) -> str | None:
    """By its name, or by its file's."""
    for key in SCENE_KEYS:
        value = row.get(key)
        if isinstance(value, str):
            path = Path(value)
            for name in (value, path.stem, path.parent.name):
                if name in methods.scenes:
                    return name
    return None


def _numbers(row: Mapping[str, Any], before: str = "", deep: int = DEEP) -> Iterator[tuple[str, float]]:
    """Those that are scores, by their names; whether something is so counts as 0 or 1."""
    for key, value in row.items():
        name = str(key)
        if name in NO_SCORES or name.endswith(NO_ENDINGS) or len(name) > 60:
            continue
        path = before if name == "mean" and before else f"{before} {name}".strip().replace("_", " ")
        if isinstance(value, dict) and deep:
            yield from _numbers(value, path, deep - 1)
        elif isinstance(value, bool | int | float) and isfinite(value):
            yield path, float(value)


def _better(name: str) -> str:
    words = name.lower().split()
    if set(words) & set(LOWER):
        return "low"
    return "high" if set(words) & set(HIGHER) else ""
