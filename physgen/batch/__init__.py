"""Many scenes -> many output folders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.batch import axes as axes
    from physgen.batch import clips as clips
    from physgen.batch import cluster as cluster
    from physgen.batch import dataset as dataset
    from physgen.batch import outcomes as outcomes
    from physgen.batch import run as run
    from physgen.batch import shipping as shipping
    from physgen.batch import sweep as sweep
    from physgen.batch import verify as verify
    from physgen.batch import workers as workers

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    [
        "axes",
        "clips",
        "cluster",
        "dataset",
        "outcomes",
        "run",
        "shipping",
        "sweep",
        "verify",
        "workers",
    ],
)
