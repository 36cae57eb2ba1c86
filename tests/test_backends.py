from __future__ import annotations

import os
import subprocess
import sys

import pytest

from physgen import registry
from physgen.problems import InputError
from physgen.registry import Backend, Choice, Plan, choices, listing, listing_lines


def test_rows_are_unique_and_every_role_has_a_default_in_the_core():
    keys = [(row.role, row.name) for row in registry.BACKENDS]
    assert len(keys) == len(set(keys))
    for role in registry.roles():
        assert registry.find(role).extra is None


def test_asking_imports_nothing():
    code = "import sys, physgen.registry as r; r.listing(); sys.exit('numpy' in sys.modules or 'cv2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("role", "name", "message"),
    [
        ("inpant", None, '--backend: "inpant" is not a role; did you mean inpaint? choose from'),
        ("inpaint", "fil", '--backend: inpaint="fil" is not a backend; did you mean fill? choose from fill'),
    ],
)
def test_unknown_names_are_answered(role: str, name: str | None, message: str):
    with pytest.raises(InputError) as error:
        registry.make(role, name)
    assert str(error.value).startswith(message)


def test_a_missing_extra_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch):
    row = Backend("segment", "sam", "nowhere:sam", "", extra="models", needs=("no_such_module",))
    monkeypatch.setattr(registry, "BACKENDS", (*registry.BACKENDS, row))
    with pytest.raises(InputError) as error:
        registry.make("segment", "sam")
    assert 'needs no_such_module, which is not installed; pip install "physgen[models]"' in str(error.value)
    listed = listing()[-1]
    assert listed["installed"] is False
    assert listed["missing"] == ["no_such_module"]


def test_settings_collect_every_mistake():
    assert choices(["inpaint=fill", "matte=edge"]) == {"inpaint": Choice("fill"), "matte": Choice("edge")}
    with pytest.raises(InputError) as error:
        choices(["inpaint", "mate=edge", "matte=edg"])
    assert len(error.value.problems) == 3


def listed(setting: str) -> tuple[dict, list[str]]:
    """The row that a choice takes, and the lines below it."""
    rows = listing(Plan(choices([setting])))
    (row,) = (row for row in rows if row["chosen"] and row["role"] == setting.partition("=")[0])
    return dict(row), [line.strip() for line in list(listing_lines([row]))[2:]]


def test_what_a_choice_leaves_out_is_the_rows_own(tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path / "hub"))
    own = "[lacks IDEA-Research/grounding-dino-tiny (0.7 GB, Apache-2.0): hf download"
    (tmp_path / "SAM").touch()
    row, lines = listed(f"segment=grounding-dino+sam:,{tmp_path}/SAM")
    assert [one["here"] for one in row["weights"]] == [False, True]
    assert lines[-2].startswith(own)
    assert lines[-1] == f"{tmp_path}/SAM, here"
    row, lines = listed(f"segment=grounding-dino+sam:{tmp_path}/SAM")
    assert [one["id"] for one in row["weights"]] == [f"{tmp_path}/SAM", "facebook/sam-vit-huge"]
    (tmp_path / "hub/models--IDEA-Research--grounding-dino-tiny/snapshots/1").mkdir(parents=True)
    (tmp_path / "hub/models--IDEA-Research--grounding-dino-tiny/snapshots/1/config.json").touch()
    row, _ = listed(f"segment=grounding-dino+sam:, {tmp_path}/SAM")
    assert all(one["here"] for one in row["weights"])
    (tmp_path / "a,b").mkdir()
    row, _ = listed(f"depth=depth-anything:{tmp_path}/a,b")
    assert [(one["id"], one["here"]) for one in row["weights"]] == [(f"{tmp_path}/a,b", True)]


def test_rows_that_take_a_map_are_ready_once_one_is_named(tmp_path):
    for row in (row for row in listing() if row["name"] == "file"):
        assert not row["ready"]
        assert list(listing_lines([row]))[-1].strip() == f"[write {row['role']}=file:PATH]"
    row, lines = listed(f"inpaint=file:{tmp_path}/nowhere.png")
    assert not row["ready"]
    assert lines == [f"[lacks {tmp_path}/nowhere.png]"]
    row, lines = listed(f"inpaint=file:{tmp_path}")  # a folder is no picture
    assert not row["ready"]
    (tmp_path / "a,b.png").touch()
    row, lines = listed(f"inpaint=file:{tmp_path}/a,b.png")
    assert row["ready"]
    assert lines == [f"{tmp_path}/a,b.png, here"]


@pytest.mark.parametrize(
    "said",
    [
        {},
        {"XDG_CACHE_HOME": "/a"},
        {"XDG_CACHE_HOME": "/a", "HF_HOME": "~/b"},
        {"HF_HOME": "/b", "HUGGINGFACE_HUB_CACHE": "$HOME/c"},
        {"HUGGINGFACE_HUB_CACHE": "/c", "HF_HUB_CACHE": "/d"},
    ],
)
def test_the_hubs_cache_is_where_its_own_library_has_it(said: dict[str, str]):
    code = (
        "from physgen.registry import hub_cache\n"
        "from huggingface_hub import constants\n"
        "assert str(hub_cache()) == constants.HF_HUB_CACHE, (hub_cache(), constants.HF_HUB_CACHE)"
    )
    names = ("XDG_CACHE_HOME", "HF_HOME", "HUGGINGFACE_HUB_CACHE", "HF_HUB_CACHE")
    rest = {key: value for key, value in os.environ.items() if key not in names}
    subprocess.run([sys.executable, "-c", code], env=rest | said, check=True)
