"""What every test may use; peer-scene tests run only where PHYSGEN_PEER_SCENES names their folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest
from vlm_stub import KEY, Stub

# the same examples on every run, so that a red run tells of a change; no deadline: machines are shared
hypothesis.settings.register_profile("steady", derandomize=True, deadline=None)
hypothesis.settings.load_profile("steady")
os.environ.setdefault("HF_HUB_OFFLINE", "1")
os.environ["XDG_CONFIG_HOME"] = os.devnull  # nobody's own physgen.toml

ROOT = Path(__file__).resolve().parent.parent


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect, never skip: without the folder these tests have nothing to read."""
    if os.environ.get("PHYSGEN_PEER_SCENES"):
        return
    peer = [item for item in items if item.get_closest_marker("peer_scenes")]
    if peer:
        config.hook.pytest_deselected(items=peer)
        items[:] = [item for item in items if not item.get_closest_marker("peer_scenes")]


@pytest.fixture(scope="session")
def peer_scenes() -> Path:
    return Path(os.environ["PHYSGEN_PEER_SCENES"])


@pytest.fixture(scope="session")
def bundled() -> Path:
    return ROOT / "scenes"


@pytest.fixture
def vlm_stub(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Stub]:
    """A server for `vlm` on loopback that answers well; set `act` to have it otherwise. The cache is empty."""
    with Stub() as stub:
        for name, value in (("URL", stub.url), ("MODEL", "stub"), ("KEY", KEY)):
            monkeypatch.setenv(f"PHYSGEN_VLM_{name}", value)
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        yield stub
