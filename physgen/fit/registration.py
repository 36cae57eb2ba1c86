"""Find the pose of one object in one frame.

A patch of a frame is explained as the background with the object's template on it. Gauss-
Newton steps find the pose with the smallest difference to hundredths of a pixel; phase
correlation finds the pose after a jump. Pixels of nearer objects do not count.

Templates and backgrounds are blended in linear light, as in a camera: blended in codes, a
border between light and dark would move by tenths of a pixel. Differences are those of the
square root of light, with nearly even noise, in codes from 0 to 255.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, nan, pi

import cv2
import numpy as np

from physgen.arrays import F32, F64, Mask
from physgen.fit.template import Template, Window, window_around, window_overlap


@dataclass(frozen=True)
class RegistrationTuning:
    """Steps and limits of the registration."""

    smallest_side: int = 3
    """Shorter side of a window, px, at least."""
    blurs: tuple[float, ...] = (3.0, 0.0)
    """Standard deviations, px; a wide blur makes the valley of the cost wider."""
    max_steps: int = 8
    """Gauss-Newton steps for each blur, at most."""
    longest_step: float = 6.0
    """Length of a step, px, at most."""
    last_step: float = 0.004
    """Length of a step, px, below which the search ends."""
    convergence: float = 0.05
    """Length of the last step, px, below which the search has converged."""
    min_brightness: float = 8.0
    """Brightness by which light is divided for its slope, codes, at least."""
    outlier: float = 12.0
    """Difference of a pixel from which its weight falls, codes."""
    min_visible_share: float = 0.3
    """Visible share of a template's pixels, at least."""
    turn_information: float = 0.004
    """Information about the angle, as a share of a shift's, for an observed angle."""
    damping: float = 1e-3
    """Damping of a Gauss-Newton step, as a share of the mean information."""
    disc_share: float = 0.85
    """Share of a disc's radius inside which the picture shows the angle."""
    disc_angles: int = 180
    """Number of angles at which the picture of a disc is compared."""
    peak_share: float = 0.8
    """Share of the best correlation from which an angle of a disc is possible."""


REGISTRATION = RegistrationTuning()
CODES = 255.0
"""Brightness of white."""


@dataclass(frozen=True)
class Patch:
    """The neighbourhood of one object in one frame."""

    window: Window
    frame: F32
    """(h, w, 3): brightness."""
    background: F32
    """(h, w, 3): linear light without the object."""
    open_mask: Mask
    """(h, w): pixels without a nearer object."""

    def crop(self, window: Window) -> Patch:
        """Return the part of the patch inside a window of the picture."""
        shift = (
            window.origin[0] - self.window.origin[0],
            window.origin[1] - self.window.origin[1],
        )
        inner = Window(shift, window.size)
        open_mask = inner.crop(self.open_mask.astype(np.float32)) > 0
        frame = inner.crop(self.frame)
        background = inner.crop(self.background)
        return Patch(window, frame, background, open_mask)

    def blur(self, sigma: float) -> Patch:
        """Return the patch out of focus; `sigma` in px."""
        if not sigma:
            return self
        # A lens blurs light, not its root.
        light = (self.frame / CODES) ** 2
        frame = brightness(np.asarray(cv2.GaussianBlur(light, (0, 0), sigma)))
        background = np.asarray(
            cv2.GaussianBlur(self.background, (0, 0), sigma), np.float32
        )
        return Patch(self.window, frame, background, self.open_mask)


@dataclass(frozen=True)
class Match:
    """A registered pose."""

    pose: F64
    gain: float
    """Share of the difference from the background that the template explains."""
    has_angle: bool
    """Whether the picture shows the angle."""
    is_stationary: bool
    """Whether the last step was short; after an impact, many steps are needed."""

    def observed_pose(self) -> F64:
        """Return the pose (3,), with NaN for an angle without evidence."""
        x, y, angle = self.pose.tolist()
        return np.array([x, y, angle if self.has_angle else nan])


def brightness(light: F32) -> F32:
    """Return the square root of linear light, in codes from 0 to 255."""
    return np.asarray(CODES * np.sqrt(np.maximum(light, 0.0)), np.float32)


def _blend(paint: F32, background: F32) -> F32:
    """Return the brightness (h, w, 3) of a template's paint over a background."""
    return brightness(paint[..., :3] + (1 - paint[..., 3:]) * background)


def find_pose(
    template: Template, start: F64, patch: Patch, blurs: Sequence[float]
) -> Match | None:
    """Return the match in the valley of the cost around a start.

    Returns None if too little of the object is visible.
    """
    # Pixels far from the object only cost time.
    right, bottom = patch.window.far_corner
    window = window_around(start, template.reach, (bottom, right))
    window = window_overlap(window, patch.window)
    if min(window.size) < REGISTRATION.smallest_side:
        return None
    sharp_patch = patch.crop(window)
    pose = start.copy()
    has_angle = False
    length = 0.0
    # A wide blur widens the valley of the cost; later blurs make its bottom exact.
    for sigma in blurs:
        blurred_patch = sharp_patch.blur(sigma)
        for _ in range(REGISTRATION.max_steps):
            step, has_angle = _gauss_newton_step(template, pose, blurred_patch, sigma)
            pose = pose + step
            # An angle counts as the shift at the radius of gyration.
            length = float(np.abs(step * [1, 1, template.gyration]).max())
            if length < REGISTRATION.last_step:
                break
    gain = _explained_share(template, pose, sharp_patch)
    if gain is None:
        return None
    return Match(pose, gain, has_angle, length < REGISTRATION.convergence)


def _explained_share(template: Template, pose: F64, patch: Patch) -> float | None:
    """Return the share of the difference from the background that a pose explains.

    Returns None if too little of the object is visible.
    """
    paint = template.draw(pose, patch.window)
    visible_mask = (paint[..., 3] > 0.5) & patch.open_mask
    if visible_mask.sum() < REGISTRATION.min_visible_share * template.area:
        return None
    residual = (patch.frame - _blend(paint, patch.background))[visible_mask]
    contrast = (patch.frame - brightness(patch.background))[visible_mask]
    # Highlights and hands in front of the object should not decide.
    limit = 4 * REGISTRATION.outlier
    mean_residual = np.minimum(np.abs(residual), limit).mean()
    mean_contrast = np.minimum(np.abs(contrast), limit).mean()
    # The minimum contrast keeps an object before an equal background from a division by
    # zero.
    return 1.0 - float(mean_residual) / max(float(mean_contrast), 1.0)


def _gauss_newton_step(
    template: Template, pose: F64, patch: Patch, sigma: float
) -> tuple[F64, bool]:
    """Return one Gauss-Newton step (3,), and whether the picture shows the angle."""
    paint = template.draw(pose, patch.window)
    if sigma:
        paint = np.asarray(cv2.GaussianBlur(paint, (0, 0), sigma), np.float32)
    prediction = _blend(paint, patch.background)
    residual = patch.frame - prediction
    weights = _pixel_weights(residual, patch.open_mask)
    slopes = _pose_slopes(template, pose, paint, prediction, patch)
    # The normal equations of weighted least squares: S W S' change = S W residual.
    weighted_slopes = slopes * weights
    matrix = (weighted_slopes @ slopes.T).astype(np.float64)
    vector = (weighted_slopes @ residual.ravel()).astype(np.float64)
    has_angle = _shows_angle(matrix)
    size = 2
    if has_angle:
        size = 3
    matrix = matrix[:size, :size]
    vector = vector[:size]
    # Damping keeps the matrix of an even picture invertible.
    damping = REGISTRATION.damping * np.trace(matrix) / size + 1e-9
    change = np.linalg.solve(matrix + damping * np.eye(size), vector)
    # A linear model holds for a few pixels only.
    largest = max(float(np.abs(change).max()), 1e-9)
    change *= min(1.0, REGISTRATION.longest_step / largest)
    step = np.zeros(3)
    step[:size] = change
    step[2] /= template.gyration
    return step, has_angle


def _pixel_weights(residual: F32, open_mask: Mask) -> F32:
    """Return the weights (3 P,) of all channels of residuals (h, w, 3)."""
    # Pixels with large differences show other things than the object.
    distance = np.abs(residual).mean(axis=-1)
    squared_ratio = (distance / REGISTRATION.outlier) ** 2
    weight = open_mask / np.maximum(1.0, squared_ratio)
    return np.repeat(weight.astype(np.float32).ravel(), 3)


def _shows_angle(matrix: F64) -> bool:
    """Return whether the information matrix (2, 2) or (3, 3) determines the angle."""
    if len(matrix) < 3:
        return False
    # A turn counts as a shift at the radius of gyration, so that both are comparable.
    shift_information = (matrix[0, 0] + matrix[1, 1]) / 2
    return bool(matrix[2, 2] > REGISTRATION.turn_information * shift_information)


def _pose_slopes(
    template: Template, pose: F64, paint: F32, prediction: F32, patch: Patch
) -> F32:
    """Return derivatives (2 or 3, P) of the brightness by the pose.

    The angle is measured in px at the radius of gyration.
    """
    # The brightness is the root of the light, with a steep slope in the dark.
    divisor = 2 * np.maximum(prediction, REGISTRATION.min_brightness)
    # The derivative of 255 sqrt(light) is 255² over twice the brightness.
    light_factor = CODES**2 / divisor
    slopes = []
    for kernel in (_ROW_KERNEL, _ROW_KERNEL.T):
        change = np.asarray(cv2.filter2D(paint, -1, kernel), np.float32)
        # The coverage also moves: it uncovers background behind the object.
        light = change[..., :3] - change[..., 3:] * patch.background
        # A shift to the right brings the values from the left.
        slopes.append(-light * light_factor)
    if template.can_turn:
        left, top = patch.window.origin
        width, height = patch.window.size
        rows = np.arange(height)[:, None, None] + (top - pose[1])
        columns = np.arange(width)[None, :, None] + (left - pose[0])
        # By a turn, a pixel at (x, y) moves by (-y, x).
        turn = slopes[1] * columns - slopes[0] * rows
        slopes.append(turn / template.gyration)
    return np.array([slope.ravel() for slope in slopes], np.float32)


_ROW_KERNEL = np.array([[-0.5, 0.0, 0.5]], np.float32)
"""Central differences along a row."""


def phase_shift(template: Template, start: F64, patch: Patch) -> F64:
    """Return the shift (x, y, 0) px from a start to the peak of phase correlation."""
    paint = template.draw(start, patch.window)
    empty = brightness(patch.background)
    # Both pictures show the difference from the background: an object without one is
    # invisible.
    prediction = _blend(paint, patch.background)
    expected = np.abs(prediction - empty).sum(axis=2)
    difference = np.abs(patch.frame - empty).sum(axis=2)
    difference = difference * patch.open_mask
    # The window function fades the borders, since a Fourier transform is periodic.
    hanning = cv2.createHanningWindow(patch.window.size, cv2.CV_32F)
    (x, y), _ = cv2.phaseCorrelate(
        expected.astype(np.float32), difference.astype(np.float32), hanning
    )
    return np.array([x, y, 0.0])


def disc_turn(
    template: Template, pose: F64, patch: Patch, expected_angle: float
) -> float:
    """Return the turn (rad) from a pose to the best angle of a disc's picture.

    Of several angles with nearly the same correlation, the nearest to the expected angle
    is chosen. Returns 0 for a disc without a mark.
    """
    center = (
        template.center[0] - template.corner[0],
        template.center[1] - template.corner[1],
    )
    own_rings = _rings(brightness(template.paint[..., :3]), template, center)
    # The template turns about its own centre, and the frame about the matched one.
    x = pose[0] - patch.window.origin[0]
    y = pose[1] - patch.window.origin[1]
    frame = patch.frame * patch.open_mask[..., None]
    frame_rings = _rings(frame.astype(np.float32), template, (float(x), float(y)))
    correlation = _turn_correlation(own_rings, frame_rings)
    # Angles are circular: the last one is beside the first.
    is_rise = correlation >= np.roll(correlation, 1)
    is_peak = is_rise & (correlation >= np.roll(correlation, -1))
    limit = REGISTRATION.peak_share * correlation.max()
    peaks = np.flatnonzero(is_peak & (correlation >= limit))
    if not len(peaks):
        return 0.0
    # Spokes and symmetrical marks give several peaks.
    angles = 2 * pi * peaks / len(own_rings)
    deviations = _wrap_angle(angles - expected_angle)
    index = int(np.argmin(np.abs(deviations)))
    return float(_wrap_angle(angles[index] - float(pose[2])))


def _turn_correlation(own_rings: F32, frame_rings: F32) -> F64:
    """Return the correlation (A,) of two discs by angle and radius for each turn."""
    # In polar coordinates a turn is a shift, so that one Fourier transform tries all.
    own_spectrum = np.fft.rfft(own_rings, axis=0)
    frame_spectrum = np.fft.rfft(frame_rings, axis=0)
    # The conjugate makes a correlation of the convolution.
    spectrum = np.conj(own_spectrum) * frame_spectrum
    # The transform is linear: sum radii and channels before it.
    correlation = np.fft.irfft(spectrum.sum(axis=(1, 2)), n=len(own_rings))
    return np.asarray(correlation)


def _wrap_angle(angles: F64) -> F64:
    """Return angles (rad) from -pi to pi."""
    return np.asarray((angles + pi) % (2 * pi) - pi)


def _rings(picture: F32, template: Template, center: tuple[float, float]) -> F32:
    """Return a disc by angle and radius, without the mean of each ring."""
    radius = REGISTRATION.disc_share * min(template.paint.shape[:2]) / 2
    size = (ceil(radius), REGISTRATION.disc_angles)
    flags = cv2.INTER_LINEAR | cv2.WARP_FILL_OUTLIERS
    polar = cv2.warpPolar(picture, size, center, radius, flags)
    # Outer rings have more pixels of the frame for each angle.
    weights = np.sqrt(np.arange(size[0]) + 0.5)
    deviations = polar - polar.mean(axis=0)
    return np.asarray(deviations * weights[None, :, None], np.float32)
