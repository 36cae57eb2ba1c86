"""`physgen sweep` as a person runs it; its tables by independent readers."""

from __future__ import annotations

import csv
import json
import resource
from argparse import Namespace
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from physgen import pipeline, tables
from physgen.batch.axes import read_axes
from physgen.batch.sweep import Point, plan_clips
from physgen.cli import sweep as sweep_command
from physgen.cli.clips import preview_edits
from physgen.cli.main import main

GRID = ["objects.ball.velocity.0=300,200", "objects.crate.friction=0:1:2"]


def sweep(scene: Path, out: Path, *arguments: str) -> int:
    return main(["sweep", str(scene), *arguments, "-o", str(out), "--report", "none"])


def test_a_table_says_what_manifests_and_trajectories_say(
    lesson: Path, tmp_path: Path, capsys
) -> None:
    out = tmp_path / "out"
    assert (
        sweep(lesson, out, *GRID, "--variant", "all", "--set", "world.duration=0.2")
        == 0
    )
    lines = capsys.readouterr().out.splitlines()
    assert [Path(line).name for line in lines[8:]] == ["index.html", "sweep.csv"]
    by_csv = pd.read_csv(out / "sweep.csv", keep_default_na=True)
    assert by_csv["name"].tolist() == [Path(line).name for line in lines[:8]]
    assert list(by_csv["objects.ball.velocity.0"]) == [300, 300, 200, 200] * 2
    by_csv["variant"] = by_csv["variant"].fillna("")
    for row in by_csv.to_dict("records"):
        manifest = json.loads((out / row["manifest"]).read_text())
        ball = manifest["document"]["objects"]["ball"]
        assert ball["velocity"][0] == row["objects.ball.velocity.0"]
        assert ball["mass"] == (900 if row["variant"] == "heavy" else 100)
        assert (
            manifest["document"]["objects"]["crate"]["friction"]
            == row["objects.crate.friction"]
        )
        assert (manifest["variant"] or "") == row["variant"]
        assert (out / row["video"]).is_file()
        with np.load(out / row["folder"] / "trajectory.npz") as file:
            told = dict(file)
        for name, n in (("ball", 0), ("crate", 1)):
            x, y, angle = told["poses"][-1, n].tolist()
            found = [
                row[f"objects.{name}.{key}"] for key in ("x", "y", "angle_degrees")
            ]
            assert found == [x, y, degrees(angle)]
            speed = np.hypot(*told["velocities"][:, n, :2].T).max()
            assert row[f"objects.{name}.peak_speed"] == speed
            touching = (told["contacts_touch_pairs"] == n).any(axis=1)
            assert row[f"objects.{name}.touches"] == touching.sum()
        assert row["touches"] == len(told["contacts_touch_pairs"])


def test_the_same_again_makes_nothing_and_gives_the_same_table(
    lesson: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    draws = ["objects.ball.mass=~loguniform(10, 1000)", "--samples", "3", "--seed", "5"]
    assert sweep(lesson, out, *draws) == 0
    before = {
        p: p.read_bytes()
        for p in out.rglob("*")
        if p.is_file() and p.name != "index.html"
    }
    times = {p: p.stat().st_mtime_ns for p in out.glob("*/manifest.json")}
    (out / "sweep.csv").unlink()
    assert sweep(lesson, out, *draws) == 0
    after = {p: p.read_bytes() for p in before}
    assert {p: p.stat().st_mtime_ns for p in times} == times
    assert after == before


def test_a_draw_that_makes_no_scene_is_a_row_and_a_card(
    lesson: Path, tmp_path: Path, capsys
) -> None:
    out = tmp_path / "out"
    code = sweep(
        lesson,
        out,
        "objects.ball.elasticity=~normal(0.5, 1)",
        "--samples",
        "8",
        "--json",
    )
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    rows = list(csv.DictReader((out / "sweep.csv").open()))
    good = [0 <= float(row["objects.ball.elasticity"]) <= 10 for row in rows]
    assert 0 < sum(good) < 8
    assert code == 2
    assert (
        [row["state"] == "done" for row in rows]
        == good
        == [line["state"] == "made" for line in lines[:8]]
    )
    for row, fine in zip(rows, good, strict=True):
        assert bool(row["objects.ball.x"]) == bool(row["video"]) == fine
        assert fine or "objects.ball.elasticity" in row["error"]
        assert (out / f"{row['name']}.failed.json").exists() != fine
    page = (out / "index.html").read_text()
    assert page.count("Failed") >= 8 - sum(good)
    assert lines[-1]["failed"] == 8 - sum(good)
    assert lines[-1]["sweep.csv"] == str(out / "sweep.csv")
    empty = pd.read_csv(out / "sweep.csv")["objects.ball.x"].isna()
    assert empty.tolist() == [not fine for fine in good]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["objects.bal.mass=1,2"],
            'objects.bal.mass=1,2: no object is called "bal"; did you mean "ball"?',
        ),
        (
            ["objects.ball.mas=1,2"],
            'objects.ball.mas=1,2: objects.ball.mas: unknown key; did you mean "mass"?',
        ),
        (
            ["objects.ball.motion=~uniform(0,1)", "--samples", "3"],
            "objects.ball.motion=~uniform(0,1): objects.ball.motion: 0.5 does not fit here",
        ),
        (
            ["objects.ball.mass=1,2", "--variant", "hevy"],
            '--variant hevy: "hevy" is not a variant',
        ),
        (
            ["objects.ball.mass=1,2", "--track", "floor"],
            '--track: "floor" is not an object that can move',
        ),
        (
            ["variants.heavy=1,2"],
            "variants.heavy=1,2: variants cannot be set; write it in the scene file",
        ),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_made(
    arguments: list[str], message: str, lesson: Path, tmp_path: Path, capsys
) -> None:
    assert sweep(lesson, tmp_path / "out", *arguments) == 2
    told = capsys.readouterr()
    [line] = told.err.splitlines()
    assert line.startswith(message)
    assert told.out == ""
    assert not (tmp_path / "out").exists()


def test_a_forgotten_scene_is_told(capsys) -> None:
    assert main(["sweep", "objects.ball.mass=1,2", "objects.ball.friction=1"]) == 2
    assert (
        "the scene comes first: physgen sweep scene.yaml KEY=VALUES"
        in capsys.readouterr().err
    )


def test_a_dry_run_lists_and_makes_nothing(
    lesson: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    flags = ["--samples", "2", "objects.ball.mass=~choice(7, 9)", "--dry-run"]
    assert (
        main(["sweep", "lesson.yaml", GRID[0], *flags]) == 0
    )  # flags between arguments
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert [row["objects.ball.velocity.0"] for row in rows] == [
        "300",
        "300",
        "200",
        "200",
    ]
    assert main(["sweep", "lesson.yaml", GRID[0], *flags, "--json"]) == 0
    lines: list[dict[str, Any]] = [
        json.loads(line) for line in capsys.readouterr().out.splitlines()
    ]
    assert [line["name"] for line in lines] == [row["name"] for row in rows]
    assert lines[2]["set"] == [
        "objects.ball.velocity.0=200",
        f"objects.ball.mass={rows[2]['objects.ball.mass']}",
    ]
    assert list(tmp_path.iterdir()) == [lesson]


def test_previews_last_as_long_as_their_own_clips(lesson: Path, tmp_path: Path) -> None:
    import cv2

    out = tmp_path / "out"
    assert sweep(lesson, out, "world.duration=0.25,3", "--preview") == 0
    scene = pipeline.load(lesson, ["world.duration=auto"])
    until_rest = pipeline.compile(scene, None).world.duration
    assert (
        main(
            [
                "render",
                str(lesson),
                "--set",
                "world.duration=auto",
                "--preview",
                "-o",
                str(out),
            ]
        )
        == 0
    )
    for name, seconds in (
        ("00,duration=0.25", 0.25),
        ("01,duration=3", 3),
        ("lesson", until_rest),
    ):
        film = cv2.VideoCapture(str(out / name / "video.mp4"))
        frames = film.get(cv2.CAP_PROP_FRAME_COUNT)
        assert frames <= 24
        assert frames / film.get(cv2.CAP_PROP_FPS) == pytest.approx(seconds, rel=0.05)


@pytest.mark.parametrize(
    ("axis", "duration", "calls"),
    [
        ("objects.ball.velocity.0=20,90,300", "0.5", 1),
        ("objects.ball.velocity.0=20,90,300", "auto", 3),
        ("render.fps=10,20,40", "0.5", 3),
    ],
)
def test_points_of_one_duration_share_their_preview(
    axis: str, duration: str, calls: int, lesson: Path, monkeypatch
) -> None:
    changes = [f"world.duration={duration}"]
    options = Namespace(scene=str(lesson), allow_outside=False, set=changes)
    plan = plan_clips(read_axes([axis]))

    def own_edits(point: Point) -> tuple[str, ...]:
        return preview_edits(str(lesson), None, options, point.overrides)

    expected = [own_edits(point) for point in map(plan.__getitem__, range(3))]
    made = []

    def counted(*arguments: object) -> tuple[str, ...]:
        made.append(arguments)
        return preview_edits(*arguments)

    monkeypatch.setattr(sweep_command, "preview_edits", counted)
    previews = sweep_command.Previews(plan, options)
    edits = [previews.edits(plan[number]) for number in range(3)]
    assert edits == expected
    assert len(made) == calls


def test_the_folder_is_named_after_scene_and_variant(
    lesson: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    command = [
        "sweep",
        "lesson.yaml",
        "objects.ball.mass=5",
        "--variant",
        "heavy",
        "--report",
        "none",
    ]
    assert main(command) == 0
    assert capsys.readouterr().out.splitlines()[0] == "out/lesson-heavy-sweep/00,mass=5"


def test_tracked_objects_have_columns_and_others_none(
    lesson: Path, tmp_path: Path
) -> None:
    assert (
        sweep(lesson, tmp_path / "out", "objects.ball.mass=5,6", "--track", "crate")
        == 0
    )
    names = sorted(p.name for p in (tmp_path / "out").iterdir() if p.is_file())
    assert names == ["index.html", "sweep.csv"]
    header = (tmp_path / "out" / "sweep.csv").read_text().splitlines()[0].split(",")
    assert "objects.crate.x" in header
    assert "objects.ball.x" not in header


def test_whole_numbers_too_large_for_floats_have_their_tables(
    lesson: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    sweep(lesson, out, "objects.ball.mass=1:100000000000000000001:3")
    assert list(pd.read_csv(out / "sweep.csv")["objects.ball.mass"]) == [1, 5e19, 1e20]


def test_a_file_of_somebody_else_is_kept(lesson: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "sweep.csv").write_text("mine\n")
    assert sweep(lesson, out, "objects.ball.mass=5,6") == 0
    assert "kept as sweep.csv~" in capsys.readouterr().err
    assert (out / "sweep.csv~").read_text() == "mine\n"
    assert len((out / "sweep.csv").read_text().splitlines()) == 3
    lesson.write_text(lesson.read_text().replace("mass: 200", "mass: 210"))
    assert (
        sweep(lesson, out, "objects.ball.mass=5,6") == 0
    )  # the same clips, of another scene
    assert sorted(path.name for path in out.glob("sweep*")) == [
        "sweep.csv",
        "sweep.csv~",
    ]


def test_a_table_of_other_draws_is_kept_and_told(
    lesson: Path, tmp_path: Path, capsys
) -> None:
    out = tmp_path / "out"
    flags = ["objects.ball.mass=~uniform(5, 50)", "--preview"]
    assert sweep(lesson, out, *flags, "--samples", "2") == 0
    old = (out / "sweep.csv").read_bytes()
    assert sweep(lesson, out, *flags, "--samples", "2") == 0
    assert capsys.readouterr().err == "2 clips: 0 made, 2 unchanged\n"
    assert sweep(lesson, out, *flags, "--samples", "3") == 0
    told = capsys.readouterr().err
    assert f"the previous {out / 'sweep.csv'} is kept as sweep.csv~\n" in told
    assert (out / "sweep.csv~").read_bytes() == old
    assert (out / "sweep.csv").read_bytes() != old
    assert len(pd.read_csv(out / "sweep.csv")) == 3


def test_an_interrupted_sweep_leaves_no_table(
    lesson: Path, tmp_path: Path, monkeypatch
) -> None:
    from physgen.batch import sweep as files

    def stop(*arguments: object) -> None:
        assert (tmp_path / "out" / "sweep.part.csv").exists()
        raise KeyboardInterrupt

    monkeypatch.setattr(files, "table_row", stop)
    assert sweep(lesson, tmp_path / "out", "objects.ball.mass=5,6") == 130
    monkeypatch.undo()
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "00,mass=5",
        "index.files",
    ]
    assert sweep(lesson, tmp_path / "out", "objects.ball.mass=5,6") == 0
    assert len((tmp_path / "out" / "sweep.csv").read_text().splitlines()) == 3


def test_rows_by_the_ten_thousand_are_read_back(tmp_path: Path) -> None:
    columns = ["n", "x", "word", "on"]
    with tables.Table(tmp_path / "sweep.csv", columns) as made:
        for n in range(10_000):
            made.add(
                {"n": n, "x": n / 3, "word": f'a,"{n}"', "on": n % 2 == 0}
                if n % 7
                else {"n": n}
            )
        made.publish()
    with (tmp_path / "sweep.csv").open(newline="") as text:
        read = list(csv.DictReader(text))
    assert len(read) == 10_000
    for n, b in enumerate(read):
        want = (n, n / 3, f'a,"{n}"', n % 2 == 0) if n % 7 else (n, None, None, None)
        assert b["n"] == str(n)
        assert b["x"] == ("" if want[1] is None else repr(want[1]))
        assert (b["word"], b["on"]) == (
            ("", "") if want[1] is None else (want[2], str(want[3]).lower())
        )
    assert sorted(p.name for p in tmp_path.iterdir()) == ["sweep.csv"]


def test_a_full_disk_leaves_no_table_and_says_which(tmp_path: Path) -> None:
    (tmp_path / "sweep.csv").write_text("of the run before\n")

    def fill() -> None:
        with tables.Table(tmp_path / "sweep.csv", ["word"]) as made:
            for _ in range(1000):
                made.add({"word": "x" * 100})

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        with pytest.raises(OSError, match="too large") as told:
            fill()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert told.value.filename == str(tmp_path / "sweep.csv")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [
        ("sweep.csv", "of the run before\n")
    ]
