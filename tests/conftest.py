"""What every test may use; peer-scene tests run only where PHYSGEN_PEER_SCENES names their folder."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from browser import launched
from vlm_stub import KEY, Stub

# the same examples on every run, so that a red run tells of a change; no deadline: machines are shared
hypothesis.settings.register_profile(
    "steady", derandomize=True, deadline=None, max_examples=50
)
hypothesis.settings.load_profile("steady")
os.environ.setdefault("HF_HUB_OFFLINE", "1")
os.environ["XDG_CONFIG_HOME"] = os.devnull  # nobody's own physgen.toml

ROOT = Path(__file__).resolve().parent.parent


def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Deselect, never skip: without the folder these tests have nothing to read."""
    if os.environ.get("PHYSGEN_PEER_SCENES"):
        return
    peer = [item for item in items if item.get_closest_marker("peer_scenes")]
    if peer:
        config.hook.pytest_deselected(items=peer)
        items[:] = [
            item for item in items if not item.get_closest_marker("peer_scenes")
        ]


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
