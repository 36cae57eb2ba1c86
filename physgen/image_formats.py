"""Limits and formats of image files; imports nothing."""

from __future__ import annotations

MOST_PIXELS = 100_000_000
"""A larger picture is refused before it is decoded."""
EXIF_ORIENTATION = 0x0112
"""Tag of how a camera was held; 1 is upright."""
SCENE_FORMATS = ("PNG", "JPEG", "WEBP")
"""What a scene may name as its photo."""
FORMATS = (*SCENE_FORMATS, "BMP", "TIFF", "GIF", "PPM")
"""What perceive reads: none of Pillow's readers that call other programs."""
