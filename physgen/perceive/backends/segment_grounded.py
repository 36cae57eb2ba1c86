"""Photo and categories -> labels of what moves, and of what stands still: Grounding DINO boxes, SAM cuts (section 3.1).

`segment=grounding-dino+sam:DINO,SAM` names both weights, `:DINO` or `:,SAM` one of them, as hub ids or paths.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from physgen.backends import Setup, find
from physgen.perceive.backends.categories_everyday import everyday
from physgen.perceive.backends.cut_sam import Cutter, Sam, Sam2
from physgen.perceive.backends.detect_grounding_dino import GroundingDino
from physgen.perceive.backends.models import device_of, dtype_of, freed
from physgen.perceive.backends.options import Real, read
from physgen.perceive.cleaned import SURE, Cut, segments
from physgen.perceive.roles import Category, Meant, Rgb, Segments
from physgen.problems import InputError


def with_sam(setup: Setup) -> Grounded:
    """The backend `grounding-dino+sam`."""
    return Grounded("grounding-dino+sam", Sam, setup)


def with_sam2(setup: Setup) -> Grounded:
    """The backend `grounding-dino+sam2`."""
    return Grounded("grounding-dino+sam2", Sam2, setup)


class Grounded:
    """A segmenter that finds what it is told to; its models are loaded when they are first needed."""

    def __init__(self, name: str, cutter: Callable[..., Cutter], setup: Setup) -> None:
        """Raises InputError for a device, a type or weights that cannot be."""
        self.weights = weights_of(name, setup)
        self.device = device_of(setup)
        self.dtype = dtype_of(setup, self.device)
        self.sure = surely(name, setup)
        self._cutter = cutter
        self._detector_made: GroundingDino | None = None
        self._cutter_made: Cutter | None = None
        self._told: dict[str, Any] = {}

    def __call__(self, rgb: Rgb, categories: Sequence[Category] = ()) -> Segments:
        """What of `categories` the photo shows; everyday things where none are named."""
        kinds = list(categories) or list(everyday()(rgb))
        found = self._detector()(rgb, [kind.noun for kind in kinds])
        cutter = self._cutting()
        cutter.look(rgb)
        masks = cutter.boxes([one.box for one in found])
        cuts = (  # one at a time: a large photo's masks are large
            Cut.of(mask, kinds[one.noun].noun, kinds[one.noun].movable, one.score, fit)
            for one, (mask, fit) in zip(found, masks, strict=True)
        )
        result = segments(
            cuts, (rgb.shape[0], rgb.shape[1]), lambda boxes: list(cutter.boxes(boxes)), self.sure
        )
        cutter.forget()
        self._told = {"asked": len(kinds), "boxes": len(found)}
        return result

    def meant(
        self,
        rgb: Rgb,
        boxes: Sequence[tuple[float, float, float, float]],
        points: Sequence[tuple[float, float]],
    ) -> list[Meant]:
        """What SAM cuts out for boxes (left, top, width, height px) and for points, in that order."""
        cutter = self._cutting()
        cutter.look(rgb)
        corners = [(x, y, x + width, y + height) for x, y, width, height in boxes]
        said = [Meant(mask, fit) for mask, fit in (*cutter.boxes(corners), *cutter.points(points))]
        cutter.forget()
        return said

    def note(self) -> Mapping[str, Any]:
        """Where and with what it ran, for the record."""
        return {
            "device": self.device,
            "dtype": str(self.dtype).removeprefix("torch."),
            "weights": ",".join(self.weights),
            **self._told,
        }

    def close(self) -> None:
        """Let the models go."""
        for part in (self._detector_made, self._cutter_made):
            if part is not None:
                part.close()
        self._detector_made = self._cutter_made = None
        freed()

    def _detector(self) -> GroundingDino:
        if self._detector_made is None:
            self._detector_made = GroundingDino(self.weights[0], self.device)
        return self._detector_made

    def _cutting(self) -> Cutter:
        if self._cutter_made is None:
            self._cutter_made = self._cutter(self.weights[1], self.device, self.dtype)
        return self._cutter_made


def weights_of(name: str, setup: Setup) -> tuple[str, ...]:
    """One id or path for each that the row has: `A,B` names both, `A` and `,B` one. Raises InputError for more."""
    own = [weights.id for weights in find("segment", name).weights]
    said = [part.strip() for part in setup.weights.split(",")]
    if len(said) > len(own):
        fix = f"write at most {len(own)}, with a comma between"
        raise InputError.of("--backend", f'"{setup.weights}"', f"names {len(said)} weights for {name}", fix)
    said += [""] * (len(own) - len(said))
    return tuple(text or default for text, default in zip(said, own, strict=True))


def surely(name: str, setup: Setup, default: float = SURE) -> float:
    """The option `threshold`: confidence, 0..1, from which a mask is an object. Raises InputError."""
    return float(read(setup, name, {"threshold": Real(default)})["threshold"])
