"""Curves and bins -> plots as SVG, both axes from 0 to 1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from physgen.evaluate.curves import Curve, Reliability, falling

LEFT, TOP, SIDE = 64, 22, 380
"""px: margins and the square of the axes."""
COLOURS = ("#1d4ed8", "#c2410c", "#15803d")
GREY, FRAME = "#444", "#e4e4e4"
TALL = 70
"""px of the counts below the reliability diagram."""


def precision_recall(lines: Mapping[str, tuple[Curve, float | None]]) -> str:
    """Precision over recall: as it is (thin) and made to fall (bold), as AP reads it; by name with its AP."""
    parts = _frame("recall", "precision", SIDE)
    for k, (name, (line, area)) in enumerate(lines.items()):
        colour = COLOURS[k % len(COLOURS)]
        if len(line.recall) and np.isfinite(line.recall).all():
            parts.append(_steps(line.recall, falling(line.precision), colour))
            raw = "M" + "L".join(_at(r, p) for r, p in zip(line.recall, line.precision, strict=True))
            parts.append(f'<path d="{raw}" fill="none" stroke="{colour}" stroke-opacity="0.5"/>')
        y = TOP + SIDE - 16 - 20 * (len(lines) - 1 - k)
        known = "nothing is true" if area is None else f"AP {area:.3f}"
        parts.append(f'<text x="{LEFT + 14}" y="{y}" fill="{colour}">{name}: {known}</text>')
    return _whole(parts, SIDE)


def diagram(bins: Reliability) -> str:
    """Share right over said confidence: bars at the bins' means, the diagonal of perfect candour, counts below."""
    parts = _frame("said confidence", "share that is right", SIDE)
    most = max(int(bins.count.max()), 1)
    base = TOP + SIDE + 58 + TALL
    width = SIDE / len(bins.count) - 4
    for k, count in enumerate(bins.count.tolist()):
        x = LEFT + bins.edges[k] * SIDE + 2
        if count:
            y, high = TOP + (1 - bins.right[k]) * SIDE, bins.right[k] * SIDE
            parts.append(
                f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{high:.1f}" fill="{COLOURS[0]}" '
                'fill-opacity="0.35"/>'
            )
            cx, cy = _place(bins.confidence[k], bins.right[k])
            parts.append(f'<circle cx="{cx}" cy="{cy}" r="4.5" fill="{COLOURS[1]}"/>')
        tall = TALL * count / most
        parts.append(
            f'<rect x="{x:.1f}" y="{base - tall:.1f}" width="{width:.1f}" height="{tall:.1f}" fill="#888"/>'
        )
        parts.append(
            f'<text x="{x + width / 2:.1f}" y="{base + 16}" text-anchor="middle" fill="{GREY}">{count:,}</text>'
        )
    parts.append(f'<path d="M{_at(0, 0)}L{_at(1, 1)}" stroke="#888" stroke-dasharray="5 5"/>')
    error = "nothing was said" if bins.error is None else f"expected calibration error {bins.error:.3f}"
    parts.append(f'<text x="{LEFT + 14}" y="{TOP + 22}" fill="{GREY}">{error}</text>')
    parts.append(
        f'<text x="{LEFT + SIDE / 2}" y="{base + 34}" text-anchor="middle">masks said, by confidence</text>'
    )
    return _whole(parts, SIDE + 34 + TALL + 22)


def _place(x: float, y: float) -> tuple[float, float]:
    return round(LEFT + float(x) * SIDE, 1), round(TOP + (1 - float(y)) * SIDE, 1)


def _at(x: float, y: float) -> str:
    return "{} {}".format(*_place(x, y))


def _steps(x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray, colour: str) -> str:
    """Constant from each x back to the one before, at the y of the right end."""
    path, before = f"M{_at(0, y[0])}", 0.0
    for right, high in zip(x, y, strict=True):
        path += f"L{_at(before, high)}L{_at(right, high)}"
        before = right
    return f'<path d="{path}L{_at(before, 0)}" fill="none" stroke="{colour}" stroke-width="2.5"/>'


def _frame(across: str, up: str, side: int) -> list[str]:
    """Grid, numbers and names of the axes."""
    parts = []
    for k in range(6):
        value = k / 5
        x, bottom = _place(value, 0)
        _, y = _place(0, value)
        parts.append(f'<path d="M{x} {TOP}V{bottom}M{LEFT} {y}H{LEFT + side}" stroke="{FRAME}"/>')
        parts.append(f'<text x="{x}" y="{bottom + 18}" text-anchor="middle" fill="{GREY}">{value:g}</text>')
        parts.append(f'<text x="{LEFT - 8}" y="{y + 4}" text-anchor="end" fill="{GREY}">{value:g}</text>')
    middle = LEFT + side / 2
    parts.append(f'<text x="{middle}" y="{TOP + side + 40}" text-anchor="middle">{across}</text>')
    parts.append(
        f'<text transform="translate(20 {TOP + side / 2}) rotate(-90)" text-anchor="middle">{up}</text>'
    )
    return parts


def _whole(parts: Sequence[str], tall: int) -> str:
    wide, high = LEFT + SIDE + 24, TOP + tall + 56
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide}" height="{high}" viewBox="0 0 {wide} {high}" '
        'font-family="system-ui, sans-serif" font-size="13">'
    )
    return "\n".join([head, '<rect width="100%" height="100%" fill="#ffffff"/>', *parts, "</svg>", ""])
