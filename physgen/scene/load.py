"""Load a scene file: inheritance, variants, overrides, checks, and the frozen Scene."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from physgen.files import file_stamp
from physgen.messages import Message, one_of
from physgen.problems import InputError, Limit, Place, Problem
from physgen.scene import scene as parts
from physgen.scene.causes import name_edits, name_extending_keys
from physgen.scene.checked_tree import Ground
from physgen.scene.construction import _shape, scene_from_tree
from physgen.scene.document import (
    Node,
    Source,
    children,
    decode,
    items,
    read,
    to_plain_data,
)
from physgen.scene.files import Record, merge_bases, read_bases, read_scene
from physgen.scene.overlay import (
    Edit,
    apply,
    edit_of_flag,
    edits_of_variant,
    targets,
    variants_of,
)
from physgen.scene.rules import Files, check_rules
from physgen.scene.schema import (
    with_defaults,
)
from physgen.scene.tree_numbers import in_numbers
from physgen.scene.validate import (
    MAX_PROBLEMS,
    Findings,
    TooManyError,
    check_schema,
)
from physgen.text import KeyPath, dotted, quoted


class OpenedScene:
    """A checked scene file, for any number of its variants.

    For an edit, `text` is the future content of the file.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        allow_outside: bool = False,
        text: str | None = None,
    ) -> None:
        self.file = Path(os.fspath(path))
        self.allow_outside = allow_outside
        name = os.fspath(path)
        self._source = Source(name, Path(os.path.abspath(self.file)).parent)
        # The stamp is taken before reading, so that a save in between is noticed.
        if text is None:
            self._stamps = {self.file: file_stamp(self.file)}
        else:
            self._stamps = {}
        if text is None:
            own_problems = read_scene(self.file, name)
        else:
            own_problems = read(
                decode(text.encode("utf-8", "surrogatepass"), name), self._source
            )
        self._chain = read_bases(own_problems, self.file, allow_outside, self._stamps)
        self._root = merge_bases(self._chain)
        self._files = Files(allow_outside)
        self.variants = tuple(name for name, _ in variants_of(self._root))
        self._own = Findings()
        self.ground = _check(in_numbers(self._root), self._own, self._files)
        """The photo and the assets of the file itself, if usable."""

    @cached_property
    def variant_problems(self) -> tuple[Problem, ...]:
        """Return the problems of each variant, without those of the file itself.

        A faulty variant does not block the file and its other variants.
        """
        return tuple(_problems_of_variants(self._root, self._own, self._files))

    def document(self) -> dict[str, Any]:
        """Return the plain YAML data with the bases, without defaults."""
        data = to_plain_data(self._root)
        assert isinstance(data, dict)
        return data

    def place(self, path: KeyPath) -> Place:
        """Return the place of the value at a path, or of the nearest ancestor."""
        node = self._root
        for key in path:
            child_nodes = children(node).get(str(key))
            if child_nodes is None:
                break
            node = child_nodes
        return node.place

    def stale(self) -> bool:
        """Return whether the file or one of its bases has changed."""
        return any(file_stamp(file) != stamp for file, stamp in self._stamps.items())

    def scene(
        self, overrides: Sequence[str] = (), variant: str | None = None
    ) -> parts.Scene:
        """Return the scene with one variant and `KEY=VALUE` overrides. Raise InputError
        with all problems.
        """
        report = Findings()
        edits = _edits(self._root, overrides, variant, self._source)
        edited_root = _apply_edits(self._root, edits)
        ground = _check(in_numbers(edited_root), report, self._files)
        # The slow search for causes runs only after a fault.
        if report.problems:
            raise InputError(self._at_causes(report, edits))
        scene = scene_from_tree(
            *_apply_consequences(edited_root, self._root, ground),
            scene_name(self.file),
            self._source,
            ground,
        )
        return replace(scene, files=tuple(self._stamps))

    def _at_causes(self, report: Findings, edits: Sequence[Edit]) -> list[Problem]:
        """Return the problems, each at the key of the overlay that caused it."""

        def check(root: Node) -> dict[Problem, None]:
            return _problems(root, self._files)

        own_problems = []
        for problem in report.problems:
            if problem in self._own.problems:
                own_problems.append(problem)
        new = []
        for problem in report.problems:
            if problem not in own_problems:
                new.append(problem)
        # A file without bases is itself the cause.
        if len(self._chain) > 1:
            own_problems = name_extending_keys(own_problems, self._chain, check)
        return [*own_problems, *name_edits(new, self._root, edits, check)]


def load(
    path: str | os.PathLike[str],
    overrides: Sequence[str] = (),
    variant: str | None = None,
    allow_outside: bool = False,
) -> parts.Scene:
    """Return the scene of a file with its bases, one variant and `KEY=VALUE` overrides.

    A faulty variant does not block the file and its other variants. Paths in the file
    must be below its folder unless `allow_outside`; see files.py. Raise InputError with
    all problems, sorted by place.
    """
    return OpenedScene(path, allow_outside).scene(overrides, variant)


def _edits(
    root: Node, overrides: Sequence[str], variant: str | None, source: Source
) -> list[Edit]:
    """Return the edits of a variant and of the overrides. Raise InputError with all
    malformed ones.
    """
    problems: list[Problem] = []
    edits: list[Edit] = []
    # Malformed variants are missing here; the schema reports them.
    variants = dict(variants_of(root))
    if variant in variants:
        edits += edits_of_variant(variants[variant], variant)
    elif variant is not None:
        problems.append(_unknown_variant(variant, list(variants)))
    for text in overrides:
        try:
            edits.append(edit_of_flag(text, source))
        except InputError as error:
            problems += error.problems
    if not problems:
        return edits
    try:
        # Also apply the valid edits, so that all faults appear in one message.
        _apply_edits(root, edits)
    except InputError as error:
        problems += error.problems
    raise InputError(dict.fromkeys(problems))


def _unknown_variant(variant: str, names: Sequence[str]) -> Problem:
    """Return the problem of `--variant`."""
    fix = "the file has no variants"
    if names:
        fix = one_of(variant, names)
    place = Place(f"--variant {quoted(variant, '')}")
    return Message.UNKNOWN_VARIANT.problem(place, "", quoted(variant), fix=fix)


def _apply_edits(root: Node, edits: Sequence[Edit]) -> Node:
    """Return the tree after the edits. Raise InputError with all impossible edits."""
    problems: list[Problem] = []
    left = Limit.SET.most
    for edit in edits:
        if edit.variant:
            left -= targets(root, edit) * _values(edit.value)
        # Stop at once: checking such a large tree would take minutes.
        if left < 0:
            raise edit.error(Limit.SET.refusal())
        try:
            root = apply(root, edit)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(dict.fromkeys(problems))
    return root


def _check(root: Node, report: Findings, files: Files) -> Ground:
    try:
        check_schema(root, report)
        return check_rules(root, report, files)
    except TooManyError:
        return Ground()


def _problems(root: Node, files: Files) -> dict[Problem, None]:
    """Return the problems of a tree."""
    report = Findings()
    _check(in_numbers(root), report, files)
    return report.problems


def _problems_of_variants(
    root: Node, own_findings: Findings, files: Files
) -> Iterator[Problem]:
    """Yield problems of each variant, without the problems `own_findings` of
    the file itself.
    """
    variants = list(variants_of(root))
    # So many faults of the file itself come first.
    if not variants or len(own_findings.problems) > 100:
        return
    edits = sum(1 + len(children(node)) for _, node in variants)
    # The work is the product of variants and values: both may be allowed alone.
    if edits * _values(root) > Limit.CHECKS.most:
        place = children(root)["variants"].key_place
        yield from Limit.CHECKS.error(place, "variants").problems
        return
    # Edits with wildcards multiply: count their targets before any tree is copied.
    count = 0
    left = Limit.SET.most
    for name, node in variants:
        edits_of_one = edits_of_variant(node, name)
        left -= sum(targets(root, edit) * _values(edit.value) for edit in edits_of_one)
        if left < 0:
            yield from (edits_of_one[-1].error(Limit.SET.refusal()).problems)
            return
        problems = _problems_of_variant(root, edits_of_one, own_findings, files)
        yield from problems
        count += len(problems)
        if count > MAX_PROBLEMS:
            return


def _problems_of_variant(
    root: Node, edits: Sequence[Edit], own_findings: Findings, files: Files
) -> list[Problem]:
    """Return the problems of one variant, without those of the file itself."""
    try:
        problems = _problems(_apply_edits(root, edits), files)
    except InputError as error:
        return error.problems
    new = []
    for problem in problems:
        if problem not in own_findings.problems:
            new.append(problem)
    return name_edits(new, root, edits, lambda tree: _problems(tree, files))


def _values(node: Node) -> int:
    """Return the number of values in a tree."""
    if isinstance(node.value, dict):
        return 1 + sum(map(_values, node.value.values()))
    return 1 + sum(map(_values, items(node)))


def scene_name(file: Path) -> str:
    """Return the file's stem, or its folder's name for a file `scene.yaml`."""
    if file.name == "scene.yaml":
        return Path(os.path.abspath(file)).parent.name
    return file.stem


def _apply_consequences(root: Node, file: Node, ground: Ground) -> tuple[Node, Record]:
    """Return the tree in numbers, with the consequences of changed labels and scale,
    and their record.

    Values of overrides, variants and other files than the perceived one stay unchanged.
    `file` is the tree before edits.
    """
    record, tree = ground.record, in_numbers(root)
    if not record.objects or ground.size is None:
        return tree, record
    # Only scenes with a photo need OpenCV.
    from physgen.scene.provenance import apply_consequences

    data = to_plain_data(tree)
    outlines: dict[str, Any] = {}
    for name, entry in data.get("objects", {}).items():
        shape = _known_shape(entry, ground)
        if shape is None:
            continue
        outline = parts.shape_outline(_shape(shape))
        if outline is not None:
            outlines[name] = outline
    values, record = apply_consequences(
        to_plain_data(root), with_defaults(data), record, outlines, ground.size
    )
    if not values:
        return tree, record
    # A value may lie inside the value of another one: set the outer one first.
    for path, value in sorted(values.items(), key=lambda item: len(item[0])):
        if _is_perceived_value(root, file, path):
            root = _with_value(root, path, value)
    return in_numbers(root), record


def _known_shape(entry: Mapping[str, Any], ground: Ground) -> Any:
    """Return the shape of an object, or that stored for its mask, or None."""
    if isinstance(entry.get("shape"), dict):
        return entry["shape"]
    if not isinstance(entry.get("mask"), int):
        return None
    stored_shapes = ground.outlines.get(entry["mask"])
    return stored_shapes[1] if stored_shapes else None


def _is_perceived_value(root: Node, file: Node, path: Sequence[str]) -> bool:
    """Return whether a value is absent or that of the perceived file.

    Only such values follow: an edit or another file states its value on purpose.
    """
    node = children(root, *path[:-1]).get(path[-1])
    if node is None:
        return True
    # The file with the key `assets` is the perceived one.
    if node.source != children(root)["assets"].source:
        return False
    # Trees share unchanged nodes: an edited value is another node.
    return node is children(file, *path[:-1]).get(path[-1])


def _with_value(root: Node, path: KeyPath, value: Any) -> Node:
    """Return the tree with a value at a path."""
    node = _find_node(root, path)
    new_value = value
    if isinstance(value, list):
        new_value = list(map(node.with_value, value))
    return apply(root, Edit(dotted(path), node.with_value(new_value), ()))


def _find_node(root: Node, path: KeyPath) -> Node:
    """Return the node at a path, or the nearest ancestor."""
    for key in path:
        root = children(root).get(str(key), root)
    return root
