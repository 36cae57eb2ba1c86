"""Static equilibrium of objects under gravity, contact forces and Coulomb friction.

An object stands where forces at its contacts, each within its cone of Coulomb friction,
can balance its weight and its neighbours' (Palmer 1987, The complexity of simple
mechanisms; Whiting et al. 2009, masonry): a least-squares problem with forces that only
push, solved by an interior point method (Wright 1997, Primal-dual interior-point
methods). Image axes, px; weight is proportional to area.
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
"""Angle by which the photo may be turned without anything falling."""
UNHELD = 0.004
"""Share of its weight that may stay unbalanced, for outlines that are off by a part of
a pixel.
"""
MANY = 32
"""Objects in one pile, beyond which several of them are held at a time, and for good.
"""


@dataclass(frozen=True)
class _Limits:
    """Contacts and iterations."""

    touch: float = 0.6  # px between surfaces that still touch: gaps that close unseen
    inner: float = 1.5  # px, or a fifth of a face, by which its ends may be off
    # sine of the angle by which a surface that lies above what it touches faces down
    overhead: float = 0.3
    # of its radius: half of the spot a ball rests on; more than the tangent of TILTED
    spot: float = 0.04
    # cosine between normals of contacts on one face
    one_face: float = float(np.cos(np.radians(12.0)))
    # in which some of a large pile are held, after which all are that do not stand yet
    hold_rounds: int = 8
    passes: int = 60  # of the interior point method
    accuracy: float = 1e-7  # of complementarity and gradient: far below UNHELD
    diverged: float = 1e3  # times the least error so far: rounding dominates
    step: float = 0.99  # share of the way to the border of what is allowed


LIMITS = _Limits()
Pairs = NDArray[np.int64]
Friction = Mapping[tuple[int, int], float]


@dataclass(frozen=True, eq=False)
class Contact:
    """Where one object rests against another, or against a wall."""

    body: int  # Index of its outline
    other: int  # The same; -1 a wall
    point: Array  # (2,) px
    normal: Array  # (2,) unit, from the other into the body


def contacts(outlines: Sequence[Outline], walls: Sequence[Array]) -> list[Contact]:
    """Contacts between outlines, and of outlines with walls, each `(K, 2)` px."""
    boxes = np.array([bounds(outline) for outline in outlines]).reshape(-1, 4)
    found: list[Contact] = []
    on = [wall_contacts(outlines, boxes, wall) for wall in walls]
    for i, outline in enumerate(outlines):
        for j in _near(boxes[i + 1 :], boxes[i]):
            found += _face_ends(i, i + 1 + j, _touches(outline, outlines[i + 1 + j]))
        found += [contact for wall in on for contact in wall if contact.body == i]
    return found


def wall_contacts(
    outlines: Sequence[Outline], boxes: Array, wall: Array
) -> list[Contact]:
    """Contacts of outlines, with their `bounds` in `boxes` (N, 4), with one wall `(K,
    2)` px.
    """
    found: list[Contact] = []
    for i in _near(boxes, np.concatenate([wall.min(axis=0), wall.max(axis=0)])):
        found += _face_ends(
            i, -1, _on_chain(outlines[i], wall, mass_properties(outlines[i]).center)
        )
    return found


def unstable_objects(
    outlines: Sequence[Outline],
    found: Sequence[Contact],
    friction: Friction,
    fixed: Collection[int] = (),
    default: float = 0.3,
    known: dict[tuple[object, ...], list[int]] | None = None,
) -> list[int]:
    """Indices of the objects that cannot stand still, lowest first: hold them and all
    else stands.

    `friction` of pairs (body, other) that is not `default`; `fixed` are held already.
    `known` caches the result of each group of objects that touch, for a call with some
    of the same contacts and the same friction.
    """
    everyone = [i for i in range(len(outlines)) if i not in fixed]
    found = [c for c in found if not _from_above(c, fixed)]
    masses = {i: mass_properties(outlines[i]) for i in everyone}
    discs = {i: o.radius for i in everyone if isinstance(o := outlines[i], Disc)}
    known = {} if known is None else known
    unstable: list[int] = []
    groups = _groups(everyone, found)
    within = {i: k for k, group in enumerate(groups) for i in group}
    parts: list[list[Contact]] = [[] for _ in groups]
    for contact in found:
        k = within.get(contact.body, within.get(contact.other))
        if k is not None:
            parts[k].append(contact)
    for group, part in zip(groups, parts, strict=True):
        key = (*group, *part)
        if key not in known:
            forces = _Forces(masses, part, friction, default, discs)
            known[key] = (
                _held(group, forces)
                if len(group) <= MANY
                else _held_of_many(group, forces)
            )
        unstable += known[key]
    return sorted(unstable, key=lambda i: -float(masses[i].center[1]))


def _held(group: Sequence[int], forces: _Forces) -> list[int]:
    """Return the fewest of a group that must be held, found one by one."""
    held: list[int] = []
    while bad := forces.worst_first(
        forces.residual([i for i in group if i not in held])
    ):
        held.append(bad[0])
    for i in list(held):
        if len(held) > 1:
            rest = forces.residual([k for k in group if k not in held or k == i])
            if all(value <= UNHELD for value in rest.values()):
                held.remove(i)
    return held


def _held_of_many(group: Sequence[int], forces: _Forces) -> list[int]:
    """Some of a group that must be held: each time all that do not touch each other."""
    beside: dict[int, set[int]] = {i: set() for i in group}
    for contact in forces.found:
        if contact.body in beside and contact.other in beside:
            beside[contact.body].add(contact.other)
            beside[contact.other].add(contact.body)
    held: set[int] = set()
    for _ in range(LIMITS.hold_rounds):
        bad = forces.worst_first(forces.residual([i for i in group if i not in held]))
        if not bad:
            return [i for i in group if i in held]
        new: set[int] = set()
        for i in bad:
            if not beside[i] & new:
                new.add(i)
        held |= new
    rest = forces.residual([i for i in group if i not in held])
    return [i for i in group if i in held or rest[i] > UNHELD]


def _from_above(contact: Contact, fixed: Collection[int]) -> bool:
    """Return whether a fixed object lies on top: it might jam an object, but has no
    weight to press it down.
    """
    if contact.other < 0 or contact.other in fixed:
        return bool(contact.normal[1] > LIMITS.overhead)
    return contact.body in fixed and bool(-contact.normal[1] > LIMITS.overhead)


def _groups(everyone: Sequence[int], found: Sequence[Contact]) -> list[list[int]]:
    """Objects that touch, directly or through others."""
    root = {i: i for i in everyone}

    def top(i: int) -> int:
        while root[i] != i:
            root[i] = i = root[root[i]]
        return i

    for contact in found:
        if contact.body in root and contact.other in root:
            root[top(contact.body)] = top(contact.other)
    groups: dict[int, list[int]] = {}
    for i in everyone:
        groups.setdefault(top(i), []).append(i)
    return list(groups.values())


# contacts of outlines


def _near(boxes: Array, box: Array) -> list[int]:
    """Indices of the boxes `(N, 4)` that may touch one."""
    apart = (boxes[:, :2] >= box[2:] + LIMITS.touch) | (
        box[:2] >= boxes[:, 2:] + LIMITS.touch
    )
    return [int(i) for i in np.flatnonzero(~apart.any(axis=1))]


def _touches(a: Outline, b: Outline) -> list[tuple[Array, Array]]:
    """Points, and normals from b into a."""
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
    hits = [
        hit
        for mine in _rings(a)
        for other in _rings(b)
        for hit in _corners_on(mine, other)
    ]
    return hits + [
        (p, -n)
        for mine in _rings(a)
        for other in _rings(b)
        for p, n in _corners_on(other, mine)
    ]


def _rings(outline: Outline) -> list[Array]:
    """Closed, the inside on the right of every edge as it turns +x towards +y."""
    assert not isinstance(outline, Disc)
    rings = []
    for ring in outline.rings:
        points = ring.outer
        x, y = points.T
        twice = float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
        points = points if twice > 0 else points[::-1]
        rings.append(np.concatenate([points, points[:1]]))
    return rings


def _disc_on(disc: Disc, chain: Array) -> list[tuple[Array, Array]]:
    at, off = _closest(disc.center[None], np.stack([chain[:-1], chain[1:]], axis=1))
    hits = []
    for k in np.flatnonzero(np.hypot(*off[0].T) <= disc.radius + LIMITS.touch).tolist():
        length = float(np.hypot(*off[0, k]))
        if length > 0.5 * disc.radius:
            hits.append((at[0, k], off[0, k] / length))
    return hits


def _corners_on(points: Array, chain: Array) -> list[tuple[Array, Array]]:
    """Corners of one closed chain on edges of another; the normals point out of the
    other.
    """
    low, high = (
        points.min(axis=0) - LIMITS.touch - 1,
        points.max(axis=0) + LIMITS.touch + 1,
    )
    edges = np.flatnonzero(
        (np.maximum(chain[:-1], chain[1:]) >= low).all(1)
        & (np.minimum(chain[:-1], chain[1:]) <= high).all(1)
    )
    if not len(edges):
        return []
    hits = []
    segments = np.stack([chain[edges], chain[edges + 1]], axis=1)
    at, off = _closest(points[:-1], segments)
    length = np.hypot(off[..., 0], off[..., 1])
    for i in np.flatnonzero(length.min(axis=1) <= LIMITS.touch).tolist():
        k = int(length[i].argmin())
        along = segments[k, 1] - segments[k, 0]
        run = float(np.hypot(*along))
        if run > 1e-9:
            hits.append((at[i, k], np.array([along[1], -along[0]]) / run))
    return hits


def _on_chain(
    outline: Outline, chain: Array, center: Array
) -> list[tuple[Array, Array]]:
    """Where an outline touches an open chain; normals towards the side that its centre
    is on.
    """
    if isinstance(outline, Disc):
        return _disc_on(outline, chain)
    hits = []
    closed = np.concatenate([chain, chain[-1:]])
    for ring in _rings(outline):
        hits += _corners_on(ring, chain) + [
            (p, -n) for p, n in _corners_on(closed, ring)
        ]
    return [(p, n if (center - p) @ n >= 0 else -n) for p, n in hits]


def _closest(points: Array, segments: Array) -> tuple[Array, Array]:
    """`(N, M, 2)`: of each segment `(M, 2, 2)` the point nearest to each of `(N, 2)`,
    and the way from there.
    """
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    off = points[:, None] - start[None]
    share = np.clip((off * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12), 0, 1)
    at = start[None] + share[..., None] * along[None]
    return at, points[:, None] - at


def _face_ends(i: int, j: int, hits: Sequence[tuple[Array, Array]]) -> list[Contact]:
    """Return the two ends of the hits on each face, moved inwards by their uncertainty."""
    left = list(hits)
    found = []
    while left:
        normal = left[0][1]
        face = [hit for hit in left if hit[1] @ normal >= LIMITS.one_face]
        left = [hit for hit in left if hit[1] @ normal < LIMITS.one_face]
        where = [cross(normal, p) for p, _ in face]
        first, last = (face[int(k)] for k in (np.argmin(where), np.argmax(where)))
        if len(face) == 1:
            found.append(Contact(i, j, *first))
            continue
        way = last[0] - first[0]
        inwards = way * min(0.2, LIMITS.inner / max(float(np.hypot(*way)), 1e-9))
        found += [
            Contact(i, j, first[0] + inwards, first[1]),
            Contact(i, j, last[0] - inwards, last[1]),
        ]
    return found


# balance of forces


@dataclass(frozen=True, eq=False)
class _Forces:
    """Forces that may act within a group."""

    masses: Mapping[int, MassProperties]
    found: Sequence[Contact]
    friction: Friction
    default: float
    discs: Mapping[int, float]  # Radii, px

    def worst_first(self, rest: Mapping[int, float]) -> list[int]:
        """Objects that do not stand, the least balanced of the lowest first: those on
        top may only lack them.
        """
        bad = [i for i in rest if rest[i] > UNHELD]
        return sorted(
            bad, key=lambda i: -(float(self.masses[i].center[1]) + 4 * rest[i])
        )

    def residual(self, free: Sequence[int]) -> dict[int, float]:
        """Share of each object's weight (or of a torque of its weight and size) that
        nothing balances.

        The worst of a level photo and of one tilted a little either way: an object that
        only just stands will fall.
        """
        pairs, parts = self._columns(free)
        worst = np.zeros(len(free))
        for tilt in (0.0, -TILTED, TILTED):
            wanted = np.tile([-np.sin(tilt), -np.cos(tilt), 0.0], (len(free), 1))
            rest = unbalanced_forces(pairs, parts, wanted)
            worst = np.maximum(worst, np.abs(rest).max(axis=1))
        return dict(zip(free, worst.tolist(), strict=True))

    def _columns(self, free: Sequence[int]) -> tuple[Pairs, Array]:
        """Return the edges of every friction cone: the places in `free` of both objects
        (M, 2), -1 none of them, and the force and torque on each (M, 2, 3).
        """
        place = {i: k for k, i in enumerate(free)}
        pairs, parts = [], []
        for contact in self.found:
            both = (contact.body, contact.other)
            if contact.body not in place and contact.other not in place:
                continue
            mu = self.friction.get(both, self.default)
            along = np.array([-contact.normal[1], contact.normal[0]])
            # a round object is held by a spot, not by a point, unless it lies on another
            radii = [self.discs[i] for i in both if i in self.discs]
            spot = LIMITS.spot * radii[0] if len(radii) == 1 else 0.0
            for aside in (-spot, spot) if spot else (0.0,):
                for way in (-mu, mu):
                    force = contact.normal + way * along
                    column = np.zeros((2, 3))
                    for k, (i, sign) in enumerate(zip(both, (1.0, -1.0), strict=True)):
                        if i in place:
                            mass = self.masses[i]
                            arm = (
                                contact.point + aside * along - mass.center
                            ) / np.sqrt(mass.area)
                            part = np.array([force[0], force[1], cross(arm, force)])
                            column[k] = sign * part / mass.area
                    pairs.append([place.get(i, -1) for i in both])
                    parts.append(column / max(np.abs(column).max(), 1e-12))
        return np.array(pairs, np.int64).reshape(-1, 2), np.array(parts).reshape(
            -1, 2, 3
        )


def unbalanced_forces(pairs: Pairs, parts: Array, wanted: Array) -> Array:
    """(N, 3): `wanted` (N, 3) minus matrix x, for the x >= 0 that makes it least.

    Each column of the matrix holds `parts` (M, 2, 3) at two of the N objects, `pairs`
    (M, 2); -1 is none of them. Mehrotra's predictor and corrector; objects are taken in
    layers, each of which touches only the next, so that every system is block
    tridiagonal.
    """
    count = len(wanted)
    if not len(pairs):
        return wanted
    spread = 3 * np.where(pairs < 0, count, pairs)[:, :, None] + np.arange(3)
    system = _System(count, pairs, parts)

    def times(x: Array) -> Array:
        weighted = (parts * x[:, None, None]).ravel()
        return np.asarray(
            np.bincount(spread.ravel(), weighted, 3 * count + 3)[:-3], np.float64
        )

    def transposed(y: Array) -> Array:
        return np.asarray((parts * np.append(y, np.zeros(3))[spread]).sum((1, 2)))

    def towards(right: Array) -> Array:
        way = scale * (right - transposed(system.solve(times(scale * right))))
        # large weights are rounded off: one step of refinement
        off = right - transposed(times(way)) - way / scale
        return way + scale * (off - transposed(system.solve(times(scale * off))))

    x, s = np.ones(len(pairs)), np.ones(len(pairs))
    best = left = wanted.ravel() - times(x)
    least = np.inf
    for _ in range(LIMITS.passes):
        slope, gap = -transposed(left) - s, float((x * s).mean())
        error = max(gap, float(np.abs(slope).max()))
        if error < least:
            best, least = left, error
        if least < LIMITS.accuracy or error > LIMITS.diverged * least:
            break
        scale = x / s
        system.factor(scale)
        dx = towards(-slope - s)
        ds = -s - dx / scale
        a, b = _longest_step(x, dx), _longest_step(s, ds)
        middle = gap * (float(((x + a * dx) * (s + b * ds)).mean()) / gap) ** 3
        right = middle - x * s - a * b * dx * ds
        dx = towards(-slope + right / x)
        ds = (right - s * dx) / x
        # one step for both: the gradient depends on x as well
        step = min(1.0, LIMITS.step * min(_longest_step(x, dx), _longest_step(s, ds)))
        x, s = x + step * dx, s + step * ds
        left = wanted.ravel() - times(x)
    return best.reshape(-1, 3)


def _longest_step(x: Array, way: Array) -> float:
    """Share of a way that can be gone before some of x turns negative; 1 at most."""
    down = way < 0
    return min(1.0, float((-x[down] / way[down]).min())) if down.any() else 1.0


class _System:
    """I + matrix diag(weights) matrix^T, factored layer by layer."""

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
        flat = parts.reshape(-1, 6)
        one, other = np.broadcast_arrays(rows[:, :, None], rows[:, None, :])
        self.at, self.entry = np.unique(
            (one * self.size + other).ravel(), return_inverse=True
        )
        self.products = (flat[:, :, None] * flat[:, None, :]).reshape(-1, 36)

    def factor(self, weights: Array) -> None:
        whole = np.zeros(self.size**2)
        weighted = (self.products * weights[:, None]).ravel()
        whole[self.at] = np.bincount(self.entry.ravel(), weighted, len(self.at))
        matrix = whole.reshape(self.size, self.size)[:-3, :-3]
        matrix[np.diag_indices(self.size - 3)] += 1
        # of each layer the inverse of the rest of its block, and its block beside the next layer
        self.steps: list[tuple[Array, Array]] = []
        ends = [*self.ends.tolist(), self.size - 3]
        left = matrix[: ends[1], : ends[1]]
        for k in range(len(ends) - 2):
            inverse = np.asarray(np.linalg.inv(left), np.float64)
            here, after = slice(ends[k], ends[k + 1]), slice(ends[k + 1], ends[k + 2])
            beside = matrix[here, after]
            self.steps.append((inverse, beside))
            left = matrix[after, after] - beside.T @ inverse @ beside

    def solve(self, right: Array) -> Array:
        parts = np.split(right[self.rows], self.ends[1:-1].tolist())
        for k, (inverse, beside) in enumerate(self.steps[:-1]):
            parts[k + 1] = parts[k + 1] - beside.T @ (inverse @ parts[k])
        parts[-1] = self.steps[-1][0] @ parts[-1]
        for k in range(len(parts) - 2, -1, -1):
            inverse, beside = self.steps[k]
            parts[k] = inverse @ (parts[k] - beside @ parts[k + 1])
        result = np.empty(len(right))
        result[self.rows] = np.concatenate(parts)
        return result


def _layers(count: int, pairs: Pairs) -> list[Pairs]:
    """Objects by their distance, in contacts, from an end of their group: each touches
    the next layer only.
    """
    beside: list[set[int]] = [set() for _ in range(count)]
    for a, b in np.unique(pairs, axis=0).tolist():
        if a >= 0 and b >= 0:
            beside[a].add(b)
            beside[b].add(a)

    def outwards(start: int) -> list[list[int]]:
        seen, found = {start}, [[start]]
        while after := sorted({j for i in found[-1] for j in beside[i]} - seen):
            seen.update(after)
            found.append(after)
        return found

    layers: list[Pairs] = []
    left = set(range(count))
    while left:
        found = outwards(outwards(min(left))[-1][0])  # the last one found is at an end
        layers += [np.array(layer, np.int64) for layer in found]
        left.difference_update(*found)
    return layers
