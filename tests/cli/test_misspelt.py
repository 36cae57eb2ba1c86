"""Misspelt words on the command line."""

from __future__ import annotations

import pytest

from physgen.cli.main import main


@pytest.mark.parametrize(
    ("command", "meant"), [(["exprot"], "export"), (["evaluate", "studdy"], "study"), (["rendr"], "render")]
)
def test_a_word_that_is_misspelt(command: list[str], meant: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(command)
    assert ended.value.code == 2
    assert f"invalid choice: '{command[-1]}', did you mean {meant}?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "instead"),
    [
        (["render", "scene.yaml", "--ship"], "--ship was removed; share a folder"),
        (
            ["render", "a.yaml", "--cluster", "dask=a.json"],
            "--cluster was removed; write --part K/N, on each",
        ),
        (["render", "a.yaml", "--fps", "30"], "--fps was removed; write --set render.fps=N"),
        (["pack", "scene.yaml"], "pack was removed; zip the scene's folder"),
    ],
)
def test_what_was_removed_names_what_to_use(command: list[str], instead: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(command)
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert instead in told
    assert "too many" not in told
