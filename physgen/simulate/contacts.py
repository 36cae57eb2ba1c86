"""Contact impulses of every step -> touches with begin and end, impulse sums a sample, dissipated energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physgen.simulate.trajectory import Contacts

Array = NDArray[np.float64]
Index = NDArray[np.int32]


class ContactLog:
    """Collects what the engine reads after each step."""

    def __init__(self, surfaces: tuple[str, ...]) -> None:
        self._surfaces = surfaces
        self._open: dict[int, float] = {}
        self._touches: list[tuple[int, float, float]] = []
        self._keys = np.zeros(0, np.int64)
        self._running = np.zeros((0, 2))
        self._closed: list[tuple[NDArray[np.int64], Array]] = []
        self._rows: list[tuple[int, NDArray[np.int64], Array]] = []

    def step(self, time: float, first: Index, second: Index, impulse: Array) -> None:
        """Pairs in contact after the step that ends at `time`: (K,), (K,), (K, 2) g·px/s on the first."""
        N = len(self._surfaces)
        swap = first > second
        key = np.where(swap, second, first).astype(np.int64) * N + np.where(swap, first, second)
        signed = np.where(swap[:, None], -impulse, impulse)
        if np.array_equal(key, self._keys):
            self._running += signed
            return
        now = set(key.tolist())
        for pair in sorted(now - self._open.keys()):
            self._open[pair] = time
        for pair in sorted(self._open.keys() - now):
            self._touches.append((pair, self._open.pop(pair), time))
        self._closed.append((self._keys, self._running))
        self._keys, self._running = key, signed.copy()

    def sample(self, index: int) -> None:
        """Close the sums of the sample `index`."""
        keys = np.concatenate([keys for keys, _ in (*self._closed, (self._keys, self._running))])
        sums = np.concatenate([sums for _, sums in (*self._closed, (self._keys, self._running))])
        pairs, row = np.unique(keys, return_inverse=True)
        total = np.zeros((len(pairs), 2))
        np.add.at(total, row, sums)
        given = total.any(axis=1)
        self._rows.append((index, pairs[given], total[given]))
        self._closed.clear()
        self._running = np.zeros_like(self._running)

    def result(self) -> Contacts:
        """All of it; touches by begin, then by pair."""
        N = len(self._surfaces)
        touches = [*self._touches, *((pair, begin, np.inf) for pair, begin in self._open.items())]
        touches.sort(key=lambda touch: (touch[1], touch[0]))
        pairs = np.array([divmod(pair, N) for pair, _, _ in touches], np.int32).reshape(-1, 2)
        keys = np.concatenate([np.zeros(0, np.int64), *(keys for _, keys, _ in self._rows)])
        samples = np.repeat([index for index, _, _ in self._rows], [len(keys) for _, keys, _ in self._rows])
        return Contacts(
            surfaces=self._surfaces,
            touch_pairs=pairs,
            touch_times=np.array([(begin, end) for _, begin, end in touches]).reshape(-1, 2),
            impulse_rows=np.stack([samples, *divmod(keys, N)], axis=1).astype(np.int32).reshape(-1, 3),
            impulses=np.concatenate([np.zeros((0, 2)), *(total for _, _, total in self._rows)]),
        )
