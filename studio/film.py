"""Truth videos: the true motion of a scene file, photographed at its times; short clips with the push varied.

The motion is physgen's own, whose agreement with closed forms docs/accuracy.md measures; poses are stored with the
frames.
"""

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from darkroom import denoise, develop, png, webp
from exposure import Pose, Studio, maps, picture
from photograph import scaled
from stage import Camera, Stage

from physgen import pipeline
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import Trajectory, rotation_matrices


def poses(
    camera: Camera,
    scene_file: Path,
    times: Sequence[float],
    overrides: Sequence[str] = (),
    variant: str | None = None,
) -> tuple[list[dict[str, Pose]], dict[str, list]]:
    """Poses of every thing at each time (s): in metres for Mitsuba, and as the file has them (x px, y px, degrees)."""
    scene = pipeline.load(scene_file, variant=variant, overrides=list(overrides))
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    run = simulate(world, np.array(times))

    def metres(px: np.ndarray) -> np.ndarray:
        middle = (np.array(camera.size) - 1) / 2
        return (px - middle) / camera.ppm * [1, -1] + camera.centre

    frames: list[dict[str, Pose]] = [{} for _ in times]
    for k, body in enumerate(world.bodies):
        turns = rotations(camera, run, k)
        for sample, frame in enumerate(frames):
            frame[body.name] = Pose(
                metres(body.center), metres(run.poses[sample, k, :2]), turns[sample]
            )
    rolled = (
        run.turns if run.turns.size else np.zeros((len(times), len(world.bodies), 0))
    )
    said = {
        body.name: [
            np.round([*p[:2], np.degrees(p[2]), *turn], 4).tolist()
            for p, turn in zip(run.poses[:, k], rolled[:, k], strict=True)
        ]
        for k, body in enumerate(world.bodies)
    }
    return frames, said


def rotations(camera: Camera, run: Trajectory, body: int) -> np.ndarray:
    """(T, 3, 3) rotation of the world since t = 0, from how a body has turned in space, or in the picture.

    The picture's axes are +x right, +y down and so +z into it, by the right hand.
    """
    into = camera.axes * [
        [1],
        [-1],
        [-1],
    ]  # rows: the picture's x, y and z in the world
    if run.turns.size:
        return into.T @ rotation_matrices(run.turns[:, body]) @ into
    return np.stack(
        [cv2.Rodrigues(into[2] * angle)[0] for angle in run.poses[:, body, 2]]
    )


def film(
    stage: Stage,
    scenes: Path,
    truth: Path,
    rays: int = 64,
    scale: float = 1.0,
    tell: Callable[[str], None] = print,
) -> None:
    """Photograph `stage.film` into truth/NAME/film/: 01.webp ..., ids-01.png ..., film.json with times and poses."""
    if stage.film is None:
        return
    start = time.monotonic()
    count, until = stage.film["frames"], stage.film["until"]
    times = [until * (k + 1) / count for k in range(count)]
    camera = scaled(stage.camera, scale)
    folder = truth / stage.name / "film"
    folder.mkdir(parents=True, exist_ok=True)
    motions, said = poses(
        camera,
        scenes / stage.name / "scene.yaml",
        times,
        variant=stage.film.get("variant"),
    )
    studio = Studio(stage, camera)
    for k, frame in enumerate(motions, 1):
        scene, lookup = studio.scene(frame)
        webp(folder / f"{k:02}.webp", shot(studio, scene, rays, seed=100 + k), 92)
        png(
            folder / f"ids-{k:02}.png",
            maps(studio, scene, lookup, 32).labels.astype(np.uint8),
        )
    about = {
        "scene": f"scenes/{stage.name}/scene.yaml",
        "variant": stage.film.get("variant"),
        "rays": rays,
        "times_s": np.round(times, 6).tolist(),
        "poses": "x px, y px of the centre of mass, degrees turned since t = 0; of balls on a table also a quaternion w, x, y, z (+x right, +y down, +z into the photo); one a frame",
        "objects": said,
    }
    (folder / "film.json").write_text(rows(about) + "\n")
    tell(f"{stage.name}: film of {count} frames in {time.monotonic() - start:.0f} s")


def shot(studio: Studio, scene: object, rays: int, seed: int) -> np.ndarray:
    """(H, W, 3) uint8: a frame, developed as the photo."""
    seen = picture(studio, scene, rays, seed=seed)
    return develop(
        denoise(seen.light, seen.albedo, seen.normals),
        studio.stage.exposure,
        studio.stage.vignette,
    )


def clips(
    stage: Stage,
    scenes: Path,
    truth: Path,
    rays: int = 32,
    side: int = 256,
    scale: float = 1.0,
    tell: Callable[[str], None] = print,
) -> None:
    """Record `stage.clips` into truth/NAME/clips/: a strip of frames a clip; clips.json says the pushes."""
    if stage.clips is None:
        return
    start = time.monotonic()
    count, frames, until = (stage.clips[k] for k in ("count", "frames", "until"))
    times = [until * (k + 1) / frames for k in range(frames)]
    folder = truth / stage.name / "clips"
    folder.mkdir(parents=True, exist_ok=True)
    camera = scaled(stage.camera, scale)
    studio = Studio(stage, scaled(stage.camera, side / stage.camera.size[1]))
    about = []
    for k in range(count):
        edits = stage.clips["edit"](camera, np.random.default_rng(1000 + k))
        motions, said = poses(camera, scenes / stage.name / "scene.yaml", times, edits)
        strip = [
            shot(studio, studio.scene(frame)[0], rays, seed=k * frames + i)
            for i, frame in enumerate(motions)
        ]
        webp(folder / f"{k:02}.webp", np.hstack(strip), 90)
        about.append({"clip": f"{k:02}.webp", "set": edits, "poses": said})
        tell(
            f"{stage.name}: clip {k + 1} of {count}, {time.monotonic() - start:.0f} s so far"
        )
    head = {
        "scene": f"scenes/{stage.name}/scene.yaml",
        "frame": [side, side],
        "rays": rays,
        "times_s": times,
    }
    (folder / "clips.json").write_text(
        json.dumps(head | {"clips": about}, separators=(",", ":")) + "\n"
    )


def rows(about: dict) -> str:
    """JSON with one object's poses a line."""
    lines = ",\n".join(
        f"    {json.dumps(name)}: {json.dumps(value)}"
        for name, value in about["objects"].items()
    )
    head = json.dumps({k: v for k, v in about.items() if k != "objects"}, indent=2)
    return head[:-2] + ',\n  "objects": {\n' + lines + "\n  }\n}"
