"""`physgen render` in a process of its own: start, progress, stop and results."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from secrets import token_hex
from threading import Lock, Thread
from typing import IO, Any

from physgen.edit.errors import EditError, Why, impossible
from physgen.export.video import Format
from physgen.problems import InputError

Data = dict[str, Any]
Tell = Callable[[Data], None]

LINES = 50
"""Of stderr that are kept."""
PATIENCE = 10.0
"""s that a run may take to end once it is stopped, cleanly."""
OFTEN = 0.1
"""s between two events."""
WORDS = {
    "compile": "reading the scene",
    "simulate": "simulating",
    "render": "drawing frames",
    "refine": "retouching frames",
    "fan": "drawing the fan",
    "chaos": "looking how long it can be foretold",
    "export": "writing labels",
    "gallery": "making the gallery",
}
SHARES = {"compile": (0, 2), "simulate": (2, 20), "render": (20, 95), "refine": (30, 97)}
"""Percent of a clip at which a stage begins and ends."""
VIDEOS = ("video.mp4", "video.webp", "video.gif")


def nobody(event: Data) -> None:
    """Events that nobody hears."""


class RenderJob:
    """Renders one scene file into one folder, one run at a time; safe to be called from several threads."""

    def __init__(self, path: Path, output: Path, allow_outside: bool = False, tell: Tell = nobody) -> None:
        self.path, self.output, self.allow_outside = path, output, allow_outside
        self._tell, self._lock = tell, Lock()
        self._process: subprocess.Popen[str] | None = None
        self._thread: Thread | None = None
        self._stopped = False
        self._told = 0.0
        self._status: Data = {**IDLE}

    # What there is

    def status(self) -> Data:
        """`state` is idle, running, done, stopped or failed; `done` of `total` percent, over all clips."""
        with self._lock:
            return {**self._status, "lines": list(self._status["lines"])}

    def command(self, variant: str | None = None, format: str = "mp4", refine: bool = True) -> str:
        """What a person types for the same, quoted for a shell."""
        return shlex.join(["physgen", *self._arguments(variant, format, refine)])

    def file(self, name: str) -> Path | None:
        """A file of this run's results by its path below the output folder; None: there is no such."""
        with self._lock:
            folders = [row["folder"] for row in self._status["result"] or ()]
        try:
            path = (self.output / name).resolve()
            root = self.output.resolve()
            inside = any(path.is_relative_to((root / folder).resolve()) for folder in folders)
            return path if inside and path.is_relative_to(root) and path.is_file() else None
        except (OSError, ValueError):
            return None

    # What is done

    def start(
        self, variants: Sequence[str | None] | None = None, format: str = "mp4", refine: bool = True
    ) -> str:
        """Begin; the job's name. `variants` None: the file itself. Raises EditError: one is running, no such format."""
        wanted = [None] if variants is None else list(dict.fromkeys(variants))
        if not wanted:
            raise impossible("no variant is chosen", "choose at least one")
        kinds = format.split(",") if isinstance(format, str) else []
        if not kinds or any(kind not in {one.value for one in Format} for kind in kinds):
            raise impossible("the format is none that is known", "choose mp4, gif, webp or png")
        with self._lock:
            if self._status["state"] == "running":
                raise EditError(Why.STALE, "a run is under way", "wait for it, or stop it")
            job = token_hex(8)
            commands = [self._arguments(variant, format, refine) for variant in wanted]
            line = " && ".join(shlex.join(["physgen", *command]) for command in commands)
            self._stopped = False
            self._status = {
                **IDLE,
                "job": job,
                "state": "running",
                "running": True,
                "stage": "starting",
                "total": 100 * len(wanted),
                "lines": deque(maxlen=LINES),
                "command": line,
            }
            self._thread = Thread(target=self._run, args=(commands, wanted), daemon=True)
            self._thread.start()
        self._say(now=True)
        return job

    def stop(self) -> None:
        """End the run, cleanly: what is whole stays, nothing is left half-written. Returns once it has ended."""
        with self._lock:
            self._stopped = self._status["state"] == "running"
            process, thread = self._process, self._thread
        if process is not None:
            with suppress(ProcessLookupError):
                process.send_signal(signal.SIGTERM)
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
        if thread is not None:
            thread.join(PATIENCE)

    def wait(self, seconds: float | None = None) -> Data:
        """The status once the run has ended, or after some seconds."""
        thread = self._thread
        if thread is not None:
            thread.join(seconds)
        return self.status()

    # How

    def _arguments(self, variant: str | None, format: str, refine: bool) -> list[str]:
        found = ["render", str(self.path), "-o", str(self.output)]
        found += [] if variant is None else ["--variant", variant]
        found += [] if format == "mp4" else ["--format", format]
        found += [] if refine or not self._refined(variant) else ["--refine", "none"]
        found += ["--allow-outside"] if self.allow_outside else []
        return found

    def _refined(self, variant: str | None) -> bool:
        """Whether the scene asks for refinement."""
        from physgen.scene.load import load

        try:
            return load(self.path, (), variant, self.allow_outside).refine.backend != "none"
        except InputError:
            return False

    def _run(self, commands: Sequence[Sequence[str]], variants: Sequence[str | None]) -> None:
        error: Data | None = None
        for k, (command, variant) in enumerate(zip(commands, variants, strict=True)):
            if self._stopped:
                break
            try:
                code = self._one(k, command, variant)
            except OSError as failure:
                error = {"message": f"cannot be started: {failure.strerror or failure}", "fix": ""}
                break
            if code and not self._stopped:
                error = self._why(code)
                break
        with self._lock:
            state = "stopped" if self._stopped else "failed" if error else "done"
            self._process = None
            self._status |= {"state": state, "running": False, "stage": "", "error": error}
            if state == "done":
                self._status["done"] = self._status["total"]
        self._say(now=True)

    def _one(self, k: int, command: Sequence[str], variant: str | None) -> int:
        """Run one command to its end; its exit code."""
        process = subprocess.Popen(
            [sys.executable, "-m", "physgen", *command, "--json"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            env={**os.environ, "PHYSGEN_PROGRESS": "json"},
            start_new_session=True,  # Ctrl-C in the server's terminal is the server's to pass on
        )
        with self._lock:
            self._process = process
        if self._stopped:  # between two of them
            process.send_signal(signal.SIGTERM)
        assert process.stderr is not None
        assert process.stdout is not None
        listening = Thread(target=self._listen, args=(process.stderr, k), daemon=True)
        listening.start()
        for line in process.stdout:
            self._ended(line, variant)
        listening.join()
        return process.wait()

    def _listen(self, stream: IO[str], k: int) -> None:
        """Progress, and what else is said."""
        for line in stream:
            told = _json(line)
            with self._lock:
                if told is None or "progress" not in told:
                    if line.strip():
                        self._status["lines"].append(line.rstrip("\n"))
                    continue
                stage = str(told["progress"])
                begin, end = SHARES.get(stage, (0, 0))
                part = begin + (end - begin) * float(told["done"]) / max(float(told["total"]), 1.0)
                self._status["stage"] = WORDS.get(stage, stage)
                self._status["done"] = max(self._status["done"], round(100 * k + min(part, 99.0), 1))
            self._say()

    def _ended(self, line: str, variant: str | None) -> None:
        """A clip that is there, or is not."""
        told = _json(line)
        if told is None or "clip" not in told:
            return
        with self._lock:
            if told.get("folder"):
                self._status["result"] = [*(self._status["result"] or ()), self._made(told, variant)]
                self._status["done"] = max(self._status["done"], 100 * len(self._status["result"]))
        self._say(now=True)

    def _made(self, told: Data, variant: str | None) -> Data:
        folder = Path(told["folder"])
        video = next((name for name in VIDEOS if (folder / name).is_file()), None)
        return {
            "variant": variant,
            "folder": Path(os.path.relpath(folder, self.output)).as_posix(),
            "video": video,
            "report": "report.html" if (folder / "report.html").is_file() else None,
            "seconds": told.get("seconds"),
            "state": told.get("state"),
        }

    def _why(self, code: int) -> Data:
        """What the run said last."""
        with self._lock:
            lines = [line for line in self._status["lines"] if "warning:" not in line]
        message = lines[-1] if lines else f"the run ended with exit code {code}"
        text, _, fix = message.partition("; ")
        return {"message": text, "fix": fix}

    def _say(self, *, now: bool = False) -> None:
        """To every window, not too often."""
        with self._lock:
            if not now and time.monotonic() - self._told < OFTEN:
                return
            self._told = time.monotonic()
        self._tell({"type": "render", **self.status()})


IDLE: Data = {
    "job": None,
    "state": "idle",
    "running": False,
    "stage": "",
    "done": 0,
    "total": 0,
    "lines": (),
    "error": None,
    "result": None,
    "command": "",
}


def _json(line: str) -> Data | None:
    """A line of JSON that is a mapping."""
    try:
        told = json.loads(line)
    except ValueError:
        return None
    return told if isinstance(told, dict) else None
