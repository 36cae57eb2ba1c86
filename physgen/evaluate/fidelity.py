"""Frames against truth: the studio's true poses replayed, by physgen and by the paper's compositing.

Truth videos (`studio/truth/NAME/film`) hold poses and what a path tracer sees at them. The headline uses the maps that
`perceive` makes of the photo, given the true masks. Beside it stand the same with the true maps, and the paper's way:
objects cut out hard, relit, and pasted over the true background.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen import pipeline
from physgen.compile.compile import Compiled
from physgen.evaluate.measure import Bar, Findings, Progress, Section, Table, number
from physgen.geometry.polygon import rotation
from physgen.maps import F32, U8, Percepts
from physgen.perceive.perceive import KnownFacts, perceive
from physgen.perceive.roles import BoundaryGuess
from physgen.perceive.segment.prompts import from_masks
from physgen.photometry import DistantLight, decode, encode_u8, sphere_normals
from physgen.photos import read_image
from physgen.problems import InputError
from physgen.scene.scene import Light, Scene, Settings, Solid
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import Trajectory

Mask = NDArray[np.bool_]

REGIONS = ("objects", "shadows", "both", "rest")
"""`both`: objects and shadow regions together."""
BAR = 3.0
"""dB that ours is to be better than the paper's compositing with its relighting on shadows, on the test half."""
SHADOW = 6
"""Grey levels by which truth differs from the empty background where a shadow or a reflection falls."""
MOST_DB = 60.0
"""dB: what is equal counts as this."""

TRUTH = Path("studio/truth")
"""Of a checkout."""


@dataclass(frozen=True)
class Truth:
    """One truth video."""

    name: str
    scene: Scene
    maps: Percepts
    film: Mapping[str, Any]
    folder: Path

    def frames(self) -> Iterator[tuple[U8, Mask]]:
        """(H, W, 3) sRGB and where objects are (H, W), a frame after the other."""
        for k in range(1, len(self.film["times_s"]) + 1):
            yield (
                read_image(self.folder / f"{k:02}.webp"),
                read_ids(self.folder / f"ids-{k:02}.png") > 0,
            )


def read_ids(path: Path) -> U8:
    """(H, W) uint8 ids of a truth frame."""
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), np.uint8)


def truths(folder: Path, names: Sequence[str] = ()) -> list[Truth]:
    """Truth videos below `folder`, by name; raises InputError where there are none, or none of that name."""
    found = {
        path.parent.parent.name: path
        for path in sorted(folder.glob("*/film/film.json"))
    }
    if not found:
        fix = "name the folder of the studio's truth, studio/truth in physgen's repository"
        raise InputError.of("--truth", str(folder), "holds no truth videos", fix)
    wrong = [name for name in names if name not in found]
    if wrong:
        raise InputError.of(
            "--scenes",
            ", ".join(wrong),
            "has no truth video",
            f"choose from {', '.join(found)}",
        )
    result = []
    for name in names or found:
        film = json.loads(found[name].read_text())
        scene = pipeline.load(
            folder.resolve().parents[1] / film["scene"], variant=film["variant"]
        )
        maps = pipeline.percepts(scene)
        assert maps is not None
        normals = found[name].parent.parent / "normals.webp"
        if normals.exists():
            turned = (read_image(normals).astype(np.float32) - 128) / 127
            maps = replace(maps, normals=np.asarray(turned, np.float32))
        result.append(Truth(name, scene, maps, film, found[name].parent))
    return result


def replayed(truth: Truth, compiled: Compiled) -> Trajectory:
    """The stored poses as a trajectory, t = 0 first; how balls have turned is simulated again."""
    times = np.array([0.0, *truth.film["times_s"]])
    run = simulate(compiled.world, times)
    poses = run.poses.copy()
    for k, name in enumerate(run.names):
        stored = np.array(truth.film["objects"][name])
        poses[1:, k] = np.column_stack([stored[:, :2], np.radians(stored[:, 2])])
    return replace(run, poses=poses)


def ours(truth: Truth, scene: Scene, maps: Percepts) -> Iterator[U8]:
    """physgen's frames, after the photo itself."""
    compiled = pipeline.compile(scene, maps)
    frames = pipeline.render(
        pipeline.stage(scene, compiled, maps), replayed(truth, compiled)
    )
    next(frames)
    for frame in frames:
        yield frame.rgb


def seen(truth: Truth) -> tuple[Scene, Percepts]:
    """Scene and maps with what `perceive` makes of the photo, given the true masks; shapes and motion stay true."""
    world = truth.scene.world
    found = perceive(
        truth.maps.rgb,
        from_masks(truth.maps.labels),
        known=KnownFacts(BoundaryGuess(world.view, 1.0, "as given", ())),
    )
    light, around = found.document["light"], found.document["world"]
    direction = np.array(light["direction"], float)
    x, y, z = (direction / np.linalg.norm(direction)).tolist()
    sun = Light(
        (x, y, z), light["intensity"], light["ambient"], light.get("softness", 4.0)
    )
    settings: Settings = replace(
        world, tilt=around.get("tilt", 4.0), backdrop=around.get("backdrop")
    )
    return replace(truth.scene, light=sun, world=settings), found.percepts


def paper(truth: Truth, background: U8, light: DistantLight | None) -> Iterator[U8]:
    """Objects cut out by their masks, hard, and pasted over `background`; relit by Lambert's law where there is light.

    Relighting multiplies the photo by the shading of the turned normals over that of the first ones, with the true
    light and, for spheres, the true normals.
    """
    compiled = pipeline.compile(truth.scene, truth.maps)
    run = replayed(truth, compiled)
    height, width = compiled.labels.shape
    linear = decode(truth.maps.rgb)
    order = sorted(
        range(len(truth.scene.objects)), key=lambda k: truth.scene.objects[k].layer
    )
    for sample in range(1, len(run.times)):
        canvas = background.copy()
        for k in order:
            body = compiled.world.bodies[k]
            x, y, angle = run.poses[sample, k]
            turn = rotation(angle)
            matrix = np.concatenate(
                [turn, (np.array([[x], [y]]) - turn @ body.center[:, None])], axis=1
            )
            mask = (compiled.labels == k + 1).astype(np.uint8)
            there = (
                cv2.warpAffine(mask, matrix, (width, height), flags=cv2.INTER_NEAREST)
                > 0
            )
            look: F32 = linear
            if (
                light is not None
                and body.solid is Solid.SPHERE
                and body.radius is not None
            ):
                normals, _ = sphere_normals(
                    height, width, tuple(body.center.tolist()), body.radius
                )
                turned = normals.copy()
                turned[..., :2] = normals[..., :2] @ turn.T.astype(np.float32)
                ratio = light.shade(turned) / np.maximum(light.shade(normals), 0.05)
                look = np.asarray(linear * ratio[..., None], np.float32)
            moved = cv2.warpAffine(
                look, matrix, (width, height), flags=cv2.INTER_LINEAR
            )
            canvas[there] = encode_u8(np.asarray(moved, np.float32)[there])
        yield canvas


Ways = Mapping[str, Callable[[], Iterator[U8]]]
"""Ways to draw a video, by name."""


def ways(truth: Truth) -> Ways:
    """The headline, the same with true maps, and the paper's."""
    background = truth.maps.background
    assert background is not None
    return {
        "ours": lambda: ours(truth, *seen(truth)),
        "ours, true maps": lambda: ours(truth, truth.scene, truth.maps),
        "paper, relit": lambda: paper(truth, background, true_light(truth)),
    }


def true_light(truth: Truth) -> DistantLight:
    """The light of the path tracer's scene."""
    light = truth.scene.light
    assert light is not None
    return DistantLight(light.direction, light.intensity, light.ambient)


def psnr(error: NDArray[np.float64], where: Mask) -> float | None:
    """dB of squared errors (H, W), 0..1, over a region; None where it is empty."""
    if not where.any():
        return None
    return min(MOST_DB, float(-10 * np.log10(max(float(error[where].mean()), 1e-9))))


def ssim(a: U8, b: U8) -> F32:
    """(H, W) structural similarity of luma: Gaussian windows of 1.5 px (Wang, Bovik, Sheikh, Simoncelli, 2004)."""
    x, y = (cv2.cvtColor(p, cv2.COLOR_RGB2GRAY).astype(np.float32) for p in (a, b))

    def mean(v: Any) -> F32:
        return np.asarray(cv2.GaussianBlur(v, (11, 11), 1.5), np.float32)

    mx, my = mean(x), mean(y)
    vx, vy, vxy = mean(x * x) - mx * mx, mean(y * y) - my * my, mean(x * y) - mx * my
    c1, c2 = np.float32((0.01 * 255) ** 2), np.float32((0.03 * 255) ** 2)
    return np.asarray(
        ((2 * mx * my + c1) * (2 * vxy + c2))
        / ((mx * mx + my * my + c1) * (vx + vy + c2)),
        np.float32,
    )


def compared(truth: Truth, frames: Iterator[U8]) -> dict[str, float | None]:
    """PSNR (dB) and SSIM over objects, shadow regions and the rest; flicker: grey levels by which the error changes."""
    assert truth.maps.clean is not None
    empty = truth.maps.clean.astype(np.int16)
    sums: dict[str, list[float]] = {
        f"{m}_{r}": [] for m in ("psnr", "ssim") for r in REGIONS
    }
    flicker: list[float] = []
    before: NDArray[np.float64] | None = None
    for (true, objects), drawn in zip(truth.frames(), frames, strict=True):
        shaded = ~objects & (np.abs(true.astype(np.int16) - empty).max(-1) > SHADOW)
        off = (drawn.astype(np.float64) - true) / 255
        square, alike = (off**2).mean(-1), ssim(drawn, true)
        for region, where in zip(
            REGIONS,
            (objects, shaded, objects | shaded, ~objects & ~shaded),
            strict=True,
        ):
            if (decibels := psnr(square, where)) is not None:
                sums[f"psnr_{region}"].append(decibels)
                sums[f"ssim_{region}"].append(float(alike[where].mean()))
        if before is not None:
            flicker.append(float(np.abs(off - before)[objects | shaded].mean() * 255))
        before = off
    result: dict[str, float | None] = {
        key: float(np.mean(v)) if v else None for key, v in sums.items()
    }
    result["flicker"] = float(np.mean(flicker)) if flicker else None
    return result


def evaluate(
    folder: Path,
    names: Sequence[str] = (),
    progress: Progress = lambda *_: None,
    ways: Callable[[Truth], Ways] = ways,
) -> dict[str, Any]:
    """Every way on every truth video below `folder`; means over the scenes of each half of the split."""
    films = truths(folder, names)
    file = folder / "../split.json"
    split = json.loads(file.read_text()) if file.exists() else {}
    rows: list[dict[str, Any]] = []
    for k, truth in enumerate(films):
        half = next(
            (half for half in ("tune", "test") if truth.name in split.get(half, ())), ""
        )
        for name, draw in ways(truth).items():
            progress(f"{truth.name}: {name}", k, len(films))
            rows.append(
                {
                    "scene": truth.name,
                    "half": half,
                    "way": name,
                    **compared(truth, draw()),
                }
            )
    found = means(rows)
    return {"rows": rows, "means": found, "ahead": ahead(found)}


@dataclass(frozen=True)
class Ahead:
    """dB by which the headline is better than the paper's relit compositing, on the test half."""

    shadows: float
    objects: float

    @property
    def reached(self) -> bool:
        """Better by `BAR` on shadows, and no worse on objects."""
        return self.shadows >= BAR and self.objects >= 0

    def __str__(self) -> str:
        return f"{self.shadows:.2f} dB on shadows, {self.objects:.2f} dB on objects"


def ahead(found: Sequence[Mapping[str, Any]]) -> Ahead | None:
    """None where either way is missing on the test half."""
    mine = {row["way"]: row for row in found if row["half"] == "test"}
    if "ours" not in mine or "paper, relit" not in mine:
        return None
    own, other = mine["ours"], mine["paper, relit"]
    shadows, objects = (
        float(own[key] - other[key]) for key in ("psnr_shadows", "psnr_objects")
    )
    return Ahead(shadows, objects)


def means(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Of every way, over the scenes of each half."""
    found = []
    for half in ("test", "tune"):
        for way in dict.fromkeys(row["way"] for row in rows):
            mine = [row for row in rows if row["way"] == way and row["half"] == half]
            if mine:
                keys = [key for key in mine[0] if key not in ("scene", "half", "way")]
                values = {
                    key: [float(row[key]) for row in mine if row[key] is not None]
                    for key in keys
                }
                average = {
                    key: float(np.mean(some)) for key, some in values.items() if some
                }
                found.append({"half": half, "way": way, **average})
    return found


# ---- report ------------------------------------------------------------------------------------------------------

SHOWN_WAYS = ("ours", "ours, true maps", "paper, relit")
"""Of the table scene by scene."""
STRIP_WAYS, COLUMNS = ("paper, relit", "ours"), 4
"""Rows of a strip above the truth, and frames in a row."""


def findings(result: Mapping[str, Any]) -> Findings:
    """Of the result of `evaluate`; no bar where no scene is of the test half."""
    ahead = result["ahead"]
    sentence, bars = (
        "None of these scenes is of the test half: there is no bar.",
        tuple[Bar, ...](),
    )
    if ahead is not None:
        better = "ours over the paper's way, relit, on the test half"
        bars = (
            Bar(
                better,
                str(ahead),
                f"{BAR:g} dB on shadows, 0 on objects",
                ahead.reached,
            ),
        )
        sentence = (
            f"On the test half, ours is nearer to the truth than the paper's way, relit, by {ahead}. "
            "The bar is this project's own."
        )
    heads = (
        "half",
        "way",
        *(f"{r}, dB" for r in REGIONS),
        *(f"{r}, SSIM" for r in REGIONS),
        "flicker",
    )
    keys = [*(f"psnr_{r}" for r in REGIONS), *(f"ssim_{r}" for r in REGIONS), "flicker"]
    rows = tuple(
        (row["half"], row["way"], *(_cell(row, key) for key in keys))
        for row in result["means"]
    )
    by_scene = _by_scene(result["rows"])
    ways = [way for way in SHOWN_WAYS if any(way in mine for mine in by_scene.values())]
    lines = []
    for name, mine in by_scene.items():
        cells = (
            f"{_cell(mine[way], 'psnr_objects')} / {_cell(mine[way], 'psnr_shadows')}"
            for way in ways
        )
        lines.append((name, next(iter(mine.values()))["half"], *cells))
    scene_heads = ("scene", "half", *(f"{way}: objects / shadows, dB" for way in ways))
    sections = (
        Section("Means over scenes", (), (Table(heads, rows),)),
        Section("Scene by scene", (), (Table(scene_heads, tuple(lines)),)),
    )
    more = {"means": result["means"], "ahead": None if ahead is None else asdict(ahead)}
    return Findings(
        "fidelity",
        "Frames against the truth",
        (sentence,),
        sections,
        result["rows"],
        bars,
        more,
    )


def _by_scene(
    found: Sequence[Mapping[str, Any]],
) -> dict[str, dict[str, Mapping[str, Any]]]:
    names = dict.fromkeys(row["scene"] for row in found)
    return {
        name: {row["way"]: row for row in found if row["scene"] == name}
        for name in names
    }


def _cell(row: Mapping[str, Any], key: str) -> str:
    return number(row.get(key), ".3f" if key.startswith("ssim") else ".2f")


def write_strips(truth: Truth, path: Path) -> None:
    """A picture with rows of the paper's way, ours and the truth, from above, at the same moments."""
    count = len(truth.film["times_s"])
    chosen = {round((k + 1) * count / COLUMNS) - 1 for k in range(min(COLUMNS, count))}
    draw = ways(truth)
    rows = [*(draw[name]() for name in STRIP_WAYS), (rgb for rgb, _ in truth.frames())]
    strips = [
        np.hstack([frame for k, frame in enumerate(frames) if k in chosen])
        for frames in rows
    ]
    cv2.imwrite(str(path), cv2.cvtColor(np.vstack(strips), cv2.COLOR_RGB2BGR))
