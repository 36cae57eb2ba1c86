"""A server that misbehaves: a scene, or one message."""

from __future__ import annotations

from pathlib import Path

import pytest
from misbehaviours import CASES, Case, play
from vlm_stub import KEY


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_each_ends_in_a_scene_or_in_one_clear_message(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    seen = play(case, tmp_path)
    assert (seen.code, seen.requests) == (case.code, case.requests)
    assert "Traceback" not in seen.stderr
    files = [path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()]
    assert not any(KEY.encode() in text for text in (seen.stderr.encode(), *files))
    if case.code:
        lines = [line for line in seen.stderr.splitlines() if line.strip()]
        assert len(lines) == 1
        for told in ("http://127.0.0.1:8000/v1", "model stub", "; "):
            assert told in lines[0]
        assert not seen.scene
    else:
        assert "g, vlm 0.49: " in seen.scene
        assert "--backend" not in seen.stderr
