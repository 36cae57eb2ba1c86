"""How much texture Algorithm 1 keeps: fresh noise in every step, as printed, against the same noise; JSON on stdout.

    python benchmarks/fusion_noise.py > benchmarks/results/fusion_noise.json

Data is drawn from N(0, spread^2), for which the exact denoiser is known: no model's own faults are in the figures.
Each is the variance of refined latents as a part of the data's own; 1 keeps all, less is smoother than the data.
`spread` is the data's: 1 is what latents are scaled to as a whole, fine texture given what is around it has less. Free
of objects (m = 0) no guidance is blended in: what is missing there is lost by the sampler's steps, in both ways alike.
"""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import NDArray

from physgen.refine.fusion import fuse_latents, steps_fused, steps_run

STEPS, STRENGTH, STOP, DRAWS, SEED = 50, 0.5, 5, 400_000, 0
SPREADS = (1.0, 0.5, 0.2)
MASKS = (1.0, 0.5, 0.0)
Array = NDArray[np.float64]


def ddim() -> tuple[Array, Array]:
    """Signal and noise of each level, none at the end: AnimateDiff's linear betas."""
    kept = np.cumprod(1 - np.linspace(0.00085, 0.012, 1000))[
        np.linspace(999, 0, STEPS).round().astype(int)
    ]
    kept = np.append(kept, 1.0)
    return np.sqrt(kept), np.sqrt(1 - kept)


def flow() -> tuple[Array, Array]:
    """Straight paths with shift 3, as flow-matching video models have."""
    s = np.linspace(1, 1e-3, STEPS)
    s = np.append(3 * s / (1 + 2 * s), 0.0)
    return 1 - s, s


def refined(a: Array, b: Array, spread: float, mask: float, fresh: bool) -> float:
    """Variance after refinement, of the data's own."""
    rng = np.random.default_rng(SEED)
    data, once = spread * rng.standard_normal(DRAWS), rng.standard_normal(DRAWS)

    def noised(z: Array, k: int) -> Array:
        return a[k] * z + b[k] * (rng.standard_normal(DRAWS) if fresh and k else once)

    def denoised(z: Array, k: int) -> Array:
        z0 = a[k] * spread**2 / (a[k] ** 2 * spread**2 + b[k] ** 2) * z  # E[z0 | z]
        return a[k + 1] * z0 + b[k + 1] / b[k] * (z - a[k] * z0)

    z = fuse_latents(
        data, mask, add_noise=noised, denoise=denoised, count=len(a) - 1, stop=STOP
    )
    return round(float(z.var() / data.var()), 3)


def main() -> None:
    count = steps_run(STEPS, STRENGTH)
    rows = []
    for name, levels in (("ddim", ddim()), ("flow", flow())):
        a, b = (level[-count - 1 :] for level in levels)
        for spread in SPREADS:
            for mask in MASKS:
                same, fresh = (
                    refined(a, b, spread, mask, way) for way in (False, True)
                )
                rows.append(
                    {
                        "schedule": name,
                        "spread": spread,
                        "mask": mask,
                        "same noise": same,
                        "fresh noise": fresh,
                    }
                )
    result = {
        "steps": STEPS,
        "strength": STRENGTH,
        "steps_run": count,
        "steps_fused": steps_fused(count, STOP),
        "draws": DRAWS,
        "seed": SEED,
        "rows": rows,
    }
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
