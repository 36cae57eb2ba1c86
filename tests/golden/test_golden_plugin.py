"""`physgen_golden` as its users have it: clips that differ, damaged files, and whatever they ask for."""

from __future__ import annotations

import subprocess
import sys
from math import ceil
from pathlib import Path

import pytest
from users import FPS, MEET, ONE, TABLE, Said, edit, told

pytest_plugins = ["pytester"]


def test_the_first_run_writes_and_the_second_passes(home: Path, said: Said) -> None:
    code, text = said()
    assert code == 1
    assert "created" in text
    kept = sorted(path.name for path in (home / "test_scenes").iterdir())
    assert kept == ["test_clip.npz", "test_clip.webp"]
    assert said()[0] == 0


def test_a_changed_mass_names_the_sample_the_object_and_the_edit(home: Path, said: Said) -> None:
    """Nothing knows of the mass before the two meet; who stands aside never does."""
    said()
    edit(
        home / "scene.yaml", ("mass: 170, elasticity: 0.9, velocity", "mass: 300, elasticity: 0.9, velocity")
    )
    code, text = said()
    assert code == 1
    first = f"from sample {ceil(MEET * FPS)} ({ceil(MEET * FPS) / FPS:.3f} s)"
    assert first in told(text, "motion")
    assert "2 of 3 objects, at most" in told(text, "motion")
    assert "bystander" not in told(text, "motion")
    assert "is the first that differs" in told(text, "frame")
    obtained = Path(told(text, "the new files").split()[-1])
    assert obtained.is_file()
    assert obtained.with_suffix(".webp").is_file()


def test_a_changed_light_is_a_matter_of_pixels(pytester: pytest.Pytester, said: Said, bundled: Path) -> None:
    test = f"""
        import os
        def test_clip(physgen_golden):
            light = ["light.intensity=0.6"] if os.environ.get("DIM") else []
            physgen_golden({str(bundled / "wall-ball" / "scene.yaml")!r}, overrides=["world.duration=0.4", *light])
    """
    pytester.makepyfile(test_scenes=test)
    said()
    assert said()[0] == 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DIM", "1")
        code, text = said()
    assert code == 1
    assert "is the first that differs" in told(text, "frame")
    assert "motion" not in text


def test_comments_and_the_order_of_keys_do_not_count(home: Path, said: Said) -> None:
    said()
    scene = home / "scene.yaml"
    edit(scene, ("physgen: 1\nsize: [128, 96]\n", "size: [128, 96]  # a table\nphysgen: 1\n"))
    assert said()[0] == 0


def test_force_regen_takes_what_is_now(home: Path, said: Said) -> None:
    said()
    scene, kept = home / "scene.yaml", home / "test_scenes" / "test_clip.npz"
    first = kept.read_bytes()
    edit(scene, ("velocity: [300, 0]", "velocity: [350, 0]"))
    assert said()[0] == 1
    assert kept.read_bytes() == first
    code, text = said("--force-regen")
    assert code == 1
    assert "--force-regen set, regenerating file at" in text
    assert kept.read_bytes() != first
    assert said("--force-regen")[0] == 0, "nothing differs any more"
    edit(scene, ("velocity: [350, 0]", "velocity: [300, 0]"))
    assert said("--regen-all")[0] == 0
    assert kept.read_bytes() == first, "the same clip is kept as the same bytes"


@pytest.mark.parametrize("harm", ["cut", "no picture", "other picture"])
def test_damaged_files_are_named_and_mended(home: Path, said: Said, harm: str) -> None:
    said()
    kept = home / "test_scenes" / "test_clip.npz"
    picture = kept.with_suffix(".webp")
    if harm == "cut":
        kept.write_bytes(kept.read_bytes()[:-40])
    elif harm == "no picture":
        picture.unlink()
    else:
        edit(home / "scene.yaml", ("size: [128, 96]", "size: [120, 96]"))
        old = kept.read_bytes()
        said("--regen-all")
        kept.write_bytes(old)
    code, text = said()
    assert code == 1
    if harm == "other picture":
        assert "test_clip.webp is not the picture that test_clip.npz was written with" in text
    else:
        assert (
            "test_clip.npz is no golden file of physgen, or it or its picture is damaged or missing" in text
        )
    said("--force-regen")
    assert said()[0] == 0


def test_names_of_classes_parameters_and_several_clips(pytester: pytest.Pytester, said: Said) -> None:
    (pytester.path / "scenes").mkdir()
    (pytester.path / "scenes" / "a.yaml").write_text(TABLE)
    (pytester.path / "tests").mkdir()
    (pytester.path / "pytest.ini").touch()
    (pytester.path / "tests" / "test_scenes.py").write_text(
        "import pytest\n"
        "class TestAll:\n"
        "    @pytest.mark.parametrize('mass', [100])\n"
        "    def test_clip(self, physgen_golden, mass):\n"
        "        physgen_golden('scenes/a.yaml', overrides=[f'objects.cue.mass={mass}'], pixels=None)\n"
        "def test_two(physgen_golden):\n"
        "    for name in ('one', 'other'):\n"
        "        physgen_golden('scenes/a.yaml', basename=name, motion=None)\n"
    )
    assert said("--regen-all", "--with-test-class-names")[0] == 0
    kept = {path.name for path in (pytester.path / "tests" / "test_scenes").iterdir()}
    assert kept == {
        "TestAll_test_clip_100_.npz",
        *(f"{name}{ending}" for name in ("one", "other") for ending in (".npz", ".webp")),
    }


def test_wrong_input_is_told_without_a_traceback(home: Path, said: Said) -> None:
    edit(home / "scene.yaml", ("mass: 100", "mass: heavy"))
    code, text = said()
    assert code == 1
    assert "scene.yaml gives no clip:" in text
    assert 'scene.yaml:6:69: objects.bystander.mass: "heavy" is not a number' in text
    assert "Traceback" not in text
    (home / "test_scenes.py").write_text(ONE.replace("scene.yaml", "nowhere.yaml"))
    assert f"there is no scene nowhere.yaml, in {home}" in said()[1]
    assert not (home / "test_scenes").exists()


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ("frames=[0, 99]", "frames: 99 are not among the clip's first 24"),
        ("motion=None, pixels=None", "nothing would be compared"),
    ],
)
def test_what_cannot_be_asked_for(home: Path, said: Said, how: str, why: str) -> None:
    first = "from physgen.pytest_plugin import Motion, Pixels\n"
    (home / "test_scenes.py").write_text(first + ONE.replace('yaml"', f'yaml", {how}'))
    assert why in said()[1]


def test_sessions_without_pytest_regressions_go_on(home: Path, said: Said) -> None:
    (home / "test_scenes.py").write_text(ONE + "def test_other():\n    pass\n")
    _, text = said("-p", "no:regressions", "-p", "no:pytest-datadir")
    assert "1 passed, 1 error" in text
    assert 'physgen_golden needs pytest-regressions: pip install "physgen[golden]"' in text


def test_being_loaded_costs_nothing() -> None:
    """pytest loads the plugin in every session."""
    code = (
        "import sys, pytest; before = set(sys.modules); import physgen.pytest_plugin;"
        "print(*sorted({name.split('.')[0] for name in set(sys.modules) - before}))"
    )
    new = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert set(new) <= {"physgen", *sys.stdlib_module_names}
