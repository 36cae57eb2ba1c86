"""The machine that physgen runs on: processor and memory."""

from __future__ import annotations

import os
import platform
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path


@dataclass(frozen=True)
class Machine:
    """The machine that physgen runs on."""

    machine: str
    """Kind of processor: `x86_64`."""
    system: str
    processor: str
    """Its model; `""` if unknown."""
    cores: int
    """Those that this process may use."""
    memory_gib: float | None

    def as_dict(self) -> dict[str, str | int | float | None]:
        """As JSON."""
        return asdict(self)

    def __str__(self) -> str:
        memory = "" if self.memory_gib is None else f", {self.memory_gib:.0f} GiB"
        cores = f"{self.cores} core{'s' * (self.cores != 1)}"
        return f"{self.processor or self.machine}, {cores}{memory}, {self.system}"


@cache
def this_machine() -> Machine:
    """Read once."""
    return Machine(
        platform.machine(), platform.system(), _processor(), _cores(), _memory()
    )


def _processor() -> str:
    with suppress(OSError):
        for line in (
            Path("/proc/cpuinfo")
            .read_text(encoding="utf-8", errors="replace")
            .splitlines()
        ):
            name, _, value = line.partition(":")
            if name.strip().lower() in ("model name", "hardware") and value.strip():
                return " ".join(value.split())
    return platform.processor()


def _cores() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on this system
        return os.cpu_count() or 1


def _memory() -> float | None:
    try:
        size = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None
    return round(size / 2**30, 1) if size > 0 else None


def keep_freed_memory() -> None:
    """Make glibc keep freed blocks up to twice the size of one that was freed, 32 MiB at most; others do nothing.

    Arrays of a frame are mapped anew each time otherwise, which takes a quarter of its time.
    """
    bytes(31 * 2**20)
