"""Latents of the guidance -> refined latents: Algorithm 1 of the paper, over NumPy arrays of any shape, or numbers.

Symbols, as the paper's Algorithm 1 has them (section 3.4 and supplement), and what they are called here:

| paper | here | what |
|---|---|---|
| z~0 | `guidance` | latents of the relit video |
| m | `mask` | 1 where the objects are, 0 elsewhere; we take coverage in between |
| T (line 1: nint(T s)) | `steps_run(steps, strength)` | denoising steps that run: 25 of 50 at s = 0.5 |
| t = T .. 1 | `k = 0 .. count - 1`, k = T - t | steps run so far |
| z_T, z~_T ~ q(z_T given z~0) (line 2) | `noised(guidance, 0)` | the guidance at the first step's noise |
| p(z_t-1 given z_t) (lines 6, 12) | `denoised(z, k)` | one step of the model |
| z~_t-1 ~ q(z_t-1 given z~0) (line 5) | `noised(guidance, k + 1)` | the guidance, as noisy as the step leaves z |
| w = (T - t) / T (line 7) | `rising(k, count)` | how much of the model's own enters the objects: 0, 1/T .. (T - 1)/T |
| delta (line 4) | `stop` | the last steps, which run free |

Line 4 is printed `t <= T - delta` with t counting down, which would leave the *first* delta steps free. The text calls
delta "the signal to stop the fusion", and the public code counts up and fuses while k < T - delta, so that the *last*
delta steps are free: 20 of 25 fused at delta = 5. We follow text and code: objects are laid down while there is much
noise, and the model then settles borders and light by itself.

Lines 2 and 5 draw fresh noise in every step, and so does the public code. Blending w z + (1 - w) z~ of independent
noises leaves less noise than the model is told of: at w = 1/2 half its variance; the model takes what is missing for
smoothness, and objects lose texture. `noised` is therefore to add the same noise every time: that of z_T, which a
deterministic sampler carries along. docs/refinement.md has the figures for data whose exact denoiser is known.
"""

from __future__ import annotations

from collections.abc import Callable
from math import floor
from typing import Any, TypeVar

import numpy as np

Latent = TypeVar("Latent")
"""An array, or a number."""

Weight = Callable[[int, int], float]
"""Step and count of steps -> fusion weight w."""


def steps_run(steps: int, strength: float) -> int:
    """Line 1: how many of a schedule's steps run, nint(T s), halves upwards.

    >>> steps_run(50, 0.5), steps_run(50, 0.009)
    (25, 0)
    """
    return floor(steps * strength + 0.5)


def steps_fused(count: int, stop: int) -> int:
    """Line 4: how many of `count` steps are fused with the guidance.

    >>> steps_fused(25, 5)
    20
    """
    return max(0, count - stop)


def rising(k: int, count: int) -> float:
    """Line 7: the fusion weight w of step k.

    >>> rising(0, 25), rising(19, 25)
    (0.0, 0.76)
    """
    return k / count


def each_step(held: Any, count: int) -> Any:
    """What of the guidance each of `count` steps puts back so that `held` of it is there after all of them.

    Blends multiply: putting 0.15 back in 25 steps would leave 0.85^25 = 0.02 of what the model changed.

    >>> each_step(1.0, 25), each_step(0.0, 25), round(each_step(0.75, 2), 6)
    (1.0, 0.0, 0.5)
    """
    return 1 - (1 - held) ** (1 / count)


def fused(
    guidance: Latent,
    mask: Any,
    *,
    noised: Callable[[Latent, int], Latent],
    denoised: Callable[[Latent, int], Latent],
    count: int,
    stop: int,
    weight: Weight = rising,
    held: Any = 0.0,
) -> Latent:
    """Refined latents of the guidance's shape.

    `mask` 0..1 broadcasts against latents. `noised(z0, k)` is z0 at the noise that step k starts from, z0 itself at
    k = count; `denoised(z, k)` is step k. `held` 0..1, broadcasting too, is how much of the guidance stays in every
    step, free ones included: 1 on the first frame, which is the photo; see `each_step`.
    """
    z = noised(guidance, 0)
    fusing = steps_fused(count, stop)
    for k in range(count):
        z = denoised(z, k)
        share = mask * (1 - weight(k, count)) if k < fusing else 0 * mask
        share = np.maximum(share, held)  # line 8, and what is held in any case
        # not z + share (z~ - z): with share 1 this is z~ to the last bit
        z = (1 - share) * z + share * noised(guidance, k + 1)
    return z
