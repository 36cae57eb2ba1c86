"""What every layout of a data set is, and what was done."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from physgen.batch.dataset.sample import Sample


@dataclass
class Count:
    """Of one split."""

    clips: int = 0
    frames: int = 0
    seconds: float = 0.0
    bytes: int = 0
    photos: set[str] = field(default_factory=set)
    captions: int = 0
    """Clips that have one."""

    def add(self, sample: Sample) -> None:
        """One more."""
        self.clips += 1
        self.frames += int(sample.about["frames"])
        self.seconds += float(sample.about["seconds"])
        self.bytes += sample.size
        self.photos.add(str(sample.about["photo"]))
        self.captions += bool(sample.caption)


class Layout(Protocol):
    """Writes samples below a folder, in the order in which they come; whole files alone appear."""

    made: int
    """Samples that were written."""
    kept: int
    """Samples that were there already, of the same."""

    def add(self, sample: Sample) -> None:
        """The next one."""

    def close(self) -> list[Path]:
        """All were added; returns the files that readers open."""

    def drop(self) -> None:
        """Something went wrong: what is half-written goes."""

    def strays(self) -> tuple[int, Path | None]:
        """Clips below the folder that are not of this data set, an earlier run's: how many, and one of them."""
