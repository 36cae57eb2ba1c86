"""The machine that physgen runs on: processor and memory."""

from __future__ import annotations

import platform
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from physgen.operating_system import available_cores, installed_memory


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
        """Return the machine as JSON."""
        return asdict(self)

    def __str__(self) -> str:
        memory = "" if self.memory_gib is None else f", {self.memory_gib:.0f} GiB"
        cores = f"{self.cores} core{'s' * (self.cores != 1)}"
        return f"{self.processor or self.machine}, {cores}{memory}, {self.system}"


@cache
def this_machine() -> Machine:
    """Read once."""
    return Machine(
        platform.machine(),
        platform.system(),
        _processor(),
        available_cores(),
        _memory_gib(),
    )


def _processor() -> str:
    with suppress(OSError):
        path = Path("/proc/cpuinfo")
        text = path.read_text(encoding="utf-8", errors="replace")
        for line in text.splitlines():
            name, _, value = line.partition(":")
            if name.strip().lower() in ("model name", "hardware") and value.strip():
                return " ".join(value.split())
    return platform.processor()


def _memory_gib() -> float | None:
    size = installed_memory()
    return None if size is None else round(size / 2**30, 1)


def keep_freed_memory() -> None:
    """Make glibc keep freed blocks up to twice the size of one that was freed, 32 MiB at most; others do nothing.

    Arrays of a frame are mapped anew each time otherwise, which takes a quarter of its time.
    """
    bytes(31 * 2**20)
