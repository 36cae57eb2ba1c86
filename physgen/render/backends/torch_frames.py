"""Stage + Trajectory -> Frames, many drawn at a time by torch: the arithmetic of `frames.py`, within 1 grey level.

Where things are, and how dark their shadows, is worked out as there, by NumPy and OpenCV; the pixels of a batch of
frames are drawn on the device and come back once, as bytes. OpenCV samples between pixels exactly from version 5 on;
older ones round to 1/32 px, and edges may then differ by more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import islice

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physgen.photometry import decode, encode_u8
from physgen.problems import InputError
from physgen.render.backends.torch_cutout import Cutout
from physgen.render.placing import covered
from physgen.render.shadowed import figured, lifted, thrown, veiled
from physgen.render.stage import Cover, Frame, Stage, Stand, planned
from physgen.simulate.trajectory import Trajectory

F32 = NDArray[np.float32]
Moment = tuple[float, list[Stand]]

MOST = 32
"""Frames that are drawn at a time."""
BYTES = 256
"""That a pixel of a frame takes while it is drawn."""
ON_CPU = 2**30
"""Bytes for a batch, where torch draws on the processor."""


def opened(name: str) -> torch.device:
    """The device called `cpu`, `cuda`, `cuda:1`. Raises InputError where there is none."""
    device = torch.device(name)
    if device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count():
        fix = "leave --device out, or install NVIDIA's driver and a torch that is made for it"
        raise InputError.of("--device", f'"{name}"', "is no GPU that torch can use here", fix)
    return device


def title(name: str) -> str:
    """What draws on a device, for the manifest; raises as `opened`."""
    device = opened(name)
    model = f" ({torch.cuda.get_device_name(device)})" if device.type == "cuda" else ""
    return f"{device}{model}, torch {torch.__version__}"


def render_frames_torch(
    stage: Stage,
    trajectory: Trajectory,
    order: Sequence[int] | None = None,
    parts: int = 1,
    *,
    device: str,
    batch: int | None = None,
) -> Iterator[Frame]:
    """The frames of `render_frames(stage, trajectory, order, parts)`, drawn a `batch` at a time, or as many as fit.

    Raises as `opened`, and MemoryError where the device holds too little for a single one.
    """
    try:
        canvas = Canvas(stage, opened(device))
        batch = batch or _fitting(stage.background[..., 0].size, canvas.device)
        moments, index = planned(stage, trajectory, order), 0
        while group := list(islice(moments, batch * parts)):
            with torch.inference_mode():
                rgb, ids = (pictures.cpu().numpy() for pictures in canvas.exposed(group, parts))
            for (time, stands), picture, names in zip(group[parts - 1 :: parts], rgb, ids, strict=True):
                named, covering = partial(names.view, np.uint16), partial(_covering, stage, stands)
                yield Frame(index, time, picture, named, covering)
                index += 1
    except torch.OutOfMemoryError as error:
        raise MemoryError from error


def _covering(stage: Stage, stands: Sequence[Stand]) -> list[Cover]:
    """Worked out on the processor, which few ask for: at an edge, a pixel may differ from what was drawn."""
    there = [(stage.sprites[stand.k], stand.where) for stand in stands if stand.where is not None]
    return [Cover(sprite.body, where.box, covered(sprite, where) >= 0.5) for sprite, where in there]


def _fitting(pixels: int, device: torch.device) -> int:
    """Frames of so many pixels that half of the free memory holds."""
    free = torch.cuda.mem_get_info(device)[0] // 2 if device.type == "cuda" else ON_CPU
    return max(1, min(MOST, free // (BYTES * pixels)))


class Canvas:
    """A stage on a device."""

    def __init__(self, stage: Stage, device: torch.device) -> None:
        self.stage, self.device, self.lit = stage, device, stage.lit
        self.plate = self._here(decode(stage.background) if self.lit is None else self.lit.plate)
        self.encoding = self._here(encode_u8(np.arange(65536) / 65535))
        self.cutouts = [Cutout(sprite, device, stage.supersample) for sprite in stage.sprites]
        self.tint = None if self.lit is None else self._here(self.lit.tint)

    def _here(self, values: NDArray[np.generic]) -> Tensor:
        return torch.tensor(values, device=self.device)

    def exposed(self, moments: Sequence[Moment], parts: int) -> tuple[Tensor, Tensor]:
        """(n, H, W, 3) uint8 sRGB, the means of `parts` moments each in linear light, and (n, H, W) ids of the last."""
        light = torch.zeros((), device=self.device)
        for part in range(parts):
            more, ids = self.drawn([stands for _, stands in moments[part::parts]])
            light = light + more
        return self._encoded(light / parts), ids

    def _encoded(self, light: Tensor) -> Tensor:
        """As `photometry.encode_u8`."""
        return self.encoding[(light * 65535 + 0.5).int().clamp(0, 65535)]

    def drawn(self, moments: Sequence[Sequence[Stand]]) -> tuple[Tensor, Tensor]:
        """(n, H, W, 3) linear light and (n, H, W) int16 ids."""
        n, (H, W) = len(moments), self.plate.shape[:2]
        factors: list[dict[int, F32]] = [{} for _ in moments]
        brighter: Tensor | None = None
        if self.lit is None or self.tint is None:
            light = self.plate.repeat(n, 1, 1, 1)
        else:
            dark, factors = self.darkness(moments)
            light = self.plate * torch.exp(self._here(dark)[..., None] * -self.tint)
            brighter = torch.exp((self._here(self.lit.total) - self._here(dark)).clamp(max=1))[..., None]
        ids = torch.zeros((n, H, W), dtype=torch.int16, device=self.device)
        for k, cutout in enumerate(self.cutouts):
            there = [(m, where) for m, stands in enumerate(moments) if (where := stands[k].where) is not None]
            for patch in cutout.patches(there, (W, H), [factor.get(k) for factor in factors]):
                at = patch.at
                light[at] = light[at] * (1 - patch.coverage)[..., None] + patch.light
                if patch.rest is not None:
                    light[at] += patch.rest if brighter is None else patch.rest * brighter[at]
                ids[at] = torch.where(patch.coverage >= 0.5, cutout.sprite.body + 1, ids[at])
        return light, ids

    def darkness(self, moments: Sequence[Sequence[Stand]]) -> tuple[F32, list[dict[int, F32]]]:
        """(n, H, W) -log of the light that all shadows leave behind things, and for each moment `veiled`."""
        assert self.lit is not None
        dark: F32 = np.repeat(self.lit.total[None], len(moments), axis=0)
        factors = []
        for picture, stands in zip(dark, moments, strict=True):
            figures = {}
            for stand in stands:
                asked = self.stage.veils is not None or self.lit.casts[stand.k].sliding is None
                if stand.where is not None and asked:
                    coverage = covered(self.stage.sprites[stand.k], stand.where)
                    figures[stand.k] = figured(self.stage, stand, stand.where, coverage)
            moved = [stand for stand in stands if stand.start != stand.pose]
            for stand in moved:
                lifted(picture, self.lit, stand)
                thrown(picture, self.lit, stand, figures.get(stand.k))
            seen = [stand for stand in stands if stand.where is not None]
            factors.append(veiled(self.stage, seen, figures))
        return dark, factors
