"""Trajectory and physics as files, by other readers, against the trajectory that the clip is made of."""

from __future__ import annotations

import json
from math import radians
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from storied import BALL, clip

from physgen.export.physics import Physics
from physgen.export.trajectory import TrajectoryTables

TWO = (
    BALL
    + "  crate: {shape: {box: {center: [250, 165], size: [30, 30]}}, mass: 40, friction: 0.9}\n"
)
SCALE = "world.pixels_per_meter=250"
FOLLOWED = "render.camera=[{time: 0, zoom: 1}, {time: 0.8, zoom: 2.5, follow: ball}]"


def written(
    tmp_path: Path, *edits: str, objects: str = TWO
) -> tuple[pd.DataFrame, dict, object]:
    told = clip(tmp_path, objects, "objects.ball.velocity=[80, -50]", *edits)
    made = tmp_path / "made"
    made.mkdir()
    TrajectoryTables(made, told).close()
    with np.load(made / "trajectory.npz", allow_pickle=False) as file:
        arrays = dict(file)
    return pd.read_csv(made / "trajectory.csv"), arrays, told


@pytest.mark.parametrize("play", ["forward", "backward", "there-and-back"])
def test_both_files_hold_what_the_engine_gave(tmp_path: Path, play: str) -> None:
    table, arrays, told = written(tmp_path, SCALE, f"render.play={play}")
    seen, order = told.trajectory, list(told.shot.order)
    T, N = len(order), len(seen.names)
    assert len(table) == T * N
    assert (table["object"] == list(seen.names) * T).all()
    assert (table["frame"] == np.repeat(np.arange(T), N)).all()
    poses = table[["x", "y", "angle_rad"]].to_numpy().reshape(T, N, 3)
    speeds = table[["vx", "vy", "spin_rad_s"]].to_numpy().reshape(T, N, 3)
    assert np.array_equal(poses, seen.poses[order])
    assert np.array_equal(speeds, seen.velocities[order])
    assert np.array_equal(arrays["poses"], poses)
    assert np.array_equal(arrays["times"], seen.times[order])
    assert np.array_equal(
        table["clip_time"].to_numpy().reshape(T, N)[:, 0], np.arange(T) / 60
    )
    assert np.allclose(table[["x_m", "y_m"]] * 250, table[["x", "y"]], rtol=1e-15)
    assert np.allclose(table[["vx_m", "vy_m"]] * 250, table[["vx", "vy"]], rtol=1e-15)


def test_places_on_the_video_follow_the_camera_and_so_do_speeds(tmp_path: Path) -> None:
    table, arrays, told = written(
        tmp_path, FOLLOWED, "render.fps=480", "boundaries={}", "world.gravity=[0, 100]"
    )
    lenses = np.stack([told.shot.affine(time) for time in told.trajectory.times])
    places = table[["video_x", "video_y"]].to_numpy().reshape(-1, 2, 2)
    for body in (0, 1):
        at = np.column_stack([told.trajectory.poses[:, body, :2], np.ones(len(lenses))])
        assert np.allclose(
            places[:, body], np.einsum("tij,tj->ti", lenses, at), atol=1e-9
        )
    assert np.array_equal(arrays["lenses"], lenses)
    speeds = table[["video_vx", "video_vy"]].to_numpy().reshape(-1, 2, 2)
    seen = (
        (places[2:] - places[:-2]) * 480 / 2
    )  # what anybody would measure in the film
    assert np.abs(speeds[1:-1] - seen)[4:-4].max() < 0.02 * np.abs(seen).max()


def test_physics_says_what_holds_and_who_said_it(tmp_path: Path) -> None:
    objects = TWO.replace("mass: 40,", "mass: 40, from: {mass: vlm 0.8},")
    push, turn = (
        "{object: crate, force: [100, 0], at: [250, 160]}",
        "{object: ball, torque: 5, start: 0.1, duration: 0.2}",
    )
    told = clip(
        tmp_path, objects, SCALE, f"forces=[{push}, {turn}]", "objects.ball.spin=90"
    )
    Physics(tmp_path, told).close()
    about = json.loads((tmp_path / "physics.json").read_text())
    ball, crate = about["objects"]
    assert crate["from"]["mass"] == "vlm 0.8"
    assert (ball["from"]["mass"], ball["from"]["rolling"], ball["from"]["spin"]) == (
        "written",
        "default",
        "written",
    )
    assert (crate["mass"], crate["mass_kg"]) == (40, 0.04)
    assert ball["moment"] == pytest.approx(5 * 10**2 / 2)  # a disc
    assert crate["moment_kg_m2"] == pytest.approx(0.04 * 2 * (30 / 250) ** 2 / 12)
    assert radians(ball["spin"]) == told.world.bodies[0].spin
    pair = next(
        p for p in about["pairs"] if (p["first"], p["second"]) == (["crate"], ["floor"])
    )
    assert pair["friction"] == pytest.approx((0.9 * 0.4) ** 0.5)
    assert about["gravity_m_s2"] == [0, 2]
    lasting, turning = about["forces"]
    assert (lasting["force"], lasting["place"], lasting["end"]) == (
        [100, 0],
        [250, 160],
        None,
    )
    assert (turning["torque"], turning["start"], turning["end"]) == (
        5,
        0.1,
        pytest.approx(0.3),
    )
