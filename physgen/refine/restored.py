"""What the model made of a frame, and of the guidance -> the refined frame: its changes alone, where they are wanted.

The decoder cannot say all that the encoder saw: fine texture and letters are lost even where the model changes
nothing. So it is not the decoded frame D(z) that is shown but the guidance and what the model changed of it,
D(z) - D(z~0). Where nothing changed, that is the guidance to the last bit, at any resolution.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.photometry import decode, encode_u8

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]


def restored(
    guidance: U8,
    refined: F32,
    guided: F32,
    coverage: F32,
    *,
    detail: float,
    lock: float,
    held: float,
) -> U8:
    """(H, W, 3) sRGB.

    `refined` and `guided`: what the decoder makes of the refined latents and of the guidance's, (H, W, 3) sRGB 0..1;
    `coverage` (H, W) of objects. `detail` 0..1: how much of what the decoder loses of the guidance is put back;
    `lock` 0..1: how much of the guidance's objects is; `held` 0..1: how much of the guidance is, everywhere.
    """
    before = guidance.astype(np.float32) / np.float32(255)
    after = refined + np.float32(detail) * (before - guided)
    after = before + np.float32(1 - held) * (after - before)
    shown: U8 = np.rint(np.clip(after, 0, 1) * 255).astype(np.uint8)
    share = np.float32(lock) * coverage
    if not share.any():
        return shown
    box = _around(share)
    there = share[box][..., None]
    mixed = encode_u8((1 - there) * decode(shown[box]) + there * decode(guidance[box]))
    shown[box] = np.where(there > 0, mixed, shown[box])
    return shown


def _around(values: F32) -> tuple[slice, slice]:
    """The box of all that is not 0."""
    rows, columns = np.flatnonzero(values.any(axis=1)), np.flatnonzero(values.any(axis=0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
