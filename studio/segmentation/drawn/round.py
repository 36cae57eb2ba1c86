"""Round solids, drawn analytically: ellipsoids, solids of revolution, tubes."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from .canvas import Canvas, Finish, Pose
from .hand import Array
from .surface import CORNERS, DULL, Paint, lay, origin, unit, up


@dataclass(frozen=True)
class Ellipsoid:
    """A unit sphere stretched by `axes` (3, 3; columns are half-axes) about `centre`, own units."""

    centre: Array
    axes: Array
    paint: Paint
    finish: Finish = DULL

    def hull(self) -> Array:
        reach = np.sqrt((self.axes**2).sum(axis=1))
        return self.centre + CORNERS * reach

    def draw(self, canvas: Canvas, pose: Pose) -> None:
        stretch = pose.turn @ self.axes * pose.scale
        middle = pose.apply(self.centre[None])[0]
        reach = np.sqrt((stretch**2).sum(axis=1))
        x0, y0, x1, y1 = canvas.window(middle - reach, middle + reach)
        if x1 <= x0 or y1 <= y0:
            return
        back = np.linalg.inv(stretch.astype(np.float64)).astype(np.float32)
        x = (np.arange(x0, x1, dtype=np.float32) - middle[0])[None, :, None]
        y = (np.arange(y0, y1, dtype=np.float32) - middle[1])[:, None, None]
        flat = (
            x * back[:, 0] + y * back[:, 1]
        )  # of the unit sphere, at depth 0; depth adds back[:, 2]
        a = float(back[:, 2] @ back[:, 2])
        b = flat @ back[:, 2]
        root = b * b - a * (np.einsum("ijk,ijk->ij", flat, flat) - 1)
        rows, columns = np.nonzero(root > 0)
        if not len(rows):
            return
        z = (-b[rows, columns] + np.sqrt(root[rows, columns])) / a
        ball = flat[rows, columns] + z[:, None] * back[:, 2]
        normal = ball @ back
        normal /= np.sqrt(np.einsum("ij,ij->i", normal, normal))[:, None]
        uv = (
            np.arctan2(ball[:, 0], ball[:, 2]) / np.float32(np.pi),
            ball[:, 1] * 0.5 + 0.5,
        )
        lay(
            canvas,
            pose,
            rows + y0,
            columns + x0,
            z + middle[2],
            normal,
            uv,
            self.paint,
            self.finish,
        )


@dataclass(frozen=True)
class Lathe:
    """A solid of revolution: `profile` (N, 2) of radius and height, from the foot up to the rim, then down the inside.

    An inside that ends at a radius above 0 is a hole one looks through.
    """

    profile: Array
    paint: Paint
    finish: Finish = DULL
    inside: Paint | None = None
    foot: Array = field(default_factory=origin)
    axis: Array = field(default_factory=up)

    def hull(self) -> Array:
        axis = unit(self.axis)
        side = unit(np.cross(axis, [0.31, 0.42, 0.85]))
        other = np.cross(axis, side)
        turns = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        ring = np.cos(turns)[:, None] * side + np.sin(turns)[:, None] * other
        few = self.profile[:: max(1, len(self.profile) // 16)]
        few = np.vstack(
            [few, self.profile[-1:], self.profile[np.argmax(self.profile, axis=0)]]
        )
        points = self.foot + few[:, 1, None, None] * axis + few[:, 0, None, None] * ring
        return points.reshape(-1, 3).astype(np.float32)

    def draw(self, canvas: Canvas, pose: Pose) -> None:
        axis = unit(pose.turn @ self.axis)
        foot = pose.apply(self.foot[None])[0]
        radius, height, slope, rim = self._rings(pose.scale, abs(float(axis[2])))
        flat = float(np.hypot(axis[0], axis[1]))
        perp = (
            np.array([-axis[1] / flat, axis[0] / flat, 0], np.float32)
            if flat > 1e-3
            else np.array([1, 0, 0], np.float32)
        )
        front = np.cross(perp, axis)
        front = (
            front if front[2] > 0 or (front[2] == 0 and front[1] > 0) else -front
        ).astype(np.float32)
        centres = foot + height[:, None] * axis
        reach = float(radius.max()) + 1
        x0, y0, x1, y1 = canvas.window(
            centres.min(axis=0) - reach, centres.max(axis=0) + reach
        )
        if x1 <= x0 or y1 <= y0:
            return
        index = self._painted(
            radius,
            centres - np.array([x0, y0, 0], np.float32),
            perp,
            front,
            rim,
            float(axis[2]),
            (y1 - y0, x1 - x0),
        )
        rows, columns = np.nonzero(index)
        if not len(rows):
            return
        ring = index[rows, columns] - 1
        r, c = np.maximum(radius[ring], 1e-3), centres[ring]
        dx, dy = (
            (columns + x0).astype(np.float32) - c[:, 0],
            (rows + y0).astype(np.float32) - c[:, 1],
        )
        cos = np.clip((dx * perp[0] + dy * perp[1]) / r, -1, 1)
        across = dx * front[0] + dy * front[1]
        sin = np.sqrt(1 - cos * cos)
        sin = np.where((across < -0.3) & (r * abs(axis[2]) > 1), -sin, sin)
        sin = np.where((ring > rim) & (r * abs(axis[2]) <= 1), -np.abs(sin), sin)
        out = cos[:, None] * perp + sin[:, None] * front
        normal = slope[ring, 0, None] * out + slope[ring, 1, None] * axis
        z = c[:, 2] + r * out[:, 2]
        last, rounded = (len(radius) - 1 if axis[2] > 0 else 0), radius[ring] > 1.5
        cap = (ring == last) & rounded & (rim == len(radius) - 1 or axis[2] <= 0)
        if cap.any():
            normal[cap] = axis if axis[2] > 0 else -axis
            z[cap] = c[cap, 2] - (axis[0] * dx[cap] + axis[1] * dy[cap]) / axis[2]
        along = (height[ring] - height.min()) / max(float(np.ptp(height)), 1e-6)
        uv = (
            np.arctan2(cos, sin).astype(np.float32) / np.float32(np.pi),
            along.astype(np.float32),
        )
        within = ring > rim
        for chosen, paint in (
            (~within, self.paint),
            (within, self.inside or self.paint),
        ):
            if chosen.any():
                lay(
                    canvas, pose, rows[chosen] + y0, columns[chosen] + x0, z[chosen].astype(np.float32),
                    normal[chosen].astype(np.float32), (uv[0][chosen], uv[1][chosen]), paint, self.finish,
                )  # fmt: skip

    def _rings(self, scale: float, tilt: float) -> tuple[Array, Array, Array, int]:
        """Radii and heights (px) dense enough to leave no gaps, outward normals (radial, axial), index of the rim."""
        r, h = self.profile[:, 0] * scale, self.profile[:, 1] * scale
        steps = np.ceil(
            (
                np.abs(np.diff(h)) * np.sqrt(1 - tilt**2)
                + np.abs(np.diff(r)) * (0.3 + tilt)
            )
            / 0.9
        )
        steps = np.clip(steps, 1, 200).astype(int)
        radii, heights, slopes = [], [], []
        for k, n in enumerate(steps):
            t = np.arange(n, dtype=np.float32) / n
            radii.append(r[k] + t * (r[k + 1] - r[k]))
            heights.append(h[k] + t * (h[k + 1] - h[k]))
            normal = unit(np.array([h[k + 1] - h[k], r[k] - r[k + 1]], np.float32))
            slopes.append(np.repeat(normal[None], n, axis=0))
        slope = np.concatenate([*slopes, slopes[-1][-1:]])
        slope = cv2.blur(slope, (1, 3), borderType=cv2.BORDER_REPLICATE)
        slope /= np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-6)
        top = (
            int(np.argmax(self.profile[:, 1]))
            if self.inside is not None
            else len(steps)
        )
        rim = int(steps[:top].sum())
        return (
            np.append(np.concatenate(radii), r[-1]).astype(np.float32),
            np.append(np.concatenate(heights), h[-1]).astype(np.float32),
            slope.astype(np.float32),
            rim,
        )

    @staticmethod
    def _painted(
        radius: Array,
        centres: Array,
        perp: Array,
        front: Array,
        rim: int,
        tilt: float,
        shape: tuple[int, int],
    ) -> Array:
        """(h, w) int32: 1 + the ring seen at each pixel, 0 = none; the painter goes from the far end to the near one."""
        index = np.zeros(shape, np.int32)
        turns = np.linspace(
            0, 2 * np.pi, int(np.clip(radius.max() * 1.5, 12, 64)), endpoint=False
        )
        circle = np.cos(turns)[:, None] * perp[:2] + np.sin(turns)[:, None] * front[:2]
        corners = np.round(
            (centres[:, None, :2] + radius[:, None, None] * circle) * 16
        ).astype(np.int32)
        order = range(rim + 1) if tilt >= 0 else range(rim, -1, -1)
        for k in order:
            cv2.fillConvexPoly(index, corners[k], k + 1, cv2.LINE_8, 4)
        if rim == len(radius) - 1 or tilt <= 0.01:
            return index
        mouth = np.zeros(shape, np.uint8)
        cv2.fillConvexPoly(
            mouth, corners[min(rim + 1, len(radius) - 1)], 1, cv2.LINE_8, 4
        )
        within = np.zeros(shape, np.int32)
        for k in range(rim + 1, len(radius)):
            cv2.fillConvexPoly(within, corners[k], k + 1, cv2.LINE_8, 4)
        if radius[-1] > 1:
            cv2.fillConvexPoly(within, corners[-1], 0, cv2.LINE_8, 4)
        return np.where(mouth > 0, within, index)


@dataclass(frozen=True)
class Tube:
    """A line of `points` (N, 3) as thick as `radius` (N,), own units; v runs 0..1 along it."""

    points: Array
    radius: Array
    paint: Paint
    finish: Finish = DULL

    def hull(self) -> Array:
        most = float(self.radius.max())
        return np.concatenate(
            [self.points + most * d for d in np.vstack([np.eye(3), -np.eye(3)])]
        ).astype(np.float32)

    def draw(self, canvas: Canvas, pose: Pose) -> None:
        line = pose.apply(self.points)
        length = np.concatenate(
            [[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))]
        )
        count = max(2, int(length[-1] * 1.5) + 2)
        at = np.linspace(0, length[-1], count)
        if length[-1] < 0.5:
            at, length = np.linspace(0, 1, count), np.linspace(0, 1, len(line))
        path = np.stack(
            [np.interp(at, length, line[:, k]) for k in range(3)], axis=1
        ).astype(np.float32)
        thick = np.maximum(np.interp(at, length, self.radius) * pose.scale, 0.7).astype(
            np.float32
        )
        most = float(thick.max())
        x0, y0 = (np.floor(path[:, :2].min(axis=0) - most).astype(int) - 1).tolist()
        x1, y1 = (np.ceil(path[:, :2].max(axis=0) + most).astype(int) + 2).tolist()
        if (
            (x1 - x0) * (y1 - y0) > 4_000_000
            or x1 <= 0
            or y1 <= 0
            or x0 >= canvas.width
            or y0 >= canvas.height
        ):
            return
        order = np.argsort(path[:, 2], kind="stable")
        nearest = np.zeros((y1 - y0, x1 - x0), np.int32)
        nearest[
            np.round(path[order, 1]).astype(int) - y0,
            np.round(path[order, 0]).astype(int) - x0,
        ] = order + 1
        away, label = cv2.distanceTransformWithLabels(
            (nearest == 0).astype(np.uint8),
            cv2.DIST_L2,
            5,
            labelType=cv2.DIST_LABEL_PIXEL,
        )
        table = np.zeros(int(label.max()) + 1, np.int32)
        on = nearest > 0
        table[label[on]] = nearest[on] - 1
        rows, columns = np.nonzero(away < most + 1)
        inside = (
            (rows + y0 >= 0)
            & (rows + y0 < canvas.height)
            & (columns + x0 >= 0)
            & (columns + x0 < canvas.width)
        )
        rows, columns = rows[inside], columns[inside]
        k = table[label[rows, columns]]
        dx, dy = (
            (columns + x0).astype(np.float32) - path[k, 0],
            (rows + y0).astype(np.float32) - path[k, 1],
        )
        left = thick[k] ** 2 - dx * dx - dy * dy
        keep = left > 0
        rows, columns, k, dx, dy = (
            rows[keep],
            columns[keep],
            k[keep],
            dx[keep],
            dy[keep],
        )
        rise = np.sqrt(left[keep])
        normal = np.stack([dx, dy, rise], axis=1) / thick[k][:, None]
        v = (k / (count - 1)).astype(np.float32)
        lay(
            canvas, pose, rows + y0, columns + x0, (path[k, 2] + rise).astype(np.float32), normal.astype(np.float32),
            (np.zeros_like(v), v), self.paint, self.finish,
        )  # fmt: skip
