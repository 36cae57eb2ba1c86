"""Optical flow of KITTI: PNG of 16 bits (Menze and Geiger, CVPR 2015)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from physgen.export.labels import Clip, Moment, Writer, write_png
from physgen.maps import F32, U16

STEPS = 64
"""Codes per px of flow."""
ZERO = 2**15
"""Code of no motion."""
MAX_CODE = 2**16 - 1
"""Largest code."""


class Kitti(Writer):
    """Writes PNG with R = 64 u + 2^15, G = 64 v + 2^15 and B = 1 for valid pixels, else
    0.

    `flow_occ/000000_10.png` has all pixels from frame 0 to 1, `flow_noc/` only pixels
    visible in frame 1; `image_2/` has both frames. Flow of 512 px and more is not
    valid.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        super().__init__(folder, clip)
        for name in ("flow_occ", "flow_noc", "image_2"):
            (folder / name).mkdir()

    def add(self, moment: Moment) -> None:
        """Write the pair of frames and its flow, twice."""
        flow = moment.forward
        if moment.after is None or flow is None:
            return
        name = f"{moment.view.index:06d}"
        for number, view in ((10, moment.view), (11, moment.after)):
            write_png(self._folder / "image_2" / f"{name}_{number}.png", view.rgb)
        codes = kitti_codes(flow.motion)
        write_png(self._folder / "flow_occ" / f"{name}_10.png", codes)
        # The second file marks hidden pixels as invalid.
        codes[~flow.visible] = 0
        write_png(self._folder / "flow_noc" / f"{name}_10.png", codes)


def kitti_codes(flow: F32) -> U16:
    """Return codes (H, W, 3) of a flow (H, W, 2) px: u, v, valid."""
    codes = np.rint(flow * np.float32(STEPS)) + np.float32(ZERO)
    valid = ((codes >= 0) & (codes <= MAX_CODE)).all(axis=2)
    channels = np.zeros((*valid.shape, 3), np.uint16)
    channels[valid, :2] = codes[valid].astype(np.uint16)
    channels[..., 2] = valid
    return channels
