"""Compare frames with ground truth: replay the studio's true poses by physgen and by
the paper's compositing.

Truth videos (`studio/truth/NAME/film`) have poses and their path-traced frames. The
headline uses the maps from `perceive` with the true masks. Other ways are the true
maps, and the paper's compositing: objects with hard borders, relit, over the true
background.
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
from physgen.compile.compile import CompiledScene
from physgen.compile.world import Body
from physgen.evaluate.measure import Bar, Findings, Progress, Section, Table, number
from physgen.geometry.polygon import rotation
from physgen.maps import F32, U8, Percepts
from physgen.messages import Message
from physgen.perceive.perceive import KnownFacts, perceive
from physgen.perceive.roles import BoundaryGuess
from physgen.perceive.segment.prompts import from_masks
from physgen.photometry import DistantLight, decode, encode_u8, sphere_normals
from physgen.photos import read_image
from physgen.scene.scene import Light, Scene, Settings, Solid
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import Trajectory

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

REGIONS = ("objects", "shadows", "both", "rest")
"""`both`: objects and shadow regions together."""
BAR = 3.0
"""Minimum advantage over the paper's relit compositing on shadows of the test
half, dB.
"""
SHADOW = 6
"""Minimum difference from the empty background in a shadow or a reflection, grey
levels.
"""
MAX_DB = 60.0
"""PSNR of equal pictures, dB."""
MIN_ERROR = 1e-9
"""Squared error of equal pictures, 0..1."""
MIN_SHADE = 0.05
"""Minimum shading as a divisor of the photo."""
HALVES = ("test", "tune")

TRUTH = Path("studio/truth")
"""Folder in a checkout."""


@dataclass(frozen=True)
class Truth:
    """One truth video."""

    name: str
    scene: Scene
    maps: Percepts
    film: Mapping[str, Any]
    folder: Path

    def frames(self) -> Iterator[tuple[U8, Mask]]:
        """Yield each frame (H, W, 3) sRGB, and its mask of objects (H, W)."""
        for k in range(1, len(self.film["times_s"]) + 1):
            rgb = read_image(self.folder / f"{k:02}.webp")
            yield rgb, read_ids(self.folder / f"ids-{k:02}.png") > 0


def read_ids(path: Path) -> U8:
    """Return the ids of a truth frame, (H, W) uint8."""
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), np.uint8)


def truths(folder: Path, names: Sequence[str] = ()) -> list[Truth]:
    """Return the truth videos below a folder by name; all without names.

    Raise InputError for a folder without truth videos, or for an unknown name.
    """
    paths = {}
    for path in sorted(folder.glob("*/film/film.json")):
        paths[path.parent.parent.name] = path
    if not paths:
        raise Message.NO_TRUTH_VIDEOS.error("--truth", str(folder))
    unknown_names = []
    for name in names:
        if name not in paths:
            unknown_names.append(name)
    if unknown_names:
        raise Message.UNKNOWN_TRUTH.error(
            "--scenes", ", ".join(unknown_names), names=", ".join(paths)
        )
    # The folder is `studio/truth` of a checkout, and scenes are named from its top.
    root = folder.resolve().parents[1]
    return [_read_truth(name, paths[name], root) for name in names or paths]


def _read_truth(name: str, path: Path, root: Path) -> Truth:
    """Return the truth video of a `film.json`; its scene is below `root`."""
    film = json.loads(path.read_text())
    scene = pipeline.load(root / film["scene"], variant=film["variant"])
    maps = pipeline.percepts(scene)
    assert maps is not None
    normals_path = path.parent.parent / "normals.webp"
    if normals_path.exists():
        # The code 128 means 0, and 127 steps are 1.
        normals = (read_image(normals_path).astype(np.float32) - 128) / 127
        maps = replace(maps, normals=np.asarray(normals, np.float32))
    return Truth(name, scene, maps, film, path.parent)


def replay(truth: Truth, compilation: CompiledScene) -> Trajectory:
    """Return the stored poses as a trajectory from t = 0. The roll of balls is
    simulated again.
    """
    times = np.array([0.0, *truth.film["times_s"]])
    trajectory = simulate(compilation.world, times)
    poses = trajectory.poses.copy()
    for k, name in enumerate(trajectory.names):
        stored_poses = np.array(truth.film["objects"][name])
        angles = np.radians(stored_poses[:, 2])
        # Row 0 is the photo, with the poses of the scene.
        poses[1:, k] = np.column_stack([stored_poses[:, :2], angles])
    return replace(trajectory, poses=poses)


def render_own_frames(truth: Truth, scene: Scene, maps: Percepts) -> Iterator[U8]:
    """Yield the photo itself, and physgen's frames."""
    compiled = pipeline.compile(scene, maps)
    stage = pipeline.stage(scene, compiled, maps)
    frames = pipeline.render(stage, replay(truth, compiled))
    # The first frame is the photo at t = 0; the truth begins after it.
    next(frames)
    for frame in frames:
        yield frame.rgb


def perceive_truth(truth: Truth) -> tuple[Scene, Percepts]:
    """Return scene and maps of `perceive` for the photo with the true masks. Shapes and
    motion are true.
    """
    world = truth.scene.world
    perception = perceive(
        truth.maps.rgb,
        from_masks(truth.maps.labels),
        facts=KnownFacts(BoundaryGuess(world.view, 1.0, "as given", ())),
    )
    light = perception.document["light"]
    document = perception.document["world"]
    direction = np.array(light["direction"], float)
    x, y, z = (direction / np.linalg.norm(direction)).tolist()
    softness = light.get("softness", 4.0)
    scene_light = Light((x, y, z), light["intensity"], light["ambient"], softness)
    settings: Settings = replace(
        world, tilt=document.get("tilt", 4.0), backdrop=document.get("backdrop")
    )
    scene = replace(truth.scene, light=scene_light, world=settings)
    return scene, perception.percepts


def paper(truth: Truth, background: U8, light: DistantLight | None) -> Iterator[U8]:
    """Yield frames of hard cut-outs over a background, relit by Lambert's law if there
    is a light.

    Relighting multiplies the photo by the ratio of the shading of turned and original
    normals, with the true light and, for spheres, the true normals.
    """
    compiled = pipeline.compile(truth.scene, truth.maps)
    trajectory = replay(truth, compiled)
    photo = decode(truth.maps.rgb)
    objects = truth.scene.objects
    # Nearer layers are pasted last and cover farther ones.
    order = sorted(range(len(objects)), key=lambda k: objects[k].layer)
    for sample in range(1, len(trajectory.times)):
        canvas = background.copy()
        for k in order:
            body = compiled.world.bodies[k]
            pose = trajectory.poses[sample, k]
            look: F32 = photo
            # Only spheres have normals that the paper's way could know.
            if light is not None and body.solid is Solid.SPHERE:
                look = _relight(photo, body, pose[2], light)
            _paste(canvas, compiled.labels == k + 1, look, body, pose)
        yield canvas


def _relight(photo: F32, body: Body, angle: float, light: DistantLight) -> F32:
    """Return the linear photo with the shading of a turned sphere; `angle` in rad."""
    if body.radius is None:
        return photo
    height, width = photo.shape[:2]
    center = tuple(body.center.tolist())
    normals, _ = sphere_normals(height, width, center, body.radius)
    # A turned picture shows at each pixel the normal of another place: the row vectors
    # are multiplied by the inverse rotation.
    turned_normals = normals.copy()
    turn = rotation(angle).T.astype(np.float32)
    turned_normals[..., :2] = normals[..., :2] @ turn
    shading = np.maximum(light.shade(normals), MIN_SHADE)
    # The photo contains the first shading; the ratio replaces it by the new one.
    ratio = light.shade(turned_normals) / shading
    return np.asarray(photo * ratio[..., None], np.float32)


def _paste(canvas: U8, mask: Mask, look: F32, body: Body, pose: F64) -> None:
    """Paste an object's pixels of a linear picture over a canvas at a pose (x
    px, y px, angle rad).
    """
    height, width = mask.shape
    x, y, angle = pose
    turn = rotation(angle)
    # The rotation is about the centre of mass, which moves to (x, y).
    shift = np.array([[x], [y]]) - turn @ body.center[:, None]
    matrix = np.concatenate([turn, shift], axis=1)

    def warp(picture: Any, interpolation: int) -> Any:
        return cv2.warpAffine(picture, matrix, (width, height), flags=interpolation)

    # The paper's cut-outs have hard borders: no mask value between 0 and 1.
    is_covered = warp(mask.astype(np.uint8), cv2.INTER_NEAREST) > 0
    pixels = np.asarray(warp(look, cv2.INTER_LINEAR), np.float32)
    canvas[is_covered] = encode_u8(pixels[is_covered])


Ways = Mapping[str, Callable[[], Iterator[U8]]]
"""Ways to draw a video, by name."""


def ways(truth: Truth) -> Ways:
    """Return the headline, the same with true maps, and the paper's way."""
    background = truth.maps.background
    assert background is not None
    return {
        "ours": lambda: render_own_frames(truth, *perceive_truth(truth)),
        "ours, true maps": lambda: render_own_frames(truth, truth.scene, truth.maps),
        "paper, relit": lambda: paper(truth, background, true_light(truth)),
    }


def true_light(truth: Truth) -> DistantLight:
    """Return the light of the path tracer's scene."""
    light = truth.scene.light
    assert light is not None
    return DistantLight(light.direction, light.intensity, light.ambient)


def psnr(error: F64, region: Mask) -> float | None:
    """Return dB of squared errors (H, W), 0..1, over a region; None if it is empty."""
    if not region.any():
        return None
    mean_error = max(float(error[region].mean()), MIN_ERROR)
    return min(MAX_DB, float(-10 * np.log10(mean_error)))


def ssim(a: U8, b: U8) -> F32:
    """Return the structural similarity of luma, (H, W), with Gaussian windows of 1.5 px
    (Wang et al., 2004).
    """
    x = cv2.cvtColor(a, cv2.COLOR_RGB2GRAY).astype(np.float32)
    y = cv2.cvtColor(b, cv2.COLOR_RGB2GRAY).astype(np.float32)

    def mean(v: Any) -> F32:
        return np.asarray(cv2.GaussianBlur(v, (11, 11), 1.5), np.float32)

    # Equation 13 of the paper, with its constants K1 = 0.01 and K2 = 0.03.
    mx, my = mean(x), mean(y)
    # The variance is the mean of the squares less the square of the mean.
    vx = mean(x * x) - mx * mx
    vy = mean(y * y) - my * my
    vxy = mean(x * y) - mx * my
    c1 = np.float32((0.01 * 255) ** 2)
    c2 = np.float32((0.03 * 255) ** 2)
    numerator = (2 * mx * my + c1) * (2 * vxy + c2)
    denominator = (mx * mx + my * my + c1) * (vx + vy + c2)
    return np.asarray(numerator / denominator, np.float32)


def compare(truth: Truth, frames: Iterator[U8]) -> dict[str, float | None]:
    """Return PSNR (dB) and SSIM over objects, shadow regions and the rest, and the flicker.

    Flicker is the mean change of the error from frame to frame, grey levels.
    """
    values: dict[str, list[float]] = {}
    for measure in ("psnr", "ssim"):
        for name in REGIONS:
            values[f"{measure}_{name}"] = []
    values["flicker"] = []
    last_error: F64 | None = None
    for (true_frame, objects), frame in zip(truth.frames(), frames, strict=True):
        regions = _regions(truth, true_frame, objects)
        error = (frame.astype(np.float64) - true_frame) / 255
        # The error contains its sign, in shares of full scale. Its mean square gives
        # PSNR, and its change from frame to frame the flicker.
        square = (error**2).mean(-1)
        similarity = ssim(frame, true_frame)
        for name, region in regions.items():
            decibels = psnr(square, region)
            if decibels is not None:
                values[f"psnr_{name}"].append(decibels)
                values[f"ssim_{name}"].append(float(similarity[region].mean()))
        if last_error is not None:
            # A constant error does not flicker.
            change = np.abs(error - last_error)[regions["both"]]
            values["flicker"].append(float(change.mean() * 255))
        last_error = error
    return {name: _mean(numbers) for name, numbers in values.items()}


def _regions(truth: Truth, frame: U8, objects: Mask) -> dict[str, Mask]:
    """Return the mask (H, W) of each region of a true frame."""
    assert truth.maps.clean is not None
    clean = truth.maps.clean.astype(np.int16)
    difference = np.abs(frame.astype(np.int16) - clean)
    # Shadows are the pixels that differ from the clean background by more than noise.
    shadows = ~objects & (difference.max(-1) > SHADOW)
    masks = (objects, shadows, objects | shadows, ~objects & ~shadows)
    return dict(zip(REGIONS, masks, strict=True))


def _mean(values: Sequence[float]) -> float | None:
    if values:
        return float(np.mean(values))
    return None


def evaluate(
    folder: Path,
    names: Sequence[str] = (),
    progress: Progress = lambda *_: None,
    ways: Callable[[Truth], Ways] = ways,
) -> dict[str, Any]:
    """Compare every way on every truth video below a folder; means are over the
    scenes of each half of the split.
    """
    films = truths(folder, names)
    path = folder / "../split.json"
    if path.exists():
        split = json.loads(path.read_text())
    else:
        split = {}
    rows: list[dict[str, Any]] = []
    for k, truth in enumerate(films):
        half = _find_half(truth.name, split)
        for name, draw in ways(truth).items():
            progress(f"{truth.name}: {name}", k, len(films))
            row = {"scene": truth.name, "half": half, "way": name}
            rows.append({**row, **compare(truth, draw())})
    averages = means(rows)
    return {"rows": rows, "means": averages, "ahead": ahead(averages)}


def _find_half(name: str, split: Mapping[str, Sequence[str]]) -> str:
    """Return the half of a scene, or "" for a scene outside the split."""
    for half in ("tune", "test"):
        if name in split.get(half, ()):
            return half
    return ""


@dataclass(frozen=True)
class Ahead:
    """Advantage of the headline over the paper's relit compositing on the test half,
    dB.
    """

    shadows: float
    objects: float

    @property
    def is_enough(self) -> bool:
        """Return whether ours is better by `BAR` on shadows, and not worse on
        objects.
        """
        return self.shadows >= BAR and self.objects >= 0

    def __str__(self) -> str:
        return f"{self.shadows:.2f} dB on shadows, {self.objects:.2f} dB on objects"


def ahead(means: Sequence[Mapping[str, Any]]) -> Ahead | None:
    """Return the advantage of ours, or None without both ways on the test half."""
    by_way = {}
    for row in means:
        if row["half"] == "test":
            by_way[row["way"]] = row
    if "ours" not in by_way or "paper, relit" not in by_way:
        return None
    own, paper = by_way["ours"], by_way["paper, relit"]
    return Ahead(
        shadows=float(own["psnr_shadows"] - paper["psnr_shadows"]),
        objects=float(own["psnr_objects"] - paper["psnr_objects"]),
    )


def means(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the means of every way, over the scenes of each half."""
    averages = []
    ways = dict.fromkeys(row["way"] for row in rows)
    for half in HALVES:
        for way in ways:
            group = []
            for row in rows:
                if row["way"] == way and row["half"] == half:
                    group.append(row)
            if group:
                average = {"half": half, "way": way, **_average(group)}
                averages.append(average)
    return averages


def _average(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the mean of each measure over the rows."""
    averages = {}
    for key in rows[0]:
        if key in ("scene", "half", "way"):
            continue
        values = []
        for row in rows:
            if row[key] is not None:
                values.append(float(row[key]))
        if values:
            averages[key] = float(np.mean(values))
    return averages


# ---- report

SCENE_WAYS = ("ours", "ours, true maps", "paper, relit")
"""Columns of the table of scenes."""
STRIP_WAYS, COLUMNS = ("paper, relit", "ours"), 4
"""Rows of a strip above the truth, and number of frames in a row."""


def findings(result: Mapping[str, Any]) -> Findings:
    """Return the findings of a result of `evaluate`, without a bar if it has no scene
    of the test half.
    """
    advantage = result["ahead"]
    sentence = "None of these scenes is of the test half: there is no bar."
    bars: tuple[Bar, ...] = ()
    if advantage is not None:
        label = "ours over the paper's way, relit, on the test half"
        limit = f"{BAR:g} dB on shadows, 0 on objects"
        bars = (Bar(label, str(advantage), limit, advantage.is_enough),)
        sentence = (
            f"On the test half, ours is nearer to the truth than the paper's way, relit, by {advantage}. "
            "The bar is this project's own."
        )
    return Findings(
        measure="fidelity",
        title="Frames against the truth",
        sentences=(sentence,),
        sections=(
            Section("Means over scenes", (), (_means_table(result["means"]),)),
            Section("Scene by scene", (), (_scene_table(result["rows"]),)),
        ),
        rows=result["rows"],
        bars=bars,
        extra={
            "means": result["means"],
            "ahead": None if advantage is None else asdict(advantage),
        },
    )


def _means_table(means: Sequence[Mapping[str, Any]]) -> Table:
    psnr_heads = [f"{region}, dB" for region in REGIONS]
    ssim_heads = [f"{region}, SSIM" for region in REGIONS]
    heads = ("half", "way", *psnr_heads, *ssim_heads, "flicker")
    psnr_keys = [f"psnr_{region}" for region in REGIONS]
    ssim_keys = [f"ssim_{region}" for region in REGIONS]
    keys = (*psnr_keys, *ssim_keys, "flicker")
    lines = []
    for row in means:
        cells = (_cell(row, key) for key in keys)
        lines.append((row["half"], row["way"], *cells))
    return Table(heads, tuple(lines))


def _scene_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return the table of PSNR on objects and shadows, one line per scene."""
    by_scene: dict[str, dict[str, Mapping[str, Any]]] = {}
    for row in rows:
        by_scene.setdefault(row["scene"], {})[row["way"]] = row
    ways = []
    for way in SCENE_WAYS:
        if any(way in by_way for by_way in by_scene.values()):
            ways.append(way)
    lines = []
    for name, by_way in by_scene.items():
        half = next(iter(by_way.values()))["half"]
        cells = []
        for way in ways:
            objects = _cell(by_way[way], "psnr_objects")
            cells.append(f"{objects} / {_cell(by_way[way], 'psnr_shadows')}")
        lines.append((name, half, *cells))
    way_heads = (f"{way}: objects / shadows, dB" for way in ways)
    return Table(("scene", "half", *way_heads), tuple(lines))


def _cell(row: Mapping[str, Any], key: str) -> str:
    return number(row.get(key), ".3f" if key.startswith("ssim") else ".2f")


def write_strips(truth: Truth, path: Path) -> None:
    """Write a picture with rows of the paper's way, ours and the truth, from
    above, at the same moments.
    """
    count = len(truth.film["times_s"])
    columns = range(min(COLUMNS, count))
    # Moments evenly spread over the clip, the last one included.
    frame_numbers = {round((k + 1) * count / COLUMNS) - 1 for k in columns}
    draw = ways(truth)
    films = [draw[name]() for name in STRIP_WAYS]
    films.append(rgb for rgb, _ in truth.frames())
    strips = []
    for film in films:
        frames = []
        for k, frame in enumerate(film):
            if k in frame_numbers:
                frames.append(frame)
        strips.append(np.hstack(frames))
    cv2.imwrite(str(path), cv2.cvtColor(np.vstack(strips), cv2.COLOR_RGB2BGR))
