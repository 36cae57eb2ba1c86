"""The array types of physgen, each declared once. Shapes are in the documentation of each value.

`Mask`, `Image`, `Labels`, `Points` and `Poses` name the meaning of an array; `U8`, `U16`,
`F32`, `F64` and `Indices` name its numbers alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Indices = NDArray[np.intp]

Mask = NDArray[np.bool_]
"""(H, W): whether a pixel belongs to an object."""
Image = U8
"""(H, W, 3) sRGB."""
Labels = NDArray[np.integer]
"""(H, W): the id of each pixel's object, 0 for the background."""
Points = F64
"""(N, 2): x and y, px."""
Poses = F64
"""(T, N, 3): x and y of the centre of mass, px, and the angle, rad."""
