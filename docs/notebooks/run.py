"""Run the notebooks and write their outputs into them: python docs/notebooks/run.py, in the folder of the clone."""

from __future__ import annotations

from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parent
CLONE = FOLDER.parents[1]
TIMEOUT = 600
"""s that a cell may take."""


def executed(path: Path) -> nbformat.NotebookNode:
    """Return a notebook with new outputs. Raises CellExecutionError."""
    notebook = nbformat.read(path, as_version=4)
    resources = {"metadata": {"path": str(CLONE)}}
    client = NotebookClient(
        notebook, timeout=TIMEOUT, resources=resources, record_timing=False
    )
    client.execute()
    return notebook


def main() -> None:
    """Run all of them."""
    for path in sorted(FOLDER.glob("*.ipynb")):
        nbformat.write(executed(path), path)


if __name__ == "__main__":
    main()
