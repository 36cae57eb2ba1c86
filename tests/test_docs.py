"""Figures in docs come from committed JSON, and nothing committed knows the machine it was made on."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def test_benchmark_page_is_what_its_json_says() -> None:
    code = "import sys; sys.path.insert(0, 'benchmarks'); import tables; sys.stdout.write(tables.page())"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (ROOT / "docs" / "benchmarks.md").read_text() == run.stdout


def test_fidelity_page_is_what_its_json_says() -> None:
    code = "import sys; sys.path.insert(0, 'benchmarks'); import tables; sys.stdout.write(tables.fidelity_page())"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (ROOT / "docs" / "fidelity.md").read_text() == run.stdout


def test_plausibility_page_is_what_its_json_says() -> None:
    code = "import sys; sys.path.insert(0, 'benchmarks'); import tables; sys.stdout.write(tables.plausibility_page())"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (ROOT / "docs" / "plausibility.md").read_text() == run.stdout


def test_materials_page_is_what_the_table_says() -> None:
    code = "import sys; sys.path.insert(0, 'benchmarks'); import tables; sys.stdout.write(tables.materials_page())"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (ROOT / "docs" / "materials.md").read_text() == run.stdout


def test_readme_links_lead_somewhere() -> None:
    import re

    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            assert (page.parent / link).exists(), f"{page.name} -> {link}"
