"""What this process would make clips with -> a few words of text by name, equal where its clips are equal."""

from __future__ import annotations

from collections.abc import Mapping

from physgen.batch.finished import CODE
from physgen.cache.keys import code_version
from physgen.problems import InputError
from physgen.report.record import versions

Versions = Mapping[str, str]


def here() -> Versions:
    """Versions of physgen, its sources, Python, libraries and the kind of processor; worked out once a process."""
    return {**code_version((*CODE, "batch")), **versions()}


def other(worker: str, theirs: Versions) -> InputError:
    """A worker would make other bytes."""
    ours = here()
    names = [name for name in dict.fromkeys((*ours, *theirs)) if ours.get(name) != theirs.get(name)]
    if names == ["sources"]:
        ours, theirs = ({"sources": v.get("sources", "")[:12]} for v in (ours, theirs))
    elif "sources" in names:
        names.remove("sources")  # told by what else differs

    def told(of: Versions) -> str:
        return ", ".join(f"{name} {of.get(name, 'none')}" for name in names)

    expected = f"has {told(theirs)}, and here is {told(ours)}: its clips would not be the same"
    return InputError.of("--cluster", f"worker {worker}", expected, "install the same on both")
