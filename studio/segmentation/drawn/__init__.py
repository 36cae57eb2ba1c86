"""Pictures drawn by rule, with the truth of every pixel: `draw(seed)`."""

from .drawing import Drawn, draw, draw_told

__all__ = ["Drawn", "draw", "draw_told"]
