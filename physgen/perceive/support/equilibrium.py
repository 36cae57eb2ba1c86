"""Static equilibrium of objects under gravity, contact forces and Coulomb friction.

An object is at rest if forces at its contacts, each within its cone of Coulomb
friction, can balance its weight and the forces of its neighbours (Palmer 1987, The
complexity of simple mechanisms; Whiting et al. 2009, masonry). This is a least-squares
problem with forces that only push, solved by an interior point method (Wright 1997,
Primal-dual interior-point methods). Coordinates are image axes, px; weight is
proportional to area.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import (
    Array,
    Disc,
    MassProperties,
    Outline,
    bounds,
    cross,
    mass_properties,
)

TILTED = np.radians(1.0)
"""Angle by which the photo may be rotated before an object falls."""
UNHELD = 0.004
"""Tolerated unbalanced share of its weight, because outlines have errors of a fraction
of a pixel.
"""
MANY = 32
"""Objects in one pile above which several are held at a time, without a later check."""


@dataclass(frozen=True)
class _Limits:
    """Limits of contacts and iterations."""

    # px: largest gap between touching surfaces; such gaps are invisible.
    touch: float = 0.6
    # px, or a fifth of a face: uncertainty of the ends of a face.
    inner: float = 1.5
    # Sine of the angle by which a surface on top of another faces down.
    overhead: float = 0.3
    # Half the contact spot of a ball, as a share of its radius; more than the tangent
    # of TILTED.
    spot: float = 0.04
    # Least cosine between normals of contacts on one face.
    one_face: float = float(np.cos(np.radians(12.0)))
    # Rounds in which some objects of a large pile are held; after them all unbalanced
    # ones are held.
    hold_rounds: int = 8
    # Largest number of steps of the interior point method.
    passes: int = 60
    # Accuracy of complementarity and gradient, far below UNHELD.
    accuracy: float = 1e-7
    # Ratio to the least error so far at which rounding dominates.
    divergence: float = 1e3
    # Share of the way to the border of the feasible region.
    step: float = 0.99


LIMITS = _Limits()
Pairs = NDArray[np.int64]
Friction = Mapping[tuple[int, int], float]


@dataclass(frozen=True, eq=False)
class Contact:
    """A contact between an object and another object or a wall."""

    # Index of its outline.
    body: int
    # Index of the other outline; -1 for a wall.
    other: int
    point: Array  # (2,) px
    # (2,) unit, from the other object into the body.
    normal: Array


def contacts(outlines: Sequence[Outline], walls: Sequence[Array]) -> list[Contact]:
    """Return contacts between outlines, and of outlines with walls, each `(K, 2)`
    px.
    """
    boxes = np.array(list(map(bounds, outlines))).reshape(-1, 4)
    result: list[Contact] = []
    wall_hits = [wall_contacts(outlines, boxes, wall) for wall in walls]
    for i, outline in enumerate(outlines):
        for j in _find_close_boxes(boxes[i + 1 :], boxes[i]):
            result += _face_ends(i, i + 1 + j, _touches(outline, outlines[i + 1 + j]))
        result += [
            contact for wall in wall_hits for contact in wall if contact.body == i
        ]
    return result


def wall_contacts(
    outlines: Sequence[Outline], boxes: Array, wall: Array
) -> list[Contact]:
    """Return the contacts of outlines with one wall `(K, 2)` px.

    `boxes` (N, 4) are the outlines' `bounds`.
    """
    result: list[Contact] = []
    for i in _find_close_boxes(
        boxes, np.concatenate([wall.min(axis=0), wall.max(axis=0)])
    ):
        result += _face_ends(
            i, -1, _on_chain(outlines[i], wall, mass_properties(outlines[i]).center)
        )
    return result


def unstable_objects(
    outlines: Sequence[Outline],
    contacts: Sequence[Contact],
    friction: Friction,
    held_ids: Collection[int] = (),
    default: float = 0.3,
    cache: dict[tuple[object, ...], list[int]] | None = None,
) -> list[int]:
    """Return the indices of objects to hold so that all others are at rest, lowest
    first.

    `friction` gives coefficients of pairs (body, other) if they differ from `default`;
    objects `held_ids` are held already. `cache` keeps the results of groups for calls
    with the same contacts and the same friction.
    """
    free_ids = []
    for i in range(len(outlines)):
        if i not in held_ids:
            free_ids.append(i)
    contacts = [c for c in contacts if not _check_fixed_on_top(c, held_ids)]
    masses = {i: mass_properties(outlines[i]) for i in free_ids}
    discs = {i: o.radius for i in free_ids if isinstance(o := outlines[i], Disc)}
    if cache is None:
        cache = {}
    unstable_ids: list[int] = []
    for group, group_contacts in _split_contacts(free_ids, contacts):
        key = (*group, *group_contacts)
        if key not in cache:
            forces = _Forces(masses, group_contacts, friction, default, discs)
            cache[key] = _choose_held(group, forces)
        unstable_ids += cache[key]
    return sorted(unstable_ids, key=lambda i: -float(masses[i].center[1]))


def _split_contacts(
    ids: Sequence[int], contacts: Sequence[Contact]
) -> list[tuple[list[int], list[Contact]]]:
    """Return groups of objects that touch, each with its contacts."""
    groups = _groups(ids, contacts)
    group_of = {i: k for k, group in enumerate(groups) for i in group}
    parts: list[list[Contact]] = [[] for _ in groups]
    for contact in contacts:
        k = group_of.get(contact.body, group_of.get(contact.other))
        if k is not None:
            parts[k].append(contact)
    return list(zip(groups, parts, strict=True))


def _choose_held(group: Sequence[int], forces: _Forces) -> list[int]:
    """Return objects of a group to hold."""
    if len(group) <= MANY:
        return _choose_held_of_few(group, forces)
    return _choose_held_of_many(group, forces)


def _choose_held_of_few(group: Sequence[int], forces: _Forces) -> list[int]:
    """Return a minimal set of objects of a group to hold, found one by one."""
    held_ids: list[int] = []
    while unbalanced_ids := forces.worst_first(
        forces.residual([i for i in group if i not in held_ids])
    ):
        held_ids.append(unbalanced_ids[0])
    # An object may be released if the others, held later, suffice.
    for i in list(held_ids):
        if len(held_ids) > 1:
            rest = forces.residual([k for k in group if k not in held_ids or k == i])
            if all(value <= UNHELD for value in rest.values()):
                held_ids.remove(i)
    return held_ids


def _choose_held_of_many(group: Sequence[int], forces: _Forces) -> list[int]:
    """Return objects of a large group to hold.

    Each round holds all unbalanced objects that do not touch each other.
    """
    neighbours: dict[int, set[int]] = {i: set() for i in group}
    for contact in forces.contacts:
        if contact.body in neighbours and contact.other in neighbours:
            neighbours[contact.body].add(contact.other)
            neighbours[contact.other].add(contact.body)
    held_ids: set[int] = set()
    for _ in range(LIMITS.hold_rounds):
        unbalanced_ids = forces.worst_first(
            forces.residual([i for i in group if i not in held_ids])
        )
        if not unbalanced_ids:
            return [i for i in group if i in held_ids]
        new: set[int] = set()
        for i in unbalanced_ids:
            if not neighbours[i] & new:
                new.add(i)
        held_ids |= new
    rest = forces.residual([i for i in group if i not in held_ids])
    return [i for i in group if i in held_ids or rest[i] > UNHELD]


def _check_fixed_on_top(contact: Contact, held_ids: Collection[int]) -> bool:
    """Return whether a fixed object lies on top.

    It might jam an object, but has no weight to press it down.
    """
    if contact.other < 0 or contact.other in held_ids:
        return bool(contact.normal[1] > LIMITS.overhead)
    return contact.body in held_ids and bool(-contact.normal[1] > LIMITS.overhead)


def _groups(ids: Sequence[int], contacts: Sequence[Contact]) -> list[list[int]]:
    """Return groups of objects that touch, directly or through others."""
    root = {i: i for i in ids}

    def top(i: int) -> int:
        while root[i] != i:
            root[i] = i = root[root[i]]
        return i

    for contact in contacts:
        if contact.body in root and contact.other in root:
            root[top(contact.body)] = top(contact.other)
    groups: dict[int, list[int]] = {}
    for i in ids:
        groups.setdefault(top(i), []).append(i)
    return list(groups.values())


# Contacts of outlines.


def _find_close_boxes(boxes: Array, box: Array) -> list[int]:
    """Return the indices of the boxes `(N, 4)` that may touch one box."""
    separation = (boxes[:, :2] >= box[2:] + LIMITS.touch) | (
        box[:2] >= boxes[:, 2:] + LIMITS.touch
    )
    return list(map(int, np.flatnonzero(~separation.any(axis=1))))


def _touches(a: Outline, b: Outline) -> list[tuple[Array, Array]]:
    """Return contact points, and normals from b into a."""
    if isinstance(a, Disc) and isinstance(b, Disc):
        way = a.center - b.center
        length = max(float(np.hypot(*way)), 1e-9)
        if length - a.radius - b.radius > LIMITS.touch:
            return []
        return [(b.center + way / length * b.radius, way / length)]
    if isinstance(a, Disc):
        return [hit for points in _rings(b) for hit in _disc_on(a, points)]
    if isinstance(b, Disc):
        return [(p, -n) for points in _rings(a) for p, n in _disc_on(b, points)]
    hits = []
    for ring in _rings(a):
        for other in _rings(b):
            hits.extend(_corners_on(ring, other))
    return hits + [
        (p, -n)
        for ring in _rings(a)
        for other in _rings(b)
        for p, n in _corners_on(other, ring)
    ]


def _rings(outline: Outline) -> list[Array]:
    """Return closed rings with the inside on the right of every edge (+x turns to
    +y).
    """
    assert not isinstance(outline, Disc)
    rings = []
    for ring in outline.rings:
        points = ring.outer
        x, y = points.T
        double_area = float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
        points = points if double_area > 0 else points[::-1]
        rings.append(np.concatenate([points, points[:1]]))
    return rings


def _disc_on(disc: Disc, chain: Array) -> list[tuple[Array, Array]]:
    """Return contact points of a disc on the edges of a chain, and normals into the
    disc.
    """
    nearest, offsets = _closest(
        disc.center[None], np.stack([chain[:-1], chain[1:]], axis=1)
    )
    hits = []
    for k in np.flatnonzero(
        np.hypot(*offsets[0].T) <= disc.radius + LIMITS.touch
    ).tolist():
        length = float(np.hypot(*offsets[0, k]))
        # Points near the centre would mean that the outlines overlap deeply.
        if length > 0.5 * disc.radius:
            hits.append((nearest[0, k], offsets[0, k] / length))
    return hits


def _corners_on(points: Array, chain: Array) -> list[tuple[Array, Array]]:
    """Return corners of one closed chain on edges of another, with the other's
    normals.
    """
    low = points.min(axis=0) - LIMITS.touch - 1
    high = points.max(axis=0) + LIMITS.touch + 1
    # Only edges near the box of the points can be touched.
    edges = np.flatnonzero(
        (np.maximum(chain[:-1], chain[1:]) >= low).all(1)
        & (np.minimum(chain[:-1], chain[1:]) <= high).all(1)
    )
    if not len(edges):
        return []
    hits = []
    segments = np.stack([chain[edges], chain[edges + 1]], axis=1)
    nearest, offsets = _closest(points[:-1], segments)
    length = np.hypot(offsets[..., 0], offsets[..., 1])
    for i in np.flatnonzero(length.min(axis=1) <= LIMITS.touch).tolist():
        k = int(length[i].argmin())
        edge = segments[k, 1] - segments[k, 0]
        run = float(np.hypot(*edge))
        if run > 1e-9:
            hits.append((nearest[i, k], np.array([edge[1], -edge[0]]) / run))
    return hits


def _on_chain(
    outline: Outline, chain: Array, center: Array
) -> list[tuple[Array, Array]]:
    """Return contact points of an outline on an open chain.

    Normals point to the side with the outline's centre.
    """
    if isinstance(outline, Disc):
        return _disc_on(outline, chain)
    hits = []
    closed_chain = np.concatenate([chain, chain[-1:]])
    for ring in _rings(outline):
        hits += _corners_on(ring, chain) + [
            (p, -n) for p, n in _corners_on(closed_chain, ring)
        ]
    return [(p, n if (center - p) @ n >= 0 else -n) for p, n in hits]


def _closest(points: Array, segments: Array) -> tuple[Array, Array]:
    """Return the points of segments `(M, 2, 2)` nearest to points `(N, 2)`, and the
    offsets from them.

    Both results are `(N, M, 2)`.
    """
    start = segments[:, 0]
    edges = segments[:, 1] - segments[:, 0]
    offsets = points[:, None] - start[None]
    share = np.clip(
        (offsets * edges).sum(-1) / np.maximum((edges**2).sum(-1), 1e-12), 0, 1
    )
    nearest = start[None] + share[..., None] * edges[None]
    return nearest, points[:, None] - nearest


def _face_ends(i: int, j: int, hits: Sequence[tuple[Array, Array]]) -> list[Contact]:
    """Return the two ends of the hits on each face, moved inwards by their
    uncertainty.
    """
    left = list(hits)
    result = []
    while left:
        normal = left[0][1]
        face = []
        for hit in left:
            if hit[1] @ normal >= LIMITS.one_face:
                face.append(hit)
        left = [hit for hit in left if hit[1] @ normal < LIMITS.one_face]
        positions = [cross(normal, p) for p, _ in face]
        first = face[int(np.argmin(positions))]
        last = face[int(np.argmax(positions))]
        if len(face) == 1:
            result.append(Contact(i, j, *first))
            continue
        way = last[0] - first[0]
        inset = way * min(0.2, LIMITS.inner / max(float(np.hypot(*way)), 1e-9))
        result += [
            Contact(i, j, first[0] + inset, first[1]),
            Contact(i, j, last[0] - inset, last[1]),
        ]
    return result


# Balance of forces.


@dataclass(frozen=True, eq=False)
class _Forces:
    """The possible forces in a group of objects."""

    masses: Mapping[int, MassProperties]
    contacts: Sequence[Contact]
    friction: Friction
    default: float
    # Radii by index, px.
    discs: Mapping[int, float]

    def worst_first(self, rest: Mapping[int, float]) -> list[int]:
        """Return the unbalanced objects, the least balanced of the lowest first.

        Objects on top may only lack the support of the lower ones.
        """
        unbalanced_ids = []
        for i in rest:
            if rest[i] > UNHELD:
                unbalanced_ids.append(i)
        return sorted(
            unbalanced_ids,
            key=lambda i: -(float(self.masses[i].center[1]) + 4 * rest[i]),
        )

    def residual(self, free: Sequence[int]) -> dict[int, float]:
        """Return the unbalanced share of each object's weight, or of a torque of weight
        times size.

        It is the worst value of a level photo and of one tilted slightly either way,
        because an object in a labile balance will fall.
        """
        pairs, parts = self._columns(free)
        worst = np.zeros(len(free))
        for tilt in (0.0, -TILTED, TILTED):
            weights = np.tile([-np.sin(tilt), -np.cos(tilt), 0.0], (len(free), 1))
            rest = unbalanced_forces(pairs, parts, weights)
            worst = np.maximum(worst, np.abs(rest).max(axis=1))
        return dict(zip(free, worst.tolist(), strict=True))

    def _columns(self, free: Sequence[int]) -> tuple[Pairs, Array]:
        """Return the edges of every friction cone as pairs (M, 2) and columns (M, 2,
        3).

        Pairs are the positions of both objects in `free`, -1 for none; columns are the
        force and torque on each.
        """
        positions = {i: k for k, i in enumerate(free)}
        pairs, columns = [], []
        for contact in self.contacts:
            if contact.body not in positions and contact.other not in positions:
                continue
            pair = [positions.get(i, -1) for i in (contact.body, contact.other)]
            for point, force in self._cone_edges(contact):
                column = self._column(contact, point, force, positions)
                pairs.append(pair)
                columns.append(column / max(np.abs(column).max(), 1e-12))
        return np.array(pairs, np.int64).reshape(-1, 2), np.array(columns).reshape(
            -1, 2, 3
        )

    def _cone_edges(self, contact: Contact) -> list[tuple[Array, Array]]:
        """Return points and forces on the body at the edges of a friction cone."""
        pair = (contact.body, contact.other)
        mu = self.friction.get(pair, self.default)
        tangent = np.array([-contact.normal[1], contact.normal[0]])
        # A round object rests on a spot rather than a point, except on another
        # round object.
        radii = []
        for i in pair:
            if i in self.discs:
                radii.append(self.discs[i])
        if len(radii) == 1:
            spot = LIMITS.spot * radii[0]
        else:
            spot = 0.0
        result: list[tuple[Array, Array]] = []
        for shift in (-spot, spot) if spot else (0.0,):
            for way in (-mu, mu):
                result.append(
                    (contact.point + shift * tangent, contact.normal + way * tangent)
                )
        return result

    def _column(
        self,
        contact: Contact,
        point: Array,
        force: Array,
        positions: Mapping[int, int],
    ) -> Array:
        """Return force and torque (2, 3) on both objects of a contact."""
        column = np.zeros((2, 3))
        for k, (i, sign) in enumerate(((contact.body, 1.0), (contact.other, -1.0))):
            if i in positions:
                mass = self.masses[i]
                arm = (point - mass.center) / np.sqrt(mass.area)
                part = np.array([force[0], force[1], cross(arm, force)])
                column[k] = sign * part / mass.area
        return column


def unbalanced_forces(pairs: Pairs, parts: Array, target: Array) -> Array:
    """Return `target` (N, 3) minus matrix x, for the x >= 0 with the least residual.

    Each column of the matrix holds `parts` (M, 2, 3) at two of the N objects, given by
    `pairs` (M, 2); -1 is none. The method is Mehrotra's predictor-corrector method.
    Objects are ordered in layers that touch only the next layer, so that every system
    is block tridiagonal.
    """
    if not len(pairs):
        return target
    columns = _ForceColumns(len(target), pairs, parts)
    x = np.ones(len(pairs))
    s = np.ones(len(pairs))
    best = residual = target.ravel() - columns.combine(x)
    least_error = np.inf
    for _ in range(LIMITS.passes):
        # The gradient of the dual problem and the complementarity gap measure the
        # error.
        slope = -columns.project(residual) - s
        error = max(float((x * s).mean()), float(np.abs(slope).max()))
        if error < least_error:
            best = residual
            least_error = error
        if least_error < LIMITS.accuracy or error > LIMITS.divergence * least_error:
            break
        dx, ds = columns.find_step(x, s, slope)
        # Both variables take one common step, since the gradient depends on x as well.
        step = min(1.0, LIMITS.step * min(_longest_step(x, dx), _longest_step(s, ds)))
        x = x + step * dx
        s = s + step * ds
        residual = target.ravel() - columns.combine(x)
    return best.reshape(-1, 3)


class _ForceColumns:
    """The matrix of `unbalanced_forces` and the steps towards its solution."""

    def __init__(self, count: int, pairs: Pairs, parts: Array) -> None:
        self.count = count
        self.parts = parts
        objects = np.where(pairs < 0, count, pairs)
        self.rows = 3 * objects[:, :, None] + np.arange(3)
        self.system = _System(count, pairs, parts)

    def combine(self, x: Array) -> Array:
        """Return the matrix times x (M,)."""
        products = (self.parts * x[:, None, None]).ravel()
        size = 3 * self.count + 3
        return np.asarray(
            np.bincount(self.rows.ravel(), products, size)[:-3], np.float64
        )

    def project(self, y: Array) -> Array:
        """Return the transpose of the matrix times y (3 N,)."""
        return np.asarray(
            (self.parts * np.append(y, np.zeros(3))[self.rows]).sum((1, 2))
        )

    def find_step(self, x: Array, s: Array, slope: Array) -> tuple[Array, Array]:
        """Return the predictor-corrector step of x and of its dual variable s."""
        gap = float((x * s).mean())
        scale = x / s
        self.system.factor(scale)
        # Predictor: a step towards the solution without centring.
        dx = self._solve(scale, -slope - s)
        ds = -s - dx / scale
        a = _longest_step(x, dx)
        b = _longest_step(s, ds)
        # Corrector: centre as far as the predictor fell short, with a second-order
        # term.
        predicted_x = x + a * dx
        predicted_s = s + b * ds
        predicted_gap = float((predicted_x * predicted_s).mean())
        middle = gap * (predicted_gap / gap) ** 3
        right = middle - x * s - a * b * dx * ds
        dx = self._solve(scale, -slope + right / x)
        return dx, (right - s * dx) / x

    def _solve(self, scale: Array, right: Array) -> Array:
        """Return the step of x for a right-hand side."""
        step = self._solve_once(scale, right)
        # Large weights cause rounding errors: add one step of iterative refinement.
        error = right - self.project(self.combine(step)) - step / scale
        return step + self._solve_once(scale, error)

    def _solve_once(self, scale: Array, right: Array) -> Array:
        solution = self.system.solve(self.combine(scale * right))
        return scale * (right - self.project(solution))


def _longest_step(x: Array, way: Array) -> float:
    """Return the share of a step, at most 1, before an entry of x turns negative."""
    down = way < 0
    if down.any():
        return min(1.0, float((-x[down] / way[down]).min()))
    return 1.0


class _System:
    """The matrix I + A diag(weights) A^T, factored layer by layer."""

    def __init__(self, count: int, pairs: Pairs, parts: Array) -> None:
        self.size = 3 * count + 3
        layers = _layers(count, pairs)
        self.ends = np.cumsum([0, *map(len, layers)]) * 3
        order = np.concatenate(layers)
        place = np.empty(count + 1, np.int64)
        place[order], place[count] = np.arange(count), count
        rows = (
            3 * place[np.where(pairs < 0, count, pairs)][:, :, None] + np.arange(3)
        ).reshape(-1, 6)
        self.rows = (3 * order[:, None] + np.arange(3)).ravel()
        flat_parts = parts.reshape(-1, 6)
        row_index, column_index = np.broadcast_arrays(
            rows[:, :, None], rows[:, None, :]
        )
        self.at, self.entry = np.unique(
            (row_index * self.size + column_index).ravel(), return_inverse=True
        )
        self.products = (flat_parts[:, :, None] * flat_parts[:, None, :]).reshape(
            -1, 36
        )

    def factor(self, weights: Array) -> None:
        """Factor the matrix for new weights by block elimination."""
        flat_matrix = np.zeros(self.size**2)
        entries = (self.products * weights[:, None]).ravel()
        flat_matrix[self.at] = np.bincount(self.entry.ravel(), entries, len(self.at))
        matrix = flat_matrix.reshape(self.size, self.size)[:-3, :-3]
        matrix[np.diag_indices(self.size - 3)] += 1
        # Keep, for each layer, the inverse of its Schur complement and its coupling to
        # the next layer.
        self.steps: list[tuple[Array, Array]] = []
        ends = [*self.ends.tolist(), self.size - 3]
        left = matrix[: ends[1], : ends[1]]
        for k in range(len(ends) - 2):
            inverse = np.asarray(np.linalg.inv(left), np.float64)
            block = slice(ends[k], ends[k + 1])
            after = slice(ends[k + 1], ends[k + 2])
            coupling = matrix[block, after]
            self.steps.append((inverse, coupling))
            left = matrix[after, after] - coupling.T @ inverse @ coupling

    def solve(self, right: Array) -> Array:
        """Solve the factored system for one right-hand side."""
        # Forward elimination, then back substitution, over the layers.
        parts = np.split(right[self.rows], self.ends[1:-1].tolist())
        for k, (inverse, coupling) in enumerate(self.steps[:-1]):
            parts[k + 1] = parts[k + 1] - coupling.T @ (inverse @ parts[k])
        parts[-1] = self.steps[-1][0] @ parts[-1]
        for k in range(len(parts) - 2, -1, -1):
            inverse, coupling = self.steps[k]
            parts[k] = inverse @ (parts[k] - coupling @ parts[k + 1])
        result = np.empty(len(right))
        result[self.rows] = np.concatenate(parts)
        return result


def _layers(count: int, pairs: Pairs) -> list[Pairs]:
    """Return objects in layers by their distance, in contacts, from an end of their
    group.

    Each layer touches only the next one.
    """
    neighbours: list[set[int]] = [set() for _ in range(count)]
    for a, b in np.unique(pairs, axis=0).tolist():
        if a >= 0 and b >= 0:
            neighbours[a].add(b)
            neighbours[b].add(a)

    def find_shells(start: int) -> list[list[int]]:
        visited_ids = {start}
        shells = [[start]]
        while after := sorted(
            {j for i in shells[-1] for j in neighbours[i]} - visited_ids
        ):
            visited_ids.update(after)
            shells.append(after)
        return shells

    layers: list[Pairs] = []
    left = set(range(count))
    while left:
        # The last object of a first search lies at an end of the group.
        object_layers = find_shells(find_shells(min(left))[-1][0])
        layers += [np.array(layer, np.int64) for layer in object_layers]
        left.difference_update(*object_layers)
    return layers
