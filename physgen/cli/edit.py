"""Run `edit`: open a scene or photo in the browser editor. `rename`, `merge` and
`remove` edit a file directly.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import physgen.edit
import physgen.scene
from physgen import pipeline
from physgen.cli.arguments import Command, Parser, check_folder_name, integer_reader
from physgen.cli.output import (
    OK,
    Bar,
    print_backup,
    print_error,
    print_line,
    print_problem,
)
from physgen.cli.perceive import BEGIN, add_backends, crew_of
from physgen.files import check_writable, install
from physgen.messages import Message, Note
from physgen.problems import EditError, InputError, Place, RefusedError
from physgen.text import quoted

if TYPE_CHECKING:
    from physgen.scene.load import OpenedScene
    from physgen.scene.scene import Scene

NEEDED = ("fastapi", "filelock", "uvicorn")
SCENES = (".yaml", ".yml", ".physgen")
LOOPBACK = ("127.0.0.1", "::1", "localhost")


def edit(options: argparse.Namespace) -> int:
    # Check all conditions before the editor opens the scene, because it locks the scene
    # for other editors.
    if missing_packages := [name for name in NEEDED if find_spec(name) is None]:
        raise Message.EDITOR_PACKAGES_MISSING.error(
            "physgen edit",
            packages=" and ".join(missing_packages),
            install=install("edit"),
        )
    check_folder_name(options.output)
    check_writable(options.output)
    # An empty host would listen on all networks.
    host = options.host.strip() or LOOPBACK[0]
    scene, is_new = _scene(options)

    try:
        editor = physgen.edit.app.Editor(
            scene, host, options.port, options.allow_outside, options.output
        )
    except physgen.edit.draft.BusyError as busy:
        print_error(f"{scene}: is open in an editor already, at this address")
        _print_address(options, scene, busy.address)
        return OK
    editor.session.is_new = is_new
    try:
        if editor.session.recovered:
            print_error(f"{scene}: goes on where the editor ended before it was saved")
        if host not in LOOPBACK:
            print_error(
                f"--host {host}: exposes the scene, its photo and renders to whoever reaches this machine and "
                "has the token in the address, which is not encrypted; requests without it are refused"
            )
        _print_address(options, scene, editor.address)
        # The browser starts in a thread: it may block until its window opens.
        if options.browser:
            import webbrowser

            threading.Thread(
                target=webbrowser.open, args=(editor.new_page_key(),), daemon=True
            ).start()
        if sys.stderr.isatty():
            print_error("Ctrl-C ends it")
        with suppress(KeyboardInterrupt):
            editor.run()
    finally:
        kept_files = editor.close()
    if kept_files is not None:
        print_error(
            f"{scene}: not saved; what was edited is kept in {kept_files.name}, and the next physgen edit goes on there"
        )
    return OK


def _edit_objects(path: Path, options: argparse.Namespace) -> Any:
    """Return the result of the edit. Raise InputError if it is impossible."""
    text = path.read_bytes().decode("utf-8-sig")
    names = list(options.objects)
    ops: list[dict[str, Any]] = []
    if options.command == "rename":
        new_name = getattr(options, "to", "")
        ops.append({"rename": ["objects", names[0]], "to": new_name})
    if options.command == "remove":
        ops = [{"remove": ["objects", name]} for name in dict.fromkeys(names)]
    try:
        if options.command == "merge":
            return physgen.edit.corrections.correct(
                physgen.edit.live.Live(path), text, {"kind": "merge", "objects": names}
            )
        return physgen.edit.operations.apply_operations(text, ops)
    except EditError as error:
        refusal = RefusedError(error.message, error.fix, error.code)
        raise InputError([refusal.problem(Place(str(path)))]) from None


def _check_edited(before: OpenedScene, after: OpenedScene) -> None:
    """Read the new text before it is saved. Raise InputError for new problems.

    An edit must not break a scene that was valid. Variants with older faults do not
    block the edit.
    """
    after.scene()
    failed_variants = {problem.variant for problem in before.variant_problems}
    new_problems = []
    for problem in after.variant_problems:
        if problem.variant not in failed_variants:
            new_problems.append(problem)
    if new_problems:
        raise InputError(new_problems)


def edit_file(options: argparse.Namespace) -> int:
    """Apply one edit of objects. All other lines and the comments stay."""
    path: Path = options.scene
    words = list(options.objects)
    if "to" in options:
        words.append(options.to)
    _refuse_scene_behind(options.command, path, words)
    # A scene with faults is refused before any change of its file.
    before = physgen.scene.load.OpenedScene(path, options.allow_outside)
    scene = before.scene()
    check_writable(path.resolve().parent)
    _refuse_other_names(scene, path, options.objects)
    _check_names(scene, path, options)
    correction = _edit_objects(path, options)
    # The edited text is validated before the file is replaced.
    _check_edited(
        before,
        physgen.scene.load.OpenedScene(path, options.allow_outside, correction.text),
    )
    folder = getattr(correction, "folder", None)
    if folder is not None and scene.assets is not None:
        physgen.scene.saving.note_copies(scene.assets, folder)
    # The file behind a link is replaced, and the link stays.
    physgen.scene.saving.save_scene(
        path.resolve(),
        correction.text.encode("utf-8"),
        lambda kept: print_error(
            Note.EDITED.text(edit=_past_tense(correction.title), backup=kept.name)
        ),
    )
    print_line(str(path))
    return OK


def _check_names(scene: Scene, path: Path, options: argparse.Namespace) -> None:
    """Raise InputError for unknown objects, and for a merge that cannot be made."""
    names = list(options.objects)
    is_merge = options.command == "merge"
    # A merge can add doubtful regions to an object.
    doubtful_names = set(scene.document.get("doubtful") or {}) if is_merge else set()
    for name in names:
        if name not in doubtful_names:
            pipeline.pushes.find_object(scene, str(path), name)
    if not is_merge:
        return
    if len(names) < 2:
        raise Message.MERGE_NEEDS_TWO.error(
            str(path), quoted(names[0]), path=path, name=names[0]
        )
    if names[0] in doubtful_names:
        _refuse_doubtful_first(scene, path, names)


def _past_tense(edit: str) -> str:
    """Return an edit's name as a report: `rename a to b` becomes `renamed a to b`."""
    verb, _, rest = edit.partition(" ")
    return f"{verb.removesuffix('e')}ed {rest}"


def _refuse_scene_behind(command: str, path: Path, words: Sequence[str]) -> None:
    """Raise InputError if the scene comes after the names."""
    files = []
    for text in words:
        if Path(text).suffix.lower() in SCENES and Path(text).is_file():
            files.append(text)
    if path.exists() or len(files) != 1:
        return
    names = [str(path), *(text for text in words if text not in files)]
    raise Message.SCENE_NOT_FIRST.error(
        str(path), command=command, arguments=" ".join([*files, *names])
    )


def _refuse_doubtful_first(scene: Scene, path: Path, names: Sequence[str]) -> None:
    """Raise InputError for a merge into a doubtful region."""
    objects = []
    for name in names:
        if name in {item.name for item in scene.objects}:
            objects.append(name)
    fix = "name the object first that the region belongs to"
    if objects:
        others = []
        for name in names:
            if name != objects[0]:
                others.append(name)
        fix = f"write {' '.join([objects[0], *others])}"
    raise Message.DOUBTFUL_FIRST.error(str(path), quoted(names[0]), fix=fix)


def _refuse_other_names(scene: Scene, path: Path, names: Sequence[str]) -> None:
    """Raise InputError for several names in one argument, and for names of other parts
    of the scene.
    """
    objects = {item.name for item in scene.objects}
    kinds: dict[str, str] = {}
    parts_of_scene = (
        ("boundary", scene.boundaries),
        ("joint", scene.joints),
        ("field", scene.fields),
    )
    for kind, items in parts_of_scene:
        kinds |= {item.name: kind for item in items}
    for name in names:
        if name in objects:
            continue
        # A list with commas is a common mistake for several arguments.
        parts = list(filter(None, re.split(r"[,;\s]+", name)))
        if len(parts) > 1 and objects.issuperset(parts):
            raise Message.SEVERAL_NAMES_IN_ONE.error(
                str(path), quoted(name), parts=" ".join(parts)
            )
        if name in kinds:
            raise Message.NAME_OF_ANOTHER_KIND.error(
                str(path), quoted(name), kind=kinds[name]
            )


def _scene(options: argparse.Namespace) -> tuple[Path, bool]:
    """Return the scene, and whether its photo was perceived just now."""
    path: Path = options.scene
    if not path.is_file() or path.suffix.lower() in SCENES:
        return path, False
    # An existing scene may contain the work of a user.
    scene = path.with_name(f"{path.stem}.yaml")
    if scene.exists():
        print_error(
            f"{scene}: is there already and is opened; move it away to start again"
        )
        return scene, False
    bar = Bar()
    with bar.ticking():
        bar.show(BEGIN, 0, 1)

        check_writable(scene.parent)
        pipeline.perceive(
            path,
            scene,
            crew=crew_of(options),
            progress=bar.show,
            warn=bar.aside(print_problem),
            keep=bar.aside(print_backup),
            inform=bar.aside(print_error),
        )
    return scene, True


def _print_address(options: argparse.Namespace, scene: Path, address: str) -> None:
    print_line(
        json.dumps({"scene": str(scene), "address": address})
        if options.json
        else address
    )


def add(parser: Parser) -> None:
    help_text = (
        "a scene file; or a photo, which is perceived first into a scene of its name beside it. A scene that is there "
        "already is opened"
    )
    parser.add_argument("scene", metavar="SCENE or PHOTO", type=Path, help=help_text)
    help_text = "folder of what is rendered from the page; default: out"
    parser.option("-o --output", "DIR", Path, help_text, Path("out"))
    parser.option(
        "--port",
        "N",
        integer_reader(0, 65535),
        "port to listen at; default: a free one",
    )
    help_text = "name or address to listen at; default: 127.0.0.1, which only this machine can reach"
    parser.option("--host", "HOST", str, help_text, LOOPBACK[0])
    parser.flag("--no-browser", "only print the address")
    parser.flag("--allow-outside", "let the scene read files outside its folder")
    parser.flag("--json", "print the address as a line of JSON")
    add_backends(parser)


def _add_file_edit(extra: Sequence[str], parser: Parser) -> None:
    parser.add_argument(
        "scene", metavar="SCENE", type=Path, help="the file, which is changed"
    )
    verb = parser.prog.split()[-1]
    count: Any = {"merge": "+", "remove": "+"}.get(verb, 1)
    help_text = "an object"
    if verb == "merge":
        help_text = "the object that remains, then objects and doubtful regions"
    parser.add_argument("objects", metavar="NAME", nargs=count, help=help_text)
    if "to" in extra:
        parser.add_argument("to", metavar="NEW", help="its new name")
    parser.flag("--allow-outside", "let the scene read files outside its folder")


FILE_EDITS = tuple(
    Command(
        name,
        about,
        f"physgen {name} scene.yaml {example}",
        partial(_add_file_edit, extra),
        edit_file,
    )
    for name, about, example, extra in (
        (
            "rename",
            "Renames an object, wherever the scene names it.",
            "ball-1 cue-ball",
            ["to"],
        ),
        (
            "merge",
            "Makes one object of several, under the name of the first; others may be doubtful regions.",
            "mug-1 handle-1 maybe-2",
            [],
        ),
        ("remove", "Removes objects from a scene and from the picture.", "ball-2", []),
    )
)
EDIT = Command(
    "edit",
    "Opens a scene or a photo in the browser: push objects and watch; see docs/editor.md.",
    "physgen edit scene.yaml",
    add,
    edit,
)
