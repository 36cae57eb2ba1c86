"""pytest fixture `physgen_golden(scene)`: passes while the clip moves and looks as its golden files have it.

pytest loads this module in every session, so that only light modules are imported here; see docs/golden-tests.md.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from physgen.batch.tolerances import GoldenOptions, Motion, Pixels

if TYPE_CHECKING:
    from physgen.pipeline import Stages
    from physgen.simulate.trajectory import Trajectory


__all__ = ["GoldenFixture", "Motion", "Pixels", "physgen_golden"]

ENDING = ".npz"
MISSING_LIBRARY = (
    'physgen_golden needs pytest-regressions: pip install "physgen[golden]"; '
    "where plugins are not loaded by themselves, say -p pytest_datadir.plugin -p pytest_regressions.plugin"
)


@pytest.fixture(scope="session")
def _physgen_warm() -> Stages:
    """Shared by the tests of a session: each scene file is parsed once, each photo is read once."""
    from physgen.pipeline import Stages

    return Stages()


@pytest.fixture
def physgen_golden(request: pytest.FixtureRequest) -> GoldenFixture:
    """A function that compares the clip of a scene file with golden files beside the test."""
    if request.config.getoption("force_regen", None) is None:
        pytest.fail(MISSING_LIBRARY, pytrace=False)
    return GoldenFixture(request)


class GoldenFixture:
    """Compares clips with golden files in the folder named after the test's module."""

    def __init__(self, request: pytest.FixtureRequest) -> None:
        self._request = request

    def __call__(self, scene: str | Path, *, basename: str | None = None, **options: Any) -> Trajectory:
        """Makes the clip and compares it; returns its motion, for further assertions.

        `scene` is looked for beside the test's file, then in pytest's rootdir. `options` are fields of GoldenOptions.
        `basename` names the files of a test that checks several clips.

        Raises AssertionError where the clip differs; fails where there are no golden files yet, or with
        `--force-regen`, once they are written.
        """
        __tracebackhide__ = True
        from pytest_regressions.common import perform_regression_check

        from physgen.batch.golden import PICTURE, differences, make_clip, save
        from physgen.problems import InputError

        wanted, reason = GoldenOptions(**options), ""
        try:
            trajectory, golden = make_clip(self._found(scene), wanted, self._of("_physgen_warm"))
        except InputError as error:
            reason = str(error)
        if reason:
            pytest.fail(f"{scene} gives no clip:\n{reason}", pytrace=False)
        datadir = self._of("lazy_datadir")

        def compare(obtained: Path, expected: Path) -> None:
            __tracebackhide__ = True
            lines = differences(expected, datadir / expected.with_suffix(PICTURE).name, golden, wanted)
            if lines:
                text = "\n".join(f"  {line}" for line in (*lines, f"the new files: {obtained}"))
                raise AssertionError(f"{scene} is not the clip of {expected.name}.\n{text}")

        perform_regression_check(
            datadir=datadir,
            original_datadir=self._of("original_datadir"),
            request=self._request,
            check_fn=compare,
            dump_fn=partial(save, golden),
            extension=ENDING,
            basename=basename,
        )
        return trajectory

    def _of(self, fixture: str) -> Any:
        """Requested late, so that a session without pytest-regressions can collect the test."""
        return self._request.getfixturevalue(fixture)

    def _found(self, scene: str | Path) -> Path:
        """The scene's file."""
        places = [Path(self._request.path).parent, self._request.config.rootpath]
        for place in places:
            if (path := place / scene).is_file():
                return path
        where = " or ".join(map(str, dict.fromkeys(places)))
        pytest.fail(f"there is no scene {scene}, in {where}", pytrace=False)
