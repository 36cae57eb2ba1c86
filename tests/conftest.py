"""What every test may use; peer-scene tests run only where PHYSGEN_PEER_SCENES names their folder."""

from __future__ import annotations

import hashlib
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from browser import launched
from install_browser import describe_installation, find_browser, is_required
from vlm_stub import KEY, Stub

# the same examples on every run, so that a red run tells of a change; no deadline: machines are shared
hypothesis.settings.register_profile(
    "steady", derandomize=True, deadline=None, max_examples=50
)
hypothesis.settings.load_profile("steady")
os.environ.setdefault("HF_HUB_OFFLINE", "1")
os.environ["XDG_CONFIG_HOME"] = os.devnull  # nobody's own physgen.toml

ROOT = Path(__file__).resolve().parent.parent


MISSED = pytest.StashKey[int]()
"""Number of tests that did not run, since there is no browser."""


def pytest_configure(config: pytest.Config) -> None:
    """Let the processes that tests start be interrupted.

    A shell starts a background job with SIGINT ignored, and every child process inherits that.
    """
    config.stash[MISSED] = 0
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Deselect, never skip: without the folder or the browser these tests have nothing to read."""
    if not os.environ.get("PHYSGEN_PEER_SCENES"):
        _deselect(config, items, _peer_scene_tests(items))
    if find_browser() is None and not is_required():
        config.stash[MISSED] = _deselect(config, items, _browser_tests(items))


def _peer_scene_tests(items: list[pytest.Item]) -> list[pytest.Item]:
    return [item for item in items if item.get_closest_marker("peer_scenes")]


def _browser_tests(items: list[pytest.Item]) -> list[pytest.Item]:
    return [item for item in items if "browser" in getattr(item, "fixturenames", ())]


def _deselect(
    config: pytest.Config, items: list[pytest.Item], unwanted: list[pytest.Item]
) -> int:
    """Remove tests from the session, after those that `-m` removes. Return their number."""
    if unwanted:
        config.hook.pytest_deselected(items=unwanted)
        removed = set(unwanted)
        items[:] = [item for item in items if item not in removed]
    return len(unwanted)


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Send the number of missed tests from a process of pytest-xdist to the main one."""
    config = session.config
    if hasattr(config, "workeroutput"):
        config.workeroutput["missed"] = config.stash[MISSED]


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Receive that number; every process collects all tests, so it is the same in each."""
    output = getattr(node, "workeroutput", {})
    missed = max(node.config.stash[MISSED], output.get("missed", 0))
    node.config.stash[MISSED] = missed


def pytest_unconfigure(config: pytest.Config) -> None:
    """Report the missed tests in the last line of the output."""
    missed = config.stash.get(MISSED, 0)
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if missed and reporter is not None and not hasattr(config, "workeroutput"):
        reporter.write_line(
            f"{missed} browser tests did not run: {describe_installation()}"
        )


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """One that stays open for all tests of pages: a process can drive no more."""
    with launched() as running:
        yield running


@pytest.fixture(scope="session")
def peer_scenes() -> Path:
    return Path(os.environ["PHYSGEN_PEER_SCENES"])


@pytest.fixture(scope="session")
def bundled() -> Path:
    return ROOT / "scenes"


@pytest.fixture(scope="session", autouse=True)
def _nobodys_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Nobody's own cache; this one is for what fixtures of a module or a session do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(
            "XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "caches" / "shared")
        )
        yield


@pytest.fixture(autouse=True)
def _own_cache(
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path_factory: pytest.TempPathFactory,
    _nobodys_cache: None,
) -> None:
    """Every test starts with an empty one, away from its `tmp_path`; made only where it is used."""
    name = hashlib.sha256(request.node.nodeid.encode()).hexdigest()[:16]
    monkeypatch.setenv(
        "XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "caches" / name)
    )


@pytest.fixture
def vlm_stub(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Stub]:
    """A server for `vlm` on loopback that answers well; set `act` to have it otherwise. The cache is empty."""
    with Stub() as stub:
        for name, value in (("URL", stub.url), ("MODEL", "stub"), ("KEY", KEY)):
            monkeypatch.setenv(f"PHYSGEN_VLM_{name}", value)
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        yield stub
