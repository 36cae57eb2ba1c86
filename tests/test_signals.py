"""An exception raised in a callback of the engine ends the process, and nothing is printed."""

from __future__ import annotations

import subprocess
import sys

import pytest

CODE = """
import sys, time
import pymunk
from physgen import signals

signals.DELAY = {delay}
signals.install_handler()
space = pymunk.Space()
for x in (0, 1):
    body = pymunk.Body(1, 1)
    body.position = x, 0
    space.add(body, pymunk.Circle(body, 3))

def stop(*ignored):
    raise {error}

space.on_collision(begin=stop)
try:
    space.step(0.01)
    end = time.monotonic() + 30
    while time.monotonic() < end:
        pass
    sys.exit("no exception arrived")
except KeyboardInterrupt:
    sys.exit(7)
"""


@pytest.mark.parametrize(
    ("error", "code"), [("KeyboardInterrupt", 7), ("SystemExit(5)", 5)]
)
@pytest.mark.parametrize(
    "delay", [0.001, 1e-6]
)  # the second ends within the hook, as on a busy machine
def test_an_exception_that_c_swallows_is_raised_again(
    error: str, code: int, delay: float
) -> None:
    command = [sys.executable, "-c", CODE.format(error=error, delay=delay)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (run.returncode, run.stderr) == (code, "")


def test_other_exceptions_are_reported_as_before() -> None:
    code = CODE.format(error="ValueError('odd')", delay=0.001).replace("+ 30", "+ 0.1")
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 1
    assert "ValueError: odd" in run.stderr
    assert run.stderr.endswith("no exception arrived\n")


def test_a_command_ends_well_without_stderr() -> None:
    command = f"{sys.executable} -m physgen backends 2>&- >/dev/null"
    assert subprocess.run(["sh", "-c", command], check=False).returncode == 0
