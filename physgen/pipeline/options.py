"""Options of a render: everything that a caller can choose about a clip."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from physgen.export.video import Format


class Page(Enum):
    """How much `report.html` holds."""

    FULL = "full"
    """With the player, the charts and what was perceived."""
    PLAIN = "plain"
    """Pictures and tables: half the time of a short clip is saved."""
    NONE = "none"
    """No page is written."""


@dataclass(frozen=True)
class SceneOrigin:
    """Where a scene comes from, for the rendering of a copy."""

    path: str
    """Of the scene as the user names it: a path on another machine, or a URL."""
    source: str
    """Of the scene as the manifest names it; see `RunRecord.source`."""


@dataclass(frozen=True)
class RenderOptions:
    """What a caller can choose about one clip of a scene."""

    overrides: tuple[str, ...] = ()
    """`KEY=VALUE`, as `--set` takes them."""
    variant: str | None = None
    name: str | None = None
    """Of the clip's folder; None: the scene's name, followed by the variant's."""
    allow_outside: bool = False
    """Whether the scene may read files outside its folder."""
    formats: tuple[Format, ...] = (Format.MP4,)
    """Of the video; none where it is empty."""
    command: tuple[str, ...] = ()
    """The command line, for the manifest."""
    chaos: bool = False
    """Whether neighbouring simulations are run, too, for the report."""
    draws: int = 0
    """Simulations with drawn values of what is uncertain."""
    draw_seed: int = 0
    device: str = "cpu"
    """Draws frames: `cpu`, `cuda` ..."""
    cached: bool = True
    """Whether motions and frames may come from the cache, and a complete clip of the same options is kept."""
    page: Page = Page.FULL
    single_file: bool = False
    """Whether the page embeds the video, to be sent alone."""
    export: tuple[str, ...] = ()
    """Formats of ground truth: written to `truth/`, or to the clip's folder where there is no video."""
    mark: str = ""
    """Identifies all options and the code in the manifest."""
    origin: SceneOrigin | None = None
    """Set where the scene's file is a copy."""
