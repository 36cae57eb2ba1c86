"""A test's `physgen_golden(scene)` -> passes while the clip moves and looks as its golden files have it.

pytest loads this module in every session, so that nothing is imported here but what is light; see docs/golden-tests.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from physgen.batch.tolerances import FRAMES, MOTION, PIXELS, SIDE, GoldenOptions, Motion, Pixels

if TYPE_CHECKING:
    from physgen.batch.golden import Check
    from physgen.pipeline import Stages
    from physgen.simulate.trajectory import Trajectory


__all__ = ["GoldenFixture", "Motion", "Pixels", "physgen_golden"]

ENDING = ".npz"
WITHOUT = (
    'physgen_golden needs pytest-regressions: pip install "physgen[golden]"; '
    "where plugins are not loaded by themselves, say -p pytest_datadir.plugin -p pytest_regressions.plugin"
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """One option of our own; `--force-regen` and its siblings are pytest-regressions'."""
    parser.getgroup("physgen").addoption(
        "--physgen-golden-report",
        metavar="DIR",
        help="where physgen_golden writes the page, and the new files, of a clip that differs "
        "(default: the test's own temporary folder)",
    )


@pytest.fixture(scope="session")
def _physgen_warm() -> Stages:
    """What tests of one scene share: the file is parsed once, the photo is read once."""
    from physgen.pipeline import Stages

    return Stages()


@pytest.fixture
def physgen_golden(request: pytest.FixtureRequest) -> GoldenFixture:
    """Call it with a scene file: its clip is compared with golden files beside the test, trajectory and frames."""
    if request.config.getoption("force_regen", None) is None:
        pytest.fail(WITHOUT, pytrace=False)
    return GoldenFixture(request)


class GoldenFixture:
    """Compares clips of scenes with golden files in the folder that is named after the test's module."""

    def __init__(self, request: pytest.FixtureRequest) -> None:
        self._request = request
        self._used: dict[Path, Check] = {}

    def __call__(
        self,
        scene: str | Path,
        *,
        overrides: Sequence[str] = (),
        variant: str | None = None,
        frames: int | Sequence[int] = FRAMES,
        side: int = SIDE,
        motion: Motion | None = MOTION,
        pixels: Pixels | None = PIXELS,
        until: float | None = None,
        basename: str | None = None,
        allow_outside: bool = False,
    ) -> Trajectory:
        """Make the clip and compare it; returns its motion, of which the test may assert more.

        `scene` is looked for beside the test's file, then in pytest's rootdir. `overrides` are `KEY=VALUE`, `variant`
        one of the file's. `frames` says how many frames are kept, evenly spread, or which; `side`, px, how large.
        `motion` and `pixels` are tolerances; None leaves that part out. Nothing later than `until`, s, is kept or
        compared. `basename` names the files where the test's own name does not: one that checks several clips.
        `allow_outside` lets the scene read files that do not lie below its folder.

        Raises AssertionError where the clip differs, which names the page that shows how; fails where there are no
        golden files yet, or with `--force-regen`, once they are written.
        """
        __tracebackhide__ = True
        from pytest_regressions.common import perform_regression_check

        from physgen.batch.golden import checked
        from physgen.batch.golden_files import PICTURE
        from physgen.problems import InputError

        asked = GoldenOptions(overrides, variant, allow_outside, frames, side, motion, pixels, until)
        path, name = self._found(scene)
        wrong = ""
        try:
            check = checked(path, name, self._request.node.nodeid, asked, self._of("_physgen_warm"))
        except InputError as error:
            wrong = str(error)
        if wrong:
            pytest.fail(f"{name} gives no clip:\n{wrong}", pytrace=False)
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
            said, written = check.differs(expected, picture, self._folder(expected.parent))
            shown.extend(written)
            if said:
                raise AssertionError(said)

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
        return check.clip.trajectory

    def _of(self, fixture: str) -> Any:
        """Asked for when it is needed, so that a session without pytest-regressions collects all the same."""
        return self._request.getfixturevalue(fixture)

    def _folder(self, own: Path) -> Path:
        """Where pages go: the test's `own` folder, or below what `--physgen-golden-report` says."""
        config = self._request.config
        asked = config.getoption("physgen_golden_report")
        if asked is None:
            return own
        module = Path(self._request.path).with_suffix("")
        inside = (
            module.relative_to(config.rootpath)
            if module.is_relative_to(config.rootpath)
            else Path(module.name)
        )
        return Path(config.invocation_params.dir, asked, inside)

    def _found(self, scene: str | Path) -> tuple[Path, str]:
        """The scene's file, and its name as messages have it."""
        config = self._request.config
        places = [Path(self._request.path).parent, config.rootpath]
        for place in places:
            if (path := place / scene).is_file():
                root = config.rootpath
                return path, path.relative_to(root).as_posix() if path.is_relative_to(root) else str(scene)
        where = (
            str(scene)
            if Path(scene).is_absolute()
            else f"{scene}, in {' or '.join(map(str, dict.fromkeys(places)))}"
        )
        pytest.fail(f"there is no scene {where}", pytrace=False)

    def _once(self, file: Path, check: Check) -> None:
        """No two clips of a test share their files."""
        if self._used.setdefault(file, check) is not check:
            said = f"{file.name} is that of another clip of this test: give each of them a basename"
            pytest.fail(said, pytrace=False)
