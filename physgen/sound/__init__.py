"""Sound of a clip: stereo samples of impacts, sliding and rolling.

Modal synthesis (van den Doel and Pai, Presence 7, 382, 1998): an impact excites the
modes of both bodies with a pulse of Hertz's contact time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.sound import track as track

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["track"])
