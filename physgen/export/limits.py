"""What a format can count -> whether a clip's objects fit."""

from __future__ import annotations

from physgen.export.truth import Clip
from physgen.problems import InputError, Problem


def check_count(clip: Clip, format_: str, most: int, fix: str) -> None:
    """Raises InputError where a clip has more objects than a format tells apart."""
    count = len(clip.names)
    if count > most:
        place, found = clip.scene.place("objects"), f"{count:,} objects"
        expected = f"are more than the format {format_} tells apart, which is {most}"
        raise InputError([Problem(place, "objects", found, expected, fix)])
