"""The editor of scene files in the browser; see docs/editor.md."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.edit import app as app
    from physgen.edit import corrections as corrections
    from physgen.edit import draft as draft
    from physgen.edit import live as live
    from physgen.edit import operations as operations

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, ["app", "corrections", "draft", "live", "operations"]
)
