"""Mask -> circle or polygons; their area, THE centre of mass, second moment and convex pieces."""
