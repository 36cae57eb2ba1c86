"""One file per backend; the only modules of perceive with model libraries.

The registry, `physgen.registry`, names the backends.
"""

from __future__ import annotations

import os

# it warns of torchvision, which is not needed
os.environ.setdefault("TRANSFORMERS_VERBOSITY", "error")
