"""One photo becomes an editable scene file; the scene file becomes a physically simulated video.

The stages as Python calls are in :mod:`physgen.pipeline`; nothing heavy is imported here.
"""

from __future__ import annotations

__version__ = "0.1.0"

# glibc learns from the largest block that was freed, 32 MiB at most, how much freed memory to keep: without one, arrays
# of a frame may be mapped anew each time, a quarter of its time
bytes(31 * 2**20)
