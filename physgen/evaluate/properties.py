"""Compare a physics backend's masses, and its orders of friction and elasticity, with
measured ones.

The measures are the paper's (appendix, "GPT-4V physical property estimation
evaluation"): the mean absolute difference (ADE) and the share of masses within 30 %,
and pairs in the right order.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import combinations
from math import exp, log
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.measure import Findings, Progress, Section, Table
from physgen.geometry import raster
from physgen.geometry.polygon import Disc, Outline, Region, Ring
from physgen.geometry.scale import MIN_SCALE_CONFIDENCE, box_sides, photo_scale
from physgen.materials import kind as kind_of
from physgen.messages import Message
from physgen.perceive.roles import Matter, PhotoObject, Physics, Rgb
from physgen.problems import Place
from physgen.registry import Backends
from physgen.scene.document import Source, decode, read, to_plain_data
from physgen.simulate.uncertainty import wilson

NEAR = 0.3
"""Maximum relative error of a right mass, as in the paper."""
REGULATED = 0.05
"""Maximum relative spread of sizes for a kind of object with a regulated weight."""
ROUNDING = 1e-12
"""Relative error of a float at NEAR exactly."""


# ---- tables

SHIPPED = Path(__file__).with_name("objects.yaml")


class Coefficient(Enum):
    """The property of a ranking."""

    FRICTION = "friction"
    ELASTICITY = "elasticity"


class Form(Enum):
    """Shape of an object without a photo, with its kind of size."""

    BALL = "ball"
    TURNED = "turned"
    BOX = "box"


COEFFICIENTS = tuple(coefficient.value for coefficient in Coefficient)
NUMBERS = ("mass", *COEFFICIENTS)
LENGTHS = {Form.BALL: 1, Form.TURNED: 2, Form.BOX: 3}
"""Number of lengths in a form's size."""


@dataclass(frozen=True)
class Item:
    """One object."""

    name: str
    label: str
    """The noun in the question to a backend."""
    form: Form = Form.BOX
    size: tuple[float, ...] = ()
    """mm: diameter of a ball; height and diameter of a turned object; three sides of a
    box. Empty if unknown.
    """
    mass: float | None = None
    """True mass, g."""


@dataclass(frozen=True)
class Ranking:
    """Coefficients from one method of measurement."""

    coefficient: str
    """`friction` or `elasticity`."""
    label: str
    source: str
    values: Mapping[str, float]
    """Values by the objects' names."""


@dataclass(frozen=True)
class Objects:
    """A table."""

    title: str
    source: str
    items: tuple[Item, ...]
    rankings: tuple[Ranking, ...]

    @property
    def items_with_mass(self) -> tuple[Item, ...]:
        """Return the objects with a known mass."""
        return tuple(item for item in self.items if item.mass is not None)


@dataclass(frozen=True)
class Answer:
    """Answer for one object; None without an answer."""

    mass: float | None = None
    """g."""
    friction: float | None = None
    elasticity: float | None = None
    reason: str = ""


TABLE_START = "`objects:` and one line per object, e.g. `cup: {label: cup, mass: 118}`"
"""First keys of a table, for messages."""


def read_table(path: Path) -> Objects:
    """Return a table in YAML. Raise InputError."""
    try:
        table = _parse_table(path)
    except OSError as error:
        raise Message.TABLE_UNREADABLE.error(str(path), reason=error.strerror) from None
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise Message.NOT_OBJECT_TABLE.error(str(path), reason=error) from None
    if not table.items_with_mass and not table.rankings:
        raise Message.OBJECT_TABLE_EMPTY.error(str(path))
    return table


def _parse_table(path: Path) -> Objects:
    """Return a table. Raise an error of Python for another kind of file."""
    text = decode(path.read_bytes(), str(path))
    source_file = Source(str(path), path.parent)
    data: Any = to_plain_data(read(text, source_file, start=TABLE_START))
    items = [_item(str(path), name, **row) for name, row in data["objects"].items()]
    rankings = []
    for name in data.get("rankings", {}):
        for record in data["rankings"][Coefficient(name).value]:
            label = record.get("about", "")
            source = record.get("source", "")
            values = _ranked_values(str(path), record["values"], data["objects"])
            rankings.append(Ranking(name, label, source, values))
    title = data.get("title", path.name)
    source = data.get("source", "")
    return Objects(title, source, tuple(items), tuple(rankings))


def _item(
    file: str,
    name: str,
    /,
    label: str = "",
    form: str = "box",
    size: Sequence[float] = (),
    mass: float | None = None,
) -> Item:
    """Return an object. Raise InputError, ValueError or TypeError for a wrong value."""
    shape = Form(form)
    sides = tuple(map(float, size))
    if sides and len(sides) != LENGTHS[shape]:
        raise Message.SIZE_OF_FORM.error_at(
            Place(file), f"objects.{name}.size", form=form, count=LENGTHS[shape]
        )
    if mass is None:
        known_mass = None
    else:
        known_mass = float(mass)
    if known_mass is None:
        numbers = sides
    else:
        numbers = (*sides, known_mass)
    if min(numbers, default=1.0) <= 0:
        raise Message.OBJECT_NUMBER_NEGATIVE.error_at(Place(file), f"objects.{name}")
    label = str(label) or name.replace("-", " ").replace("_", " ")
    return Item(name, label, shape, sides, known_mass)


def _ranked_values(
    file: str, values: Mapping[str, float], objects: Mapping[str, Any]
) -> dict[str, float]:
    """Return values by object. Raise InputError for fewer than two, and for unknown
    names.
    """
    if len(values) < 2 or not values.keys() <= objects.keys():
        raise Message.RANKING_TOO_SHORT.error_at(
            Place(file), "rankings", ", ".join(values)
        )
    return {name: float(value) for name, value in values.items()}


# ---- scores


@dataclass(frozen=True)
class Masses:
    """Errors of masses."""

    count: int
    ade: float
    """Mean absolute difference, g."""
    near_count: int
    """Number of masses within 30 % of the truth."""

    @property
    def share(self) -> float:
        return self.near_count / self.count

    @property
    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the share, after Wilson (1927)."""
        return wilson(self.near_count, self.count)

    def as_dict(self) -> dict[str, float | int | list[float]]:
        return {
            "objects": self.count,
            "ade_g": self.ade,
            "within_30": self.near_count,
            "share": self.share,
            "interval": list(self.interval),
        }


def masses(pairs: Sequence[tuple[float, float]]) -> Masses | None:
    """Return the errors of pairs (true, answered), g, all above 0; None without a pair.

    >>> masses([(100, 200), (100, 80)])
    Masses(count=2, ade=60.0, near_count=1)
    """
    if not pairs:
        return None
    true_masses, answers = np.array(pairs, np.float64).T
    errors = np.abs(answers - true_masses)
    # Rounding must not exclude an error of exactly 30 %.
    is_near = errors <= NEAR * true_masses * (1 + ROUNDING)
    return Masses(len(pairs), float(errors.mean()), int(is_near.sum()))


@dataclass(frozen=True)
class Order:
    """Number of pairs in the right order."""

    count: int = 0
    """Number of pairs with different true values."""
    right: int = 0
    ties: int = 0
    """Number of pairs with equal answers, which are not right."""
    wrong_pairs: tuple[tuple[str, str], ...] = ()
    """(truly larger, truly smaller) of the wrong pairs."""

    def __add__(self, other: Order) -> Order:
        return Order(
            self.count + other.count,
            self.right + other.right,
            self.ties + other.ties,
            self.wrong_pairs + other.wrong_pairs,
        )


def order(true: Mapping[str, float], answers: Mapping[str, float]) -> Order:
    """Return the order of every pair of names with different true values.

    >>> order({"a": 3, "b": 2, "c": 1}, {"a": 0.9, "b": 0.1, "c": 0.5})
    Order(count=3, right=2, ties=0, wrong_pairs=(('b', 'c'),))
    """
    total = Order()
    for first, second in combinations(true, 2):
        # Pairs with equal true values have no right order.
        if true[first] == true[second]:
            continue
        larger, smaller = first, second
        if true[first] < true[second]:
            larger, smaller = second, first
        is_right = answers[larger] > answers[smaller]
        is_tie = answers[larger] == answers[smaller]
        wrong_pairs: tuple[tuple[str, str], ...] = ()
        if not is_right:
            wrong_pairs = ((larger, smaller),)
        total += Order(1, int(is_right), int(is_tie), wrong_pairs)
    return total


# ---- asking


def ask(
    table: Objects, backends: Backends, with_size: bool, progress: Progress
) -> dict[str, Answer]:
    """Return answers by name.

    With size, the backend gets each object's size, as from a photo of known scale;
    otherwise only its name. Raise InputError if the backend cannot answer.
    """

    def ask_all(physics: Physics) -> dict[str, Answer]:
        answers = {}
        for k, item in enumerate(table.items):
            progress(f"physics of {item.name}", k, len(table.items))
            rgb, outline = silhouette(item)
            photo_object = PhotoObject(1, outline, item.label)
            scale = scale_by_labels([photo_object])
            if with_size and item.size:
                # A known size gives the scale, as an object of known size does in a
                # photo.
                longest_m = max(item.size) / 1000
                scale = box_sides(outline)[0] / longest_m
            matter = physics(rgb, [photo_object], scale)
            answers[item.name] = as_answer(matter[1])
        return answers

    answers: dict[str, Answer] = backends.run("physics", ask_all)
    return answers


def as_answer(matter: Matter) -> Answer:
    return Answer(matter.mass, matter.friction, matter.elasticity, matter.reason)


def scale_by_labels(objects: Sequence[PhotoObject]) -> float | None:
    """Return px/m as `perceive` finds it, from objects of known size, or None without
    such objects.
    """
    kinds = {photo_object.id: kind_of(photo_object.label) for photo_object in objects}
    scale = photo_scale(objects, kinds)
    if scale is None or scale.confidence < MIN_SCALE_CONFIDENCE:
        return None
    return scale.pixels_per_meter


CANVAS, LONGEST = 512, 256
"""Sides of a silhouette's picture and of its object, px."""
PAPER, INK = 235, 110
"""Grey levels of paper and object."""


UNKNOWN_SIZES = {
    Form.BALL: (1.0,),
    Form.TURNED: (2.0, 1.0),
    Form.BOX: (1.0, 1.0, 1.0),
}
"""Sizes of silhouettes for objects of unknown size."""


def silhouette(item: Item) -> tuple[Rgb, Outline]:
    """Return a grey shape on paper, and its outline.

    The shape is a ball's disc, or the rectangle of the two longest sides; turned objects stand upright.
    """
    size = item.size or UNKNOWN_SIZES[item.form]
    center = np.full(2, CANVAS / 2)
    # The longest side has the same length in the picture for all objects.
    px_per_mm = LONGEST / max(size)
    outline: Outline
    if item.form is Form.BALL:
        outline = Disc(center, size[0] / 2 * px_per_mm)
    else:
        if item.form is Form.TURNED:
            height, width = size
        else:
            # A box shows its two longest sides.
            height, width = sorted(size)[-2:]
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        corners = signs * (width, height) / 2
        outline = Region((Ring(center + corners * px_per_mm),))
    coverage = raster.coverage(outline, (CANVAS, CANVAS))[..., None]
    grey = np.rint(PAPER + (INK - PAPER) * coverage)
    rgb: NDArray[np.uint8] = grey.astype(np.uint8)
    return np.repeat(rgb, 3, axis=2), outline


# ---- report

MASS, ORDER = "Mass", "Order of friction and elasticity"
PAPER_MASS = ("the paper, GPT-4V on photos", "20", "390 g", "75 %", "[53, 89]")
PAPER_ORDER = {"friction": (12, 13), "elasticity": (6, 7)}
HEADS = ("set", "objects", "ADE", "within 30 %", "95 %")
TABLE_PAIRS = 2
"""Number of wrongly ordered pairs in a table; the JSON has all."""
NOTE = (
    "ADE: mean absolute difference. 95 %: interval of the share, since the objects are few. The paper's objects are "
    "others: 20 of Amazon Berkeley Objects."
)


@dataclass(frozen=True)
class Origin:
    """Origin of the answers."""

    source: str
    """Name of the backend: `table`, `vlm`."""
    has_size: bool


def findings(table: Objects, answers: Mapping[str, Answer], origin: Origin) -> Findings:
    """Return the scores of masses and of orders."""
    mass_sets = _mass_sets(table, answers)
    orders = []
    for ranking in table.rankings:
        values = _known_values(answers, ranking.coefficient)
        orders.append((ranking, order(ranking.values, values)))
    totals = {}
    for coefficient in COEFFICIENTS:
        totals[coefficient] = sum(_orders_of(orders, coefficient), Order())
    return Findings(
        measure="properties",
        title="Mass, friction and elasticity",
        sentences=tuple(_sentences(mass_sets.get(table.title), totals, origin, table)),
        sections=tuple(_sections(table, answers, mass_sets, orders, totals)),
        rows=[
            *({"kind": "set", "set": k, **v.as_dict()} for k, v in mass_sets.items()),
            *(_order_row(ranking, score) for ranking, score in orders),
        ],
        extra=_record(table, answers, origin),
    )


def _record(
    table: Objects, answers: Mapping[str, Answer], origin: Origin
) -> dict[str, Any]:
    """Return the origin of the findings for JSON."""
    values = {}
    for name, answer in answers.items():
        values[name] = {key: getattr(answer, key) for key in NUMBERS}
    return {
        "by": origin.source,
        "size_told": origin.has_size,
        "table": table.title,
        "source": table.source,
        "paper": {
            "objects": 20,
            "ade_g": 390,
            "share": 0.75,
            "friction": [12, 13],
            "elasticity": [6, 7],
        },
        "answers": values,
    }


@dataclass(frozen=True)
class _MassPair:
    """A true mass and its answer."""

    item: Item
    true_mass: float
    """g."""
    answer: float
    """g."""

    def factor(self) -> float:
        """Return the factor between both, 1 or more: 2 is half or twice."""
        # The logarithm treats half and twice the mass alike.
        return exp(abs(log(self.answer / self.true_mass)))


def _mass_pairs(table: Objects, answers: Mapping[str, Answer]) -> list[_MassPair]:
    pairs = []
    for item in table.items_with_mass:
        pairs.append(_MassPair(item, item.mass or 0.0, answers[item.name].mass or 0.0))
    return pairs


def _mass_sets(table: Objects, answers: Mapping[str, Answer]) -> dict[str, Masses]:
    """Return the errors of all masses, and of the masses without regulation,
    by name.
    """
    pairs = _mass_pairs(table, answers)
    free_pairs = []
    for pair in pairs:
        if not is_regulated(pair.item.label):
            free_pairs.append(pair)
    pairs_by_set = {table.title: pairs}
    # Weights of balls for sports are rules, not physics: both sets are of interest.
    if 0 < len(free_pairs) < len(pairs):
        pairs_by_set["without regulated weights"] = free_pairs
    sets = {}
    for name, set_pairs in pairs_by_set.items():
        score = masses([(pair.true_mass, pair.answer) for pair in set_pairs])
        if score is not None:
            sets[name] = score
    return sets


def _orders_of(
    orders: Sequence[tuple[Ranking, Order]], coefficient: str
) -> list[Order]:
    return [score for ranking, score in orders if ranking.coefficient == coefficient]


def _sections(
    table: Objects,
    answers: Mapping[str, Answer],
    mass_sets: Mapping[str, Masses],
    orders: Sequence[tuple[Ranking, Order]],
    totals: Mapping[str, Order],
) -> list[Section]:
    """Return the tables of masses, orders and objects."""
    sections = []
    if table.items_with_mass:
        cells = [mass_cells(name, score) for name, score in mass_sets.items()]
        mass_table = Table(HEADS, (*cells, PAPER_MASS), note=NOTE)
        sections.append(Section(MASS, (), (mass_table,)))
    if any(score.count for score in totals.values()):
        sections.append(_order_section(orders, totals))
    if table.items_with_mass:
        sections.append(_object_section(table, answers))
    return sections


def is_regulated(label: str) -> bool:
    """Return whether materials.yaml has a regulated weight for such an object, as for a
    golf ball.
    """
    kind = kind_of(label)
    return kind.mass is not None and kind.spread <= REGULATED and kind.form == "ball"


def _known_values(answers: Mapping[str, Answer], coefficient: str) -> dict[str, float]:
    values = {}
    for name, answer in answers.items():
        value = getattr(answer, coefficient)
        if value is not None:
            values[name] = value
    return values


def _sentences(
    score: Masses | None, totals: Mapping[str, Order], origin: Origin, table: Objects
) -> Iterator[str]:
    """Yield the sentences on masses, orders and the way of asking."""
    if score is not None:
        low, high = score.interval
        yield (
            f"The backend {origin.source} gives {score.near_count} of {score.count} masses to within 30 % "
            f"({100 * score.share:.0f} %; interval of 95 %: {100 * low:.0f} to {100 * high:.0f} %), with a mean error "
            f"of {_format_grams(score.ade)}. The paper: 75 % of 20, 0.39 kg."
        )
    for coefficient, total in totals.items():
        if total.count:
            right, count = PAPER_ORDER[coefficient]
            ties = ""
            if total.ties:
                ties = f", {total.ties} answered as equal"
            yield (
                f"{coefficient.capitalize()}: {total.right} of {total.count} pairs in the right order{ties}. "
                f"The paper: {right} of {count}."
            )
    size = "its size is not given"
    if origin.has_size and any(item.size for item in table.items):
        size = "its size is given by the scale"
    yield (
        "A table has no photos: the backend gets each object's name with a bare silhouette, a disc or a rectangle; "
        f"{size}. The paper asks about photos."
    )
    if origin.source == "table":
        yield (
            "The backend reads materials.yaml, which has no number from the table that ships. Its masses are no blind "
            "test: rows for kinds that the table asks about were written by those who knew it; and materials.yaml "
            "knows the rules for regulated weights, such as a golf ball's."
        )


def _order_row(ranking: Ranking, score: Order) -> dict[str, Any]:
    return {
        "kind": ranking.coefficient,
        "set": ranking.label,
        "source": ranking.source,
        "pairs": score.count,
        "right": score.right,
        "tied": score.ties,
        "not_in_order": list(map(list, score.wrong_pairs)),
    }


def mass_cells(title: str, score: Masses) -> tuple[str, ...]:
    """Return a line of the table of masses."""
    low, high = score.interval
    share = f"{100 * score.share:.0f} %"
    interval = f"[{100 * low:.0f}, {100 * high:.0f}]"
    return title, str(score.count), _format_grams(score.ade), share, interval


def _format_grams(grams: float) -> str:
    """Return a mass in three digits.

    >>> _format_grams(390.4), _format_grams(12.34)
    ('390 g', '12.3 g')
    """
    if grams < 1000:
        return f"{grams:.3g} g"
    return f"{grams / 1000:.3g} kg"


def _order_section(
    orders: Sequence[tuple[Ranking, Order]], totals: Mapping[str, Order]
) -> Section:
    """Return the table of rankings, with the paper's figures below those of
    each coefficient.
    """
    rows = []
    for coefficient in COEFFICIENTS:
        rankings = 0
        for ranking, score in orders:
            if ranking.coefficient != coefficient:
                continue
            pairs = _format_pairs(score.wrong_pairs)
            rows.append((coefficient, ranking.label, *_counts(score), pairs))
            rankings += 1
        if rankings > 1:
            counts = _counts(totals[coefficient])
            rows.append((coefficient, "all of these", *counts, ""))
        right, count = PAPER_ORDER[coefficient]
        paper = "the paper, GPT-4V on videos"
        rows.append((coefficient, paper, f"{right} of {count}", "-", ""))
    heads = (
        "coefficient",
        "compared",
        "in order",
        "equal",
        "not in order (more > less)",
    )
    return Section(ORDER, (), (Table(heads, tuple(rows)),))


def _format_pairs(pairs: Sequence[tuple[str, str]]) -> str:
    """Return the first pairs, and the number of the others."""
    texts = [f"{larger} > {smaller}" for larger, smaller in pairs[:TABLE_PAIRS]]
    text = ", ".join(texts)
    if len(pairs) > TABLE_PAIRS:
        text += f" and {len(pairs) - TABLE_PAIRS} more"
    return text


def _counts(score: Order) -> tuple[str, str]:
    return f"{score.right} of {score.count}", str(score.ties)


def _object_section(table: Objects, answers: Mapping[str, Answer]) -> Section:
    """Return the table of all objects with a mass, the nearest answer first."""
    rows = []
    for pair in sorted(_mass_pairs(table, answers), key=_MassPair.factor):
        rows.append(
            (
                pair.item.label,
                f"{pair.true_mass:g}",
                f"{pair.answer:g}",
                f"{pair.answer / pair.true_mass:.2f}",
                "x".join(f"{side:g}" for side in pair.item.size),
            )
        )
    heads = ("object", "true, g", "answered, g", "answered / true", "size, mm")
    object_table = Table(heads, tuple(rows), note=table.source)
    return Section("Each object, the nearest first", (), (object_table,))
