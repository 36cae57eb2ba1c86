"""`edit`: a scene or a photo in the browser editor."""

from __future__ import annotations

import argparse
import json
import sys
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from physgen.cli.arguments import Command, Parser, whole
from physgen.cli.output import OK, Bar, print_error, print_line
from physgen.cli.perceive import add_backends
from physgen.problems import InputError

NEEDED = ("fastapi", "filelock", "uvicorn")
SCENES = (".yaml", ".yml", ".physgen")


def edit(options: argparse.Namespace) -> int:
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise InputError.of(
            "physgen edit",
            "",
            f"needs {' and '.join(missing)}, not installed here",
            'pip install "physgen[edit]"',
        )
    if options.output.exists() and not options.output.is_dir():
        raise InputError.of(str(options.output), "", "is a file", "name a folder with -o")
    scene = _scene(options)
    from physgen.edit.app import Editor
    from physgen.edit.draft import BusyError

    try:
        editor = Editor(scene, options.host, options.port, options.allow_outside, options.output)
    except BusyError as busy:
        print_error(f"{scene}: is open in an editor already, at this address")
        _print_address(options, scene, busy.address)
        return OK
    try:
        if editor.session.recovered:
            print_error(f"{scene}: goes on where the editor ended before it was saved")
        if options.host not in ("127.0.0.1", "::1", "localhost"):
            print_error(
                f"--host {options.host}: whoever reaches this machine and has the address, which holds a token, "
                "can edit the scene, see its photo and render; requests without the token are refused"
            )
        _print_address(options, scene, editor.address)
        if options.browser:
            import threading
            import webbrowser

            threading.Thread(target=webbrowser.open, args=(editor.once(),), daemon=True).start()
        if sys.stderr.isatty():
            print_error("Ctrl-C ends it")
        with suppress(KeyboardInterrupt):
            editor.run()
    finally:
        kept = editor.close()
    if kept is not None:
        print_error(
            f"{scene}: not saved; what was edited is kept in {kept.name}, and the next physgen edit goes on there"
        )
    return OK


def _scene(options: argparse.Namespace) -> Path:
    """The scene, or the one that is perceived of a photo."""
    path: Path = options.scene
    if not path.is_file() or path.suffix.lower() in SCENES:
        return path
    scene = path.with_name(f"{path.stem}.yaml")
    if scene.exists():
        print_error(f"{scene}: is there already and is opened; move it away to start again")
        return scene
    from physgen import pipeline
    from physgen.cli.output import print_backup, print_problem
    from physgen.cli.perceive import crew_of

    bar = Bar()
    crew = crew_of(options)
    pipeline.perceive(path, scene, crew=crew, progress=bar.show, warn=print_problem, keep=print_backup)
    bar.clear()
    return scene


def _print_address(options: argparse.Namespace, scene: Path, address: str) -> None:
    print_line(json.dumps({"scene": str(scene), "address": address}) if options.json else address)


def add(parser: Parser) -> None:
    about = (
        "a scene file; or a photo, which is perceived first into a scene of its name beside it. A scene that is there "
        "already is opened"
    )
    parser.add_argument("scene", metavar="SCENE or PHOTO", type=Path, help=about)
    about = "folder of what is rendered from the page; default: out"
    parser.option("-o --output", "DIR", Path, about, Path("out"))
    parser.option("--port", "N", whole(0, 65535), "port to listen at; default: a free one")
    about = "name or address to listen at; default: 127.0.0.1, which only this machine can reach"
    parser.option("--host", "HOST", str, about, "127.0.0.1")
    parser.flag("--no-browser", "only print the address")
    parser.flag("--allow-outside", "let the scene read files outside its folder")
    parser.flag("--json", "print the address as a line of JSON")
    add_backends(parser)


EDIT = Command(
    "edit",
    "Opens a scene or a photo in the browser: push objects and watch; see docs/editor.md.",
    "physgen edit scene.yaml",
    add,
    edit,
)
