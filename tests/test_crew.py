"""Plans, their files and crews: what is chosen where, what is refused, and who takes over."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physgen import registry
from physgen.perceive.roles import PromptedMask
from physgen.perceive.segment.prompts import from_prompts, segmenter
from physgen.problems import InputError
from physgen.registry import Backend, Backends, Plan, Weights, choices, load_plan

RGB = np.zeros((8, 8, 3), np.uint8)


@pytest.fixture(autouse=True)
def nobodys_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """No configuration but the test's own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    return tmp_path


def settle(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def said(told: Plan) -> dict[str, str]:
    return {role: str(choice) for role, choice in told.choices.items()}


def test_nothing_said_is_the_offline_line():
    assert load_plan() == Plan()
    assert {load_plan().row(role).name for role in registry.roles()} == {
        registry.names(r)[0] for r in registry.roles()
    }


def test_flags_stand_over_the_folder_over_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    settle(
        tmp_path / "home/physgen/physgen.toml",
        'device = "cuda:1"\nkeep = true\n[backend]\nsegment = "classical"\ninpaint = "lama:/models/big-lama.pt"\n',
    )
    settle(tmp_path / "physgen.toml", '[backend]\nsegment = "sam3"\nphysics = "vlm"\n')
    below = tmp_path / "photos/new"
    below.mkdir(parents=True)
    monkeypatch.chdir(below)  # found from below, like a project's other files
    told = load_plan(["physics=table"], device="cpu")
    assert said(told) == {"segment": "sam3", "inpaint": "lama:/models/big-lama.pt", "physics": "table"}
    assert (told.device, told.keep, told.fallback) == ("cpu", True, False)


def test_a_profile_on_the_command_line_stands_over_the_files_one_in_them_below(tmp_path: Path):
    settle(
        tmp_path / "physgen.toml",
        'profile = "mine"\n[backend]\nsegment = "classical"\n'
        '[profiles.mine]\nsegment = "sam3"\nnormals = "marigold"\n[vlm]\nsamples = 3\n',
    )
    assert said(load_plan()) == {"segment": "classical", "normals": "marigold"}
    assert said(load_plan(profile="mine")) == {"segment": "sam3", "normals": "marigold"}
    assert said(load_plan(["segment=learned"], profile="mine"))["segment"] == "learned"
    assert load_plan(["physics=vlm"]).setup("physics").options == {"samples": 3}
    assert load_plan(profile="models").row("segment").name == "grounding-dino+sam"


def test_paths_in_a_file_are_those_beside_it(tmp_path: Path):
    file = settle(
        tmp_path / "set/up.toml", '[backend]\nnormals = "file:maps/n.npy"\nsegment = "sam3:facebook/sam3"\n'
    )
    settle(tmp_path / "set/maps/n.npy", "")
    told = said(load_plan(config=file))
    assert told == {"normals": f"file:{tmp_path / 'set/maps/n.npy'}", "segment": "sam3:facebook/sam3"}


def test_every_mistake_in_a_file_is_told_by_its_line(tmp_path: Path):
    file = settle(
        tmp_path / "physgen.toml",
        'device = "gpu"\nkeep = "yes"\n[backend]\nsegmnt = "sam3"\nsegment = "sam4"\n  inpaint = "fill:x"\n'
        '[profiles.a]\ndepth = 3\n[vln]\nurl = "x"\n',
    )
    with pytest.raises(InputError) as error:
        load_plan()
    lines = sorted(str(problem).removeprefix(f"{file}:") for problem in error.value.problems)
    assert lines == [
        '1:1: "gpu" is no device; write auto, cpu, cuda, cuda:1 or mps',
        "2:1: keep: 'yes' is not true or false; write true or false",
        lines[2],
        lines[3],
        '6:3: "inpaint=fill:x" names weights for what has none; write inpaint=fill',
        '8:1: depth: 3 is not text; write e.g. "sam3"',
        lines[6],
    ]
    assert lines[2].startswith('4:1: "segmnt" is not a role; did you mean segment?')
    assert lines[3].startswith('5:1: segment="sam4" is not a backend; did you mean sam3?')
    assert lines[6].startswith('9:1: vln: "vln" means nothing here; did you mean vlm?')


@pytest.mark.parametrize(
    ("settings", "told", "message"),
    [
        (["segment=sam3:"], {}, 'segment=sam3:" names nothing after the colon; write segment=sam3:PATH'),
        (
            ["segment=learned:x"],
            {},
            'segment=learned:x" names weights for what has none; write segment=learned',
        ),
        ([], {"profile": "modls"}, '--profile: "modls" is no profile; did you mean models?'),
        ([], {"device": "tpu"}, '--device: "tpu" is no device'),
        ([], {"dtype": "float8"}, '--dtype: "float8" is no number format; did you mean float'),
        ([], {"config": Path("nowhere.toml")}, "nowhere.toml: cannot be read (No such file or directory)"),
    ],
)
def test_wrong_flags_are_answered(settings, told, message: str):
    with pytest.raises(InputError) as error:
        load_plan(settings, **told)
    assert message in str(error.value)


class Odd:
    """A segmenter that counts its lives."""

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
    row = Backend(
        "segment", "odd", f"{__name__}:Odd", "", weights=(Weights("a/b", "", ""),), uses=("categories",)
    )
    monkeypatch.setattr(registry, "BACKENDS", (*registry.BACKENDS, row))
    monkeypatch.setitem(__import__("sys").modules, __name__, __import__("sys").modules[Odd.__module__])
    Odd.made = Odd.closed = 0
    Odd.fails = False
    return Odd


def test_models_are_let_go_after_their_role_unless_kept(odd: type[Odd]):
    for keep, lives in ((False, 3), (True, 1)):
        odd.made = odd.closed = 0
        crew = Backends(Plan(choices(["segment=odd"]), keep=keep))
        for _ in range(3):
            crew.begin()
            assert crew.call("segment", RGB, categories=[1], depth=2) == [1]  # only what the row uses
            crew.release("segment")
        assert (odd.made, odd.closed) == (lives, 0 if keep else lives)
        crew.close()
        assert odd.closed == lives
        assert [(step["backend"], step["weights"]) for step in crew.record()] == [("odd", "a/b")]


def test_a_failure_is_an_error_unless_the_default_may_take_over(odd: type[Odd]):
    odd.fails = True
    with pytest.raises(
        InputError, match=r"segment=odd:c/d failed .RuntimeError: out of memory.; see what failed"
    ):
        Backends(Plan(choices(["segment=odd:c/d"]))).call("segment", RGB, categories=[])
    heard = []
    crew = Backends(Plan(choices(["segment=odd:c/d"]), fallback=True), heard.append)
    crew.call("segment", RGB, categories=[])
    assert crew.name("segment") == "learned"
    (step,) = crew.record()
    assert (step["backend"], step["instead_of"], step["because"]) == (
        "learned", "odd:c/d", "RuntimeError: out of memory",
    )  # fmt: skip
    assert "segment=odd:c/d failed (RuntimeError: out of memory); learned took over" in str(heard[0])
    assert not crew.all_default()


def test_kept_or_not_what_failed_on_one_photo_is_tried_on_the_next(odd: type[Odd]):
    for keep in (False, True):
        crew = Backends(Plan(choices(["segment=odd"]), keep=keep, fallback=True))
        odd.fails = True
        assert crew.call("segment", np.zeros((64, 64, 3), np.uint8), categories=[1]).labels.shape == (64, 64)
        odd.fails = False
        crew.begin()
        assert crew.name("segment") == "odd"
        assert crew.call("segment", RGB, categories=[1]) == [1]  # made by whom the record names
        assert [step.backend for step in crew.steps] == ["odd"]
        assert not crew.fallbacks()


def test_a_plan_of_some_roles_makes_and_checks_nothing_of_others(odd: type[Odd]):
    told = load_plan(["segment=odd", "refine=wan:nobody/no-such-weights"])
    with pytest.raises(InputError, match="nobody/no-such-weights"):
        Backends(told)
    odd.made = 0
    crew = Backends(told.of(["segment", "label"]))
    assert crew.name("segment") == "odd"
    assert odd.made == 1
    assert told.of(["refine"]).setup("refine").weights == "nobody/no-such-weights"


def test_boxes_and_points_go_through_the_crew_too(odd: type[Odd], monkeypatch: pytest.MonkeyPatch):
    def meant(self, rgb, boxes, points):
        if odd.fails:
            raise RuntimeError("no memory")
        return [PromptedMask(np.ones(rgb.shape[:2], bool), 0.9) for _ in (*boxes, *points)]

    monkeypatch.setattr(Odd, "meant", meant, raising=False)
    rgb = np.full((64, 64, 3), 90, np.uint8)
    rgb[20:44, 20:44] = 200
    for fails in (False, True):
        odd.fails = fails
        crew = Backends(Plan(choices(["segment=odd"]), fallback=True))
        found = from_prompts(rgb, [(16, 16, 32, 32)], [], segmenter(crew, ["cup"]))
        assert ((found.labels == 1).sum() == 64 * 64) == (not fails)  # else what is seen in the box
        assert len(crew.record()) == 1
        assert bool(crew.fallbacks()) == fails


def test_boundaries_that_need_depth_say_so_before_any_work():
    with pytest.raises(InputError, match=r"boundary=depth-normals.* needs depth; choose one for depth, too"):
        Backends(load_plan(["boundary=depth-normals"]))


def test_a_folder_names_neither_programs_nor_servers(tmp_path: Path):
    text = '[backend]\ninpaint = "lama:evil.pt"\nphysics = "vlm"\n[vlm]\nurl = "http://evil.example/v1"\n'
    file = settle(tmp_path / "physgen.toml", text)
    with pytest.raises(InputError) as error:
        load_plan()
    told = str(error.value)
    assert "physgen.toml:2:1: inpaint:" in told
    assert "is a program that a folder's file may not run; say it on the command line, with --config" in told
    assert "physgen.toml:5:1: vlm.url:" in told
    assert said(load_plan(config=file))["inpaint"] == "lama:evil.pt"  # a person said so
    settle(file, '[vlm]\nurl = "http://127.0.0.1:8000/v1"\n')
    assert load_plan().options["vlm"] == {"url": "http://127.0.0.1:8000/v1"}


def test_a_folders_profile_stands_over_the_users_choices(tmp_path: Path):
    settle(tmp_path / "home/physgen/physgen.toml", 'keep = true\n[backend]\nsegment = "sam3"\n')
    settle(tmp_path / "physgen.toml", 'profile = "offline"\nkeep = false\n')
    assert said(load_plan()) == {}
    assert not load_plan(otherwise={"keep": True}).keep
    settle(tmp_path / "physgen.toml", 'device = "cpu"\n\nprofile = "offlne"\n')
    with pytest.raises(InputError, match=r'physgen.toml:3:1: "offlne" is no profile; did you mean offline'):
        load_plan()


def test_what_is_not_installed_is_told_before_anything_runs(monkeypatch: pytest.MonkeyPatch):
    rows = (
        Backend("segment", "far", "nowhere:far", "", extra="models", needs=("no_such_module",)),
        Backend("depth", "far", "nowhere:far", "", extra="models", needs=("no_such_module",)),
    )
    monkeypatch.setattr(registry, "BACKENDS", (*registry.BACKENDS, *rows))
    with pytest.raises(InputError) as error:
        Backends(Plan(choices(["segment=far", "depth=far"])))
    assert len(error.value.problems) == 2
    assert 'pip install "physgen[models]"' in str(error.value)
    crew = Backends(Plan(choices(["depth=far"]), fallback=True))
    assert not crew.call("depth", RGB).any()
    assert crew.name("depth") == "none"
