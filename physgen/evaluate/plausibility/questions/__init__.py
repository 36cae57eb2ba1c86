"""What is asked: one file a question, and its row here."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from physgen.evaluate.plausibility.evidence import Asked
from physgen.evaluate.plausibility.motion import Motion
from physgen.evaluate.plausibility.questions.energy import energy
from physgen.evaluate.plausibility.questions.gravity import gravity
from physgen.evaluate.plausibility.questions.jumps import jumps
from physgen.evaluate.plausibility.questions.momentum import momentum
from physgen.evaluate.plausibility.questions.overlap import overlap
from physgen.evaluate.plausibility.questions.speeding import speeding
from physgen.evaluate.plausibility.questions.starts import starts


class Question(NamedTuple):
    """What must hold, in words, and who finds what speaks against it."""

    text: str
    ask: Callable[[Motion], Asked]


QUESTIONS = {
    "gravity": Question("all that flies falls alike", gravity),
    "momentum": Question("who meets another pushes it back", momentum),
    "energy": Question("nothing parts faster than it came", energy),
    "overlap": Question("nothing goes through another", overlap),
    "jumps": Question("nothing jumps", jumps),
    "starts": Question("nothing at rest starts by itself", starts),
    "speeding": Question("nothing on a table speeds up by itself", speeding),
}
