"""sim.yaml of the paper's public code -> its settings with their defaults, or every wrong line of it."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from physgen.problems import InputError, Place, Problem, Severity
from physgen.scene.document import decode, read
from physgen.scene.node import Node, Source
from physgen.scene.words import shown

KEYS = (
    "cat", "animation_frames", "size", "num_steps", "display", "save_snapshot", "gravity", "init_velocity", "init_acc",
    "ground_friction", "ground_elasticity", "edge_list", "obj_info", "denoise_strength", "seed",
    "snapshot_dir", "prompt",
)  # fmt: skip
"""What its configuration knows; others are passed over there, and warned of here."""
OBJECT_KEYS = ("label", "mass", "density", "friction", "elasticity", "primitive")
STEP = 1 / 60
"""s."""

Vector = tuple[float, float]


@dataclass(frozen=True)
class Body:
    """One entry of `obj_info`."""

    label: str
    circle: bool
    """Its primitive: a circle, else the polygon of its mask."""
    mass: float
    """g; counts for circles."""
    density: float
    """g/px²; counts for polygons."""
    friction: float
    elasticity: float
    place: Place
    velocity: Vector | None = None
    """px/s."""

    def problem(self, path: str, found: str, expected: str, fix: str) -> Problem:
        """Something wrong with this entry."""
        return Problem(self.place, path, found, expected, fix)


@dataclass(frozen=True)
class Sim:
    """The file, with what its code takes for what is missing."""

    gravity: float
    """px/s² down; 0 seen from above."""
    steps: int
    """of 1/60 s."""
    frames: int
    bodies: dict[int, Body]
    """By id in mask.png."""
    push: dict[int, Vector]
    """`init_acc`, by id: a change of velocity, px/s."""
    edges: list[tuple[Vector, Vector]]
    """px."""
    ground_friction: float
    ground_elasticity: float
    strength: float | None
    """of the diffusion step."""
    warnings: list[Problem] = field(default_factory=list)

    @property
    def duration(self) -> float:
        """s."""
        return self.steps * STEP


def read_sim(path: Path) -> Sim:
    """Raises InputError with every wrong line."""
    root = read(decode(path.read_bytes(), str(path)), Source(str(path), path.parent))
    return _Reader(root).sim()


class _Reader:
    """Collects problems while it reads."""

    def __init__(self, root: Node) -> None:
        self.root = root
        self.problems: list[Problem] = []

    def sim(self) -> Sim:
        top = self._mapping(self.root, "")
        self._unknown(top, KEYS, "")
        bodies = self._bodies(top)
        velocity = self._vectors(top, "init_velocity", bodies)
        bodies = {i: _moving(body, velocity.get(i)) for i, body in bodies.items()}
        sim = Sim(
            gravity=self._number(top, "gravity", "", 980.0, lambda v: v >= 0, "0 or more, in px/s² down"),
            steps=int(
                self._number(
                    top, "num_steps", "", 120, lambda v: 1 <= v <= 216000, "a count of steps from 1 to 216000"
                )
            ),
            frames=int(
                self._number(
                    top, "animation_frames", "", 16, lambda v: 1 <= v <= 100000, "a count of frames from 1"
                )
            ),
            bodies=bodies,
            push=self._vectors(top, "init_acc", bodies),
            edges=self._edges(top),
            ground_friction=self._number(
                top, "ground_friction", "", 1.0, lambda v: 0 <= v <= 10, "from 0 to 10"
            ),
            ground_elasticity=self._number(
                top, "ground_elasticity", "", 0.0, lambda v: 0 <= v <= 1, "from 0 to 1"
            ),
            strength=self._number(top, "denoise_strength", "", None, lambda v: 0 <= v <= 1, "from 0 to 1"),
        )
        errors = [p for p in self.problems if p.severity is Severity.ERROR]
        if errors:
            raise InputError(errors)
        sim.warnings.extend(self.problems)
        return sim

    def _bodies(self, top: dict[str, Node]) -> dict[int, Body]:
        node = top.get("obj_info")
        entries = self._mapping(node, "obj_info") if node is not None else {}
        if not entries:
            at = node or self.root
            self._add(at, "obj_info", "", "names no object", "write `obj_info:` with an id of mask.png each")
        return {
            int(key): self._body(value, f"obj_info.{key}")
            for key, value in entries.items()
            if self._id(key, value)
        }

    def _body(self, node: Node, path: str) -> Body:
        entry = self._mapping(node, path)
        self._unknown(entry, OBJECT_KEYS, path)
        primitive = entry["primitive"].value if "primitive" in entry else "polygon"
        if primitive not in ("circle", "polygon"):
            self._add(
                entry["primitive"],
                f"{path}.primitive",
                shown(primitive),
                "is not a primitive",
                "write circle or polygon",
            )
        label = entry["label"].value if "label" in entry else "object"
        weight: Callable[[float], bool] = lambda v: 0 < v <= 1e12  # noqa: E731
        circle = primitive == "circle"
        mass = self._number(entry, "mass", path, None, weight, "more than 0, in g")
        density = self._number(entry, "density", path, None, weight, "more than 0, in g/px²")
        if (mass if circle else density) is None:
            wanted, unit = ("mass", "g") if circle else ("density", "g/px²")
            self._add(
                node, f"{path}.{wanted}", "", f"missing, and a {primitive} needs it", f"write it in {unit}"
            )
        return Body(
            label=str(label if label is not None else "object")[:200],
            circle=circle,
            mass=mass if mass is not None else 1.0,
            density=density if density is not None else 1.0,
            friction=self._number(entry, "friction", path, 0.5, lambda v: 0 <= v <= 10, "from 0 to 10"),
            elasticity=self._number(entry, "elasticity", path, 0.5, lambda v: 0 <= v <= 1, "from 0 to 1"),
            place=node.key_place,
        )

    def _vectors(self, top: dict[str, Node], key: str, bodies: dict[int, Body]) -> dict[int, Vector]:
        node = top.get(key)
        if node is None or node.value is None:
            return {}
        result: dict[int, Vector] = {}
        for name, value in self._mapping(node, key).items():
            path = f"{key}.{name}"
            if not self._id(name, value):
                continue
            if int(name) not in bodies:
                self._add(
                    value,
                    path,
                    name,
                    "is not among obj_info",
                    f"it has {', '.join(map(str, bodies)) or 'none'}",
                )
                continue
            vector = self._vector(value, path)
            if vector is not None:
                result[int(name)] = vector
        return result

    def _edges(self, top: dict[str, Node]) -> list[tuple[Vector, Vector]]:
        node = top.get("edge_list")
        if node is None or node.value is None:
            return []
        if not isinstance(node.value, list):
            self._add(
                node,
                "edge_list",
                shown(node.value),
                "is not a list of segments",
                "write [[[x, y], [x, y]], ...]",
            )
            return []
        edges = []
        for k, item in enumerate(node.value):
            path = f"edge_list[{k}]"
            ends = item.value if isinstance(item.value, list) else []
            if len(ends) != 2:
                self._add(
                    item, path, shown(item.value), "is not a segment of two points", "write [[x, y], [x, y]]"
                )
                continue
            a, b = (self._vector(end, path) for end in ends)
            if a is not None and b is not None:
                edges.append((a, b))
        return edges

    def _vector(self, node: Node, path: str) -> Vector | None:
        numbers: list[Any] = [child.value for child in node.value] if isinstance(node.value, list) else []
        if len(numbers) == 2 and all(_finite(n) and abs(n) <= 1e9 for n in numbers):
            return numbers[0], numbers[1]
        self._add(node, path, shown(node.value), "is not two numbers", "write [x, y]")
        return None

    def _number(
        self,
        entry: dict[str, Node],
        key: str,
        above: str,
        default: Any,
        fits: Callable[[float], bool],
        wanted: str,
    ) -> Any:
        node = entry.get(key)
        if node is None or node.value is None:
            return default
        value: Any = node.value
        path = f"{above}.{key}" if above else key
        if not _finite(value):
            self._add(node, path, shown(value), "is not a number", f"write {wanted}")
            return default if default is not None else 1.0
        if not fits(value):
            self._add(node, path, shown(value), "is out of range", f"write {wanted}")
        return value

    def _mapping(self, node: Node, path: str) -> dict[str, Node]:
        if isinstance(node.value, dict):
            return node.value
        if node.value is not None:
            self._add(node, path, shown(node.value), "is not a mapping", "write `key: value`, one a line")
        return {}

    def _id(self, key: str, node: Node) -> bool:
        if key.isascii() and key.isdigit() and 1 <= int(key) <= 65535:
            return True
        self._add(node, key, f'"{key}"', "is not an id of mask.png", "write a number from 1 to 65535")
        return False

    def _unknown(self, entry: dict[str, Node], known: tuple[str, ...], path: str) -> None:
        for key, node in entry.items():
            if key in known:
                continue
            near = difflib.get_close_matches(key, known, 1, 0.75)
            severity = Severity.ERROR if near else Severity.WARNING
            fix = f"did you mean {near[0]}?" if near else "it is passed over"
            where = f"{path}.{key}" if path else key
            self.problems.append(
                Problem(node.key_place, where, f'"{key}"', "is not a key of sim.yaml", fix, severity)
            )

    def _add(self, node: Node, path: str, found: str, expected: str, fix: str) -> None:
        self.problems.append(Problem(node.place, path, found, expected, fix))


def _moving(body: Body, velocity: Vector | None) -> Body:
    return Body(**{**body.__dict__, "velocity": velocity})


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
