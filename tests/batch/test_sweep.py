"""Names of clips: unique, safe, short, in order, and the same when the sweep grows."""

from __future__ import annotations

import random
import re
import shlex
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from physgen.batch.axes import read_axes
from physgen.batch.sweep import MAX_NAME_BYTES, clip_name, plan_clips, short_text
from physgen.batch.values import Value
from physgen.text import natural


def names(
    *arguments: str,
    variants: tuple[str | None, ...] = (None,),
    samples: int | None = None,
) -> list[str]:
    return [point.name for point in plan_clips(read_axes(arguments), variants, samples)]


def test_names_say_what_differs() -> None:
    assert names(
        "objects.cue.velocity.0=-100:-900:2", "objects.*.elasticity=0.2,0.9"
    ) == [
        "00-00,velocity.x=-100,elasticity=0.2",
        "00-01,velocity.x=-100,elasticity=0.9",
        "01-00,velocity.x=-900,elasticity=0.2",
        "01-01,velocity.x=-900,elasticity=0.9",
    ]
    assert names("objects.a.mass=1,2", "objects.b.mass=3", variants=(None, "fast"))[
        ::2
    ] == [
        "00-00-00,a.mass=1,b.mass=3",
        "01-00-00,fast,a.mass=1,b.mass=3",
    ]
    assert re.fullmatch(
        r"0007,mass=\d{3}\.?\d?",
        names("objects.a.mass=~uniform(100,900)", samples=9)[7],
    )
    assert names("boundaries.floor.segment[0][1]=1,2")[0] == "00,segment.0.y=1"


def test_two_thousand_names_are_unique_safe_short_and_in_order() -> None:
    arguments = [
        "objects.cue.velocity.0=-900:900:5", "render.size=[256,256],[64, 48]", "objects.cue.label='a/b','..'",
        "objects.cue.mass=~uniform(1,1.0001)", "world.gravity=~choice([0, 980], [0, 0])",
    ]  # fmt: skip
    sweep = plan_clips(read_axes(arguments), (None, "very-heavy"), 50)
    found = [point.name for point in sweep]
    assert len(found) == len({name.lower() for name in found}) == 2000
    assert all(
        re.fullmatch(r"[\w.,=+-]+", name) and len(name.encode()) <= MAX_NAME_BYTES
        for name in found
    )
    assert sorted(random.Random(1).sample(found, 2000), key=natural) == found


def test_names_stay_when_a_sweep_grows() -> None:
    small = names("a.mass=1,2", "a.friction=0.1,0.2")
    assert set(small) < set(names("a.mass=1,2,3", "a.friction=0.1,0.2,0.25"))
    some = names("a.mass=~uniform(0,1)", samples=20)
    assert some == names("a.mass=~uniform(0,1)", samples=1200)[:20]


@given(
    st.lists(st.tuples(st.text(max_size=12), st.text(max_size=200)), max_size=12),
    st.integers(0, 10**7),
)
def test_any_value_makes_a_name_for_a_file(
    told: list[tuple[str, str]], draw: int
) -> None:
    parts = [
        f"key{n}={short_text(Value('', data))}" for n, (_, data) in enumerate(told)
    ]
    found = clip_name(["03", f"{draw:04d}"], parts)
    assert len(found.encode()) <= MAX_NAME_BYTES
    assert not set(found) & set("/\\:*?\"<>| \0\n'$`~&;()[]{}!#")
    assert found.isprintable()
    assert found.startswith(f"03-{draw:04d}")


def test_the_page_about_sweeps_tells_the_names_that_are_given() -> None:
    text = (Path(__file__).parents[2] / "docs" / "batches.md").read_text()
    command = re.findall(r"^physgen sweep (.*)$", text, re.MULTILINE)[0]
    arguments = [part for part in shlex.split(command) if "=" in part]
    listed = re.findall(r"^dominoes/(\d\d-\d\d,\S+)/", text, re.MULTILINE)
    found = names(*arguments)
    assert listed == found[:1]
    # A line can show several examples before the verb of its sentence.
    examples = re.findall(r"^- (`KEY=.+?) (?:means|is) ", text, re.MULTILINE)
    patterns = [
        written.removeprefix("KEY=")
        for example in examples
        for written in re.findall(r"`(.+?)`", example)
    ]
    assert len(patterns) > len(examples) > 1
    for written in patterns:
        assert (
            len(
                plan_clips(
                    read_axes([f"a.b={written}"]), samples=5 if "~" in written else None
                )
            )
            > 1
        )
