"""A user's folder, in which pytest runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from users import ONE, TABLE, Said, another_library

from physgen.batch.golden import differences, make_clip, save
from physgen.batch.tolerances import GoldenOptions
from physgen.pipeline import Stages


@pytest.fixture(scope="session")
def _imported(tmp_path_factory: pytest.TempPathFactory) -> None:
    """All that a check imports: what an inner run imports is forgotten after it, and NumPy bears no second import."""
    folder = tmp_path_factory.mktemp("imported")
    (folder / "scene.yaml").write_text(TABLE)
    _, kept = make_clip(folder / "scene.yaml", GoldenOptions(), Stages())
    save(kept, folder / "a.npz")
    with pytest.MonkeyPatch.context() as patch:
        another_library(patch, 1.0)
        _, other = make_clip(folder / "scene.yaml", GoldenOptions(), Stages())
    assert differences(folder / "a.npz", folder / "a.webp", other, GoldenOptions())


@pytest.fixture
def said(_imported: None, pytester: pytest.Pytester) -> Said:
    """Runs pytest in the user's folder; its exit code and what it printed."""

    def run(*arguments: str) -> tuple[int, str]:
        result = pytester.runpytest_inprocess("-q", *arguments)
        return int(result.ret), result.stdout.str() + result.stderr.str()

    return run


@pytest.fixture
def home(_imported: None, pytester: pytest.Pytester) -> Path:
    """The user's folder, with a scene and a test."""
    pytester.makepyfile(test_scenes=ONE)
    (pytester.path / "scene.yaml").write_text(TABLE)
    return pytester.path
