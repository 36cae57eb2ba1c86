"""A scene that a test names -> its golden files, or what is said, with a page, where the clip differs from them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from physgen.golden.asking import Asked
from physgen.golden.files import PICTURE, DamagedError, Golden, read, save
from physgen.golden.judging import judged
from physgen.golden.page import headline, page
from physgen.golden.taking import Clip, taken
from physgen.golden.told import lines
from physgen.golden.tracks import track, units
from physgen.pipeline import Warm
from physgen.whole import write_whole

WIDE = 9
"""Letters of what a line is about."""


@dataclass(frozen=True)
class Check:
    """One clip of a test, just made."""

    test: str
    """The test's node id."""
    scene: str
    """As messages name it."""
    asked: Asked
    clip: Clip
    fresh: Golden
    """What would be kept of it."""

    def write(self, file: Path) -> None:
        """As golden files: `file` and the picture beside it."""
        save(self.fresh, file)

    def differs(self, expected: Path, picture: Path, folder: Path) -> tuple[str, list[Path]]:
        """What differs from the files, nothing where the clip is right; and what shows it, written into `folder`."""
        try:
            golden = read(expected, picture)
        except DamagedError as error:
            return f"{error}; --force-regen writes them anew", []
        verdict = judged(self.scene, golden, self.clip, self.asked)
        if verdict.right:
            return "", []
        shown = folder / f"{expected.stem}.html"
        got = folder / f"{expected.stem}.obtained{expected.suffix}"
        self.write(got)
        write_whole(shown, page(verdict, self.test).encode("utf-8"))
        said = [f"{self.scene} is not the clip of {expected.name}. {headline(verdict)}"]
        said += [f"  {about:<{WIDE}}{text}" for about, text in lines(verdict)]
        said.append(f"  {'page':<{WIDE}}{shown}")
        said.append(
            f"  {'right?':<{WIDE}}--force-regen keeps the clip as it is now; look at it before you commit it"
        )
        return "\n".join(said), [shown, got, *([got.with_suffix(PICTURE)] if self.fresh.stills else [])]


def checked(path: Path, scene: str, test: str, asked: Asked, warm: Warm) -> Check:
    """Make the clip of the scene file at `path`. Raises InputError where it gives none."""
    clip = taken(path, asked, warm)
    kept = None
    if asked.motion is not None:
        kept = track(clip.trajectory, units(asked.motion), asked.until)
    return Check(test, scene, asked, clip, Golden(kept, clip.stills, clip.made))
