"""What a data set holds -> README.md: its card, with the front matter that the Hugging Face Hub reads."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence

from physgen import __version__
from physgen.batch.dataset.layout import Count
from physgen.batch.dataset.splits import Splits
from physgen.resources import resource

SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
"""The Hub's words for how many there are."""


def card(
    layout: str,
    counts: Mapping[str, Count],
    splits: Splits,
    formats: Sequence[str],
    command: Sequence[str],
    shards: Mapping[str, int],
    uneven: bool,
) -> str:
    """`counts` by split; `formats` of labels that any clip has; `shards`: how many files a split is read from;
    `uneven`: clips differ in the names of their files."""
    import jinja2

    total = sum(count.clips for count in counts.values())
    there = [name for name in splits.names if counts[name].clips]
    text = resource("templates", "dataset.md.j2").read_text(encoding="utf-8")
    page = jinja2.Template(text, undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
    told: str = page.render(
        layout=layout,
        uneven=uneven,
        counts=counts,
        splits=splits,
        formats=formats,
        total=total,
        there=there,
        size=next((name for most, name in SIZES if total < most), "n>1M"),
        last=shards.get(there[0], 1) - 1,
        command=shlex.join(command),
        version=__version__,
    )
    return told
