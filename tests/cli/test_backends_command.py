"""`physgen backends --check`: what is ready runs, what is missing is named, what is broken fails."""

from __future__ import annotations

import json
from typing import ClassVar

import numpy as np
import pytest

from physgen import registry
from physgen.cli.backends import listing_lines
from physgen.cli.main import main
from physgen.evaluate.backend_check import INPUTS, Sample
from physgen.geometry.polygon import bounds
from physgen.registry import Backend, listing

FAST = ["categories=everyday", "label=shape", "depth=none", "depth=file", "matte=edge"]
"""Offline backends of no more than milliseconds."""


def checks(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, list]:
    """Exit code, and the rows of JSON."""
    code = main(["backends", "--json", "--check", *arguments])
    (line,) = capsys.readouterr().out.splitlines()
    return code, json.loads(line)["checks"]


def test_every_role_has_inputs() -> None:
    assert set(INPUTS) == set(registry.roles())


def test_sample_shows_two_objects() -> None:
    sample = Sample()
    assert sample.rgb.shape == (96, 128, 3)
    assert np.unique(sample.labels).tolist() == [0, 1, 2]
    assert not np.array_equal(sample.rgb, Sample(1).rgb)
    for one in sample.objects:
        rows, columns = np.nonzero(sample.labels == one.id)
        drawn = columns.min(), rows.min(), columns.max(), rows.max()
        assert bounds(one.outline) == pytest.approx(drawn, abs=0.6)  # px


@pytest.mark.slow
def test_offline_backends_are_ready(capsys) -> None:
    code, rows = checks(capsys, *FAST)
    assert code == 0
    assert [f"{row['role']}={row['name']}" for row in rows] == FAST
    for row in rows:
        assert row["state"] == "ready"
        assert row["load_seconds"] >= 0
        assert row["run_seconds"] >= 0
        assert row["memory_bytes"] >= 0


def test_backend_returning_nan_fails(capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    row = Backend("depth", "nan", f"{__name__}:nan_depth", "")
    monkeypatch.setattr(registry, "BACKENDS", (*registry.BACKENDS, row))
    code, (check,) = checks(capsys, "depth=nan")
    assert (code, check["state"]) == (1, "failed")
    assert check["fault"] == "ValueError: it returns numbers that are not finite"


def nan_depth():
    return lambda rgb: np.full(rgb.shape[:2], np.nan, np.float32)


class Searcher:
    """A segmenter that searches for nouns and takes prompts, and records each call."""

    calls: ClassVar[list[tuple]] = []

    def __call__(self, rgb, categories):
        self.calls.append(("nouns", [one.noun for one in categories]))

    def segment_meant_objects(self, rgb, boxes, points):
        self.calls.append(("prompts", boxes, points))

    def load(self):
        self.calls.append(("load",))

    def close(self):
        self.calls.append(("close",))


def test_segmenter_gets_nouns_box_and_point_between_load_and_close(
    capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = f"{__name__}:Searcher"
    row = Backend("segment", "searcher", target, "", uses=("categories",))
    monkeypatch.setattr(registry, "BACKENDS", (*registry.BACKENDS, row))
    monkeypatch.setattr(Searcher, "calls", [])
    code, _ = checks(capsys, "segment=searcher")
    assert code == 0
    loading, nouns, (_, (box,), (point,)), closing = Searcher.calls
    assert (loading, closing) == (("load",), ("close",))
    assert nouns == ("nouns", ["ball", "block"])
    left, top, width, height = box
    labels = Sample().labels
    assert (labels[top : top + height, left : left + width] == 2).all()
    assert labels[point[1], point[0]] == 1


def test_unknown_and_map_choices_are_refused(capsys) -> None:
    assert main(["backends", "--check", "depth=deep"]) == 2
    assert "is not a backend" in capsys.readouterr().err
    assert main(["backends", "--check", "depth=file:depth.npy"]) == 2
    assert "write depth=file to check the reader" in capsys.readouterr().err


def test_listing_shows_size_and_licence_of_all_weights() -> None:
    rows = listing()
    text = "\n".join(listing_lines(rows))
    weights = [one for row in registry.BACKENDS for one in row.weights]
    assert len(weights) > 8
    for one in weights:
        assert f"{one.size}, {one.licence}" in text
    ids = [one["id"] for row in rows for one in row["weights"]]
    assert ids == [one.id for one in weights]
