"""Keep physgen's comments in a scene file true after changes of values."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any

from physgen.problems import EditError
from physgen.scene.yaml_edit import (
    apply_patches,
    entry,
    leads,
    line_begin,
    line_end,
    mark_values,
    newline,
    parent_of,
)
from physgen.text import KeyPath, listed

LONGEST = 116
"""Maximum number of columns of a line with a comment after its value."""
DEEP = {"objects": 3, "world": 2, "boundaries": 2, "render": 1}
"""Number of keys in a path to a value with a comment of perception, by section."""


def without_comments(
    text: str, paths: Sequence[Sequence[str | int]], own_comments: Collection[str]
) -> str:
    """Return the text without the comments in `own_comments` after or above the values at
    `paths`, which a user has set. Other comments stay.
    """
    for path in paths:
        if depth := DEEP.get(str(path[0]), 0):
            text = _without_comment(text, tuple(path[:depth]), own_comments)
    return text


def with_comments(
    text: str,
    comments: Mapping[str, str],
    own_comments: Collection[str],
    new: Collection[str],
) -> str:
    """Return the text with comments at dotted keys, after short values and above
    others. They replace comments in `own_comments`; without one, only keys in `new` get a
    comment.
    """
    for key, comment in comments.items():
        try:
            parent, index = parent_of(text, tuple(key.split(".")))
        except EditError:
            continue
        begin = entry(text, parent, index)
        words = " ".join(comment.split())
        # A comment in a line of several values could belong to any of them.
        if parent.is_flow or not leads(text, begin):
            continue
        present_comments = set(dict(_comments(text, begin)).values())
        if words in present_comments:
            continue
        has_own = any(
            _is_own_comment(present, own_comments) for present in present_comments
        )
        if key in new or has_own:
            text = without_comments(text, [key.split(".")], own_comments)
            text = _insert_comment(text, key, words)
    return text


def _insert_comment(text: str, key: str, words: str) -> str:
    """Return the text with a comment after the value of a key, or above its line."""
    parent, index = parent_of(text, tuple(key.split(".")))
    begin = entry(text, parent, index)
    first = line_begin(text, begin)
    stop = line_end(text, begin)
    # A user's own comment on the line stays alone there.
    is_short = stop - first + len(words) <= LONGEST and "#" not in text[first:stop]
    child = parent.children[index]
    # A block begins below its key, so that the line of the key has room for a comment.
    if is_short and (child.end <= stop or not (child.is_flow or child.kind is str)):
        return apply_patches(text, (stop, stop, f"  # {words}"))
    line = f"{text[first:begin]}# {words}{newline(text)}"
    return apply_patches(text, (first, first, line))


_COUNTS = re.compile(
    r"\d+ x .+?(, (?:where you pointed|from the masks given|found by [^,]+"
    r"|as the scene had them(?:, and where you pointed)?)"
    r", counted from left to right(?:; \d+ specks of under \d+ px left out)?)"
)
"""Perception's comment on all objects: 2 x ball, 1 x block, found by ..."""

_SUPPORTED = re.compile(r"under \d+ objects?")
"""Perception's comment on a boundary."""

_HIDING = "in front: it hides parts of "
"""Start of perception's comment on a layer, before the names of objects."""

_HIDDEN = re.compile(_HIDING + r"([\w-]+(?:, [\w-]+)*(?: and [\w-]+)?)")


def with_true_comments(
    text: str, old: Mapping[str, Any], new_names: Mapping[str, str]
) -> str:
    """Update or remove comments of perception after objects were added, removed or
    changed.

    `old` is the data before the change; `new_names` maps old to new names of objects.
    """
    labels = _labels(mark_values(text).data())
    labels_before = _labels(old)
    # Most edits do not change labels.
    if labels == labels_before:
        return text
    counts = _label_counts(labels)
    if counts != _label_counts(labels_before):
        text = _with_comment(
            text, ("objects",), lambda words: _count_objects(words, counts)
        )
    if len(labels) != len(labels_before):
        for name in old.get("boundaries") or {}:
            text = _with_comment(text, ("boundaries", str(name)), _without_support)
    if _HIDING not in text:
        return text
    for name in labels:
        text = _with_comment(
            text,
            ("objects", name, "layer"),
            lambda words: _hidden_names(words, labels, new_names),
        )
    return text


def _is_own_comment(words: str, own_comments: Collection[str]) -> bool:
    """Return whether perception wrote a comment, or an edit updated it."""
    is_updated = _HIDDEN.fullmatch(words) or _COUNTS.fullmatch(words)
    return words in own_comments or is_updated is not None


def _labels(data: Mapping[str, Any]) -> dict[str, str]:
    """Return the labels of objects by name."""
    labels: dict[str, str] = {}
    objects = data.get("objects")
    for name, item in objects.items() if isinstance(objects, dict) else ():
        if isinstance(item, dict):
            label = item.get("label")
        else:
            label = None
        labels[name] = str(label or "object")
    return labels


def _label_counts(labels: Mapping[str, str]) -> str:
    """Return the number of objects of each label: 2 x ball, 1 x block."""
    counts = Counter(labels.values())
    ordered_counts = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{number} x {label}" for label, number in ordered_counts)


def _count_objects(words: str, counts: str) -> str:
    """Return perception's comment on all objects with new counts."""
    match = _COUNTS.fullmatch(words)
    if match is None:
        return words
    if counts:
        return counts + match[1]
    return ""


def _without_support(words: str) -> str:
    """Return a comment on a boundary, or "" if it counts the objects on it."""
    if _SUPPORTED.fullmatch(words):
        return ""
    return words


def _hidden_names(
    words: str, names: Collection[str], new_name_of: Mapping[str, str]
) -> str:
    """Return a comment on a layer with the current names of hidden objects."""
    match = _HIDDEN.fullmatch(words)
    if match is None:
        return words
    before = re.split(", | and ", match[1])
    new_names = [new_name_of.get(name, name) for name in before]
    hidden_names = []
    for name in new_names:
        if name in names:
            hidden_names.append(name)
    if hidden_names:
        return _HIDING + listed(hidden_names, "and")
    return ""


def _with_comment(text: str, path: KeyPath, change: Callable[[str], str]) -> str:
    """Change the words of the comments after and above a key. "" removes a comment."""
    try:
        parent, index = parent_of(text, path)
    except EditError:
        return text
    begin = entry(text, parent, index)
    if parent.is_flow or not leads(text, begin):
        return text
    for line, words in _comments(text, begin):
        new = change(words)
        if new != words:
            text = _with_words(text, line, new)
    return text


def _with_words(text: str, number: int, words: str) -> str:
    """Replace the words of the comment in a line, or remove the comment."""
    lines = text.split("\n")
    line = lines[number]
    end = ""
    if line.endswith("\r"):
        end = "\r"
    is_whole = line.lstrip().startswith("#")
    if is_whole and not words:
        del lines[number]
        return "\n".join(lines)
    # A comment after a value begins at the last mark on its line.
    before = line[: line.index("#")] if is_whole else line.rpartition(" #")[0] + " "
    lines[number] = (before + f"# {words}" if words else before.rstrip()) + end
    return "\n".join(lines)


def _comments(text: str, place: int) -> Iterator[tuple[int, str]]:
    """Yield the index and words of the comment at the end of a place's line, and of the
    comment lines above it.
    """
    lines = text.split("\n")
    line_number = text.count("\n", 0, place)
    _, mark, words = lines[line_number].rpartition(" #")
    if mark:
        yield line_number, " ".join(words.split())
    while line_number and lines[line_number - 1].lstrip().startswith("#"):
        line_number -= 1
        yield line_number, " ".join(lines[line_number].lstrip(" #").split())


def _without_comment(text: str, path: KeyPath, own_comments: Collection[str]) -> str:
    try:
        parent, index = parent_of(text, path)
    except EditError:
        return text
    begin = entry(text, parent, index)
    if parent.is_flow or not leads(text, begin):
        return text
    lines = text.split("\n")
    for line, words in _comments(text, begin):
        if _is_own_comment(words, own_comments) and lines[line].lstrip().startswith(
            "#"
        ):
            # A comment alone on its line takes the line with it.
            del lines[line]
        elif _is_own_comment(words, own_comments):
            # A comment behind a value leaves the value, and the carriage return of a
            # line that ends with one.
            lines[line] = lines[line].rpartition(" #")[0].rstrip() + "\r" * lines[
                line
            ].endswith("\r")
    return "\n".join(lines)
