"""The solids things are made of, and what paints them."""

from .flat import Box, Slab
from .round import Ellipsoid, Lathe, Tube
from .surface import Paint, Part, Surface

__all__ = ["Box", "Ellipsoid", "Lathe", "Paint", "Part", "Slab", "Surface", "Tube"]
