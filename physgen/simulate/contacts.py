"""Contact impulses of many steps -> touches with begin and end, and impulse sums a sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.trajectory import Contacts

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class ContactLog:
    """Collects, a block of steps at a time, who touched whom and with what impulse."""

    def __init__(self, surfaces: tuple[str, ...], gap: float) -> None:
        """Two touches of a pair that lie at most `gap` s apart are one."""
        self._surfaces, self._gap = surfaces, gap
        self._open: dict[int, float] = {}
        self._touches: list[tuple[int, float, float]] = []
        self._keys: list[tuple[Index, Index, Array]] = []

    def block(
        self,
        times: Array,
        step: Index,
        sample: Index,
        first: Index,
        second: Index,
        impulse: Array,
        when: Array,
    ) -> None:
        """S steps that end at `times` (S,), and R contacts of them.

        step, sample (R,): in which step, before which sample each acted; impulse (R, 2) g·px/s is on the first; when
        (R,) s: the end of its step, or the very time of a blow.
        """
        N = len(self._surfaces)
        swap = first > second
        key = np.where(swap, second, first) * N + np.where(swap, first, second)
        signed = np.where(swap[:, None], -impulse, impulse)
        self._sum(sample, key, signed)
        self._touch(times, step, key, when)

    def _sum(self, sample: Index, key: Index, impulse: Array) -> None:
        if not len(key):
            return
        N = len(self._surfaces)
        pairs, row = np.unique(sample * (N * N) + key, return_inverse=True)
        total = np.stack([np.bincount(row, impulse[:, k], len(pairs)) for k in (0, 1)], axis=1).astype(
            np.float64
        )
        self._keys.append((pairs // (N * N), pairs % (N * N), total))

    def _touch(self, times: Array, step: Index, key: Index, when: Array) -> None:
        """Runs of steps in a row, by pair; a run that goes on from the block before stays open."""
        S = len(times)
        order = np.lexsort((when, step, key))
        key, step, when = key[order], step[order], when[order]
        fresh = np.ones(len(key), bool)
        fresh[1:] = (key[1:] != key[:-1]) | (step[1:] != step[:-1])
        key, step, when = key[fresh], step[fresh], when[fresh]
        starts = np.ones(len(key), bool)
        starts[1:] = (key[1:] != key[:-1]) | (step[1:] != step[:-1] + 1)
        begins = np.flatnonzero(starts)
        ends = np.append(begins[1:], len(key))[: len(begins)] - 1
        still, carried = {}, set()
        for pair, begin, last, at in zip(
            key[begins].tolist(),
            step[begins].tolist(),
            step[ends].tolist(),
            when[begins].tolist(),
            strict=True,
        ):
            since = at
            if begin == 0 and pair in self._open:
                since = self._open[pair]
                carried.add(pair)
            if last == S - 1:
                still[pair] = since
            else:
                self._touches.append((pair, since, float(times[last + 1])))
        for pair in self._open.keys() - carried:
            self._touches.append((pair, self._open[pair], float(times[0])))
        self._open = still

    def _joined(self, touches: list[tuple[int, float, float]]) -> list[tuple[int, float, float]]:
        """One touch for those of a pair that follow each other at once; sorted by pair and begin."""
        joined: list[tuple[int, float, float]] = []
        for pair, begin, end in touches:
            if joined and joined[-1][0] == pair and begin - joined[-1][2] <= self._gap:
                joined[-1] = (pair, joined[-1][1], max(end, joined[-1][2]))
            else:
                joined.append((pair, begin, end))
        return joined

    def result(self) -> Contacts:
        """All of it; touches by begin, then by pair."""
        N = len(self._surfaces)
        touches = [*self._touches, *((pair, begin, np.inf) for pair, begin in self._open.items())]
        touches = self._joined(sorted(touches))
        touches.sort(key=lambda touch: (touch[1], touch[0], touch[2]))
        pairs = np.array([divmod(pair, N) for pair, _, _ in touches], np.int32).reshape(-1, 2)
        sample = np.concatenate([np.zeros(0, np.int64), *(sample for sample, _, _ in self._keys)])
        key = np.concatenate([np.zeros(0, np.int64), *(key for _, key, _ in self._keys)])
        part = np.concatenate([np.zeros((0, 2)), *(part for _, _, part in self._keys)])
        rows, where = np.unique(sample * (N * N) + key, return_inverse=True)
        total = np.stack([np.bincount(where, part[:, k], len(rows)) for k in (0, 1)], axis=1).astype(
            np.float64
        )
        given = total.any(axis=1)
        rows, total = rows[given], total[given]
        first, second = np.divmod(rows % (N * N), N) if N else (rows, rows)
        return Contacts(
            surfaces=self._surfaces,
            touch_pairs=pairs,
            touch_times=np.array([(begin, end) for _, begin, end in touches]).reshape(-1, 2),
            impulse_rows=np.stack([rows // max(N * N, 1), first, second], axis=1)
            .astype(np.int32)
            .reshape(-1, 3),
            impulses=total,
        )
