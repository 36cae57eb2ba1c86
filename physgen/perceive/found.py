"""What perception starts from, and what a photo became."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Doubt, Name
from physgen.percepts.maps import Percepts
from physgen.problems import Problem

SMALLEST = 12
"""px: an id of fewer pixels is a speck, no object."""


@dataclass(frozen=True)
class Found:
    """The objects that perception starts from, found or given."""

    labels: NDArray[np.uint16]
    """(H, W), 0 = background."""
    source: str
    """Who found them, for `from`."""
    confidence: Mapping[int, float]
    """0..1, by id."""
    names: Mapping[int, Name]
    """What some of them are called already, by id."""
    prompts: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)
    """Where a person pointed, by id, as the scene says it: `{"box": [x, y, w, h]}` or `{"point": [x, y]}`, px."""
    doubtful: Sequence[Doubt] = ()
    """What may be an object and was not taken for one."""
    called: Mapping[int, str] = field(default_factory=dict)
    """What objects are named in the scene already, by id."""
    said: Mapping[int, str] = field(default_factory=dict)
    """Who found single masks, by id, as the scene's `from` has it; `source` found the others."""
    layers: Mapping[int, int] = field(default_factory=dict)
    """Who is drawn over whom as a person said it, by id."""
    named_by: str = "given"
    """Who said `names`, for `from`."""


@dataclass(frozen=True)
class Perceived:
    """What a photo became."""

    percepts: Percepts
    document: dict[str, Any]
    """A scene as plain YAML data, valid once the assets are written; `maps` is for the writer of the assets to add."""
    comments: dict[str, str]
    """Dotted path -> a sentence or more to stand above it."""
    header: str
    """What to say at the top of the file."""
    warnings: tuple[Problem, ...] = ()
    """What was strange in the input and could be passed over."""
    record: Sequence[Mapping[str, Any]] = ()
    """How each role went, where others than the core's own had a part."""
