"""How an object answers to pushes -> what is said of it."""

from __future__ import annotations

from typing import Any

from physgen.evaluate.controllability.answers import SEEN, Aim, Answers, answers, exactly
from physgen.evaluate.controllability.outcomes import Outcome
from physgen.evaluate.controllability.sweep import Swept
from physgen.evaluate.measure import Findings, Section, Table
from physgen.scene.scene import View

LEAST = 0.01
"""degrees, and per cent: what is less is told to be less."""
NOTE = (
    "Answer: from where the object would be at the end without the push, to where it is. Spearman, Kendall (tau-b): "
    "rank correlations of the push's size and the answer's length. 0 degrees is to the right, 90 down."
)


def findings(swept: Swept) -> Findings:
    """Without plots; `drawn` makes them."""
    found = answers(swept)
    title = f"Controllability: {swept.object} of {swept.scene}"
    sections = (_all(found, swept), _directions(found), _pushes(found, swept))
    rows = [_row(one, swept) for along in found.along for one in along.outcomes]
    return Findings(
        "controllability", title, tuple(_sentences(found, swept)), sections, rows, (), _more(found, swept)
    )


def _sentences(found: Answers, swept: Swept) -> list[str]:
    rising, steps = found.steps
    told = []
    if steps and found.correlation is not None:
        least, mean = found.correlation
        count, others = len(found.correlations), len(found.along) - len(found.correlations)
        over = (
            f"on average over {count} directions, {least:.3f} at the least"
            if count > 1
            else "in one direction"
        )
        also = f" ({others} more without: of one push alone, or of equal answers)" if others else ""
        told.append(
            f"A harder push takes {swept.object} farther in {rising} of {steps} steps; Spearman's correlation of push "
            f"and answer is {mean:.3f} {over}{also}."
        )
        if found.free[1] and any(one.met for one in swept.outcomes):
            told.append(
                f"Where it meets nobody, a harder push takes it farther in {found.free[0]} of {found.free[1]} steps."
            )
    elif steps:
        told.append(f"{swept.object} answers to no push: it ends at one place, however hard it is pushed.")
    same, count = found.sideways
    if swept.view is View.SIDE and count:
        told.append(
            f"Until it meets anybody it goes to the side that it is pushed to in {same} of {count} pushes. Seen from "
            "the side, angles tell less: what is pushed up comes down again."
        )
    elif found.first.median is not None and found.first.worst is not None:
        told.append(
            f"Until it meets anybody it goes where it is pushed to within {_off(found.first)}"
            + (
                f", and ends up {_degrees(found.last.median)} off (median)."
                if found.last.median is not None
                else "."
            )
        )
    same, count = found.turns
    if count:
        told.append(f"Turning the push turns the answer the same way in {same} of {count} steps.")
    if found.still is not None:
        told.append(f"Without a push it moves by {found.still:.2f} px.")
    else:
        told.append("No clip is without a push: answers count from where the object begins.")
    if found.law is not None and swept.law is not None:
        count, worst = found.law
        told.append(
            f"The {count} pushes by which it meets nobody end within "
            f"{_percent(worst).removeprefix('under ')} of the closed form, {swept.law.formula}."
        )
    told.append("The paper shows the same as pictures (figure 6) and gives no number.")
    return told


def _all(found: Answers, swept: Swept) -> Section:
    rising, steps = found.steps
    same, count = found.turns
    sides = found.sideways
    rows = [
        ("pushes", str(len(swept.outcomes)), f"{len(found.along)} direction{'s' * (len(found.along) != 1)}"),
        ("harder, farther", f"{rising} of {steps}", "steps of one direction"),
    ]
    if found.free[1] and any(one.met for one in swept.outcomes):
        rows.append(
            ("the same, meeting nobody", f"{found.free[0]} of {found.free[1]}", "steps of one direction")
        )
    if found.correlation is not None:
        least, mean = found.correlation
        of = f"least {least:.3f}" if len(found.correlations) > 1 else "one direction"
        rows.append(("Spearman, mean", f"{mean:.3f}", of))
    rows += [
        ("off the push until it meets anybody", *_aim(found.first)),
        ("off the push at the end", *_aim(found.last)),
        ("to the side it is pushed to", f"{sides[0]} of {sides[1]}", "pushes, until it meets anybody"),
        (
            "turns with the push",
            f"{same} of {count}" if count else "-",
            "steps from one direction to the next",
        ),
        ("moves without a push", "-" if found.still is None else f"{found.still:.2f} px", ""),
    ]
    if found.law is not None:
        rows.append(("off the closed form", _percent(found.law[1]), f"at most, of {found.law[0]} pushes"))
    return Section("All pushes", (), (Table(("measure", "found", "of"), tuple(rows), note=NOTE),))


def _aim(aim: Aim) -> tuple[str, str]:
    if aim.median is None or aim.worst is None:
        return "-", f"no answer is longer than {SEEN:g} px"
    return _degrees(aim.median), f"median of {aim.count}; at most {_degrees(aim.worst)}"


def _degrees(angle: float) -> str:
    if angle < LEAST:
        return f"under {LEAST:g}°"
    return f"{angle:.2g}°" if angle < 10 else f"{angle:.0f}°"


def _off(aim: Aim) -> str:
    assert aim.median is not None
    assert aim.worst is not None
    if aim.worst < LEAST:
        return f"{LEAST:g}°"
    return f"{max(aim.median, LEAST):.2g}° (median; {_degrees(aim.worst)} at most)"


def _percent(part: float) -> str:
    return f"under {LEAST:g} %" if 100 * part < LEAST else f"{100 * part:.2g} %"


def _directions(found: Answers) -> Section:
    rows = []
    for one in found.along:
        rise = one.rise
        cells = ("-", "-", "-") if rise is None else (
            "-" if rise.spearman is None else f"{rise.spearman:.3f}",
            "-" if rise.kendall is None else f"{rise.kendall:.3f}",
            f"{rise.rising} of {rise.steps}",
        )  # fmt: skip
        longest = max(o.length for o in one.outcomes)
        rows.append((f"{one.angle:g}", str(len(one.outcomes)), *cells, f"{longest:.1f}", str(one.met)))
    heads = (
        "direction, degrees",
        "pushes",
        "Spearman",
        "Kendall",
        "harder, farther",
        "longest answer, px",
        "met somebody",
    )
    return Section("Each direction", (), (Table(heads, tuple(rows)),))


def _pushes(found: Answers, swept: Swept) -> Section:
    rows = []
    for along in found.along:
        for one in along.outcomes:
            exact = exactly(one, swept)
            rows.append(
                (
                    f"{one.push.angle:g}", f"{one.push.size:.4g}", f"{one.length:.2f}",
                    "-" if exact is None else f"{exact:.2f}", f"{one.response[0]:+.1f}, {one.response[1]:+.1f}",
                    "yes" if one.met else "no",
                )
            )  # fmt: skip
    heads = ("direction, degrees", "push, px/s", "answer, px", "closed form, px", "x, y px", "met somebody")
    note = "A push of v px/s is an impulse of mass x v at t = 0, through the centre of mass (the paper's F0)."
    return Section("Each push", (), (Table(heads, tuple(rows), note=note),))


def _row(one: Outcome, swept: Swept) -> dict[str, Any]:
    return {
        "push": [one.push.x, one.push.y],
        "size": one.push.size,
        "angle": one.push.angle,
        "answer": [float(one.response[0]), float(one.response[1])],
        "length": one.length,
        "until_met": [float(one.at_first[0]), float(one.at_first[1])],
        "met": one.met,
        "moved": one.moved,
        "closed_form": exactly(one, swept),
    }


def _more(found: Answers, swept: Swept) -> dict[str, Any]:
    rising, steps = found.steps
    least, mean = found.correlation or (None, None)
    same, count = found.turns
    directions = [
        {
            "angle": one.angle,
            "spearman": None if one.rise is None else one.rise.spearman,
            "kendall": None if one.rise is None else one.rise.kendall,
            "steps": 0 if one.rise is None else one.rise.steps,
            "rising": 0 if one.rise is None else one.rise.rising,
        }
        for one in found.along
    ]
    return {
        "scene": swept.scene,
        "object": swept.object,
        "pushes": len(swept.outcomes),
        "steps": steps,
        "rising": rising,
        "meeting_nobody": {"steps": found.free[1], "rising": found.free[0]},
        "spearman_mean": mean,
        "spearman_least": least,
        "off_until_met": {"median": found.first.median, "worst": found.first.worst, "of": found.first.count},
        "off_at_end": {"median": found.last.median, "worst": found.last.worst, "of": found.last.count},
        "sideways": {"same": found.sideways[0], "of": found.sideways[1]},
        "turns": {"same": same, "of": count},
        "still_px": found.still,
        "closed_form": None if found.law is None or swept.law is None
        else {"formula": swept.law.formula, "pushes": found.law[0], "worst": found.law[1]},
        "directions": directions,
    }  # fmt: skip
