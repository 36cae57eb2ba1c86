"""Backend inpaint=fill: exemplar-based fill with matched colour and grain.

Borrowed patches carry lines and grain on. Their difference from the photo around the hole is spread over it, so that
no seam shows. Where the surroundings are smooth, a harmonic fill is right and the patches bring the grain only.
Pixels right beside an object are mixed with its blurred edge and its contact shadow: they are not learnt from, they
stay, and the fill meets them within a few pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.inpaint.patch_match import patch_match_fill
from physgen.perceive.inpaint.poisson import blend_at_border, close_gaps, dilate, harmonic_fill, hole_pieces
from physgen.perceive.roles import Inpaint, Mask, Rgb


@dataclass(frozen=True)
class _Limits:
    """Pixels beside the hole, and smooth surroundings."""

    mixed: int = 2  # px beside the hole that are mixed with the object's edge
    band: int = 3  # px beyond them that are filled too, so that their difference from the photo is known
    limit: float = 24.0  # levels of that difference, at most: more is no difference of light
    around: int = 12  # px around a piece of the hole in which smoothness is judged
    # levels: RMS distance from a quadratic surface up to which the surroundings are smooth
    smooth: float = 3.0
    grain: float = 3.0  # px: standard deviation of the blur that separates grain from colour


LIMITS = _Limits()


def fill() -> Inpaint:
    """The backend `fill`."""
    return _fill


def _fill(rgb: Rgb, hole: Mask) -> Rgb:
    if not hole.any() or hole.all():
        return rgb.copy()
    photo = rgb.astype(np.float32)
    whole = close_gaps(hole)
    near, far = dilate(whole, LIMITS.mixed), dilate(whole, LIMITS.mixed + LIMITS.band)
    if far.all():  # hardly anything is left to learn from
        near = far = hole
    borrowed = _smooth_pieces(photo, patch_match_fill(photo, far), far)
    gap = np.where(near[:, :, None], np.float32(0), np.clip(photo - borrowed, -LIMITS.limit, LIMITS.limit))
    filled = np.where(near[:, :, None], borrowed + harmonic_fill(gap, near, 0.4), photo)
    return blend_at_border(filled, rgb, hole)


def _smooth_pieces(photo: F32, borrowed: F32, hole: Mask) -> F32:
    """`borrowed` (H, W, 3), but a harmonic fill with its grain in pieces of the hole with smooth surroundings."""
    smooth, most = np.zeros_like(hole), np.zeros(hole.shape, np.float32)
    for part, piece in hole_pieces(hole):
        wide = tuple(slice(max(0, s.start - LIMITS.around), s.stop + LIMITS.around) for s in part)
        inner = np.zeros_like(hole[wide])
        here = tuple(slice(s.start - w.start, s.stop - w.start) for s, w in zip(part, wide, strict=True))
        inner[here][piece] = True
        rough = _roughness(photo[wide], dilate(inner, LIMITS.around) & ~dilate(hole[wide], 1))
        if rough < LIMITS.smooth:
            smooth[wide] |= inner
            most[wide][inner] = 2 * rough
    if not smooth.any():
        return borrowed
    grain = borrowed - cv2.GaussianBlur(borrowed, (0, 0), LIMITS.grain)
    grain = np.clip(grain, -most[:, :, None], most[:, :, None])
    film = harmonic_fill(np.where(hole[:, :, None], borrowed, photo), smooth, 0.1)
    return np.where(smooth[:, :, None], film + grain, borrowed)


def _roughness(photo: F32, around: Mask) -> float:
    """Levels: RMS distance of the pixels `around` (H, W) from a quadratic surface."""
    y, x = np.nonzero(around)
    if len(y) < 24:
        return float(np.inf)
    u, v = (y - y.mean()) / 64, (x - x.mean()) / 64
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], 1)
    colours = photo[y, x].astype(np.float64)
    off = colours - terms @ np.linalg.lstsq(terms, colours, rcond=None)[0]
    return float(np.sqrt((off**2).mean(0)).max())
