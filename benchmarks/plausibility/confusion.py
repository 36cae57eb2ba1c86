"""What the judge answered for clips that are known -> the confusion table, as Findings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import hypot
from typing import TYPE_CHECKING, Any, NamedTuple

from physgen.evaluate.measure import Bar, Findings, Section, Table
from physgen.evaluate.plausibility.judge import EVEN
from physgen.simulate.uncertainty import wilson

from .balls import FREE

if TYPE_CHECKING:
    from .trial import Said

RIGHT = "right"
BAR = 0.95
"""Balanced accuracy that exact tracks must reach, of either source."""
Row = Mapping[str, Any]


def counted(answers: Sequence[Said]) -> list[dict[str, Any]]:
    """A row for all clips of a source, family, fault and tracker: how many, called wrong, not asked; scores."""
    groups: dict[tuple[str, ...], list[Said]] = {}
    for one in answers:
        groups.setdefault((one.tracker, one.source, one.family, one.fault), []).append(
            one
        )
    return [
        {
            **dict(zip(("tracker", "source", "family", "fault"), key, strict=True)),
            "clips": len(group),
            "called_wrong": sum(
                one.score is not None and one.score < EVEN for one in group
            ),
            "not_asked": sum(one.score is None for one in group),
            "scores": [
                None if one.score is None else round(one.score, 3) for one in group
            ],
        }
        for key, group in groups.items()
    ]


def findings(rows: Sequence[Row], seeds: range) -> Findings:
    """`rows` as `counted` gives them."""
    trackers, sources = _known(rows, "tracker"), _known(rows, "source")
    exact = trackers[0]
    bars = tuple(
        Bar(
            f"balanced accuracy, {source}, {exact} tracks",
            _part(found),
            f"{BAR:.0%}",
            found >= BAR,
        )
        for source in sources
        if (found := balanced(_only(rows, source=source, tracker=exact))) is not None
    )
    clips = sum(row["clips"] for row in _only(rows, tracker=exact))
    sentences = (
        f"Of {clips} clips, seeds {seeds.start} to {seeds.stop - 1}, which no threshold was chosen on, "
        f"{_part(balanced(_only(rows, tracker=exact)))} are called rightly on {exact} tracks (balanced accuracy: the "
        "mean of the shares of right and of wrong clips).",
    )
    sections = [
        Section("Right and wrong", _about(), (_confusion(rows, trackers, sources),)),
        Section("By what is wrong", (), (_by_fault(rows, trackers),)),
        Section("Right clips by kind", (), (_by_family(rows, trackers),)),
    ]
    shares = {source: _table(rows, source, trackers) for source in sources}
    more = {"seeds": [seeds.start, seeds.stop - 1], "balanced_accuracy": shares}
    return Findings(
        "plausibility",
        "Right and wrong clips",
        sentences,
        tuple(sections),
        list(rows),
        bars,
        more,
    )


class Counts(NamedTuple):
    """Of right clips, or of wrong ones."""

    clips: int
    wrong: int
    """Called so."""
    unasked: int
    """Of whom nothing can be asked: called rightly they are not, whatever they are."""

    @property
    def right(self) -> int:
        """Called so."""
        return self.clips - self.wrong - self.unasked


def balanced(rows: Sequence[Row]) -> float | None:
    """Mean of the shares of right clips and of wrong ones that are called rightly; None without either."""
    told = _told(rows)
    return None if told is None else sum(hits / count for hits, count in told) / 2


def interval(rows: Sequence[Row]) -> tuple[float, float] | None:
    """95 % of the balanced accuracy, as if all clips were drawn apart from each other; None without either kind."""
    told = _told(rows)
    return None if told is None else interval_of_mean(*told)


def _told(rows: Sequence[Row]) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """Of right clips and of wrong ones, how many are called rightly, of all; None without either."""
    right, wrong = _counts(rows, True), _counts(rows, False)
    if not (right.clips and wrong.clips):
        return None
    return (right.right, right.clips), (wrong.wrong, wrong.clips)


def _counts(rows: Iterable[Row], right: bool) -> Counts:
    some = [row for row in rows if (row["fault"] == RIGHT) is right]
    return Counts(
        *(
            sum(row[key] for row in some)
            for key in ("clips", "called_wrong", "not_asked")
        )
    )


def _about() -> tuple[str, ...]:
    return (
        "physgen: random scenes of nine kinds, and the same with one body wrong: the simulator is stopped, something "
        "is changed, and it goes on. Closed form: balls on parabolas, by a program that shares nothing with the "
        "engine. Neither walls nor pushes are given to the judge, and masses only where it says so. 16, 24 and 30 "
        f"frames a second by turns. Faults have {FREE:g} s without a touch before and after them, where they need it "
        "to show; thresholds were chosen on other seeds of both sources.",
        "Tracks: exact; with normal noise of so many px on each place, and on angles as much at the rim.",
    )


def _confusion(rows: Sequence[Row], trackers: list[str], sources: list[str]) -> Table:
    lines = []
    for tracker in trackers:
        for source in sources:
            mine = _only(rows, tracker=tracker, source=source)
            right, wrong = _counts(mine, True), _counts(mine, False)
            cells = (
                right.right,
                right.wrong,
                wrong.right,
                wrong.wrong,
                right.unasked + wrong.unasked,
            )
            lines.append(
                (
                    tracker,
                    source,
                    _part(balanced(mine)),
                    _range(interval(mine)),
                    *map(str, cells),
                )
            )
    told = (
        "right, called right",
        "right, called wrong",
        "wrong, called right",
        "wrong, called wrong",
        "not asked",
    )
    note = "95 %: where balanced accuracy would lie with other clips, as if each were drawn apart from the others."
    return Table(
        ("tracks", "source", "balanced accuracy", "95 %", *told),
        tuple(lines),
        note=note,
    )


def _by_fault(rows: Sequence[Row], trackers: list[str]) -> Table:
    lines = []
    for fault in (fault for fault in _known(rows, "fault") if fault != RIGHT):
        counts = (
            _counts(_only(rows, fault=fault, tracker=tracker), False)
            for tracker in trackers
        )
        lines.append((fault, *(_share(one.wrong, one.clips) for one in counts)))
    return Table(("called wrong", *trackers), tuple(lines))


def _by_family(rows: Sequence[Row], trackers: list[str]) -> Table:
    lines = []
    for family in _known(rows, "family"):
        counts = (
            _counts(_only(rows, family=family, tracker=tracker), True)
            for tracker in trackers
        )
        lines.append((family, *(_share(one.right, one.clips) for one in counts)))
    return Table(("called right", *trackers), tuple(lines))


def _table(
    rows: Sequence[Row], source: str, trackers: list[str]
) -> dict[str, float | None]:
    found = {
        tracker: balanced(_only(rows, source=source, tracker=tracker))
        for tracker in trackers
    }
    return {
        tracker: None if value is None else round(value, 4)
        for tracker, value in found.items()
    }


def _only(rows: Sequence[Row], **what: str) -> list[Row]:
    return [
        row for row in rows if all(row[key] == value for key, value in what.items())
    ]


def _known(rows: Iterable[Row], key: str) -> list[str]:
    return list(dict.fromkeys(str(row[key]) for row in rows))


def _range(found: tuple[float, float] | None) -> str:
    return "-" if found is None else f"[{100 * found[0]:.1f}, {100 * found[1]:.1f}]"


def _share(hits: int, clips: int) -> str:
    return f"{hits} of {clips}" if clips else "-"


def _part(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def interval_of_mean(
    first: tuple[int, int], second: tuple[int, int]
) -> tuple[float, float]:
    """The 95 % interval of the mean of two independent shares (count, total), by Wilson's of each (Newcombe 1998).

    >>> [round(end, 3) for end in interval_of_mean((69, 72), (349, 366))]
    [0.917, 0.972]
    """
    shares = [count / total for count, total in (first, second)]
    (low, high), (lower, higher) = wilson(*first), wilson(*second)
    middle = sum(shares) / 2
    below, above = (
        hypot(shares[0] - low, shares[1] - lower),
        hypot(high - shares[0], higher - shares[1]),
    )
    return middle - below / 2, middle + above / 2
