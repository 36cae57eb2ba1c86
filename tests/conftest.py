"""What every test may use; peer-scene tests run only where PHYSGEN_PEER_SCENES names their folder."""

from __future__ import annotations

import os
from pathlib import Path

import hypothesis
import pytest

# the same examples on every run, so that a red run tells of a change; no deadline: machines are shared
hypothesis.settings.register_profile("steady", derandomize=True, deadline=None)
hypothesis.settings.load_profile("steady")
os.environ.setdefault("HF_HUB_OFFLINE", "1")

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
