"""The scene of a test module."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def lesson(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """The module's LESSON in a file."""
    path = tmp_path / "lesson.yaml"
    path.write_text(request.module.LESSON)
    return path
