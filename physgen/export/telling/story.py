"""A clip -> its story: events, a sentence for each, and a caption."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from physgen.export.telling.caption import Clause, caption
from physgen.export.telling.event import Event, Happening
from physgen.export.telling.found import events
from physgen.export.telling.nouns import Nouns, named
from physgen.export.telling.sentences import sentence
from physgen.export.telling.speech import Speech, times
from physgen.scene.model import Play

if TYPE_CHECKING:
    from physgen.export.truth import Clip

TRUE = 0.02
"""Of the speed: by less, nobody sees that a clip is slower or faster than what happened."""


@dataclass(frozen=True)
class Story:
    """What happens in a clip, as data and in words."""

    events: tuple[Event, ...]
    sentences: tuple[str, ...]
    """One an event."""
    clauses: tuple[Clause, ...]

    @property
    def caption(self) -> str:
        """All of the clip, on one line."""
        return " ".join(clause.text for clause in self.clauses)


def story(clip: Clip) -> Story:
    """The same clip always has the same one."""
    found = events(clip.world, clip.trajectory, clip.shot, clip.sampled)
    labels = [item.label.strip() or named(item.name) for item in clip.scene.objects]
    labels += [named(wall.name) for wall in clip.world.walls]
    speech = Speech(clip.world, Nouns(labels), pace(clip))
    clauses = (*caption(found, speech), *_shown(clip, found))
    return Story(found, tuple(sentence(event, speech) for event in found), clauses)


def pace(clip: Clip) -> float:
    """s of the clip that a second of the motion takes."""
    times = clip.trajectory.times
    return 1 / (clip.fps * float(times[1] - times[0])) if len(times) > 1 else 1.0


def _shown(clip: Clip, found: Sequence[Event]) -> tuple[Clause, ...]:
    """How the clip shows what happens; no event says so, the scene does."""
    how = {
        Play.BACKWARD: "The clip shows this backward.",
        Play.THERE_AND_BACK: "The clip shows this forward, then backward.",
    }
    still = all(event.kind in (Happening.STAY, Happening.CONTACT) for event in found)
    if still:
        return ()
    told = [how[clip.scene.render.play]] if clip.scene.render.play in how else []
    slow = pace(clip)
    if abs(slow - 1) > TRUE:
        told.append(f"The clip shows this {times(slow)} than it happens.")
    return tuple(Clause(text, ()) for text in told)
