"""A verdict -> one HTML page: what was expected, what came, the difference, motion apart from pixels."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen import __version__
from physgen.golden.charts import charts, shown, ways
from physgen.golden.drawn import Compared, Drawn
from physgen.golden.judging import Verdict
from physgen.golden.moved import MEASURES, Moved
from physgen.golden.told import lines, of_frame
from physgen.report.perception import Comparison, Picture
from physgen.report.templates import template

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
        lines=lines(verdict),
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
