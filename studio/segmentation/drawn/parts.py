"""The solids things are made of: ellipsoids, solids of revolution, boxes, slabs and tubes, each drawn analytically."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import cv2
import numpy as np

from .canvas import Canvas, Finish, Ints, Pose
from .hand import Array


@dataclass(frozen=True)
class Surface:
    """N visible points of a part, for its paint."""

    own: Array
    """(N, 3) in the thing's own units."""
    u: Array
    """(N,) across: -1..1 round a solid of revolution or over a face; 0 in front."""
    v: Array
    """(N,) along: 0..1 from the foot of a solid of revolution or tube, -1..1 up a face."""
    texel: float
    """Own units per working pixel: finer patterns than this need not be drawn."""


DULL = Finish()
Paint = Callable[[Surface], Array]
"""(N, 3) linear reflectance of N points."""


class Part(Protocol):
    """What a thing is made of."""

    def hull(self) -> Array:
        """(N, 3) points in own units about the part; their bounds are the part's, or a little more."""
        ...

    def draw(self, canvas: Canvas, pose: Pose) -> None: ...


def _unit(v: Array) -> Array:
    return (v / max(float(v @ v) ** 0.5, 1e-9)).astype(np.float32)


CORNERS = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)], np.float32)


def _origin() -> Array:
    return np.zeros(3, np.float32)


def _up() -> Array:
    return np.array([0, 1, 0], np.float32)


def _straight() -> Array:
    return np.eye(3, dtype=np.float32)


def _lay(
    canvas: Canvas,
    pose: Pose,
    y: Ints,
    x: Ints,
    z: Array,
    normal: Array,
    uv: tuple[Array, Array],
    paint: Paint,
    finish: Finish,
) -> None:
    """Test N points against the canvas's depth and paint those that are nearer."""
    keep = canvas.nearer(y, x, z)
    if not keep.any():
        return
    if not keep.all():
        y, x, z, normal, uv = y[keep], x[keep], z[keep], normal[keep], (uv[0][keep], uv[1][keep])
    points = np.stack([x.astype(np.float32), y.astype(np.float32), z], axis=1)
    surface = Surface(pose.own(points), uv[0], uv[1], 1 / pose.scale)
    canvas.put(y, x, z, normal, paint(surface), finish)


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
        flat = x * back[:, 0] + y * back[:, 1]  # of the unit sphere, at depth 0; depth adds back[:, 2]
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
        uv = np.arctan2(ball[:, 0], ball[:, 2]) / np.float32(np.pi), ball[:, 1] * 0.5 + 0.5
        _lay(canvas, pose, rows + y0, columns + x0, z + middle[2], normal, uv, self.paint, self.finish)


@dataclass(frozen=True)
class Lathe:
    """A solid of revolution: `profile` (N, 2) of radius and height, from the foot up to the rim, then down the inside.

    An inside that ends at a radius above 0 is a hole one looks through.
    """

    profile: Array
    paint: Paint
    finish: Finish = DULL
    inside: Paint | None = None
    foot: Array = field(default_factory=_origin)
    axis: Array = field(default_factory=_up)

    def hull(self) -> Array:
        axis = _unit(self.axis)
        side = _unit(np.cross(axis, [0.31, 0.42, 0.85]))
        other = np.cross(axis, side)
        turns = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        ring = np.cos(turns)[:, None] * side + np.sin(turns)[:, None] * other
        few = self.profile[:: max(1, len(self.profile) // 16)]
        few = np.vstack([few, self.profile[-1:], self.profile[np.argmax(self.profile, axis=0)]])
        points = self.foot + few[:, 1, None, None] * axis + few[:, 0, None, None] * ring
        return points.reshape(-1, 3).astype(np.float32)

    def draw(self, canvas: Canvas, pose: Pose) -> None:
        axis = _unit(pose.turn @ self.axis)
        foot = pose.apply(self.foot[None])[0]
        radius, height, slope, rim = self._rings(pose.scale, abs(float(axis[2])))
        flat = float(np.hypot(axis[0], axis[1]))
        perp = (
            np.array([-axis[1] / flat, axis[0] / flat, 0], np.float32)
            if flat > 1e-3
            else np.array([1, 0, 0], np.float32)
        )
        front = np.cross(perp, axis)
        front = (front if front[2] > 0 or (front[2] == 0 and front[1] > 0) else -front).astype(np.float32)
        centres = foot + height[:, None] * axis
        reach = float(radius.max()) + 1
        x0, y0, x1, y1 = canvas.window(centres.min(axis=0) - reach, centres.max(axis=0) + reach)
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
        dx, dy = (columns + x0).astype(np.float32) - c[:, 0], (rows + y0).astype(np.float32) - c[:, 1]
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
        uv = np.arctan2(cos, sin).astype(np.float32) / np.float32(np.pi), along.astype(np.float32)
        within = ring > rim
        for chosen, paint in ((~within, self.paint), (within, self.inside or self.paint)):
            if chosen.any():
                _lay(
                    canvas, pose, rows[chosen] + y0, columns[chosen] + x0, z[chosen].astype(np.float32),
                    normal[chosen].astype(np.float32), (uv[0][chosen], uv[1][chosen]), paint, self.finish,
                )  # fmt: skip

    def _rings(self, scale: float, tilt: float) -> tuple[Array, Array, Array, int]:
        """Radii and heights (px) dense enough to leave no gaps, outward normals (radial, axial), index of the rim."""
        r, h = self.profile[:, 0] * scale, self.profile[:, 1] * scale
        steps = np.ceil((np.abs(np.diff(h)) * np.sqrt(1 - tilt**2) + np.abs(np.diff(r)) * (0.3 + tilt)) / 0.9)
        steps = np.clip(steps, 1, 200).astype(int)
        radii, heights, slopes = [], [], []
        for k, n in enumerate(steps):
            t = np.arange(n, dtype=np.float32) / n
            radii.append(r[k] + t * (r[k + 1] - r[k]))
            heights.append(h[k] + t * (h[k + 1] - h[k]))
            normal = _unit(np.array([h[k + 1] - h[k], r[k] - r[k + 1]], np.float32))
            slopes.append(np.repeat(normal[None], n, axis=0))
        slope = np.concatenate([*slopes, slopes[-1][-1:]])
        slope = cv2.blur(slope, (1, 3), borderType=cv2.BORDER_REPLICATE)
        slope /= np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-6)
        top = int(np.argmax(self.profile[:, 1])) if self.inside is not None else len(steps)
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
        turns = np.linspace(0, 2 * np.pi, int(np.clip(radius.max() * 1.5, 12, 64)), endpoint=False)
        circle = np.cos(turns)[:, None] * perp[:2] + np.sin(turns)[:, None] * front[:2]
        corners = np.round((centres[:, None, :2] + radius[:, None, None] * circle) * 16).astype(np.int32)
        order = range(rim + 1) if tilt >= 0 else range(rim, -1, -1)
        for k in order:
            cv2.fillConvexPoly(index, corners[k], k + 1, cv2.LINE_8, 4)
        if rim == len(radius) - 1 or tilt <= 0.01:
            return index
        mouth = np.zeros(shape, np.uint8)
        cv2.fillConvexPoly(mouth, corners[min(rim + 1, len(radius) - 1)], 1, cv2.LINE_8, 4)
        within = np.zeros(shape, np.int32)
        for k in range(rim + 1, len(radius)):
            cv2.fillConvexPoly(within, corners[k], k + 1, cv2.LINE_8, 4)
        if radius[-1] > 1:
            cv2.fillConvexPoly(within, corners[-1], 0, cv2.LINE_8, 4)
        return np.where(mouth > 0, within, index)


@dataclass(frozen=True)
class Box:
    """A cuboid of half-sizes `half` about `centre`, turned by `turn` (3, 3) in own axes; faces painted over u, v in -1..1."""

    centre: Array
    half: Array
    front: Paint
    side: Paint | None = None
    top: Paint | None = None
    finish: Finish = DULL
    turn: Array = field(default_factory=_straight)
    bevel: float = 0.05

    def hull(self) -> Array:
        return self.centre + (CORNERS * self.half) @ self.turn.T

    def draw(self, canvas: Canvas, pose: Pose) -> None:
        axes = (pose.turn @ self.turn) * self.half * pose.scale  # columns: half-edges in px
        middle = pose.apply(self.centre[None])[0]
        for k, paint in ((0, self.side or self.front), (1, self.top or self.front), (2, self.front)):
            sign = 1.0 if axes[2, k] > 0 else -1.0
            if abs(axes[2, k]) < 1e-3 * np.linalg.norm(axes[:, k]):
                continue
            across, up = (axes[:, (k + 1) % 3], axes[:, (k + 2) % 3]) if k != 2 else (axes[:, 0], axes[:, 1])
            if k == 0:
                across, up = axes[:, 2], axes[:, 1]
            if k == 1:
                across, up = axes[:, 0], axes[:, 2]
            self._face(canvas, pose, middle + sign * axes[:, k], across, up, sign * axes[:, k], paint)

    def _face(
        self,
        canvas: Canvas,
        pose: Pose,
        centre: Array,
        across: Array,
        up: Array,
        outward: Array,
        paint: Paint,
    ) -> None:
        quad = np.stack([centre + a * across + b * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        x0, y0, x1, y1 = canvas.window(quad.min(axis=0), quad.max(axis=0))
        det = float(across[0] * up[1] - across[1] * up[0])
        if x1 <= x0 or y1 <= y0 or abs(det) < 1e-3:
            return
        mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
        cv2.fillConvexPoly(mask, np.round((quad[:, :2] - [x0, y0]) * 16).astype(np.int32), 1, cv2.LINE_8, 4)
        rows, columns = np.nonzero(mask)
        dx, dy = (columns + (x0 - centre[0])).astype(np.float32), (rows + (y0 - centre[1])).astype(np.float32)
        u, v = (
            (dx * up[1] - dy * up[0]) / np.float32(det),
            (dy * across[0] - dx * across[1]) / np.float32(det),
        )
        normal = np.repeat(_unit(outward)[None], len(rows), axis=0)
        if self.bevel > 0:
            for s, edge in ((u, across), (v, up)):
                over = np.maximum(np.abs(s) - (1 - self.bevel), 0) / self.bevel * np.sign(s)
                normal = normal + (0.8 * over[:, None] * _unit(edge)).astype(np.float32)
            normal /= np.sqrt(np.einsum("ij,ij->i", normal, normal))[:, None]
        z = (centre[2] + u * across[2] + v * up[2]).astype(np.float32)
        _lay(canvas, pose, rows + y0, columns + x0, z, normal, (u, v), paint, self.finish)


@dataclass(frozen=True)
class Slab:
    """A plate cut along `outline` (N, 2), with `holes`, in the plane `turn` makes of x and y; u, v are its own x, y."""

    outline: Array
    thickness: float
    paint: Paint
    rim: Paint | None = None
    finish: Finish = DULL
    holes: Sequence[Array] = ()
    centre: Array = field(default_factory=_origin)
    turn: Array = field(default_factory=_straight)
    puff: float = 0.0
    """Own units over which the face bends away at its edges."""

    def _corners(self, outline: Array, z: float) -> Array:
        flat = np.column_stack([outline, np.full(len(outline), z)])
        return (self.centre + flat @ self.turn.T).astype(np.float32)

    def hull(self) -> Array:
        return np.concatenate([self._corners(self.outline, s * self.thickness / 2) for s in (-1, 1)])

    def draw(self, canvas: Canvas, pose: Pose) -> None:
        facing = _unit(pose.turn @ self.turn[:, 2])
        sign = 1.0 if facing[2] > 0 else -1.0
        loops = [self.outline, *self.holes]
        near = [pose.apply(self._corners(loop, sign * self.thickness / 2)) for loop in loops]
        far = [pose.apply(self._corners(loop, -sign * self.thickness / 2)) for loop in loops]
        every = np.concatenate(near + far)
        x0, y0, x1, y1 = canvas.window(every.min(axis=0), every.max(axis=0))
        if x1 <= x0 or y1 <= y0:
            return
        walls = [
            np.stack([n[k - 1], n[k], f[k], f[k - 1]])
            for n, f in zip(near, far, strict=True)
            for k in range(len(n))
        ]
        walls.sort(key=lambda wall: float(wall[:, 2].mean()))
        index = np.zeros((y1 - y0, x1 - x0), np.int32)
        shift = np.array([x0, y0], np.float32)
        for k, wall in enumerate(walls):
            cv2.fillConvexPoly(
                index, np.round((wall[:, :2] - shift) * 16).astype(np.int32), k + 1, cv2.LINE_8, 4
            )
        face = np.zeros(index.shape, np.uint8)
        cv2.fillPoly(
            face, [np.round((n[:, :2] - shift) * 16).astype(np.int32) for n in near], 1, cv2.LINE_8, 4
        )
        self._walls(canvas, pose, np.where(face > 0, 0, index), walls, x0, y0)
        if abs(facing[2]) > 1e-2:
            self._face(canvas, pose, face, sign * facing, near[0][0], x0, y0)

    def _walls(self, canvas: Canvas, pose: Pose, index: Array, walls: list[Array], x0: int, y0: int) -> None:
        rows, columns = np.nonzero(index)
        if not len(rows):
            return
        stack = np.stack(walls)
        normals = np.cross(stack[:, 1] - stack[:, 0], stack[:, 3] - stack[:, 0])
        normals *= np.sign(normals[:, 2:] + 1e-9)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
        which = index[rows, columns] - 1
        normal, corner = normals[which].astype(np.float32), stack[which, 0]
        steep = np.maximum(normal[:, 2], 0.05)
        z = (
            corner[:, 2]
            - (
                normal[:, 0] * ((columns + x0).astype(np.float32) - corner[:, 0])
                + normal[:, 1] * ((rows + y0).astype(np.float32) - corner[:, 1])
            )
            / steep
        )
        z = np.clip(z, stack[which, :, 2].min(axis=1), stack[which, :, 2].max(axis=1)).astype(np.float32)
        zero = np.zeros(len(rows), np.float32)
        _lay(
            canvas,
            pose,
            rows + y0,
            columns + x0,
            z,
            normal,
            (zero, zero),
            self.rim or self.paint,
            self.finish,
        )

    def _face(
        self, canvas: Canvas, pose: Pose, face: Array, facing: Array, corner: Array, x0: int, y0: int
    ) -> None:
        rows, columns = np.nonzero(face)
        if not len(rows):
            return
        x, y = (columns + x0).astype(np.float32), (rows + y0).astype(np.float32)
        z = corner[2] - (facing[0] * (x - corner[0]) + facing[1] * (y - corner[1])) / facing[2]
        normal = np.repeat(facing[None], len(rows), axis=0)
        if self.puff > 0:
            away = cv2.distanceTransform(np.pad(face, 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
            soft = cv2.GaussianBlur(
                np.minimum(away / (self.puff * pose.scale), 1) ** 0.7,
                (0, 0),
                max(0.8, 0.2 * self.puff * pose.scale),
            )
            bend = self.puff * pose.scale * 0.9
            normal = normal.astype(np.float32)
            normal[:, 0] -= bend * (cv2.Sobel(soft, cv2.CV_32F, 1, 0, scale=0.125)[rows, columns])
            normal[:, 1] -= bend * (cv2.Sobel(soft, cv2.CV_32F, 0, 1, scale=0.125)[rows, columns])
            normal /= np.sqrt(np.einsum("ij,ij->i", normal, normal))[:, None]
        own = (pose.own(np.stack([x, y, z.astype(np.float32)], axis=1)) - self.centre) @ self.turn
        _lay(
            canvas,
            pose,
            rows + y0,
            columns + x0,
            z.astype(np.float32),
            normal.astype(np.float32),
            (own[:, 0], own[:, 1]),
            self.paint,
            self.finish,
        )


@dataclass(frozen=True)
class Tube:
    """A line of `points` (N, 3) as thick as `radius` (N,), own units; v runs 0..1 along it."""

    points: Array
    radius: Array
    paint: Paint
    finish: Finish = DULL

    def hull(self) -> Array:
        most = float(self.radius.max())
        return np.concatenate([self.points + most * d for d in np.vstack([np.eye(3), -np.eye(3)])]).astype(
            np.float32
        )

    def draw(self, canvas: Canvas, pose: Pose) -> None:
        line = pose.apply(self.points)
        length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
        count = max(2, int(length[-1] * 1.5) + 2)
        at = np.linspace(0, length[-1], count)
        if length[-1] < 0.5:
            at, length = np.linspace(0, 1, count), np.linspace(0, 1, len(line))
        path = np.stack([np.interp(at, length, line[:, k]) for k in range(3)], axis=1).astype(np.float32)
        thick = np.maximum(np.interp(at, length, self.radius) * pose.scale, 0.7).astype(np.float32)
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
        nearest[np.round(path[order, 1]).astype(int) - y0, np.round(path[order, 0]).astype(int) - x0] = (
            order + 1
        )
        away, label = cv2.distanceTransformWithLabels(
            (nearest == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
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
        dx, dy = (columns + x0).astype(np.float32) - path[k, 0], (rows + y0).astype(np.float32) - path[k, 1]
        left = thick[k] ** 2 - dx * dx - dy * dy
        keep = left > 0
        rows, columns, k, dx, dy = rows[keep], columns[keep], k[keep], dx[keep], dy[keep]
        rise = np.sqrt(left[keep])
        normal = np.stack([dx, dy, rise], axis=1) / thick[k][:, None]
        v = (k / (count - 1)).astype(np.float32)
        _lay(
            canvas, pose, rows + y0, columns + x0, (path[k, 2] + rise).astype(np.float32), normal.astype(np.float32),
            (np.zeros_like(v), v), self.paint, self.finish,
        )  # fmt: skip
