"""What a record tells of refinement -> the report's section on it: data for the template."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from physgen.report.record import REFINING

ELSEWHERE = frozenset(
    {
        "backend",
        "steps",
        "steps_run",
        "steps_fused",
        "windows",
        "size",
        "changes",
        "strip",
        "failed",
        *REFINING,
    }
)
"""Keys that are told in words of their own, or in another place."""


def refinement(told: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """`failed`: lines of a message; `changes` and `facts`: names and values.

    `told` is `RunRecord.refine`; None where nobody asked.
    """
    if told is None:
        return None
    return {
        "failed": str(told.get("failed", "")).splitlines(),
        "changes": _changes(told["changes"]) if "changes" in told else [],
        "facts": _facts(told),
    }


def _changes(found: Mapping[str, float | None]) -> list[tuple[str, str]]:
    """Means, and jumps from frame to frame."""
    near = f"near them (up to {found['near_px']:.0f} px off)"
    places = [
        ("objects", "on objects"),
        ("near", near),
        ("elsewhere", "elsewhere"),
        ("first", "in the first frame"),
    ]
    rows = [(said, _level(found[name])) for name, said in places if found[name] is not None]
    times = "" if found["flicker"] is None else f", {found['flicker']:.3g} times"
    jumps = f"{_level(found['jump_guidance'])} before, {_level(found['jump_refined'])} refined{times}"
    rows.append(("largest jump between frames", jumps))
    rows.append(
        (
            "largest jump of the change alone",
            f"{_level(found['jump_of_change'])} at {found['jump_at']:.2f} s",
        )
    )
    return rows


def _facts(told: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Who refined, and how."""
    rows = [("backend", str(told["backend"]))]
    if "steps_run" in told:
        steps = f"{told['steps_run']} of {told['steps']} run, {told['steps_fused']} of them fused with the guidance"
        rows.append(("steps", steps))
    if "windows" in told:
        spans = [f"{first}..{last - 1}" for first, last in told["windows"]]
        rows.append(("windows of latent frames", ", ".join(spans)))
    if "size" in told:
        rows.append(("frames shown to the model", "{} × {} px".format(*told["size"])))
    rows += [(name.replace("_", " "), _said(value)) for name, value in told.items() if name not in ELSEWHERE]
    return [(name, value) for name, value in rows if value]


def _level(value: float | None) -> str:
    return "none" if value is None else f"{value:.2f}"


def _said(value: object) -> str:
    """As a person writes it; nothing where nothing is told."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_said(part)}" for name, part in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(map(_said, value))
    return str(value)
