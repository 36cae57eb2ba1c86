"""Labels of an earlier run never go without a word."""

from __future__ import annotations

from pathlib import Path

from physgen.cli.main import main

SCENE = """\
physgen: 1
size: [48, 32]
world: {duration: 0.1, gravity: [0, 0]}
objects: {ball: {shape: {circle: {center: [16, 16], radius: 6}}, velocity: [60, 0]}}
render: {fps: 20}
variants: {slow: {objects.ball.velocity: [30, 0]}}
"""


def test_a_clip_made_again_tells_once_which_labels_go(tmp_path: Path, capsys) -> None:
    scene, out = tmp_path / "scene.yaml", tmp_path / "out"
    scene.write_text(SCENE)
    again = ["render", str(scene), "--variant", "all", "--report", "none", "-o", str(out)]
    assert main([*again, "--export", "order,events"]) == 0
    assert "labels" not in capsys.readouterr().err
    assert main([*again, "--export", "events"]) == 0
    said = capsys.readouterr().err
    assert said.count(f"{out}: warning: had labels that were not asked for this time, and go: order; ") == 1
    assert "add --export events,order" in said
    assert not (out / "scene-slow/truth/order").exists()
    assert main(again) == 0
    assert "and go: events;" in capsys.readouterr().err
    assert main(again) == 0
    assert "and go" not in capsys.readouterr().err
