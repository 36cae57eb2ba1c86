from __future__ import annotations

import subprocess
import sys

import pytest

from physgen import backends
from physgen.backends import Backend
from physgen.crew import Choice, choices
from physgen.problems import InputError
from physgen.roster import listing


def test_rows_are_unique_and_every_role_has_a_default_in_the_core():
    keys = [(row.role, row.name) for row in backends.BACKENDS]
    assert len(keys) == len(set(keys))
    for role in backends.roles():
        assert backends.find(role).extra is None


def test_asking_imports_nothing():
    code = "import sys, physgen.roster as r; r.listing(); sys.exit('numpy' in sys.modules or 'cv2' in sys.modules)"
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
        backends.make(role, name)
    assert str(error.value).startswith(message)


def test_a_missing_extra_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch):
    row = Backend("segment", "sam", "nowhere:sam", "", extra="models", needs=("no_such_module",))
    monkeypatch.setattr(backends, "BACKENDS", (*backends.BACKENDS, row))
    with pytest.raises(InputError) as error:
        backends.make("segment", "sam")
    assert 'needs no_such_module, which is not installed; pip install "physgen[models]"' in str(error.value)
    listed = listing()[-1]
    assert listed["installed"] is False
    assert listed["missing"] == ["no_such_module"]


def test_settings_collect_every_mistake():
    assert choices(["inpaint=fill", "matte=edge"]) == {"inpaint": Choice("fill"), "matte": Choice("edge")}
    with pytest.raises(InputError) as error:
        choices(["inpaint", "mate=edge", "matte=edg"])
    assert len(error.value.problems) == 3
