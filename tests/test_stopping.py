"""Who stops while the engine calls back is heard, and nothing is printed."""

from __future__ import annotations

import subprocess
import sys

import pytest

CODE = """
import sys, time
import pymunk
from physgen.signals import heeded

heeded()
space = pymunk.Space()
for x in (0, 1):
    body = pymunk.Body(1, 1)
    body.position = x, 0
    space.add(body, pymunk.Circle(body, 3))

def stop(*told):
    raise {wish}

space.on_collision(begin=stop)
try:
    space.step(0.01)
    end = time.monotonic() + 30
    while time.monotonic() < end:
        pass
    sys.exit("nobody heard it")
except KeyboardInterrupt:
    sys.exit(7)
"""


@pytest.mark.parametrize(("wish", "code"), [("KeyboardInterrupt", 7), ("SystemExit(5)", 5)])
def test_a_wish_to_stop_that_c_swallows_comes_again(wish: str, code: int) -> None:
    run = subprocess.run(
        [sys.executable, "-c", CODE.format(wish=wish)], capture_output=True, text=True, timeout=120
    )
    assert (run.returncode, run.stderr) == (code, "")


def test_other_faults_are_told_as_ever() -> None:
    code = CODE.format(wish="ValueError('odd')").replace("+ 30", "+ 0.1")
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert run.returncode == 1
    assert "ValueError: odd" in run.stderr
    assert run.stderr.endswith("nobody heard it\n")
