"""The role `segment` of a crew, told what to look for: for whole photos, and for boxes and points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from physgen.crew import Crew
from physgen.perceive.roles import Category, Meant, Prompted, Rgb, Segment, Segments


@dataclass(frozen=True)
class Asking:
    """A segmenter that knows its nouns, and asks for them where nobody said any."""

    crew: Crew
    nouns: Sequence[str] = ()
    """What to find, for those that find what they are told to."""

    def __call__(self, rgb: Rgb) -> Segments:
        """Objects found in the photo."""
        categories: Sequence[Category] = [Category(noun, True) for noun in self.nouns]
        if "categories" in self.crew.row("segment").uses and not categories:
            categories = self.crew.call("categories", rgb)
            self.crew.release("categories")
        found: Segments = self.crew.call("segment", rgb, categories=categories)
        return found


class Prompting(Asking):
    """One that takes boxes and points itself."""

    def meant(self, rgb: Rgb, boxes: Sequence[Any], points: Sequence[Any]) -> Sequence[Meant]:
        """See `Prompted`; nothing where another had to take over that takes none."""
        said: Sequence[Meant] = self.crew.run(
            "segment", lambda made: made.meant(rgb, boxes, points) if isinstance(made, Prompted) else ()
        )
        return said


def segmenter(crew: Crew, nouns: Sequence[str] = ()) -> Segment:
    """The crew's segmenter: a `Prompted` one where its backend is."""
    prompted = not crew.fallen("segment") and isinstance(crew.get("segment"), Prompted)
    return Prompting(crew, nouns) if prompted else Asking(crew, nouns)
