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


def test_a_removed_flag_names_what_to_use(capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["render", "scene.yaml", "--ship"])
    assert ended.value.code == 2
    assert "--ship was removed; share a folder" in capsys.readouterr().err
