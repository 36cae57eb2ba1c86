"""Read a scene file into a frozen Scene, or report all of its problems at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.scene import load as load
    from physgen.scene import provenance as provenance
    from physgen.scene import saving as saving
    from physgen.scene import scene as scene
    from physgen.scene import write as write
    from physgen.scene import yaml_edit as yaml_edit

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, ["load", "provenance", "saving", "scene", "write", "yaml_edit"]
)
