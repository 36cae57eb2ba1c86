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
    """What is asked, in words, and who answers."""

    text: str
    ask: Callable[[Motion], Asked]


QUESTIONS = {
    "gravity": Question("Does all that flies fall alike, at all times?", gravity),
    "momentum": Question("Do two that meet push each other, as their masses allow?", momentum),
    "energy": Question("Does nothing part faster than it came?", energy),
    "overlap": Question("Does nothing go through another thing?", overlap),
    "jumps": Question("Does nothing jump?", jumps),
    "starts": Question("Does nothing at rest start by itself?", starts),
    "speeding": Question("Does nothing on a table speed up by itself?", speeding),
}
