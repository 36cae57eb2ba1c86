"""One photo becomes an editable scene file; the scene file becomes a physically simulated video.

The stages as Python calls are in :mod:`physgen.pipeline`; nothing heavy is imported here.
"""

from __future__ import annotations

__version__ = "0.2.0"
