"""The registry: the table, the choice from files and flags, what is refused, and the listing."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from physgen import registry
from physgen.cli.backends import listing_lines
from physgen.files import install
from physgen.problems import InputError
from physgen.registry import (
    Backend,
    Backends,
    Choice,
    Plan,
    Setup,
    Weights,
    choices,
    listing,
    load_plan,
    read_options,
)

RGB = np.zeros((8, 8, 3), np.uint8)


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No configuration but the test's own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def chosen(plan: Plan) -> dict[str, str]:
    return {role: str(choice) for role, choice in plan.choices.items()}


def add_rows(monkeypatch: pytest.MonkeyPatch, *rows: Backend) -> None:
    monkeypatch.setattr(registry, "BACKENDS", (*registry.BACKENDS, *rows))


def test_rows_are_unique_and_every_default_is_part_of_the_core():
    keys = [(row.role, row.name) for row in registry.BACKENDS]
    assert len(keys) == len(set(keys))
    assert all(registry.find(role).extra is None for role in registry.roles())
    assert load_plan() == Plan()
    assert all(
        Plan().row(role).name == registry.names(role)[0] for role in registry.roles()
    )


@pytest.mark.parametrize(
    ("role", "name", "message"),
    [
        (
            "inpant",
            None,
            '--backend: "inpant" is not a role; did you mean inpaint? choose from',
        ),
        (
            "inpaint",
            "fil",
            '--backend: inpaint="fil" is not a backend; did you mean fill? choose from fill',
        ),
    ],
)
def test_unknown_names_are_refused(role: str, name: str | None, message: str):
    with pytest.raises(InputError) as error:
        registry.make(role, name)
    assert str(error.value).startswith(message)


def test_choices_report_every_mistake():
    assert choices(["inpaint=fill", "matte=edge"]) == {
        "inpaint": Choice("fill"),
        "matte": Choice("edge"),
    }
    with pytest.raises(InputError) as error:
        choices(["inpaint", "mate=edge", "matte=edg"])
    assert len(error.value.problems) == 3


def test_flags_override_the_file_and_another_file_may_be_named(tmp_path: Path):
    write(
        tmp_path / "home/physgen/physgen.toml",
        'device = "cuda:1"\n[backend]\nsegment = "learned"\n',
    )
    file = write(
        tmp_path / "mine.toml",
        '[backend]\nsegment = "grounding-dino+sam"\nphysics = "vlm"\n[vlm]\ntimeout = 3\n',
    )
    assert (load_plan().device, chosen(load_plan())) == (
        "cuda:1",
        {"segment": "learned"},
    )
    plan = load_plan(["physics=table"], config=file)
    assert (plan.device, chosen(plan)) == (
        "auto",
        {"segment": "grounding-dino+sam", "physics": "table"},
    )
    assert load_plan(config=file).setup("physics").options == {"timeout": 3}


def test_a_profile_of_a_flag_replaces_the_choices_of_the_file(tmp_path: Path):
    write(
        tmp_path / "home/physgen/physgen.toml",
        'profile = "models"\n[backend]\nphysics = "table"\n',
    )
    plan = load_plan()
    assert (plan.row("segment").name, plan.row("physics").name) == ("sam3", "table")
    assert load_plan(profile="models").row("physics").name == "vlm"
    assert chosen(load_plan(["segment=learned"], profile="offline")) == {
        "segment": "learned"
    }


@pytest.mark.parametrize("name", registry.PROFILES)
def test_profiles_choose_known_backends(name: str):
    plan = load_plan(profile=name)
    for role, backend in registry.PROFILES[name].items():
        assert plan.row(role) is registry.find(role, backend)


def test_small_profile_needs_no_server_and_8_gigabytes():
    """One model is in memory at a time: its weights leave half of 8 GB to the rest."""
    plan = load_plan(profile="small")
    for role in registry.PROFILES["small"]:
        row = plan.row(role)
        gigabytes = [float(weights.size.removesuffix(" GB")) for weights in row.weights]
        assert sum(gigabytes) < 4.5
        assert not row.settings


def test_every_mistake_in_a_file_is_reported(tmp_path: Path):
    file = write(
        tmp_path / "physgen.toml",
        'device = "gpu"\ndtype = "float8"\nprofile = "offlne"\n[backend]\nsegmnt = "learned"\nsegment = "sam4"\n'
        'inpaint = "fill:x"\ndepth = 3\n[vln]\nurl = "x"\n',
    )
    with pytest.raises(InputError) as error:
        load_plan(config=file)
    lines = [str(problem).removeprefix(f"{file}: ") for problem in error.value.problems]
    expected = [
        '"gpu" is not a device; write auto, cpu, cuda, cuda:1 or mps',
        '"float8" is not a number format; did you mean float',
        '"offlne" is not a profile; did you mean offline?',
        '"segmnt" is not a role; did you mean segment?',
        'segment="sam4" is not a backend; did you mean sam3? choose from learned, grounding-dino+sam',
        '"inpaint=fill:x" has weights, but the backend takes none; write inpaint=fill',
        'backend.depth: 3 is not text; write e.g. depth = "marigold"',
        'vln: "vln" is not a key of physgen.toml; did you mean vlm?',
    ]
    assert len(lines) == len(expected)
    assert all(any(line.startswith(start) for line in lines) for start in expected), (
        lines
    )


@pytest.mark.parametrize(
    ("settings", "switches", "message"),
    [
        (
            ["depth=marigold:"],
            {},
            'depth=marigold:" has nothing after the colon; write depth=marigold:PATH',
        ),
        (
            ["segment=learned:x"],
            {},
            'segment=learned:x" has weights, but the backend takes none; write segment=learned',
        ),
        (
            [],
            {"config": Path("nowhere.toml")},
            "nowhere.toml: cannot be read (No such file or directory)",
        ),
    ],
)
def test_wrong_flags_are_refused(settings: list[str], switches: dict, message: str):
    with pytest.raises(InputError) as error:
        load_plan(settings, **switches)
    assert message in str(error.value)


def test_every_wrong_option_is_told_at_once():
    known = {
        "steps": (None, {"type": "integer", "minimum": 1}),
        "prompt": ("", {"type": "string"}),
    }
    with pytest.raises(InputError) as error:
        read_options(
            Setup(options={"stepz": 3, "steps": 0, "prompt": 4}), "marigold", known
        )
    assert list(map(str, error.value.problems)) == [
        "physgen.toml: marigold.prompt: 4 is not of type 'string'; the default is ''",
        "physgen.toml: marigold.steps: 0 is less than the minimum of 1; leave it out",
        'physgen.toml: marigold.stepz: "stepz" is not a key of this table; did you mean steps? choose from steps, prompt',
    ]


class Odd:
    """A segmenter that counts its instances."""

    made = closed = 0
    fails = False

    def __init__(self, setup) -> None:
        Odd.made += 1
        self.setup = setup

    def __call__(self, rgb, categories=None):
        if Odd.fails:
            raise RuntimeError("out of memory\nat 0x123")
        return categories

    def note(self):
        return {"weights": self.setup.weights}

    def close(self) -> None:
        Odd.closed += 1


@pytest.fixture
def odd(monkeypatch: pytest.MonkeyPatch) -> type[Odd]:
    weights = (Weights("a/b", "", ""),)
    add_rows(
        monkeypatch,
        Backend(
            "segment",
            "odd",
            f"{__name__}:Odd",
            "",
            weights=weights,
            uses=("categories",),
        ),
    )
    monkeypatch.setitem(sys.modules, __name__, sys.modules[Odd.__module__])
    Odd.made = Odd.closed = 0
    Odd.fails = False
    return Odd


def test_models_are_freed_after_their_role_unless_kept(odd: type[Odd]):
    for keep, instances in ((False, 3), (True, 1)):
        odd.made = odd.closed = 0
        backends = Backends(Plan(choices(["segment=odd"]), keep=keep))
        for _ in range(3):
            backends.begin()
            assert backends.call("segment", RGB, categories=[1], depth=2) == [
                1
            ]  # only what the row uses
            backends.release("segment")
        assert (odd.made, odd.closed) == (instances, 0 if keep else instances)
        backends.close()
        assert odd.closed == instances
        assert [(step["backend"], step["weights"]) for step in backends.record()] == [
            ("odd", "a/b")
        ]


def test_a_failure_of_a_chosen_backend_is_an_error(odd: type[Odd]):
    odd.fails = True
    failed = r"segment=odd:c/d failed .RuntimeError: out of memory.; see what failed"
    with pytest.raises(InputError, match=failed):
        Backends(Plan(choices(["segment=odd:c/d"]))).call("segment", RGB, categories=[])


def test_missing_libraries_are_reported_before_anything_runs(
    monkeypatch: pytest.MonkeyPatch,
):
    rows = [
        Backend(role, "far", "nowhere:far", "", needs=("no_such_module",))
        for role in ("segment", "depth")
    ]
    add_rows(monkeypatch, *rows)
    with pytest.raises(InputError) as error:
        Backends(Plan(choices(["segment=far", "depth=far"])))
    assert len(error.value.problems) == 2
    assert f"needs no_such_module, which is not installed; {install('models')}" in str(
        error.value
    )
    assert listing()[-1]["missing"][0] == f"needs no_such_module: {install('models')}"


def missing(setting: str) -> list[str]:
    """What the row that a choice takes lacks."""
    rows = listing(Plan(choices([setting])))
    (row,) = (
        row
        for row in rows
        if row["chosen"] and row["role"] == setting.partition("=")[0]
    )
    assert row["ready"] == (not row["missing"])
    assert [line.strip()[1:-1] for line in list(listing_lines([row]))[2:]] == row[
        "missing"
    ]
    return list(row["missing"])


def test_weights_that_a_choice_leaves_out_are_the_rows_own(
    tmp_path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path / "hub"))
    (tmp_path / "SAM").touch()
    lacks = "lacks IDEA-Research/grounding-dino-tiny (0.7 GB, Apache-2.0): hf download IDEA-Research/grounding"
    (line,) = missing(f"segment=grounding-dino+sam:,{tmp_path}/SAM")
    assert line.startswith(lacks)
    (line,) = missing(f"segment=grounding-dino+sam:{tmp_path}/SAM")
    assert line.startswith("lacks facebook/sam-vit-huge")
    write(
        tmp_path
        / "hub/models--IDEA-Research--grounding-dino-tiny/snapshots/1/config.json",
        "",
    )
    assert not missing(f"segment=grounding-dino+sam:, {tmp_path}/SAM")
    (tmp_path / "a,b").mkdir()
    assert not missing(f"depth=marigold:{tmp_path}/a,b")
