"""Where an edit is written: the file itself, an overlay of the file it extends, or a variant."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, Protocol

from physgen.edit import yaml_edit
from physgen.edit.errors import impossible
from physgen.edit.yaml_tree import marked, same
from physgen.problems import InputError
from physgen.scene.document import Node, Source, plain, read
from physgen.scene.files import with_bases
from physgen.scene.overlay import Edit, apply, kind_of, merge, parse_key, rivals
from physgen.text import KeyPath, dotted

Data = dict[str, Any]
_NOBODY = Source("", Path())


class Target(Protocol):
    """One of the two."""

    @property
    def text(self) -> str:
        """Of the whole file."""
        ...

    def data(self) -> Data:
        """The scene as it is seen, without defaults."""
        ...

    def put(self, path: KeyPath, value: Any) -> None:
        """The value at a path. Raises EditError."""
        ...

    def unset(self, path: KeyPath) -> None:
        """As if nobody had said it here. Raises EditError."""
        ...

    def gone(self, path: KeyPath) -> None:
        """Nothing is at the path. Raises EditError."""
        ...

    def append(self, path: KeyPath, value: Any) -> None:
        """The value behind the items of a list. Raises EditError."""
        ...


class InFile:
    """Into the text of the file; where the file `extends` another, as an overlay of that."""

    def __init__(self, text: str, file: Path, allow_outside: bool) -> None:
        self.text = text
        """Of the whole file."""
        self._base = _inherited(text, file, allow_outside)

    def data(self) -> Data:
        """The scene as it is seen."""
        own: Data = marked(self.text).data()
        if self._base is None:
            return own
        whole: Data = plain(merge(noded(self._base), noded(own)))
        whole.pop("extends", None)
        return whole

    def inherits(self, path: KeyPath) -> bool:
        """Whether the value at a path comes from another file, in whole or in part."""
        return self._base is not None and reach(self._base, path) is not ABSENT

    def put(self, path: KeyPath, value: Any) -> None:
        """The value at a path."""
        self.text = yaml_edit.put(self.text, *self._written(path, value))
        for rival in rivals(kind_of(path[:-1])).get(str(path[-1]), ()):
            if reach(marked(self.text).data(), (*path[:-1], rival)) is not ABSENT:
                self.text = yaml_edit.drop(self.text, (*path[:-1], rival))

    def unset(self, path: KeyPath) -> None:
        """As if nobody had said it here."""
        self.gone(path)

    def gone(self, path: KeyPath) -> None:
        """Nothing is at the path."""
        own = marked(self.text).data()
        inherited = self._base is not None and reach(self.data(), path) is not ABSENT
        if isinstance(path[-1], int) and reach(own, path[:-1]) is ABSENT and inherited:
            items = reach(self.data(), path[:-1])
            self.put(path[:-1], [item for at, item in enumerate(items) if at != path[-1]])
        elif inherited and self.inherits(path) and not isinstance(path[-1], int):
            self.text = yaml_edit.put(self.text, path, None)
        elif reach(own, path) is not ABSENT:
            self.text = yaml_edit.drop(self.text, path)

    def append(self, path: KeyPath, value: Any) -> None:
        """The value behind the items of a list."""
        items = reach(marked(self.text).data(), path)
        if isinstance(items, list) and items:
            self.text = yaml_edit.append(self.text, path, value)
        else:
            seen = reach(self.data(), path)
            self.put(path, [*(seen if isinstance(seen, list) else []), value])

    def rename(self, path: KeyPath, to: str) -> None:
        """Another name for a key of this file. Raises EditError."""
        if self.inherits(path):
            raise impossible(f"{dotted(path)} comes from the file that this one extends", "rename it there")
        self.text = yaml_edit.rename(self.text, path, to)

    def _written(self, path: KeyPath, value: Any) -> tuple[KeyPath, Any]:
        """What to write where: a list that is inherited is written out, as overlays replace lists whole."""
        if self._base is None:
            return path, value
        own = marked(self.text).data()
        for depth, step in enumerate(path):
            above = path[:depth]
            if isinstance(step, int) and reach(own, above) is ABSENT and self.inherits(above):
                items = deepcopy(reach(self._base, above))
                holder = reach(items, path[depth:-1])
                if holder is ABSENT or (isinstance(holder, list) and not _fits(holder, path[-1])):
                    raise impossible(f"{dotted(path)} is not there", "set the whole list")
                holder[path[-1]] = value
                return above, items
        under = reach(self._base, path)
        return path, _over(value, under) if isinstance(under, dict) else value


class InVariant:
    """Into one of the file's variants."""

    def __init__(self, within: InFile, name: str) -> None:
        self._file, self._name = within, name
        if not isinstance(reach(within.data(), ("variants", name)), dict):
            raise impossible(f"there is no variant {name[:64]}", "make it first, or edit the file itself")

    @property
    def text(self) -> str:
        """Of the whole file."""
        return self._file.text

    def data(self) -> Data:
        """The scene as it is seen."""
        whole = self._file.data()
        edits = whole["variants"][self._name]
        root = noded(whole)
        for key, value in edits.items():
            try:
                root = apply(root, Edit(key, noded(value), ()))
            except InputError:
                continue  # told of as a problem of the variant
        seen: Data = plain(root)
        return seen

    def put(self, path: KeyPath, value: Any) -> None:
        """The value at a path."""
        key = self._key(path)
        holder = self._holder(path)
        if holder is not None:
            inner = path[len(parse_key(holder) or ()) :]
            self._file.put(("variants", self._name, holder, *inner), value)
            kind = rivals(kind_of(path[:-1])).get(str(path[-1]), ())
            for rival in kind:
                self._file.gone(("variants", self._name, holder, *inner[:-1], rival))
        else:
            self._forget(path, but=key)
            self._file.put(("variants", self._name, key), value)
        if not same(reach(self.data(), path), value):  # a later key says otherwise: be the last
            self._forget(path, but=None)
            self._file.put(("variants", self._name, key), value)
        if not same(reach(self.data(), path), value):
            raise impossible(
                f"variant {self._name} cannot say that of {dotted(path)}", "edit the file itself"
            )

    def unset(self, path: KeyPath) -> None:
        """As if nobody had said it here."""
        before = self.text
        if isinstance(path[-1], int):
            self._shorten(path)
            return
        self._forget(path, but=None)
        holder = self._holder(path)
        if holder is not None:
            inner = path[len(parse_key(holder) or ()) :]
            self._file.gone(("variants", self._name, holder, *inner))
        if self.text == before and reach(self.data(), path) is not ABSENT:
            self._file.put(("variants", self._name, self._key(path)), None)

    def gone(self, path: KeyPath) -> None:
        """Nothing is at the path."""
        self.unset(path)
        if not isinstance(path[-1], int) and reach(self.data(), path) is not ABSENT:
            self._file.put(("variants", self._name, self._key(path)), None)

    def append(self, path: KeyPath, value: Any) -> None:
        """The value behind the items of a list."""
        seen = reach(self.data(), path)
        self.put(path, [*(seen if isinstance(seen, list) else []), value])

    def _shorten(self, path: KeyPath) -> None:
        items = reach(self.data(), path[:-1])
        if isinstance(items, list):
            self.put(path[:-1], [item for at, item in enumerate(items) if at != path[-1]])

    def _key(self, path: KeyPath) -> str:
        key = dotted(path)
        if path[0] in ("variants", "extends") or parse_key(key) != path:
            raise impossible(f"a variant cannot say anything of {key[:80]}", "edit the file itself")
        return key

    def _edits(self) -> Sequence[str]:
        return list(self._file.data()["variants"][self._name])

    def _holder(self, path: KeyPath) -> str | None:
        """The last key that sets a mapping or a list in which the path lies."""
        found = None
        edits = self._file.data()["variants"][self._name]
        for key, value in edits.items():
            above = parse_key(key) or ()
            if 0 < len(above) < len(path) and path[: len(above)] == above and isinstance(value, dict | list):
                found = key
        return found

    def _forget(self, path: KeyPath, but: str | None) -> None:
        """Without the keys that set the path or what is in it."""
        for key in self._edits():
            if key != but and (parse_key(key) or ())[: len(path)] == path:
                self._file.gone(("variants", self._name, key))


class _Absent:
    """No value, which null would be."""


ABSENT = _Absent()


def reach(data: Any, path: KeyPath) -> Any:
    """What is at a path of plain data; ABSENT where nothing is."""
    for key in path:
        held = isinstance(data, dict) or (isinstance(data, list) and isinstance(key, int) and key >= 0)
        try:
            data = data[key] if held else None
        except (KeyError, IndexError):
            held = False
        if not held:
            return ABSENT
    return data


def noded(data: Any) -> Node:
    """Plain data as a tree."""
    if isinstance(data, dict):
        return Node({key: noded(child) for key, child in data.items()}, _NOBODY)
    if isinstance(data, list):
        return Node([noded(child) for child in data], _NOBODY)
    return Node(data, _NOBODY)


def _over(value: Any, under: Any) -> Any:
    """What to write over a mapping that is inherited so that the value comes of it: null takes a key away."""
    if not isinstance(value, dict) or not isinstance(under, dict):
        return value
    made = {key: _over(child, under.get(key)) for key, child in value.items()}
    return made | {key: None for key in under if key not in value}


def _fits(holder: list[Any], at: object) -> bool:
    return isinstance(at, int) and 0 <= at < len(holder)


def _inherited(text: str, file: Path, allow_outside: bool) -> Data | None:
    """What the file starts from; None where that is nothing."""
    if marked(text).child("extends") is None:
        return None
    root = read(text, Source(str(file), file.absolute().parent))
    assert isinstance(root.value, dict)
    try:
        base: Data = plain(
            with_bases(root.with_value({"extends": root.value["extends"]}), file, allow_outside)
        )
    except InputError:  # told of as a problem of the file
        return {}
    return base
