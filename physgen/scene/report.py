"""Problems found one by one in a tree -> those worth telling, and which parts of the tree were seen."""

from __future__ import annotations

from physgen.problems import Place, Problem
from physgen.scene.node import Node
from physgen.scene.words import KeyPath, dotted, shown

MAX_PROBLEMS = 200


class TooManyError(Exception):
    """More problems than anybody reads."""


class Report:
    """Collects problems, and remembers which mappings were checked and which are wrong somewhere inside."""

    def __init__(self) -> None:
        self.problems: dict[Problem, None] = {}
        self._told: dict[Place, set[tuple[str, ...]]] = {}
        self.known: set[Node] = set()
        self.bad: set[Node] = set()
        self.ruled: set[Node] = set()
        """Mappings and outlines whose cross-field rules were looked at."""

    def beyond(self) -> Report:
        """A fresh one that knows what this one has seen: for another tree that shares parts with the first."""
        other = Report()
        other.known, other.bad, other.ruled = set(self.known), set(self.bad), set(self.ruled)
        return other

    def add(self, place: Place, path: KeyPath | str, found: str, expected: str, fix: str) -> None:
        """One problem; the same one of the same place is kept once. Raises TooManyError after MAX_PROBLEMS."""
        where = path if isinstance(path, str) else dotted(path)
        said = where.rpartition(".")[2], found, expected, fix
        if said in self._told.setdefault(place, set()):
            return  # of a key with a star: one mistake, in many objects
        if len(self.problems) >= MAX_PROBLEMS:
            stop = "more problems follow"
            self.problems[Problem(place, "", "", stop, "mend these first")] = None
            raise TooManyError
        self._told[place].add(said)
        self.problems[Problem(place, where, found, expected, fix)] = None

    def value(self, node: Node, path: KeyPath, expected: str, fix: str) -> None:
        """A problem with a value; one that an overlay wrote into many objects is told once."""
        if node not in self.bad:
            self.bad.add(node)
            self.add(node.place, path, shown(node.value), expected, fix)
