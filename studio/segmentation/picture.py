"""A picture and what is known of it: the form in which drawn, rendered and labelled pictures all reach the network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

UNSAID = 65535
"""The label, in the stored PNG only, of pixels that nobody judges."""


@dataclass(frozen=True)
class Picture:
    """One picture of H x W pixels with its truth; every map has the picture's size."""

    rgb: NDArray[np.uint8]
    """(H, W, 3) sRGB."""
    labels: NDArray[np.uint16]
    """(H, W) ids of movable objects, truncated ones too; 0 = none. A pixel belongs to what covers half of it or more."""
    unsaid: NDArray[np.bool_]
    """(H, W) pixels nobody judges: haze at outlines, slivers, things that are and are not objects."""
    normals: NDArray[np.float32]
    """(H, W, 3) unit vectors, +x right, +y down, +z to the viewer; 0 where not known."""
    known: NDArray[np.bool_]
    """(H, W) where the normals are known."""
    shadow: NDArray[np.float32]
    """(H, W) 0..1: share of the light that cast shadows keep away."""
    depth_order: NDArray[np.float32] | None = None
    """(H, W) larger = nearer; the scale is the picture's own. Not stored."""
    truncated: tuple[int, ...] = ()
    """Ids of objects that the border of the photo cuts."""

    def save(self, folder: Path, stem: str) -> None:
        """Write `stem`.png, .labels.png (16 bit), .normals.png (8 bit, 128 = 0; all 0 = not known), .shadow.png (8 bit)."""
        stored = np.where(self.unsaid, np.uint16(UNSAID), self.labels)
        bent = np.clip(np.round(self.normals * 127) + 128, 1, 255)
        bent = np.where(self.known[..., None], bent, 0).astype(np.uint8)
        _write(folder / f"{stem}.png", self.rgb[..., ::-1])
        _write(folder / f"{stem}.labels.png", stored)
        _write(folder / f"{stem}.normals.png", bent[..., ::-1])
        _write(
            folder / f"{stem}.shadow.png", np.round(self.shadow * 255).astype(np.uint8)
        )

    @classmethod
    def load(cls, folder: Path, stem: str) -> Picture:
        """What `save` wrote: ids under unsaid pixels and the depth are lost; objects at the border count as truncated."""
        stored = _read(folder / f"{stem}.labels.png")
        unsaid = stored == UNSAID
        labels = np.where(unsaid, 0, stored).astype(np.uint16)
        bent = _read(folder / f"{stem}.normals.png")[..., ::-1]
        known = bent.any(axis=2)
        normals = (bent.astype(np.float32) - 128) / 127
        normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-6)
        return cls(
            rgb=np.ascontiguousarray(
                _read(folder / f"{stem}.png")[..., ::-1], np.uint8
            ),
            labels=labels,
            unsaid=unsaid,
            normals=np.where(known[..., None], normals, 0).astype(np.float32),
            known=known,
            shadow=_read(folder / f"{stem}.shadow.png").astype(np.float32) / 255,
            truncated=at_border(labels),
        )


def at_border(labels: NDArray[np.uint16]) -> tuple[int, ...]:
    """Ids that have a pixel in the outermost row or column of (H, W) `labels`."""
    rim = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    return tuple(int(i) for i in np.unique(rim) if i)


def _write(path: Path, values: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    if not cv2.imwrite(str(path), values):
        raise OSError(f"{path}: not written")


def _read(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if values is None:
        raise FileNotFoundError(path)
    return values
