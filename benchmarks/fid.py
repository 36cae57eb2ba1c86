"""The paper's ablation of physical reasoning, against the studio's 50 clips of one scene: estimated physics and random.

The studio filmed the true scene of `scenes/shelf` 50 times, the push of the ball varied. Here the photo is perceived,
told what a user sees (masks, names and the scale), and pushed 50 times, by pushes of the same distribution: with the
physics that `perceive` estimates, and, seed after seed, with physics drawn from ranges that hold for what stands in a
home, anew for every clip or once for all 50. Beside them the estimate with true masses given, and with all physics
told. `evaluate fid` then says how far each set of clips is from the filmed one.
The paper's pair is 105.70 and 111.01 by Image-FID, 30.20 and 36.60 by Motion-FID, on another scene, with Inception.

A push is said in two ways: as an impulse, which a wrong mass turns into a wrong speed, and as the speed itself.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from picture_features import Bank

from physgen import pipeline
from physgen.evaluate.fid import Distance, cloud, frechet
from physgen.maps import Percepts, read_labels
from physgen.perceive.perceive import KnownFacts, perceive
from physgen.perceive.scene_files import write_scene
from physgen.perceive.segment.prompts import from_masks
from physgen.photos import read_image
from physgen.render.stage import Stage
from physgen.simulate.engine import simulate

ROOT = Path(__file__).resolve().parents[1]
NAME = "shelf"
CLIPS = ROOT / "studio/truth" / NAME / "clips"
TRUTH = ROOT / "scenes" / NAME / "scene.yaml"
BALL = 1
"""Its id in the masks."""
FILMED, OURS = 1000, 2000
"""First seeds of the pushes: of the studio's clips, and of other ones for all methods here."""
SEEDS = 5
"""Of random physics."""
RANGES = {"mass": (50.0, 1000.0), "friction": (0.1, 1.0), "elasticity": (0.1, 0.9)}
"""g, drawn evenly by the logarithm; the others evenly. What small things in a home are, without a look at the photo."""
TOLD = ("estimated", "masses given", "all given")
"""What is known of the objects' physics: nothing but the photo, the true masses, all."""
WAYS = ("impulse", "speed")
QUALITY = 90
"""Of WebP, as the studio's clips are stored."""


@dataclass(frozen=True)
class Take:
    """One way to make 50 clips."""

    scene: Path
    edit: Callable[[int], list[str]]
    """Of the k-th clip."""


def push(seed: int) -> tuple[float, np.ndarray]:
    """Speed in m/s and direction, +x right, +y down: as studio/sets/shelf.py draws them."""
    rng = np.random.default_rng(seed)
    speed, rise = rng.uniform(0.4, 3.5), np.radians(rng.uniform(0, 25))
    return speed, np.array([np.cos(rise), -np.sin(rise)])


def pushed(take_ball: str, way: str, seed: int, mass: float, scale: float) -> list[str]:
    """As an impulse (g px/s) on a ball of the true mass, or as its speed (px/s)."""
    speed, way_to = push(seed)
    x, y = (
        round(float(v), 3)
        for v in speed * scale * way_to * (mass if way == "impulse" else 1)
    )
    if way == "impulse":
        return [f"forces=[{{object: {take_ball}, impulse: [{x}, {y}]}}]"]
    return ["forces=[]", f"objects.{take_ball}.velocity=[{x}, {y}]"]


def drawn(names: list[str], seed: int) -> list[str]:
    """Random physics of all objects."""
    rng = np.random.default_rng(seed)
    edits = []
    for name in names:
        for key, (low, high) in RANGES.items():
            value = (
                np.exp(rng.uniform(np.log(low), np.log(high)))
                if key == "mass"
                else rng.uniform(low, high)
            )
            edits.append(f"objects.{name}.{key}={value:.4g}")
    return edits


def perceived(folder: Path) -> Path:
    """The photo as it is perceived where masks, names and the scale are told."""
    true = json.loads((CLIPS.parent / "truth.json").read_text())
    photo = TRUTH.with_name("photo.png")
    labels = read_labels(TRUTH.parent / "photo.assets/masks.png")
    renames = [f"{one['id']}={one['label']}" for one in true["objects"]]
    found = perceive(
        read_image(photo),
        from_masks(labels),
        renames=renames,
        facts=KnownFacts(pixels_per_meter=true["pixels_per_meter"]),
    )
    write_scene(found, photo, "photo", folder / "scene.yaml")
    return folder / "scene.yaml"


def takes(folder: Path) -> Iterator[tuple[str, Take]]:
    """By name, the estimated physics first."""
    path = perceived(folder / "perceived")
    scene, true = pipeline.load(path), pipeline.load(TRUTH)
    by_mask = {one.mask.id: one.name for one in scene.objects}
    ball, names = by_mask[BALL], [one.name for one in scene.objects]
    true_ball = next(one for one in true.objects if one.mask.id == BALL)
    mass, scale = true_ball.mass, true.world.pixels_per_meter
    known = {
        key: [
            f"objects.{by_mask[one.mask.id]}.{key}={getattr(one, key)}"
            for one in true.objects
        ]
        for key in (*RANGES, "rolling")
    }
    edits_of = ([], known["mass"], [edit for one in known.values() for edit in one])
    for way in WAYS:

        def at(k: int, way: str = way) -> list[str]:
            return pushed(ball, way, OURS + k, mass, scale)

        for name, edits in zip(TOLD, edits_of, strict=True):
            yield (
                f"{name}, {way}",
                Take(path, lambda k, at=at, edits=edits: [*at(k), *edits]),
            )
        for seed in range(1, SEEDS + 1):
            first = 10_000 * seed
            yield (
                f"random {seed}, {way}",
                Take(
                    path,
                    lambda k, at=at, first=first: [*at(k), *drawn(names, first + k)],
                ),
            )
            yield (
                f"random {seed} held, {way}",
                Take(
                    path, lambda k, at=at, first=first: [*at(k), *drawn(names, first)]
                ),
            )
    yield (
        "true scene",
        Take(TRUTH, lambda k: pushed(true_ball.name, "impulse", OURS + k, mass, scale)),
    )


class Filmed:
    """Draws clips of one scene file; what is cut out of the photo stays for the next clip."""

    def __init__(self, scene: Path, times: np.ndarray, side: int) -> None:
        self._path, self._times, self._side = scene, times, side
        self._maps: Percepts | None = None
        self._stage: Stage | None = None

    def clip(self, edits: list[str]) -> np.ndarray:
        """(side, frames x side, 3) sRGB."""
        scene = pipeline.load(self._path, overrides=edits)
        self._maps = self._maps or pipeline.percepts(scene)
        compiled = pipeline.compile(scene, self._maps)
        self._stage = self._stage or pipeline.stage(scene, compiled, self._maps)
        motion = simulate(
            compiled.world, np.array([0.0, *self._times])
        )  # a trajectory begins as the photo is
        size = self._side, self._side
        drawn = pipeline.render(self._stage, motion)
        next(drawn)  # the studio's clips have no frame of the photo itself
        return np.hstack(
            [
                cv2.resize(frame.rgb, size, interpolation=cv2.INTER_AREA)
                for frame in drawn
            ]
        )


def write(folder: Path, k: int, strip: np.ndarray, side: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "clips.json").write_text(json.dumps({"frame": [side, side]}))
    _, data = cv2.imencode(
        ".webp", strip[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, QUALITY]
    )
    (folder / f"{k:02}.webp").write_bytes(data)


def unrolled(strips: Path, folder: Path) -> Path:
    """Of each strip of frames a folder with its frames, as the measure reads clips."""
    width, _ = json.loads((strips / "clips.json").read_text())["frame"]
    for path in sorted(strips.glob("*.webp")):
        (folder / path.stem).mkdir(parents=True)
        strip = read_image(path)
        for k in range(strip.shape[1] // width):
            frame = strip[:, k * width : (k + 1) * width, ::-1]
            cv2.imwrite(str(folder / path.stem / f"{k:02}.png"), frame)
    return folder


def fid(folder: Path) -> list[dict]:
    """Distances of every set of clips from the filmed one, and what they were reckoned with."""
    from physgen.evaluate import fid as told
    from physgen.evaluate.clip_frames import sources

    filmed = json.loads((CLIPS / "clips.json").read_text())
    side, times = filmed["frame"][0], np.array(filmed["times_s"])
    shooting: dict[Path, Filmed] = {}
    methods = {}
    for name, take in takes(folder):
        film = shooting.setdefault(take.scene, Filmed(take.scene, times, side))
        for k in range(len(filmed["clips"])):
            write(folder / name, k, film.clip(take.edit(k)), side)
        methods[name] = sources([unrolled(folder / name, folder / "frames" / name)])
        print(name, file=sys.stderr, flush=True)
    photo = cv2.resize(
        read_image(TRUTH.with_name("photo.png")),
        (side, side),
        interpolation=cv2.INTER_AREA,
    )
    for k in range(len(filmed["clips"])):
        write(folder / "still", k, np.hstack([photo] * len(times)), side)
    methods["still"] = sources(
        [unrolled(folder / "still", folder / "frames" / "still")]
    )
    truth = sources([unrolled(CLIPS, folder / "frames" / "filmed")])
    found = told.measure(truth, methods, Bank(), told.Settings())
    rows = told.rows(found)
    for row in rows:
        name, _, way = row["method"].partition(", ")
        if name.startswith("random"):
            row["farther_than"] = {
                other: {
                    kind: farther(one[row["method"]], one[f"{other}, {way}"])
                    for kind, one in found.distances.items()
                }
                for other in TOLD
            }
    halved = {
        f"{kind}_fid": halves(features)
        for kind, features in found.reference.features.items()
    }
    return [
        *map(rounded, rows),
        rounded(
            {"method": "halves", **halved, "settings": told.settings_record(found)}
        ),
        guesses(),
    ]


def farther(one: Distance, other: Distance) -> dict:
    """Than the other, from the filmed clips: by how much, within which interval, and in which share of draws.

    Methods share the draws, so that what they have in common cancels.
    """
    draws = np.subtract(one.draws, other.draws) + 0.0
    interval = np.quantile(draws, [0.025, 0.975]).tolist() if len(draws) else None
    sure = float(np.mean(draws > 0)) if len(draws) else None
    return {"by": one.value - other.value, "95": interval, "sure": sure}


def halves(features: list[np.ndarray]) -> float:
    """Mean distance of two halves of clips, of 8 random halvings."""
    side, random, found = cloud(features), np.random.default_rng(0), []
    for _ in range(8):
        half = np.zeros(side.count)
        half[random.permutation(side.count)[: side.count // 2]] = 1
        found.append(frechet(side.moments_of(half), side.moments_of(1 - half)))
    return float(np.mean(found))


def guesses() -> dict:
    """What the table says of the objects, beside the truth: by id in the masks."""
    with tempfile.TemporaryDirectory() as folder:
        scene, true = pipeline.load(perceived(Path(folder))), pipeline.load(TRUTH)
    found = {}
    for one in true.objects:
        guess = next(o for o in scene.objects if o.mask.id == one.mask.id)
        found[one.name] = {
            key: [
                round(float(getattr(one, key)), 4),
                round(float(getattr(guess, key)), 4),
            ]
            for key in RANGES
        }
    return {"method": "guesses", "true_and_estimated": found}


def rounded(value: object) -> object:
    """Numbers to five digits, as a page needs them."""
    if isinstance(value, dict):
        return {key: rounded(part) for key, part in value.items()}
    if isinstance(value, list):
        return [rounded(part) for part in value]
    return float(f"{value:.5g}") if isinstance(value, float) else value
