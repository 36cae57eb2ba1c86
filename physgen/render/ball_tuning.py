"""Thresholds for the light and the paint of balls."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BallTuning:
    """Thresholds of the separation of a ball into colour, gloss and shading."""

    paints: int = 5
    """Maximum number of paints on one ball."""
    least_light: float = 0.03
    """Smallest linear light at which colours separate paints."""
    most_pixels: int = 500
    """Maximum number of sampled pixels of a ball."""
    rounds: int = 4
    stiff: float = 0.02
    """Weight of Lambert's shading, in shares of the ball's pixels."""
    outlier_error: float = 0.15
    """Error in log light above which a pixel counts less: a highlight, a seam."""
    mixture_distance: float = 0.08
    """Distance from all paints, relative to the brightest, above which a pixel is a
    mixture.
    """
    excess: float = 1.3
    """Light relative to the paint above which a pixel is a reflection."""
    most_departure: float = 1.0
    """Maximum departure from Lambert's law, in log light."""
    darkest: float = 0.18
    """Share of full light below which the photo's darkness belongs to the skin."""
    mixture_share: float = 0.5
    """Share of mixed pixels below which a ball counts as painted."""
    painted_by_name: float = 0.65
    """The same for a ball of billiards with a pattern: it mirrors its neighbours."""
    plainly: float = 0.6
    """Slope of brightness over predicted shading above which the light is used
    fully.
    """
    rim_light: float = 0.85
    """Distance from the centre, radii, beyond which brightness differs from the
    model.
    """
    blur_width: float = 0.08
    """Width of its smoothing, radii."""
    fades: float = 1.6
    """Maximum ratio to the model."""
    light_width: float = 0.15
    """Width over which a difference from the paints is light, radii."""
    colour_error: float = 0.2
    """Error of a linear change of log light up to which a ball has one colour."""
    gloss_width: float = 0.5
    """Maximum width of a highlight, radii."""
    line_width: float = 0.25
    """Maximum width of the lines of a number, radii."""
    gloss_least: float = 0.6
    """Minimum linear light of a highlight's dimmest channel."""
    outshines: float = 1.2
    """Minimum brightness of a highlight, relative to the brightest paint elsewhere on
    the ball.
    """
    brightest_paint: float = 0.9
    """Linear light that hardly any paint reflects."""
    axes: int = 400
    """Number of directions in the search for borders of two paints."""
    steps: int = 64
    """Number of places of a border along each direction."""
    cut_share: float = 0.01
    """Minimum share of pixels that a cut explains in addition to a band."""
    closer: tuple[float, ...] = (0.08, 0.03, 0.01, 0.0)
    """Search ranges around the best direction in later rounds, rad."""
    disc: float = 0.8
    """Minimum cosine of a disc's radius."""
    disc_cosine: float = 0.5
    """Maximum cosine between a stripe's axis and a disc on the stripe."""
    view_cosine: float = 0.2
    """Cosine to the viewer above which writing is readable in the photo."""
    disc_share: float = 0.015
    """Minimum share of pixels that a disc explains."""
    pattern_share: float = 0.8
    """Minimum share of pixels that a pattern explains."""
    contrast: float = 1.0
    """Minimum difference of two paints in log light of some channel."""
    set_count: int = 5
    """Minimum number of balls to tell lamps from neighbouring balls."""
    usual: float = 0.35
    """Quantile of the light on several balls: neighbours and errors add more often than
    they subtract.
    """
    neighbour_light: float = 0.05
    """Share of a normal's light by a neighbour up to which a ball counts as alone."""
    ray_distance: float = 1.1
    """Distance of a ray from a neighbour's centre, radii, above which it does not meet
    it.
    """
    mirror_light: float = 0.1
    """Linear light of paint up to which mirror images are visible on it."""
    hue_difference: float = 0.25
    """Difference of hues in log light up to which paints of several balls are one."""
    line_distance: float = 0.4
    """Distance from the line between two paints, relative to its length, above which a
    pixel is neither.
    """
    gloss_cosine: float = 0.80
    """Minimum cosine between a highlight's normal and the mirror direction."""


BALL = BallTuning()
