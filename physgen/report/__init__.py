"""Write frames and results into files: the video, the run record, the page."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.report import clips as clips
    from physgen.report import films as films
    from physgen.report import folders as folders
    from physgen.report import gallery as gallery
    from physgen.report import html as html
    from physgen.report import listening as listening
    from physgen.report import overview as overview
    from physgen.report import page as page
    from physgen.report import perception as perception
    from physgen.report import player as player
    from physgen.report import uncertainty as uncertainty

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    [
        "clips",
        "films",
        "folders",
        "gallery",
        "html",
        "listening",
        "overview",
        "page",
        "perception",
        "player",
        "uncertainty",
    ],
)
