"""Photos that nobody here made, all the way: photo -> scene -> two clips -> a gallery; what came of each, as rows.

    PHYSGEN_PEER_SCENES=DIR python benchmarks/headline.py out/headline   # rows to results/, prints the gallery's path
    PHYSGEN_MATERIAL=DIR python benchmarks/headline.py --suitability     # verdicts on whether photos suit, as a table

Photos are scikit-image's, and those of a folder of scenes (`*/original.png`, with `mask.png`) where one is named. None
is copied into the project. Each is perceived with nothing told; then a clip as the scene stands, in which whatever the
photo shows at rest should stay at rest, and one in which the largest thing is given a push to the middle.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from subprocess import run as command

import cv2
import numpy as np

from physgen import pipeline
from physgen.environment import this_machine
from physgen.evaluate.segmentation import Photo, match, runs
from physgen.problems import InputError
from physgen.scene.scene import Motion, View

SKIMAGE = {
    "coins": "png",
    "coffee": "png",
    "clock_motion": "png",
    "rocket": "jpg",
    "chelsea": "png",
}
"""Things on a table, a cup, a clock, a rocket, and a cat, in whom nothing stands loose."""
SPEED = 350.0
"""px/s that the push gives, in a photo of 512 px; in proportion in others."""
STILL = 3.0
"""px that a thing may come from where it was, or half a pixel in a hundred of the photo, whichever is more."""
DURATION = 1.5


def photos() -> Iterator[tuple[str, Path, Path | None]]:
    """Name, photo, and its true masks where they are known."""
    peers = os.environ.get("PHYSGEN_PEER_SCENES")
    for photo in sorted(Path(peers).glob("*/original.png")) if peers else ():
        yield f"peer-{photo.parent.name}", photo, photo.parent / "mask.png"
    try:
        import skimage
    except ModuleNotFoundError:
        return
    for name, kind in SKIMAGE.items():
        yield name, Path(skimage.__file__).parent / "data" / f"{name}.{kind}", None


def whole_way(name: str, photo: Path, truth: Path | None, folder: Path) -> dict:
    """One photo's row; clips under `folder`/clips."""
    home = folder / "scenes" / name
    home.mkdir(parents=True)
    here = home / f"photo{photo.suffix}"
    shutil.copyfile(photo, here)
    path = home / "scene.yaml"
    row: dict = {"photo": name}
    begun = time.perf_counter()
    try:
        pipeline.perceive(here, path)
        row["perceive_s"] = round(time.perf_counter() - begun, 1)
        scene = pipeline.load(path)
        row |= {"view": scene.world.view.value, "objects": len(scene.objects)}
        if truth is not None:
            row |= found(path, truth)
        if not scene.objects:
            return row
        long = (f"world.duration={DURATION}",)
        begun = time.perf_counter()
        row["standing"], row["loose"] = standing(path, long)
        pipeline.render_scene(
            path, folder / "clips", overrides=long, name=name + "-as-it-stands"
        )
        thing, push = pushed(path)
        row["pushed"] = thing
        pipeline.render_scene(
            path, folder / "clips", overrides=(*long, push), name=name + "-pushed"
        )
        row["render_s"] = round((time.perf_counter() - begun) / 2, 1)
    except InputError as error:
        row["failed"] = str(error.problems[0])
    return row


def found(path: Path, truth: Path) -> dict:
    """Of the true masks: how many are met at IoU 0.5, with what mean overlap."""
    true = cv2.imread(str(truth), cv2.IMREAD_UNCHANGED)
    true = true[..., 0] if true.ndim == 3 else true
    maps = pipeline.percepts(pipeline.load(path))
    assert maps is not None
    said, known = (
        [runs(ids == i) for i in np.unique(ids[ids > 0])]
        for ids in (maps.labels, true.astype(np.uint16))
    )
    size = maps.labels.shape[1], maps.labels.shape[0]
    (judged,) = match([Photo("", size, known, (), said, np.ones(len(said)))]).photos
    hits = judged.overlap[judged.is_match]
    return {
        "true": len(known),
        "met": len(hits),
        "iou": round(float(hits.mean()), 3) if len(hits) else None,
    }


def standing(path: Path, overrides: tuple[str, ...]) -> tuple[int, int]:
    """How many things stay where the photo shows them though nothing pushes, and how many could move."""
    scene = pipeline.load(path, overrides=overrides)
    compiled = pipeline.compile(scene, pipeline.percepts(scene))
    trajectory = pipeline.simulate(compiled.world)
    free = [k for k, item in enumerate(scene.objects) if item.motion is Motion.DYNAMIC]
    far = np.linalg.norm(
        trajectory.poses[:, free, :2] - trajectory.poses[:1, free, :2], axis=2
    ).max(axis=0)
    return int((far <= max(STILL, 0.005 * max(scene.size))).sum()), len(free)


def pushed(path: Path) -> tuple[str, str]:
    """The largest thing that can move, and a `--set` that sends it to the photo's middle."""
    scene = pipeline.load(path)
    compiled = pipeline.compile(scene, pipeline.percepts(scene))
    free = [k for k, item in enumerate(scene.objects) if item.motion is Motion.DYNAMIC]
    k = max(
        free,
        key=lambda k: cv2.contourArea(
            compiled.world.bodies[k].rings[0].astype(np.float32)
        ),
    )
    body = compiled.world.bodies[k]
    way = np.array(scene.size) / 2 - body.center
    if scene.world.view is View.SIDE:
        way = np.array([np.sign(way[0]) or 1.0, -0.4])
    way = (
        way / max(np.linalg.norm(way), 1e-9) * SPEED * max(scene.size) / 512 * body.mass
    )
    return (
        scene.objects[k].name,
        f"forces=[{{object: {scene.objects[k].name}, impulse: {way.round(1).tolist()}}}]",
    )


def headline(folder: Path) -> list[dict]:
    shutil.rmtree(folder, ignore_errors=True)
    rows = []
    for name, photo, truth in photos():
        rows.append(whole_way(name, photo, truth, folder))
        print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    pages = [
        sys.executable,
        "-m",
        "physgen",
        "gallery",
        str(folder / "clips"),
        "-o",
        str(folder / "index.html"),
    ]
    command(pages, check=True)
    return rows


LIVING = frozenset(
    [
        "person",
        "bird",
        "cat",
        "dog",
        "horse",
        "sheep",
        "cow",
        "elephant",
        "bear",
        "zebra",
        "giraffe",
    ]
)
STREET = frozenset(
    ("car", "truck", "bus", "train", "airplane", "boat", "motorcycle", "bicycle", "traffic light", "stop sign",
     "fire hydrant", "parking meter", "bench", "kite", "skis", "snowboard", "surfboard", "skateboard")
)  # fmt: skip
"""Classes of COCO that are seen outdoors."""


def sorted_photos(material: Path) -> Iterator[tuple[str, str, Path]]:
    """Kind, half ("tune" or "validation": every fifth of COCO) and photo; kinds of COCO by their true masks."""
    for name in ("peer-scenes", "photos"):
        for photo in sorted(material.glob(f"{name}/*/original.png")):
            yield "objects on supports", "validation", photo
    labels = json.loads((material / "coco" / "labels.json").read_text())
    for k, name in enumerate(sorted(labels, key=int)):
        mask = cv2.imread(str(material / "coco" / f"{name}.png"), cv2.IMREAD_GRAYSCALE)
        living = sum(
            float((mask == int(i)).mean())
            for i, what in labels[name].items()
            if what in LIVING
        )
        outdoors = not STREET.isdisjoint(labels[name].values())
        kind = (
            "people or animals, 10 % or more"
            if living >= 0.1
            else "outdoors"
            if outdoors
            else "other"
        )
        yield (
            kind,
            "validation" if k % 5 == 0 else "tune",
            material / "coco" / f"{name}.jpg",
        )


def suitability(material: Path) -> str:
    """A table: of each kind of photo, how many are found good."""
    from physgen.perceive.photo_objects import fit_objects
    from physgen.perceive.roles import Detections
    from physgen.perceive.segment.prompts import Segmenter
    from physgen.perceive.support.viewpoint import judge_suitability
    from physgen.photos import read_photo
    from physgen.registry import Backends

    crew, counts, why = (
        Backends(),
        Counter[tuple[str, str, str]](),
        Counter[tuple[str, str]](),
    )
    for kind, half, photo in sorted_photos(material):
        rgb = read_photo(photo).rgb
        segments = Segmenter(crew)(rgb)
        sure = {k + 1: float(c) for k, c in enumerate(segments.confidence)}
        found = Detections(
            segments.labels, "learned", sure, segments.names, doubtful=segments.doubtful
        )
        objects, _ = fit_objects(rgb, found)
        walls = crew.call("boundary", rgb, found.labels, objects, None)
        verdict = judge_suitability(rgb, found, objects, walls)
        print(photo, verdict, file=sys.stderr, flush=True)
        counts[kind, half, verdict.verdict] += 1
        why.update(
            (kind, re.sub(r"\d+ %", "N %", reason)) for reason in verdict.reasons
        )
    lines = ["| photos | half | good | doubtful |", "|---|---|---|---|"]
    for kind, half in sorted({(kind, half) for kind, half, _ in counts}):
        lines.append(
            f"| {kind} | {half} | {counts[kind, half, 'good']} | {counts[kind, half, 'doubtful']} |"
        )
    return "\n".join(
        [
            *lines,
            "",
            *(
                f"{count} x {kind}: {reason}"
                for (kind, reason), count in why.most_common()
            ),
        ]
    )


if __name__ == "__main__":
    if sys.argv[1] == "--suitability":
        print(suitability(Path(os.environ["PHYSGEN_MATERIAL"])))
        sys.exit()
    kept = {"machine": str(this_machine()), "rows": headline(Path(sys.argv[1]))}
    (Path(__file__).parent / "results" / "headline.json").write_text(
        json.dumps(kept, indent=1) + "\n"
    )
