"""Solids with flat faces, drawn analytically: boxes, and slabs cut along an outline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from .canvas import Canvas, Finish, Pose
from .hand import Array
from .surface import CORNERS, DULL, Paint, lay, origin, straight, unit


@dataclass(frozen=True)
class Box:
    """A cuboid of half-sizes `half` about `centre`, turned by `turn` (3, 3) in own axes; faces painted over u, v in -1..1."""

    centre: Array
    half: Array
    front: Paint
    side: Paint | None = None
    top: Paint | None = None
    finish: Finish = DULL
    turn: Array = field(default_factory=straight)
    bevel: float = 0.05

    def hull(self) -> Array:
        return self.centre + (CORNERS * self.half) @ self.turn.T

    def draw(self, canvas: Canvas, pose: Pose) -> None:
        axes = (
            (pose.turn @ self.turn) * self.half * pose.scale
        )  # columns: half-edges in px
        middle = pose.apply(self.centre[None])[0]
        for k, paint in (
            (0, self.side or self.front),
            (1, self.top or self.front),
            (2, self.front),
        ):
            sign = 1.0 if axes[2, k] > 0 else -1.0
            if abs(axes[2, k]) < 1e-3 * np.linalg.norm(axes[:, k]):
                continue
            across, up = (
                (axes[:, (k + 1) % 3], axes[:, (k + 2) % 3])
                if k != 2
                else (axes[:, 0], axes[:, 1])
            )
            if k == 0:
                across, up = axes[:, 2], axes[:, 1]
            if k == 1:
                across, up = axes[:, 0], axes[:, 2]
            self._face(
                canvas,
                pose,
                middle + sign * axes[:, k],
                across,
                up,
                sign * axes[:, k],
                paint,
            )

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
        quad = np.stack(
            [
                centre + a * across + b * up
                for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
            ]
        )
        x0, y0, x1, y1 = canvas.window(quad.min(axis=0), quad.max(axis=0))
        det = float(across[0] * up[1] - across[1] * up[0])
        if x1 <= x0 or y1 <= y0 or abs(det) < 1e-3:
            return
        mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
        cv2.fillConvexPoly(
            mask,
            np.round((quad[:, :2] - [x0, y0]) * 16).astype(np.int32),
            1,
            cv2.LINE_8,
            4,
        )
        rows, columns = np.nonzero(mask)
        dx, dy = (
            (columns + (x0 - centre[0])).astype(np.float32),
            (rows + (y0 - centre[1])).astype(np.float32),
        )
        u, v = (
            (dx * up[1] - dy * up[0]) / np.float32(det),
            (dy * across[0] - dx * across[1]) / np.float32(det),
        )
        normal = np.repeat(unit(outward)[None], len(rows), axis=0)
        if self.bevel > 0:
            for s, edge in ((u, across), (v, up)):
                over = (
                    np.maximum(np.abs(s) - (1 - self.bevel), 0)
                    / self.bevel
                    * np.sign(s)
                )
                normal = normal + (0.8 * over[:, None] * unit(edge)).astype(np.float32)
            normal /= np.sqrt(np.einsum("ij,ij->i", normal, normal))[:, None]
        z = (centre[2] + u * across[2] + v * up[2]).astype(np.float32)
        lay(
            canvas, pose, rows + y0, columns + x0, z, normal, (u, v), paint, self.finish
        )


@dataclass(frozen=True)
class Slab:
    """A plate cut along `outline` (N, 2), with `holes`, in the plane `turn` makes of x and y; u, v are its own x, y."""

    outline: Array
    thickness: float
    paint: Paint
    rim: Paint | None = None
    finish: Finish = DULL
    holes: Sequence[Array] = ()
    centre: Array = field(default_factory=origin)
    turn: Array = field(default_factory=straight)
    puff: float = 0.0
    """Own units over which the face bends away at its edges."""

    def _corners(self, outline: Array, z: float) -> Array:
        flat = np.column_stack([outline, np.full(len(outline), z)])
        return (self.centre + flat @ self.turn.T).astype(np.float32)

    def hull(self) -> Array:
        return np.concatenate(
            [self._corners(self.outline, s * self.thickness / 2) for s in (-1, 1)]
        )

    def draw(self, canvas: Canvas, pose: Pose) -> None:
        facing = unit(pose.turn @ self.turn[:, 2])
        sign = 1.0 if facing[2] > 0 else -1.0
        loops = [self.outline, *self.holes]
        near = [
            pose.apply(self._corners(loop, sign * self.thickness / 2)) for loop in loops
        ]
        far = [
            pose.apply(self._corners(loop, -sign * self.thickness / 2))
            for loop in loops
        ]
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
                index,
                np.round((wall[:, :2] - shift) * 16).astype(np.int32),
                k + 1,
                cv2.LINE_8,
                4,
            )
        face = np.zeros(index.shape, np.uint8)
        cv2.fillPoly(
            face,
            [np.round((n[:, :2] - shift) * 16).astype(np.int32) for n in near],
            1,
            cv2.LINE_8,
            4,
        )
        self._walls(canvas, pose, np.where(face > 0, 0, index), walls, x0, y0)
        if abs(facing[2]) > 1e-2:
            self._face(canvas, pose, face, sign * facing, near[0][0], x0, y0)

    def _walls(
        self,
        canvas: Canvas,
        pose: Pose,
        index: Array,
        walls: list[Array],
        x0: int,
        y0: int,
    ) -> None:
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
        z = np.clip(
            z, stack[which, :, 2].min(axis=1), stack[which, :, 2].max(axis=1)
        ).astype(np.float32)
        zero = np.zeros(len(rows), np.float32)
        lay(
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
        self,
        canvas: Canvas,
        pose: Pose,
        face: Array,
        facing: Array,
        corner: Array,
        x0: int,
        y0: int,
    ) -> None:
        rows, columns = np.nonzero(face)
        if not len(rows):
            return
        x, y = (columns + x0).astype(np.float32), (rows + y0).astype(np.float32)
        z = (
            corner[2]
            - (facing[0] * (x - corner[0]) + facing[1] * (y - corner[1])) / facing[2]
        )
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
            normal[:, 0] -= (
                bend * (cv2.Sobel(soft, cv2.CV_32F, 1, 0, scale=0.125)[rows, columns])
            )
            normal[:, 1] -= (
                bend * (cv2.Sobel(soft, cv2.CV_32F, 0, 1, scale=0.125)[rows, columns])
            )
            normal /= np.sqrt(np.einsum("ij,ij->i", normal, normal))[:, None]
        own = (
            pose.own(np.stack([x, y, z.astype(np.float32)], axis=1)) - self.centre
        ) @ self.turn
        lay(
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
