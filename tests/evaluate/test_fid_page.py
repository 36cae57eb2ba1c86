"""docs/fid.md says what benchmarks/results/fid.json holds."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_fid_page_is_what_its_json_says() -> None:
    code = (
        "import sys, json; sys.path.insert(0, 'benchmarks'); import fid_page as f;"
        "sys.stdout.write(f.page(f.PAGE.read_text(), json.loads(f.RESULT.read_text())))"
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (ROOT / "docs/fid.md").read_text() == run.stdout
    assert "| impulse | estimated from the photo |" in run.stdout
