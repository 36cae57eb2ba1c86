"""`physgen backends --check` on a tiny model: there, broken, and gone."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from physgen.cli.main import main
from physgen.evaluate.backend_check import check_backends
from physgen.registry import Choice, Plan
from tests.contract.tiny_depth import depth_anything


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """The folder of a tiny Depth Anything of the real class."""
    return depth_anything(tmp_path / "depth")


@pytest.fixture
def config(tmp_path: Path) -> str:
    """A configuration file that keeps models on the CPU, and small."""
    path = tmp_path / "physgen.toml"
    path.write_text('device = "cpu"\n[depth-anything]\nresolution = 70\n')
    return str(path)


def checks(
    capsys: pytest.CaptureFixture[str], *arguments: str
) -> tuple[int, list[dict]]:
    """Exit code, and the rows of JSON."""
    code = main(["backends", "--json", "--check", *arguments])
    (line,) = capsys.readouterr().out.splitlines()
    return code, json.loads(line)["checks"]


def test_model_at_a_path_has_load_and_run_times(
    capsys, weights: Path, config: str
) -> None:
    setting = f"depth=depth-anything:{weights}"
    code, (row,) = checks(capsys, setting, "--config", config)
    assert (code, row["state"], row["missing"]) == (0, "ready", [])
    assert row["load_seconds"] > 0
    assert row["run_seconds"] > 0
    assert row["gpu_bytes"] is None


def test_broken_weights_give_one_message(capsys, weights: Path, config: str) -> None:
    (weights / "model.safetensors").write_bytes(b"broken")
    setting = f"depth=depth-anything:{weights}"
    code = main(["backends", "--check", setting, "depth=none", "--config", config])
    printed = capsys.readouterr()
    assert code == 1
    (message,) = printed.err.splitlines()
    assert message.startswith(f"{setting} failed: ")
    assert "does not load as Depth Anything" in message
    failed, ready = printed.out.splitlines()
    assert failed.split() == [setting, "failed"]
    assert ready.split()[:3] == ["depth=none", "ready", "load"]


def test_missing_weights_are_no_failure(capsys, tmp_path: Path, weights: Path) -> None:
    shutil.rmtree(weights)
    code, (row,) = checks(capsys, f"depth=depth-anything:{weights}")
    assert (code, row["state"], row["load_seconds"]) == (0, "missing", None)
    assert row["missing"] == [f"lacks {weights}"]


@pytest.mark.slow
def test_check_runs_a_refiner_on_a_clip(tiny) -> None:
    choice = Choice("animatediff", str(tiny["refine", "animatediff"]))
    plan = Plan(device="cpu", options=tiny.options)
    (check,) = check_backends(plan, [("refine", choice)])
    assert (check.state, check.fault) == ("ready", "")
    assert check.load_seconds > 0
    assert check.run_seconds > 0
