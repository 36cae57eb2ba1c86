"""One file a backend; rows in `physgen.registry` name them.

The only place in perceive for model libraries.
"""

from __future__ import annotations

import os

# it warns of torchvision, which is not needed
os.environ.setdefault("TRANSFORMERS_VERBOSITY", "error")
