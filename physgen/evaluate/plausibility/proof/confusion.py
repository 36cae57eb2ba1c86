"""What the judge said of clips that are known -> the confusion table, as Findings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from physgen.evaluate.findings import Bar, Figure, Findings, Section, Table
from physgen.evaluate.plausibility.score import EVEN

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from physgen.evaluate.plausibility.proof.trial import Said
    from physgen.report.plots.look import Palette

RIGHT = "right"
BAR = 0.95
"""Balanced accuracy that exact tracks must reach, of either source."""
Row = Mapping[str, Any]


def counted(said: Sequence[Said]) -> list[dict[str, Any]]:
    """One row for all clips of a source, family, fault and tracker: how many, how many called wrong, their scores."""
    groups: dict[tuple[str, ...], list[Said]] = {}
    for one in said:
        groups.setdefault((one.tracker, one.source, one.family, one.fault), []).append(one)
    return [
        {
            **dict(zip(("tracker", "source", "family", "fault"), key, strict=True)),
            "clips": len(group),
            "called_wrong": sum(one.score is not None and one.score < EVEN for one in group),
            "scores": [None if one.score is None else round(one.score, 3) for one in group],
        }
        for key, group in groups.items()
    ]


def findings(rows: Sequence[Row], seeds: range, plots: bool) -> Findings:
    """`rows` as `counted` gives them; figures, which need their scores, where `plots` asks for them."""
    trackers, sources = _known(rows, "tracker"), _known(rows, "source")
    exact = trackers[0]
    bars = tuple(
        Bar(f"balanced accuracy, {source}, {exact} tracks", _part(found), f"{BAR:.0%}", found >= BAR)
        for source in sources
        if (found := balanced(_only(rows, source=source, tracker=exact))) is not None
    )
    clips = sum(row["clips"] for row in _only(rows, tracker=exact))
    sentences = (
        f"Of {clips} clips, seeds {seeds.start} to {seeds.stop - 1}, which no threshold was chosen on, "
        f"{_part(balanced(_only(rows, tracker=exact)))} are told rightly on {exact} tracks (balanced accuracy: the "
        "mean of the shares of right and of wrong clips).",
    )
    sections = [
        Section("Right and wrong", _about(), (_confusion(rows, trackers, sources),)),
        Section(
            "By what is wrong", (), (_by_fault(rows, trackers), *([_figure(rows, exact)] if plots else []))
        ),
        Section("Right clips by kind", (), (_by_family(rows, trackers),)),
    ]
    shares = {source: _table(rows, source, trackers) for source in sources}
    more = {"seeds": [seeds.start, seeds.stop], "balanced_accuracy": shares}
    return Findings(
        "plausibility", "Right told from wrong", sentences, tuple(sections), list(rows), bars, more
    )


def balanced(rows: Sequence[Row]) -> float | None:
    """Mean of the shares of right clips and of wrong ones that are told rightly; None without either."""
    right, wrong = (
        _sums(row for row in rows if row["fault"] == RIGHT),
        _sums(row for row in rows if row["fault"] != RIGHT),
    )
    if not right[0] or not wrong[0]:
        return None
    return (1 - right[1] / right[0] + wrong[1] / wrong[0]) / 2


def _sums(rows: Iterable[Row]) -> tuple[int, int]:
    """Clips, and those called wrong; what nothing could be asked of is not."""
    some = list(rows)
    return sum(row["clips"] for row in some), sum(row["called_wrong"] for row in some)


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
            right, wrong = (
                _sums(row for row in mine if (row["fault"] == RIGHT) is so) for so in (True, False)
            )
            cells = (right[0] - right[1], right[1], wrong[0] - wrong[1], wrong[1])
            lines.append((tracker, source, _part(balanced(mine)), *map(str, cells)))
    told = ("right, called right", "right, called wrong", "wrong, called right", "wrong, called wrong")
    return Table(("tracks", "source", "balanced accuracy", *told), tuple(lines))


def _by_fault(rows: Sequence[Row], trackers: list[str]) -> Table:
    faults = [fault for fault in _known(rows, "fault") if fault != RIGHT]
    lines = [
        (fault, *(_share(*_sums(_only(rows, fault=fault, tracker=t))) for t in trackers)) for fault in faults
    ]
    return Table(("called wrong", *trackers), tuple(lines))


def _by_family(rows: Sequence[Row], trackers: list[str]) -> Table:
    lines = []
    for family in _known(rows, "family"):
        told = (_sums(_only(rows, fault=RIGHT, family=family, tracker=tracker)) for tracker in trackers)
        lines.append((family, *(_share(clips, clips - wrong) for clips, wrong in told)))
    return Table(("called right", *trackers), tuple(lines))


def _figure(rows: Sequence[Row], tracker: str) -> Figure:
    from physgen.evaluate.plotted import plotted
    from physgen.report.plots.look import SMALL

    mine = _only(rows, tracker=tracker)
    faults = [RIGHT, *(fault for fault in _known(mine, "fault") if fault != RIGHT)]

    def draw(axes: Axes, palette: Palette) -> None:
        for k, fault in enumerate(faults):
            told = (
                score for row in mine if row["fault"] == fault for score in row["scores"] if score is not None
            )
            scores = sorted(told)
            spread = [k + 0.6 * ((m * 0.618) % 1 - 0.5) for m in range(len(scores))]
            colour = palette.blue if fault == RIGHT else palette.orange
            axes.plot(scores, spread, ".", color=colour, markersize=2.5, alpha=0.6)
            axes.annotate(fault, (0.53, k), fontsize=SMALL, va="center")
        axes.axvline(EVEN, color=palette.soft, linewidth=0.6)
        axes.set_yticks([])
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


def _share(clips: int, told: int) -> str:
    return f"{told} of {clips}" if clips else "-"


def _part(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"
