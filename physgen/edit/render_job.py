"""`physgen render` in a process of its own: start, progress, stop and results.

The process runs the command of the terminal, so that both create the same files.
"""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from secrets import token_hex
from threading import Lock, Thread
from typing import Any

from physgen.export.video_formats import Format
from physgen.messages import Message
from physgen.operating_system import separate_session, stop_process
from physgen.problems import EditError, EditRefusal

Data = dict[str, Any]

MAX_LINES = 50
"""Number of stored lines of output."""
STOP_PATIENCE = 10.0
"""Time after a stop, s, for the run to end cleanly."""
STAGES = {
    "compile": "reading the scene",
    "simulate": "simulating",
    "render": "drawing frames",
    "refine": "retouching frames",
}
"""Words for the stages in the progress of the command."""
VIDEOS = ("video.mp4", "video.webp", "video.gif")
IDLE: Data = {
    "job": None,
    "state": "idle",
    "running": False,
    "stage": "",
    "done": 0,
    "total": 0,
    "lines": [],
    "error": None,
    "result": None,
    "command": "",
}


class RenderJob:
    """Renders one scene file into one folder, one run at a time; its methods are
    thread-safe.
    """

    def __init__(self, path: Path, output: Path, allow_outside: bool = False) -> None:
        self.path = path
        self.output = output
        self.allow_outside = allow_outside
        self._lock = Lock()
        self._process: subprocess.Popen[str] | None = None
        self._thread: Thread | None = None
        self._stopped = False
        self._status: Data = {**IDLE}

    def status(self) -> Data:
        """Return the state and the progress of the run.

        `state` is idle, running, done, stopped or failed; `done` of `total` counts
        steps of the stage.
        """
        with self._lock:
            return {**self._status, "lines": list(self._status["lines"])}

    def command(
        self, variant: str | None = None, format: str = "mp4", refine: bool = True
    ) -> str:
        """Return the command line to render the same clip, quoted for a shell."""
        return shlex.join(["physgen", *self._arguments(variant, format, refine)])

    def file(self, name: str) -> Path | None:
        """Return a result file of this run by its path below the output folder.

        None if no such file exists.
        """
        folders = [row["folder"] for row in self.status()["result"] or ()]
        try:
            # Links are resolved, so that no name leads out of the folders of this run.
            path = (self.output / name).resolve()
            root = self.output.resolve()
            is_inside = any(
                path.is_relative_to((root / folder).resolve()) for folder in folders
            )
            if is_inside and path.is_relative_to(root) and path.is_file():
                return path
            return None
        except (OSError, ValueError):
            return None

    def start(
        self,
        variants: Sequence[str | None] | None = None,
        format: str = "mp4",
        refine: bool = True,
    ) -> str:
        """Start a run and return the job's name. Raises EditError.

        `variants` None stands for the file itself.
        """
        variant_names: list[str | None] = [None]
        if variants is not None:
            variant_names = list(dict.fromkeys(variants))
        if not variant_names:
            raise Message.NO_VARIANT_CHOSEN.impossible()
        if not set(format.split(",")) <= {
            video_format.value for video_format in Format
        }:
            raise Message.UNKNOWN_VIDEO_FORMAT.impossible()
        # Build all commands before the lock: an invalid setting must not disturb a run.
        commands = []
        for variant in variant_names:
            commands.append(self._arguments(variant, format, refine))
        with self._lock:
            if self._status["running"]:
                raise EditError(
                    EditRefusal.STALE, "a run is under way", "wait for it, or stop it"
                )
            self._stopped = False
            job = token_hex(8)
            self._status = {
                **IDLE,
                "job": job,
                "state": "running",
                "running": True,
                "stage": "starting",
                "command": " && ".join(
                    shlex.join(["physgen", *command]) for command in commands
                ),
            }
            # The runs take minutes: a thread waits for them, so that the request
            # returns at once.
            self._thread = Thread(
                target=self._run, args=(commands, variant_names), daemon=True
            )
            self._thread.start()
        return job

    def stop(self) -> None:
        """Stop the run without half-written files; returns once the process has
        ended.
        """
        with self._lock:
            self._stopped = self._status["running"]
            process = self._process
            thread = self._thread
        if process is not None:
            stop_process(process)
            try:
                process.wait(STOP_PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
        if thread is not None:
            thread.join(STOP_PATIENCE)

    def _arguments(self, variant: str | None, format: str, refine: bool) -> list[str]:
        """Return the arguments of the command; defaults are left out."""
        arguments = ["render", str(self.path), "-o", str(self.output)]
        arguments += [] if variant is None else ["--variant", variant]
        arguments += [] if format == "mp4" else ["--format", format]
        arguments += [] if refine else ["--refine", "none"]
        arguments += ["--allow-outside"] if self.allow_outside else []
        return arguments

    def _run(
        self, commands: Sequence[Sequence[str]], variants: Sequence[str | None]
    ) -> None:
        """Run all commands until one fails or the job is stopped, and record the
        outcome.
        """
        error: Data | None = None
        for command, variant in zip(commands, variants, strict=True):
            if self._stopped or error:
                break
            try:
                code = self._run_one(command, variant)
                if code:
                    error = self._failure(code)
                else:
                    error = None
            except OSError as failure:
                error = {
                    "message": f"cannot be started: {failure.strerror or failure}",
                    "fix": "",
                }
        with self._lock:
            if self._stopped:
                state = "stopped"
            else:
                state = "done"
                if error:
                    state = "failed"
            self._process = None
            if self._stopped:
                error = None
            self._status |= {
                "state": state,
                "running": False,
                "stage": "",
                "error": error,
            }

    def _run_one(self, command: Sequence[str], variant: str | None) -> int:
        """Run one command to its end and return its exit code."""
        process = subprocess.Popen(
            [sys.executable, "-m", "physgen", *command, "--json"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            env={**os.environ, "PHYSGEN_PROGRESS": "json"},
            **separate_session(),
        )
        with self._lock:
            self._process = process
        # `stop` was called between two commands, without a process to stop.
        if self._stopped:
            stop_process(process)
        assert process.stdout is not None
        # A line of JSON reports progress or a clip; other lines are messages for the
        # user.
        for line in process.stdout:
            try:
                event = json.loads(line)
            except ValueError:
                event = None
            with self._lock:
                if not isinstance(event, dict):
                    if line.strip():
                        lines = [*self._status["lines"], line.rstrip("\n")]
                    else:
                        lines = self._status["lines"]
                    self._status["lines"] = lines[-MAX_LINES:]
                elif "progress" in event:
                    stage = STAGES.get(event["progress"], event["progress"])
                    self._status |= {
                        "stage": stage,
                        "done": event["done"],
                        "total": event["total"],
                    }
                elif event.get("clip") and event.get("folder"):
                    self._add_result(event, variant)
        return process.wait()

    def _add_result(self, result: Data, variant: str | None) -> None:
        """Add a complete clip to the results."""
        folder = Path(result["folder"])
        row = {
            "variant": variant,
            "folder": Path(os.path.relpath(folder, self.output)).as_posix(),
            "video": next((name for name in VIDEOS if (folder / name).is_file()), None),
            "report": "report.html" if (folder / "report.html").is_file() else None,
        }
        self._status["result"] = [*(self._status["result"] or ()), row]

    def _failure(self, code: int) -> Data:
        """Return the last message of a run and its fix."""
        lines = []
        for line in self.status()["lines"]:
            if "warning:" not in line:
                lines.append(line)
        if lines:
            message = lines[-1]
        else:
            message = f"the run ended with exit code {code}"
        text, _, fix = message.partition("; ")
        return {"message": text, "fix": fix}
