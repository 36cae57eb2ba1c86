"""Scores of masses and of orders -> what is said of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from physgen.evaluate.measure import Figure, Findings, Section, Table
from physgen.evaluate.properties.answers import NUMBERS, Answer
from physgen.evaluate.properties.scores import NONE, Masses, Order, factor, masses, order
from physgen.evaluate.properties.studio import Kind, ordered, weighed
from physgen.evaluate.properties.table import COEFFICIENTS, Objects
from physgen.materials import kind

PAPER = ("the paper, GPT-4V on photos", "20", "390 g", "75 %", "[53, 89]", "-", "-", "-", "-")
PAPERS = {"friction": (12, 13), "elasticity": (6, 7)}
HEADS = ("set", "objects", "ADE", "within 30 %", "95 %", "ALDE", "APE", "MnRE", "bias")
REGULATED = 0.05
"""Spread of sizes of a kind of thing up to which rules, and not makers, say what it weighs."""
MASS, ORDER = "Mass", "Order of friction and elasticity"
"""Titles of sections."""
SHOWN = 2
"""Pairs not in order that a table names; the JSON has all."""
NOTE = (
    "ADE: mean absolute difference. 95 %: interval of the share, since the objects are few. ALDE: mean |ln(told / "
    "true)|. APE: mean |told - true| / true. MnRE: mean of the smaller of told / true and true / told, 1 is right. "
    "ADE to MnRE as in NeRF2Physics (Zhai et al., CVPR 2024). Bias: geometric mean of told / true. The paper's objects "
    "are others: 20 of Amazon Berkeley Objects."
)


@dataclass(frozen=True)
class Asked:
    """Who answered, and how."""

    who: str
    """`table`, `vlm`, or a file of answers."""
    sized: bool
    photos: bool
    """Whether each object has a photo."""
    here: bool
    """Whether a backend answered now, or somebody's answers were read."""


def findings(table: Objects, answers: Mapping[str, Answer], kinds: Sequence[Kind], asked: Asked) -> Findings:
    """Without plots; see `with_plots`."""
    every = [(item.name, item.mass or 0, answers[item.name].mass or 0) for item in table.weighed]
    free = {item.name for item in table.weighed if not regulated(item.label)}
    lines = [(table.title, masses([(true, told) for _, true, told in every]))]
    if 0 < len(free) < len(every):
        part = masses([(true, told) for name, true, told in every if name in free])
        lines.append(("without regulated weights", part))
    photos = []
    if kinds:
        photos = [
            ("studio's photos, scale told", weighed(kinds, "scaled")),
            ("studio's photos, scale found", weighed(kinds, "found")),
        ]
    orders = {of: {one.about: (one, order(one.values, _said(answers, of))) for one in table.rankings if one.of == of}
              for of in COEFFICIENTS}  # fmt: skip
    totals = {of: sum((found for _, found in by.values()), NONE) for of, by in orders.items()}
    rows = [_row(HEADS[0], title, score) for title, score in (*lines, *photos) if score is not None]
    rows += [
        _order_row(of, about, found, one.source)
        for of, by in orders.items()
        for about, (one, found) in by.items()
    ]
    studio = {of: ordered(kinds, of) for of in COEFFICIENTS}
    rows += [_order_row(of, "studio's photos", found, "") for of, found in studio.items() if found.count]
    sections = []
    if rows and (every or kinds):
        cells = tuple(_cells(title, score) for title, score in (*lines, *photos) if score is not None)
        sections.append(Section(MASS, (), (Table(HEADS, (*cells, PAPER), note=NOTE),)))
    if any(found.count for found in (*totals.values(), *studio.values())):
        sections.append(_orders(orders, totals, studio))
    if every:
        sections.append(_objects(table, answers))
    if kinds:
        sections.append(_kinds(kinds))
    more = {
        "by": asked.who,
        "size_told": asked.sized,
        "table": table.title,
        "source": table.source,
        "paper": {"objects": 20, "ade_g": 390, "share": 0.75, "friction": [12, 13], "elasticity": [6, 7]},
        "answers": {name: {key: getattr(one, key) for key in NUMBERS} for name, one in answers.items()},
        "studio": [_kind_row(one) for one in kinds],
    }
    told = tuple(_sentences(lines[0][1], totals, asked, bool(kinds), table))
    return Findings("properties", "Mass, friction and elasticity", told, tuple(sections), rows, (), more)


def plots(
    table: Objects, answers: Mapping[str, Answer], kinds: Sequence[Kind]
) -> Mapping[str, tuple[Figure, ...]]:
    """For the page, by the section that each belongs to."""
    from physgen.evaluate.properties.drawn import mass_plot, order_plot

    sets = {}
    if table.weighed:
        sets["the table's objects"] = [
            (i.name, i.mass or 0, answers[i.name].mass or 0) for i in table.weighed
        ]
    if kinds:
        sets["the studio's things"] = [(one.label, one.true.mass or 0, one.scaled.mass or 0) for one in kinds]
    orders = tuple(order_plot(one, answers) for one in table.rankings if len(one.values) > 1)
    return {MASS: (mass_plot(sets),) if sets else (), ORDER: orders}


def regulated(label: str) -> bool:
    """Whether materials.yaml knows a weight for such a thing that rules fix: a golf ball's."""
    what = kind(label)
    return what.mass is not None and what.spread <= REGULATED and what.form == "ball"


def _said(answers: Mapping[str, Answer], of: str) -> dict[str, float]:
    return {name: value for name, one in answers.items() if (value := getattr(one, of)) is not None}


def _sentences(
    score: Masses | None, totals: Mapping[str, Order], asked: Asked, studio: bool, table: Objects
) -> list[str]:
    told = []
    who = f"The backend {asked.who}" if asked.here else asked.who
    if score is not None:
        low, high = score.interval
        told.append(
            f"{who} tells {score.near} of {score.count} masses to within 30 % ({100 * score.share:.0f} %; interval of "
            f"95 %: {100 * low:.0f} to {100 * high:.0f} %), with a mean error of {_grams(score.ade)}. The paper: 75 % "
            "of 20, 0.39 kg."
        )
    for of, found in totals.items():
        if found.count:
            right, count = PAPERS[of]
            told.append(
                f"{of.capitalize()}: {found.right} of {found.count} pairs in the right order"
                f"{f', {found.tied} told to be equal' if found.tied else ''}. The paper: {right} of {count}."
            )
    if asked.here and not asked.photos:
        sized = sum(bool(item.size) for item in table.items) if asked.sized else 0
        part = "" if sized == len(table.items) else f" of the {sized} that have one in the table"
        size = f"its size is told by the scale{part}" if sized else "its size is not told"
        told.append(
            "A table has no photos: what is asked about is each object's name with a bare silhouette, a disc or a "
            f"rectangle; {size}. The paper asks about photos."
        )
    if asked.here and asked.who == "table":
        told.append(
            "The backend reads materials.yaml, which has nothing from the table that ships: that table's masses, "
            "weighed by others, and its comparisons of friction and elasticity are independent of it. Not independent "
            "are regulated weights, such as a golf ball's: materials.yaml knows the rules."
        )
    if studio:
        told.append(
            "On the studio's photos the true masks and labels are given; whoever made the scenes set what is true."
        )
    return told


def _row(kind: str, title: str, score: Masses) -> dict[str, Any]:
    return {"kind": kind, "set": title, **score.as_dict()}


def _order_row(of: str, about: str, found: Order, source: str) -> dict[str, Any]:
    wrong = [list(pair) for pair in found.wrong]
    return {
        "kind": of, "set": about, "source": source, "pairs": found.count, "right": found.right,
        "tied": found.tied, "not_in_order": wrong,
    }  # fmt: skip


def _cells(title: str, score: Masses) -> tuple[str, ...]:
    low, high = score.interval
    return (
        title, str(score.count), _grams(score.ade), f"{100 * score.share:.0f} %",
        f"[{100 * low:.0f}, {100 * high:.0f}]", f"{score.alde:.2f}", f"{score.ape:.2f}", f"{score.mnre:.2f}",
        f"{score.bias:.2f}",
    )  # fmt: skip


def _grams(grams: float) -> str:
    """Three digits, or two decimals.

    >>> _grams(390.4), _grams(12.34)
    ('390 g', '12.3 g')
    """
    return f"{grams:.3g} g" if grams < 1000 else f"{grams / 1000:.3g} kg"


def _three(grams: float) -> str:
    """Three digits, without powers of ten.

    >>> _three(12.345), _three(1143.7)
    ('12.3', '1144')
    """
    return f"{grams:.3g}" if grams < 1000 else f"{grams:.0f}"


def _orders(orders: Mapping[str, Any], totals: Mapping[str, Order], studio: Mapping[str, Order]) -> Section:
    rows = []
    for of in COEFFICIENTS:
        for about, (_, found) in orders[of].items():
            rows.append((of, about, *_counts(found)))
        if len(orders[of]) > 1:
            rows.append((of, "all of these", *_counts(totals[of])[:2], ""))
        if studio[of].count:
            rows.append((of, "studio's photos, within each", *_counts(studio[of])[:2], ""))
        right, count = PAPERS[of]
        rows.append((of, "the paper, GPT-4V on videos", f"{right} of {count}", "-", ""))
    heads = ("coefficient", "compared", "in order", "told equal", "not in order (more > less)")
    return Section(ORDER, (), (Table(heads, tuple(rows)),))


def _counts(found: Order) -> tuple[str, str, str]:
    some = ", ".join(f"{more} > {less}" for more, less in found.wrong[:SHOWN])
    rest = f" and {len(found.wrong) - SHOWN} more" if len(found.wrong) > SHOWN else ""
    return f"{found.right} of {found.count}", str(found.tied), some + rest


def _objects(table: Objects, answers: Mapping[str, Answer]) -> Section:
    rows = sorted(
        ((item, answers[item.name].mass or 0) for item in table.weighed),
        key=lambda pair: factor(pair[0].mass or 1, pair[1]),
    )
    cells = tuple(
        (
            item.label,
            f"{item.mass:g}",
            f"{told:g}",
            f"{told / (item.mass or 1):.2f}",
            "x".join(f"{s:g}" for s in item.size),
        )
        for item, told in rows
    )
    heads = ("object", "true, g", "told, g", "told / true", "size, mm")
    return Section("Each object, the nearest first", (), (Table(heads, cells, note=table.source),))


def _kinds(kinds: Sequence[Kind]) -> Section:
    cells = tuple(
        (
            one.scene, one.label, str(one.count), f"{one.true.mass:g}", _three(one.scaled.mass or 0),
            _three(one.found.mass or 0),
            f"{one.true.friction:g} / {one.scaled.friction:g}", f"{one.true.elasticity:g} / {one.scaled.elasticity:g}",
        )
        for one in kinds
    )  # fmt: skip
    heads = ("photo", "things", "of them", "true, g", "scale told", "scale found", "friction", "elasticity")
    note = "Masses told where the photo's scale is told, and where it is not; friction and elasticity: true / told."
    return Section("The studio's photos", (), (Table(heads, cells, note=note),))


def _kind_row(one: Kind) -> dict[str, Any]:
    return {
        "scene": one.scene,
        "label": one.label,
        "count": one.count,
        **{f"true_{key}": getattr(one.true, key) for key in NUMBERS},
        **{f"told_{key}": getattr(one.scaled, key) for key in NUMBERS},
        "found_mass": one.found.mass,
    }
