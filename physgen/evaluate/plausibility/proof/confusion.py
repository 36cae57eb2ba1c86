"""What the judge said of clips that are known -> the confusion table, as Findings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from physgen.evaluate.findings import Bar, Figure, Findings, Section, Table
from physgen.evaluate.plausibility.score import EVEN

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.report.plots.look import Palette

RIGHT = "right"
BAR = 0.95
"""Balanced accuracy that exact tracks must reach, of either source."""
Row = Mapping[str, Any]


def findings(rows: Sequence[Row], seeds: range, plots: bool) -> Findings:
    """`rows` as `Said.as_dict` gives them."""
    trackers, sources = _known(rows, "tracker"), _known(rows, "source")
    exact = trackers[0]
    bars = tuple(
        Bar(f"balanced accuracy, {source}, {exact} tracks", _part(found), f"{BAR:.0%}", found >= BAR)
        for source in sources
        if (found := balanced(_only(rows, source=source, tracker=exact))) is not None
    )
    whole = balanced(_only(rows, tracker=exact))
    clips = len(_only(rows, tracker=exact))
    sentences = (
        f"Of {clips} clips of {len(seeds)} seeds that no threshold was chosen on, {_part(whole)} are told rightly on "
        f"{exact} tracks (balanced accuracy: the mean of the shares of right and of wrong clips).",
    )
    sections = [
        Section("Right and wrong", _about(), (_confusion(rows, trackers, sources),)),
        Section(
            "By what is wrong", (), (_by_fault(rows, trackers), *([_figure(rows, exact)] if plots else []))
        ),
        Section("Right clips by kind", (), (_by_family(rows, trackers),)),
    ]
    more = {
        "seeds": [seeds.start, seeds.stop],
        "balanced_accuracy": {s: _table(rows, s, trackers) for s in sources},
    }
    return Findings(
        "plausibility", "Right told from wrong", sentences, tuple(sections), list(rows), bars, more
    )


def called_wrong(row: Row) -> bool:
    """What nothing could be asked of is not."""
    return row["score"] is not None and row["score"] < EVEN


def balanced(rows: Sequence[Row]) -> float | None:
    """Mean of the shares of right clips and of wrong ones that are told rightly; None without either."""
    right = [called_wrong(row) for row in rows if row["fault"] == RIGHT]
    wrong = [called_wrong(row) for row in rows if row["fault"] != RIGHT]
    if not right or not wrong:
        return None
    return (1 - sum(right) / len(right) + sum(wrong) / len(wrong)) / 2


def _about() -> tuple[str, ...]:
    return (
        "physgen: random scenes of nine kinds, and the same with one thing wrong: the simulator is stopped, something "
        "is changed, and it goes on. Closed form: balls on parabolas, by a program that shares nothing with the "
        "engine. Neither walls nor pushes are told to the judge, and masses only where it says so. 16, 24 and 30 "
        "frames a second by turns.",
        "Tracks: exact; with normal noise of so many px on each place, and on angles as much at the rim; or centroids "
        "of masks, drawn without anti-aliasing, where things hide each other and no angle is known.",
    )


def _confusion(rows: Sequence[Row], trackers: list[str], sources: list[str]) -> Table:
    lines = []
    for tracker in trackers:
        for source in sources:
            mine = _only(rows, tracker=tracker, source=source)
            right = [called_wrong(row) for row in mine if row["fault"] == RIGHT]
            wrong = [called_wrong(row) for row in mine if row["fault"] != RIGHT]
            cells = (len(right) - sum(right), sum(right), len(wrong) - sum(wrong), sum(wrong))
            lines.append((tracker, source, *map(str, cells), _part(balanced(mine))))
    heads = (
        "tracks",
        "source",
        "right, called right",
        "right, called wrong",
        "wrong, called right",
        "wrong, called wrong",
    )
    return Table((*heads, "balanced accuracy"), tuple(lines))


def _by_fault(rows: Sequence[Row], trackers: list[str]) -> Table:
    faults = [fault for fault in _known(rows, "fault") if fault != RIGHT]
    lines = [
        (
            fault,
            *(
                _share(called_wrong(row) for row in _only(rows, fault=fault, tracker=tracker))
                for tracker in trackers
            ),
        )
        for fault in faults
    ]
    return Table(("called wrong", *trackers), tuple(lines))


def _by_family(rows: Sequence[Row], trackers: list[str]) -> Table:
    right = _only(rows, fault=RIGHT)
    lines = [
        (
            family,
            *(
                _share(not called_wrong(row) for row in _only(right, family=family, tracker=t))
                for t in trackers
            ),
        )
        for family in _known(right, "family")
    ]
    return Table(("called right", *trackers), tuple(lines))


def _figure(rows: Sequence[Row], tracker: str) -> Figure:
    from physgen.evaluate.plotted import plotted

    mine = [row for row in _only(rows, tracker=tracker) if row["score"] is not None]
    faults = _known(mine, "fault")

    def draw(axes: Axes, palette: Palette) -> None:
        for k, fault in enumerate(faults):
            scores = sorted(row["score"] for row in mine if row["fault"] == fault)
            spread = [k + 0.3 * ((m * 0.618) % 1 - 0.5) * 2 for m in range(len(scores))]
            colour = palette.blue if fault == RIGHT else palette.orange
            axes.plot(scores, spread, ".", color=colour, markersize=2.5, alpha=0.6)
        axes.axvline(EVEN, color=palette.soft, linewidth=0.6)
        axes.set_yticks(range(len(faults)), faults)
        axes.invert_yaxis()
        axes.set_xlim(-0.02, 1.02)
        axes.set_xlabel("score")

    return plotted(
        draw, f"Scores of all clips on {tracker} tracks, a dot each; the line parts right from wrong."
    )


def _table(rows: Sequence[Row], source: str, trackers: list[str]) -> dict[str, float | None]:
    found = {tracker: balanced(_only(rows, source=source, tracker=tracker)) for tracker in trackers}
    return {tracker: None if value is None else round(value, 4) for tracker, value in found.items()}


def _only(rows: Sequence[Row], **what: str) -> list[Row]:
    return [row for row in rows if all(row[key] == value for key, value in what.items())]


def _known(rows: Iterable[Row], key: str) -> list[str]:
    return list(dict.fromkeys(str(row[key]) for row in rows))


def _share(told: Iterable[bool]) -> str:
    some = list(told)
    return f"{sum(some)} of {len(some)}" if some else "-"


def _part(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"
