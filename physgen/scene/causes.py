"""Find the overlay key behind a wrong value, for messages about overlays.

If a variant removes `objects.ball`, a force on `ball` is wrong, in a line outside the
variant. Such a problem moves to the key of the overlay, and keeps the place of the
wrong value as its origin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice

from physgen.problems import Place, Problem
from physgen.scene.document import Node, items
from physgen.scene.files import merge_bases
from physgen.scene.overlay import NAMED, Edit, apply
from physgen.text import KeyPath

Check = Callable[[Node], Iterable[Problem]]
"""Returns the problems of a tree."""

MOST_KEYS = 200
"""Maximum number of keys of an extending file to try as the cause, each by
one check.
"""


def name_edits(
    problems: Iterable[Problem], root: Node, edits: Sequence[Edit], check: Check
) -> list[Problem]:
    """Return the problems of a tree after `edits`, each at the edit that caused it."""
    # A value of an edit is its own cause; other problems need checks of partial trees.
    writers = {}
    for edit in edits:
        for place in _places(edit.value):
            writers[place] = edit
    located_problems = []
    pending = []
    for problem in problems:
        writer = writers.get(problem.place)
        if writer is None:
            pending.append(problem)
        else:
            fix = problem.fix + _dotted_key_advice(writer)
            located_problems.append(replace(problem, variant=writer.variant, fix=fix))
    if pending:
        causes = _first_edits(root, edits, check)
        located_problems += [
            _move_to_cause(problem, causes, edits) for problem in pending
        ]
    return located_problems


def _dotted_key_advice(edit: Edit) -> str:
    """Return advice on setting one value, for an edit that replaces a whole section."""
    value = edit.value
    path = [edit.key]
    # The first single value of the section serves as the example.
    while isinstance(value.value, dict) and value.value:
        key, value = next(iter(value.value.items()))
        path.append(key)
    if edit.key not in NAMED or len(path) < 2:
        return ""
    return f"; this replaces all {edit.key}: to set one value, write {'.'.join(path)}"


def _move_to_cause(
    problem: Problem, causes: dict[Problem, Edit], edits: Sequence[Edit]
) -> Problem:
    """Return the problem at the edit that caused it, or unchanged without a known
    cause.
    """
    edit = causes.get(problem)
    if edit is None:
        # Without a cause, the problem stays at the value. It is the variant's if all
        # edits are.
        variants = {edit.variant for edit in edits}
        return replace(problem, variant=variants.pop() if len(variants) == 1 else "")
    place = edit.value.key_place
    return replace(problem, place=place, origin=problem.place, variant=edit.variant)


def _first_edits(
    root: Node, edits: Sequence[Edit], check: Check
) -> dict[Problem, Edit]:
    """Return the edit after which each problem first appears."""
    # A single edit caused all new problems: one check replaces the search.
    if len(edits) == 1:
        last = edits[0]
        return dict.fromkeys(check(apply(root, last)), last)
    causes: dict[Problem, Edit] = {}
    for edit in edits:
        root = apply(root, edit)
        current = dict.fromkeys(check(root))
        # A problem may vanish again by a later edit: only problems of the last tree
        # count.
        causes = {problem: causes.get(problem, edit) for problem in current}
    return causes


def name_extending_keys(
    problems: Iterable[Problem], chain: Sequence[Node], check: Check
) -> list[Problem]:
    """Return the problems of extended files, each at the key that caused it.

    `chain` holds the trees, from the opened file to its last base. Problems of the last
    file alone keep their places.
    """
    pending = dict.fromkeys(problems)
    located_problems = []
    # From the last base to the opened file: the first file with the problem is its
    # cause.
    for number in range(len(chain) - 2, -1, -1):
        inherited_scene = merge_bases(chain[number + 1 :])
        inherited_problems = set(check(inherited_scene))
        own_places = set(_places(chain[number]))
        # New problems outside this file's own lines: one of its keys must cause them.
        wrong = []
        for p in check(merge_bases(chain[number:])):
            if p not in inherited_problems:
                wrong.append(p)
        caused_problems = []
        for p in wrong:
            if p in pending and p.place not in own_places:
                caused_problems.append(p)
        for problem, node in _causes(
            caused_problems, chain[number], inherited_scene, check
        ):
            del pending[problem]
            located_problems.append(
                replace(problem, place=node.key_place, origin=problem.place)
            )
    return [*pending, *located_problems]


def _causes(
    problems: Sequence[Problem], extension: Node, base: Node, check: Check
) -> Iterator[tuple[Problem, Node]]:
    """Yield each problem that disappears without one key of `extension`, and
    the key.
    """
    pending = list(problems)
    for path, node in islice(_keys(extension, (), 3), MOST_KEYS):
        if not pending:
            return
        # The key is the cause if the problem disappears with it.
        left = set(check(merge_bases([_remove_key(extension, path), base])))
        solved_problems = []
        for problem in pending:
            if problem not in left:
                solved_problems.append(problem)
        pending = [problem for problem in pending if problem in left]
        yield from ((problem, node) for problem in solved_problems)


def _keys(node: Node, path: KeyPath, depth: int) -> Iterator[tuple[KeyPath, Node]]:
    """Yield the keys of a file that replace or remove a value of another file."""
    if not isinstance(node.value, dict):
        return
    for key, child in node.value.items():
        key_path = (*path, key)
        is_name = len(key_path) == 1 and key in NAMED
        if depth > 1 and isinstance(child.value, dict) and (is_name or child.value):
            yield from _keys(child, key_path, depth - 1)
        elif key_path != ("extends",):
            yield key_path, child


def _remove_key(node: Node, path: KeyPath) -> Node:
    """Return the tree without the value at a path."""
    assert isinstance(node.value, dict)
    key, *rest = path
    children = dict(node.value)
    child = children.pop(str(key))
    if rest:
        children[str(key)] = _remove_key(child, tuple(rest))
    return node.with_value(children)


def _mapping(node: Node) -> dict[str, Node]:
    if isinstance(node.value, dict):
        return node.value
    return {}


def _places(node: Node) -> Iterator[Place]:
    """Yield the places of a value, of its key and of all of its content."""
    yield node.place
    yield node.key_place
    for child in (*_mapping(node).values(), *items(node)):
        yield from _places(child)
