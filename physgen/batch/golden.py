"""Check a scene against its golden files and write a report page when it differs."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, floor, log10
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen import __version__
from physgen.batch.compare import MEASURES, SLACK, Compared, Drawn, Moved
from physgen.batch.golden_files import PICTURE, Clip, DamagedError, Golden, read, save, taken, track, units
from physgen.batch.golden_verdict import Verdict, judged, of_frame, summary_lines
from physgen.batch.tolerances import GoldenOptions
from physgen.files import write_atomic
from physgen.pipeline import Warm
from physgen.report.html import template
from physgen.report.perception import Comparison, Picture

# ----------------------------------------------------------------------
# How far objects are from where they were -> charts over time and the ways they went, as coordinates for SVG.

Array = NDArray[np.float64]

WIDTH, HEIGHT = 720, 230
LEFT, RIGHT, TOP, BOTTOM = 64, 14, 12, 30
"""px of a chart and its margins."""
MOST_LINES = 10
"""As many as there are colours."""
NAMES = {
    "px": "Away from where it was",
    "degrees": "Turned otherwise",
    "px_per_s": "Velocity",
    "degrees_per_s": "Spin",
}
MARGIN = 0.08
"""Of the larger side of a box around ways."""


@dataclass(frozen=True)
class Chart:
    """One measure over time, on a logarithmic scale."""

    title: str
    unit: str
    lines: tuple[tuple[int, str, str], ...]
    """Colour, name and points of each object."""
    ups: tuple[tuple[str, float], ...]
    """Labels of the scale, and where they stand."""
    acrosses: tuple[tuple[str, float], ...]
    allowed: tuple[str, float]
    first: tuple[str, float]
    """The time at which the first object strays."""


def shown(moved: Moved) -> list[str]:
    """The objects that are drawn, the first to stray first: those that stray farthest."""
    far = sorted(moved.strayed, key=lambda item: -moved.excess[:, moved.names.index(item.name)].max())[
        :MOST_LINES
    ]
    return [item.name for item in moved.strayed if item in far]


def charts(moved: Moved) -> list[Chart]:
    """One for each measure of which more is apart somewhere than is allowed."""
    names = shown(moved)
    over = [name for name in moved.apart if moved.most(name) > getattr(moved.allowed, name) * SLACK]
    return [_chart(moved, measure, names) for measure in over]


def _chart(moved: Moved, measure: str, names: list[str]) -> Chart:
    apart, allowed = moved.apart[measure], float(getattr(moved.allowed, measure))
    low, high = floor(log10(allowed)) - 1, max(ceil(log10(moved.most(measure))), floor(log10(allowed)) + 1)
    times = moved.times
    end = float(times[-1]) or 1.0

    def up(value: Array | float) -> Any:
        share = (np.log10(np.maximum(value, 10.0**low)) - low) / (high - low)
        return np.round(TOP + (1 - share) * (HEIGHT - TOP - BOTTOM), 1)

    def across(time: Array | float) -> Any:
        return np.round(LEFT + np.asarray(time) / end * (WIDTH - LEFT - RIGHT), 1)

    step = max(1, ceil((high - low) / 5))
    lines = [
        (
            k,
            name,
            " ".join(
                f"{x},{y}" for x, y in zip(across(times), up(apart[:, moved.names.index(name)]), strict=True)
            ),
        )
        for k, name in enumerate(names)
    ]
    begins = moved.strayed[0].time
    return Chart(
        NAMES[measure],
        MEASURES[measure].strip(),
        tuple(lines),
        tuple((f"{10.0**power:g}", float(up(10.0**power))) for power in range(low, high + 1, step)),
        tuple((f"{time:g}", float(across(time))) for time in _round_times(end)),
        (f"{allowed:g}", float(up(allowed))),
        (f"{begins:.3f}", float(across(begins))),
    )


def _round_times(end: float) -> list[float]:
    """About five from 0 on."""
    rough = end / 5
    power = 10.0 ** floor(log10(rough))
    step = next(power * k for k in (1, 2, 5, 10) if power * k >= rough * 0.999)
    return [round(k * step, 9) for k in range(int(end / step + 1e-9) + 1)]


@dataclass(frozen=True)
class Ways:
    """Where objects went, then and now, px of the photo."""

    box: tuple[float, float, float, float]
    """x, y, width, height."""
    unit: float
    """px: what a hundredth of the picture is."""
    lines: tuple[tuple[int, str, str, str], ...]
    """Colour, name, and the points of both ways."""


def ways(moved: Moved, size: tuple[int, int] | None) -> Ways | None:
    """On the whole canvas where its `size`, px, is given, else around the ways; None where nothing went elsewhere."""
    names = shown(moved)
    if not names or moved.most("px") <= moved.allowed.px * SLACK:
        return None
    both = [
        tuple(track.places[:, track.names.index(name)] for track in (moved.then, moved.now)) for name in names
    ]
    if size is not None:
        box = -0.5, -0.5, float(size[0]), float(size[1])
    else:
        spots = np.concatenate([way for ways in both for way in ways])
        low, high = spots.min(axis=0), spots.max(axis=0)
        margin = MARGIN * max(float((high - low).max()), 20.0)
        x, y, width, height = (round(float(v), 1) for v in (*(low - margin), *(high - low + 2 * margin)))
        box = x, y, width, height
    lines = tuple(
        (k, name, _points(then), _points(now))
        for k, (name, (then, now)) in enumerate(zip(names, both, strict=True))
    )
    return Ways(box, round(max(box[2:]) / 100, 3), lines)


def _points(way: Array) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in way)


# ----------------------------------------------------------------------
# A verdict -> one HTML page: what was expected, what came, the difference, motion apart from pixels.

U8 = NDArray[np.uint8]

FACTORS = (64, 32, 16, 8, 4, 2, 1)
"""By how much differences may be amplified."""
BRIGHT = 320
"""Grey levels up to which the largest difference of a frame is amplified; more than 255 are shown as 255."""
MOST_ROWS = 200


def page(verdict: Verdict, test: str) -> str:
    """The page of a test, by its node id; all that it needs is in it, and whatever comes from outside is escaped."""
    html: str = template("golden.html.j2").render(
        test=test,
        scene=verdict.scene,
        headline=headline(verdict),
        lines=summary_lines(verdict),
        first=_first(verdict.drawn),
        frames=_frames(verdict.drawn),
        moved=_motion(verdict),
        causes=verdict.causes,
        made=_made(verdict),
        version=__version__,
    )
    return html


def headline(verdict: Verdict) -> str:
    """In a few words."""
    moved, drawn = verdict.moved, verdict.drawn
    if verdict.pixels_alone:
        return "Moves as it did, looks different"
    if moved is not None and not moved.agrees:
        return "Moves differently" + (
            "" if drawn is None or not drawn.agrees else ", looks the same in the frames kept"
        )
    if drawn is not None and not drawn.agrees:
        return "Looks different; motion was not compared"
    return "Cannot be compared as it is asked"


def _first(drawn: Drawn | None) -> Comparison | None:
    """The first bad frame, to slide between then and now."""
    frame = None if drawn is None else drawn.first
    if drawn is None or frame is None or frame.levels is None:
        return None
    title = f"Frame {frame.then.index}, {frame.then.time:.3f} s"
    sides = [
        _picture(still.rgb, name, f"Frame {still.index} as it {how}")
        for still, name, how in ((frame.then, "expected", "was"), (frame.now, "got", "is now"))
    ]
    return Comparison("first", title, f"{_capital(of_frame(frame, drawn))}.", *sides)


def _frames(drawn: Drawn | None) -> list[dict[str, Any]]:
    if drawn is None:
        return []
    return [
        {
            "index": frame.then.index,
            "time": f"{frame.then.time:.3f}",
            "bad": frame.bad,
            "first": frame is drawn.first,
            "said": _capital(of_frame(frame, drawn)) if frame.bad else _within(frame),
            "pictures": _pictures(frame),
        }
        for frame in drawn.frames
    ]


def _within(frame: Compared) -> str:
    return (
        "The same, to the last bit"
        if frame.worst == 0
        else f"Right: no pixel differs by more than {frame.worst}"
    )


def _pictures(frame: Compared) -> list[Picture]:
    pictures = [
        _picture(still.rgb, name, f"{name} frame {still.index}")
        for still, name in ((frame.then, "expected"), (frame.now, "got"))
    ]
    if frame.levels is not None:
        factor = next((factor for factor in FACTORS if factor * frame.worst <= BRIGHT), 1)
        strong = np.minimum(frame.levels.astype(np.int32) * factor, 255).astype(np.uint8)
        heat = np.asarray(cv2.applyColorMap(strong, cv2.COLORMAP_INFERNO)[:, :, ::-1], np.uint8)
        pictures.append(_picture(heat, f"difference × {factor}", f"where frame {frame.then.index} differs"))
    return pictures


def _picture(rgb: U8, title: str, alt: str) -> Picture:
    """Lossless."""
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "WEBP", lossless=True, quality=40, method=2)
    uri = "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
    return Picture(title, title, "", alt, uri, rgb.shape[1], rgb.shape[0])


def _motion(verdict: Verdict) -> dict[str, Any] | None:
    moved = verdict.moved
    if moved is None:
        return None
    made, stills = verdict.golden.made, verdict.golden.stills
    under = None
    if made.on_photo and stills and stills[0].index == 0:
        under = _picture(stills[0].rgb, "", "")
    return {
        "agrees": moved.agrees,
        "apart": [
            (unit.strip(), f"{moved.most(name):.3g}", f"{getattr(moved.allowed, name):g}")
            for name, unit in MEASURES.items()
            if name in moved.apart
        ],
        "charts": charts(moved),
        "shown": list(enumerate(shown(moved))),
        "ways": ways(moved, made.size if made.on_photo else None),
        "under": under,
        "rows": _rows(moved, verdict),
        "strayed": len(moved.strayed),
        "objects": len(moved.names),
    }


def _rows(moved: Moved, verdict: Verdict) -> list[dict[str, Any]]:
    """Of the table of objects that strayed."""
    objects: Mapping[str, Any] = (verdict.clip.made.document or {}).get("objects") or {}
    return [
        {
            "name": item.name,
            "label": str((objects.get(item.name) or {}).get("label") or ""),
            "sample": item.sample,
            "time": f"{item.time:.3f}",
            "there": [f"{item.there[name]:.3g}{MEASURES[name]}" for name in moved.apart],
            "most": [f"{item.most[name][0]:.3g}{MEASURES[name]}" for name in moved.apart],
            "when": f"{item.most['px'][1]:.3f}",
        }
        for item in moved.strayed[:MOST_ROWS]
    ]


def _made(verdict: Verdict) -> list[tuple[str, str, str]]:
    """What both clips were made with: name, then, now."""
    then, now = verdict.golden.made, verdict.clip.made
    sides = [
        {
            **{name: number[:12] if name == "sources" else number for name, number in made.versions.items()},
            "processor": f"{made.machine.get('kind')}, {made.machine.get('system')}",
            "instructions": str(made.machine.get("instructions")),
            **{name: digest[:12] for name, digest in made.inputs.items()},
        }
        for made in (then, now)
    ]
    names = dict.fromkeys((*sides[0], *sides[1]))
    return [(name, sides[0].get(name, "none"), sides[1].get(name, "none")) for name in names]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


# ----------------------------------------------------------------------
# A scene that a test names -> its golden files, or what is said, with a page, where the clip differs from
# them.

WIDE = 9
"""Letters of what a line is about."""


@dataclass(frozen=True)
class Check:
    """One clip of a test, just made."""

    test: str
    """The test's node id."""
    scene: str
    """As messages name it."""
    asked: GoldenOptions
    clip: Clip
    fresh: Golden
    """What would be kept of it."""

    def write(self, file: Path) -> None:
        """As golden files: `file` and the picture beside it."""
        save(self.fresh, file)

    def differs(self, expected: Path, picture: Path, folder: Path) -> tuple[str, list[Path]]:
        """What differs from the files, nothing where the clip is right; and what shows it, written into `folder`."""
        try:
            golden = read(expected, picture)
        except DamagedError as error:
            return f"{error}; --force-regen writes them anew", []
        verdict = judged(self.scene, golden, self.clip, self.asked)
        if verdict.right:
            return "", []
        shown = folder / f"{expected.stem}.html"
        got = folder / f"{expected.stem}.obtained{expected.suffix}"
        self.write(got)
        write_atomic(shown, page(verdict, self.test).encode("utf-8"))
        said = [f"{self.scene} is not the clip of {expected.name}. {headline(verdict)}"]
        said += [f"  {about:<{WIDE}}{text}" for about, text in summary_lines(verdict)]
        said.append(f"  {'page':<{WIDE}}{shown}")
        said.append(
            f"  {'right?':<{WIDE}}--force-regen keeps the clip as it is now; look at it before you commit it"
        )
        return "\n".join(said), [shown, got, *([got.with_suffix(PICTURE)] if self.fresh.stills else [])]


def checked(path: Path, scene: str, test: str, asked: GoldenOptions, warm: Warm) -> Check:
    """Make the clip of the scene file at `path`. Raises InputError where it gives none."""
    clip = taken(path, asked, warm)
    kept = None
    if asked.motion is not None:
        kept = track(clip.trajectory, units(asked.motion), asked.until)
    return Check(test, scene, asked, clip, Golden(kept, clip.stills, clip.made))
