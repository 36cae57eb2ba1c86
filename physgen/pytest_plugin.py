"""pytest fixture `physgen_golden(scene)`: passes while the clip moves and looks as its golden files have it.

pytest loads this module in every session, so that only light modules are imported here; see docs/golden-tests.md.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from physgen.batch.tolerances import GoldenOptions, Motion, Pixels

if TYPE_CHECKING:
    from physgen.batch.golden import Check
    from physgen.pipeline import Stages
    from physgen.simulate.trajectory import Trajectory


__all__ = ["GoldenFixture", "Motion", "Pixels", "physgen_golden"]

ENDING = ".npz"
MISSING_LIBRARY = (
    'physgen_golden needs pytest-regressions: pip install "physgen[golden]"; '
    "where plugins are not loaded by themselves, say -p pytest_datadir.plugin -p pytest_regressions.plugin"
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds one option; `--force-regen` and the like are pytest-regressions'."""
    parser.getgroup("physgen").addoption(
        "--physgen-golden-report",
        metavar="DIR",
        help="where physgen_golden writes the page, and the new files, of a clip that differs "
        "(default: the test's own temporary folder)",
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
        self._used: dict[Path, Check] = {}

    def __call__(
        self,
        scene: str | Path,
        *,
        basename: str | None = None,
        **options: Any,
    ) -> Trajectory:
        """Makes the clip and compares it; returns its motion, for further assertions.

        `scene` is looked for beside the test's file, then in pytest's rootdir. `options` are fields of GoldenOptions.
        `basename` names the files of a test that checks several clips.

        Raises AssertionError where the clip differs, with the path of a page that shows how; fails where there are no
        golden files yet, or with `--force-regen`, once they are written.
        """
        __tracebackhide__ = True
        from pytest_regressions.common import perform_regression_check

        from physgen.batch.golden import PICTURE, checked
        from physgen.problems import InputError

        golden = GoldenOptions(**options)
        path, name = self._found(scene)
        reason = ""
        try:
            check = checked(path, name, self._request.node.nodeid, golden, self._of("_physgen_warm"))
        except InputError as error:
            reason = str(error)
        if reason:
            pytest.fail(f"{name} gives no clip:\n{reason}", pytrace=False)
        original, datadir = self._of("original_datadir"), self._of("lazy_datadir")
        unwritten = self._of("tmp_path") / "obtained"  # written only where it differs
        shown: list[Path] = []

        def dump(file: Path) -> None:
            if file != unwritten:
                self._once(file, check)
                check.write(file)

        def dumped_too(file: Path) -> list[str]:
            return [str(part) for part in (file.with_suffix(PICTURE), *shown) if part.is_file()]

        def compare(_: Path, expected: Path) -> None:
            __tracebackhide__ = True
            self._once(original / expected.name, check)
            picture = datadir / expected.with_suffix(PICTURE).name
            text, written = check.differs(expected, picture, self._folder(expected.parent))
            shown.extend(written)
            if text:
                raise AssertionError(text)

        perform_regression_check(
            datadir=datadir,
            original_datadir=original,
            request=self._request,
            check_fn=compare,
            dump_fn=dump,
            dump_aux_fn=dumped_too,
            extension=ENDING,
            basename=basename,
            obtained_filename=unwritten,
        )
        return check.trajectory

    def _of(self, fixture: str) -> Any:
        """Requested late, so that a session without pytest-regressions can collect the test."""
        return self._request.getfixturevalue(fixture)

    def _folder(self, own: Path) -> Path:
        """Where pages are written: the test's `own` folder, or below `--physgen-golden-report`."""
        config = self._request.config
        chosen = config.getoption("physgen_golden_report")
        if chosen is None:
            return own
        module = Path(self._request.path).with_suffix("")
        if module.is_relative_to(config.rootpath):
            return Path(config.invocation_params.dir, chosen, module.relative_to(config.rootpath))
        return Path(config.invocation_params.dir, chosen, module.name)

    def _found(self, scene: str | Path) -> tuple[Path, str]:
        """The scene's file, and its name in messages."""
        config = self._request.config
        places = [Path(self._request.path).parent, config.rootpath]
        for place in places:
            if (path := place / scene).is_file():
                root = config.rootpath
                return path, path.relative_to(root).as_posix() if path.is_relative_to(root) else str(scene)
        where = " or ".join(map(str, dict.fromkeys(places)))
        pytest.fail(f"there is no scene {scene}, in {where}", pytrace=False)

    def _once(self, file: Path, check: Check) -> None:
        """Two clips of a test must not share files."""
        if self._used.setdefault(file, check) is not check:
            text = f"{file.name} is that of another clip of this test: give each of them a basename"
            pytest.fail(text, pytrace=False)
