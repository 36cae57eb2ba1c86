"""Tracks from masks (COCO, folders of PNG) and from NumPy archives (TAP-Vid, trajectories)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile, is_zipfile

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from physgen.evaluate.plausibility.request import FPS, Request, Row, from_rows, title
from physgen.evaluate.plausibility.tracks import Array, Known, Outline, Tracks
from physgen.image_formats import MOST_PIXELS
from physgen.perceive.import_coco import decode_segmentation
from physgen.problems import InputError
from physgen.scene.scene import Motion, Solid, View
from physgen.text import natural

if TYPE_CHECKING:
    from physgen.compile.world import Body, World


EXACT = 0.02
"""px: what the engine's steps may shake."""


def from_scene(path: Path, overrides: tuple[str, ...] = (), variant: str | None = None) -> Tracks:
    """A scene file, simulated at its video's frames."""
    from physgen import pipeline

    scene = pipeline.load(path, overrides, variant)
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    trajectory = pipeline.simulate(world)
    name = path.parent.name if path.name == "scene.yaml" else path.stem
    return from_world(f"{name}-{variant}" if variant else name, world, trajectory.times, trajectory.poses)


def from_clip(folder: Path) -> Tracks:
    """A folder that `render` made: its `trajectory.npz`, with outlines and pushes from its scene, where that is still.

    Raises InputError where the motion cannot be read.
    """
    from physgen import pipeline
    from physgen.batch.clips import read_manifest
    from physgen.evaluate.plausibility.request import Request

    manifest = read_manifest(folder)
    view = View(str(manifest.document.get("world", {}).get("view", "side")))
    bare = from_archive(folder / "trajectory.npz", Request(view=view))
    name = folder.resolve().name
    try:
        path = Path(folder.resolve(), manifest.source or "")
        if not manifest.source or not path.is_file():
            raise InputError.of(str(path), "", "is not there", "")
        scene = pipeline.load(path, manifest.overrides, manifest.variant, allow_outside=True)
        world = pipeline.compile(scene, pipeline.percepts(scene)).world
    except InputError:
        return replace(bare, name=name)
    if tuple(body.name for body in world.bodies) != bare.names:
        return replace(bare, name=name)
    return from_world(name, world, bare.times, np.concatenate([bare.places, bare.angles[..., None]], axis=2))


def from_world(name: str, world: World, times: Array, poses: Array) -> Tracks:
    """`poses` (T, N, 3) as a trajectory has them."""
    return Tracks(
        name,
        times,
        tuple(body.name for body in world.bodies),
        poses[..., :2].copy(),
        poses[..., 2].copy(),
        tuple(map(form_of, world.bodies)),
        np.array([body.mass for body in world.bodies]),
        True,
        world.view,
        EXACT,
        "poses of a clip of physgen",
        given_by(world),
        world.view is View.SIDE and not np.any(world.gravity),
    )


def form_of(body: Body) -> Outline:
    """Of a body of a world."""
    if body.radius is not None:
        return Outline(body.radius, body.radius, float(np.sqrt(body.moment / body.mass)))
    core = min((_inscribed(piece) for piece in body.pieces if _holds_origin(piece)), default=0.0)
    return Outline(
        core, body.reach, float(np.sqrt(body.moment / body.mass)), _width(body.pieces), body.pieces
    )


def given_by(world: World) -> Known:
    """What acts from outside, as the scene says."""
    held, joined = set(), set()
    for joint in world.joints:
        held |= {joint.first} | ({joint.second} if joint.second is not None else set())
        if joint.second is not None:
            joined.add((min(joint.first, joint.second), max(joint.first, joint.second)))
    scripted = {k for k, body in enumerate(world.bodies) if body.motion is not Motion.DYNAMIC}
    pushed = [(p.body, p.start, p.end if np.isfinite(p.end) else world.duration) for p in world.pushes]
    spun = {k for k, body in enumerate(world.bodies) if world.view is View.TOP and np.any(_overspin(body))}
    return Known(
        frozenset(held | scripted),
        frozenset(k for field in world.fields for k in field.bodies),
        tuple(pushed),
        frozenset(joined),
        tuple(chain for wall in world.walls for chain in wall.chains),
        frozenset(spun),
    )


def _overspin(body: Body) -> Array:
    """px/s by which its start differs from rolling: (wx, wy) rolls at (R wy, -R wx), signs as in `Body.roll`."""
    if body.solid is not Solid.SPHERE or body.radius is None or not np.any(body.roll):
        return np.zeros(2)
    rolling = body.radius * np.array([-body.roll[1], body.roll[0]])
    return np.asarray(
        np.where(np.abs(rolling - body.velocity) > 1e-6 * np.abs(body.velocity).max(initial=1.0), 1.0, 0.0)
    )


def _width(pieces: tuple[Array, ...]) -> float:
    """px: the least of all shadows that the whole casts; hollows count as filled."""
    angles = np.linspace(0.0, np.pi, 36, endpoint=False)
    shadows = np.concatenate(pieces) @ np.stack([np.cos(angles), np.sin(angles)])
    return float(np.ptp(shadows, axis=0).min())


def _holds_origin(piece: Array) -> bool:
    following = np.roll(piece, -1, axis=0)
    turns = piece[:, 0] * following[:, 1] - piece[:, 1] * following[:, 0]
    return bool((turns >= 0).all() or (turns <= 0).all())


def _inscribed(piece: Array) -> float:
    along = np.roll(piece, -1, axis=0) - piece
    length = np.hypot(*along.T)
    keep = length > 1e-9
    return float((np.abs(piece[:, 0] * along[:, 1] - piece[:, 1] * along[:, 0])[keep] / length[keep]).min())


ARCHIVES_SHAKE = 0.05
"""px."""
FEWEST = 3
"""Points of a body that tell how it lies."""


def from_archive(path: Path, asked: Request) -> Tracks:
    """Raises InputError for archives that hold neither."""
    if path.is_file() and not is_zipfile(path):
        fix = "give TAP-Vid's points or trajectory.npz, as numpy.savez writes them"
        raise InputError.of(str(path), "", "is no NumPy archive", fix)
    try:
        with np.load(path, allow_pickle=False) as file:
            held = {name: file[name] for name in file.files if name != "video"}
            size = _size(file) if "video" in file.files else None
    except (OSError, ValueError, BadZipFile) as error:
        fix = "give TAP-Vid's points as an npz without pickles, or trajectory.npz"
        raise InputError.of(str(path), "", f"cannot be read: {error}", fix) from None
    if {"times", "names", "poses"} <= set(held):
        return _trajectory(path, held, asked)
    if {"points", "occluded"} <= set(held):
        return _points(path, held, size, asked)
    fix = "it needs points and occluded, or times, names and poses"
    raise InputError.of(str(path), f'"{", ".join(held)}"', "are no tracks", fix)


def _size(file: Any) -> tuple[int, int]:
    """Width and height of the video, px."""
    height, width = file["video"].shape[1:3]
    return int(width), int(height)


def _trajectory(path: Path, held: Mapping[str, NDArray[Any]], asked: Request) -> Tracks:
    names, poses = tuple(map(str, held["names"])), np.asarray(held["poses"], np.float64)
    forms = tuple(Outline(0.0, 0.0) for _ in names)
    return Tracks(
        title(path), np.asarray(held["times"], np.float64), names, poses[..., :2].copy(), poses[..., 2].copy(), forms,
        np.ones(len(names)), False, asked.view, EXACT, "poses without outlines: the scene is not at hand", flat=False,
    )  # fmt: skip


def _points(
    path: Path, held: Mapping[str, NDArray[Any]], size: tuple[int, int] | None, asked: Request
) -> Tracks:
    points, hidden = np.asarray(held["points"], np.float64), np.asarray(held["occluded"], bool)
    if points.ndim != 3 or points.shape[2] != 2 or hidden.shape != points.shape[:2]:
        found = f"points of {points.shape}, occluded of {hidden.shape}"
        raise InputError.of(str(path), found, "do not belong together", "give (N, T, 2) and (N, T)")
    if not np.isfinite(points[~hidden]).all():
        found = f"{np.count_nonzero(~np.isfinite(points[~hidden]).all(axis=-1))} points"
        raise InputError.of(str(path), found, "are seen at no place: NaN", "say that they are occluded")
    if size is None:
        fix = "keep the video's array in the archive: points are given in parts of it"
        raise InputError.of(str(path), "", "does not say how large the video is", fix)
    if len(points) == 0:
        raise InputError.of(str(path), "", "has no tracks", "give what moves in it points")
    places = np.where(hidden[..., None], np.nan, points * size - 0.5).transpose(1, 0, 2)
    fps = asked.fps or (float(held["fps"]) if "fps" in held else None)
    assumed = "" if fps else ", 30 frames a second assumed"
    times = np.arange(len(places)) / (fps or FPS)
    owners = held.get("object")
    if owners is None:
        count = places.shape[1]
        names = tuple(f"point {k + 1}" for k in range(count))
        return Tracks(
            title(path), times, names, places, np.full(places.shape[:2], np.nan), (Outline(0.0, 0.0),) * count,
            np.ones(count), False, asked.view, ARCHIVES_SHAKE, f"single points, TAP-Vid{assumed}", Known(), flat=False,
        )  # fmt: skip
    named = [str(name) for name in held["names"]] if "names" in held else []
    first = 1 if named[:1] == ["background"] else 0
    bodies = [one for one in np.unique(owners).tolist() if one >= first]
    rigid = [_rigid(places[:, owners == one]) for one in bodies]
    names = tuple(named[one] if 0 <= one < len(named) else f"body {one}" for one in bodies)
    forms = tuple(form for _, _, form in rigid)
    return Tracks(
        title(path), times, names, np.stack([place for place, _, _ in rigid], axis=1),
        np.stack([angle for _, angle, _ in rigid], axis=1), forms,
        np.array([max(form.reach, 1.0) ** 2 for form in forms]), False, asked.view, ARCHIVES_SHAKE,
        f"points of each body as one body, TAP-Vid{assumed}", Known(), flat=False,
    )  # fmt: skip


def _rigid(places: Array) -> tuple[Array, Array, Outline]:
    """Points (T, K, 2) of one body -> its place (T, 2), the mean of all of them, its angle (T,), and how far they lie.

    Frames that show fewer than 3 of them tell nothing. Procrustes analysis against the frame that shows most.
    """
    seen = np.asarray(np.isfinite(places).all(axis=2))
    shown = seen.sum(axis=1)
    best = int(np.argmax(shown))
    known = seen[best]
    model = places[best, known] - places[best, known].mean(axis=0)
    place, angle = np.full((len(places), 2), np.nan), np.full(len(places), np.nan)
    for frame in range(len(places)):
        both = seen[frame, known]
        if both.sum() < min(FEWEST, max(int(known.sum()), 1)):
            continue
        a, b = model[both], places[frame, known][both]
        turn = 0.0
        if len(a) > 1:
            p, q = a - a.mean(axis=0), b - b.mean(axis=0)
            turn = float(np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum()))
        c, s = np.cos(turn), np.sin(turn)
        place[frame] = b.mean(axis=0) - a.mean(axis=0) @ np.array([[c, s], [-s, c]])
        angle[frame] = turn
    reach = float(np.hypot(*model.T).max(initial=0.0))
    return place, angle, Outline(0.0, 1.3 * reach, 0.7 * reach)


Ids = NDArray[np.integer]
Pixels = NDArray[np.intp]
WHOLE = 0.965
"""Of a body's usual area: it is hidden in part where less is seen."""
SHAKE = 0.08
"""px: what centroids of some hundred pixels shake, at least."""
LEAST = 12
"""px of area: smaller bodies have no place."""


@dataclass
class Silhouettes:
    """What is kept of the maps as they go by."""

    size: tuple[int, int] = (0, 0)
    count: int = 0
    areas: dict[int, dict[int, float]] = field(default_factory=dict)
    """id -> frame -> px."""
    places: dict[int, dict[int, tuple[float, float]]] = field(default_factory=dict)
    cut: dict[int, set[int]] = field(default_factory=dict)
    """id -> frames in which it reaches the border."""
    cores: dict[int, list[float]] = field(default_factory=dict)
    reaches: dict[int, list[float]] = field(default_factory=dict)


def gathered(maps: Iterable[Ids]) -> Silhouettes:
    """One map after the other; 0 is the background."""
    found = Silhouettes()
    for frame, ids in enumerate(maps):
        height, width = ids.shape
        found.size, found.count = (width, height), frame + 1
        ys, xs = np.nonzero(ids)
        owners = ids[ys, xs]
        if not len(owners):
            continue
        order = np.argsort(owners, kind="stable")
        names, starts = np.unique(owners[order], return_index=True)
        for one, some in zip(names.tolist(), np.split(order, starts[1:]), strict=True):
            _add(found, frame, one, ys[some], xs[some])
    return found


def _add(found: Silhouettes, frame: int, one: int, ys: Pixels, xs: Pixels) -> None:
    disc = _disc(ys, xs)
    if disc is None:
        return
    place, core, reach, area = disc
    found.areas.setdefault(one, {})[frame] = area
    found.places.setdefault(one, {})[frame] = place
    width, height = found.size
    if xs.min() == 0 or ys.min() == 0 or xs.max() == width - 1 or ys.max() == height - 1:
        found.cut.setdefault(one, set()).add(frame)
        return
    found.cores.setdefault(one, []).append(core)
    found.reaches.setdefault(one, []).append(reach)


def disc_about(mask: NDArray[np.bool_]) -> tuple[tuple[float, float], float, float, float] | None:
    """Centroid px, radii of the largest disc about it inside and the least around, area px²; None for a few pixels."""
    return _disc(*np.nonzero(mask))


def _disc(ys: Pixels, xs: Pixels) -> tuple[tuple[float, float], float, float, float] | None:
    if len(xs) < LEAST:
        return None
    x0, y0 = int(xs.min()), int(ys.min())
    part = np.zeros((int(ys.max()) - y0 + 3, int(xs.max()) - x0 + 3), np.uint8)
    part[ys - y0 + 1, xs - x0 + 1] = 1
    x, y = float(xs.mean()), float(ys.mean())
    inside = cv2.distanceTransform(part, cv2.DIST_L2, 5)
    core = max(float(inside[round(y) - y0 + 1, round(x) - x0 + 1]) - 0.5, 0.0)
    return (x, y), core, float(np.hypot(xs - x, ys - y).max()) + 0.5, float(len(xs))


def tracked(found: Silhouettes) -> tuple[list[int], Array, tuple[Outline, ...], Array]:
    """Ids, places (T, N, 2) with NaN where a body is not wholly seen, forms, and areas (N,) px²."""
    ids = sorted(found.areas)
    places = np.full((found.count, len(ids), 2), np.nan)
    forms, areas = [], []
    for k, one in enumerate(ids):
        usual = float(np.quantile(list(found.areas[one].values()), 0.8))
        for frame, area in found.areas[one].items():
            if area >= WHOLE * usual and frame not in found.cut.get(one, ()):
                places[frame, k] = found.places[one][frame]
        cores, reaches = found.cores.get(one, [0.0]), found.reaches.get(one, [0.0])
        core, reach = float(np.quantile(cores, 0.8)), float(np.quantile(reaches, 0.8))
        round_ = core > 0.85 * reach
        radius = float(np.sqrt(usual / np.pi))
        forms.append(Outline(radius, radius, 0.7 * radius) if round_ else Outline(core, reach, 0.6 * reach))
        areas.append(usual)
    return ids, places, tuple(forms), np.array(areas)


BOXES = 0.15
"""px that middles of boxes shake, at least."""
MOST_BYTES = 256 * 2**20
SEEN = 0.9
"""Share of a body that must be seen, where its whole mask is not given."""


def from_coco(path: Path, asked: Request) -> Iterator[Tracks]:
    """A clip a video. Raises InputError: unreadable, without tracks, of different sizes."""
    data = _data(path)
    images = {image["id"]: image for image in data["images"] if isinstance(image, dict) and "id" in image}
    names = {track["id"]: track.get("name") for track in data.get("tracks") or [] if isinstance(track, dict)}
    by_video: dict[Any, list[Mapping[str, Any]]] = {}
    for one in data["annotations"]:
        if isinstance(one, dict) and one.get("track_id", one.get("instance_id")) is not None:
            by_video.setdefault(images.get(one.get("image_id"), {}).get("video_id"), []).append(one)
    if not by_video:
        raise InputError.of(str(path), "", "has no tracks", "give annotations a track_id")
    videos = {video.get("id"): video for video in data.get("videos") or [] if isinstance(video, dict)}
    for video, mine in by_video.items():
        own = [image for image in images.values() if image.get("video_id") == video]
        name = str(videos.get(video, {}).get("name") or title(path))
        yield _clip(path, name, own, mine, names, videos.get(video, {}), asked)


def _data(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError.of(
                str(path), f"{path.stat().st_size:,} bytes", "are too many", "split the file by video"
            )
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise InputError.of(
            str(path), "", f"is no JSON that can be read: {error}", "export it again"
        ) from None
    lists = isinstance(data, dict) and all(
        isinstance(data.get(key), list) for key in ("images", "annotations")
    )
    if not lists:
        raise InputError.of(
            str(path), "", "has no lists of images and annotations", "give a COCO file with tracks"
        )
    return dict(data)


def _clip(
    path: Path,
    name: str,
    images: Sequence[Mapping[str, Any]],
    annotations: Sequence[Mapping[str, Any]],
    names: Mapping[Any, Any],
    video: Mapping[str, Any],
    asked: Request,
) -> Tracks:
    sizes = {(image.get("width"), image.get("height")) for image in images}
    if len(sizes) > 1:
        found = " and ".join(f"{w} x {h}" for w, h in sorted(sizes, key=str)[:3])
        raise InputError.of(str(path), found, f"are sizes of frames of {name}", "give frames of one size")
    order = {image["id"]: int(image.get("frame_index", k)) for k, image in enumerate(images)}
    first = min(order.values(), default=0)
    frames, rows, masks = [], [], 0
    for one in annotations:
        track = one.get("track_id", one.get("instance_id"))
        row, masked = _row(path, str(names.get(track) or track), one, next(iter(sizes)))
        if row is not None and one.get("image_id") in order:
            masks += masked
            frames.append(order[one["image_id"]] - first)
            rows.append(row)
    fps = asked.fps or video.get("fps")
    assumed = "" if fps else ", 30 frames a second assumed"
    what, floor = ("centroids of masks", SHAKE) if masks == len(rows) else ("middles of boxes", BOXES)
    return from_rows(name, frames, rows, float(fps or FPS), floor, f"{what}, COCO{assumed}", asked)


def _row(path: Path, name: str, one: Mapping[str, Any], size: tuple[Any, Any]) -> tuple[Row | None, bool]:
    mask_given = one.get("amodal_segmentation") or one.get("segmentation")
    whole = "amodal_segmentation" in one or one.get("visible_fraction", 1.0) >= SEEN
    if mask_given and whole and one.get("truncation", 0.0) <= 1 - SEEN and None not in size:
        try:
            mask = decode_segmentation(mask_given, (int(size[0]), int(size[1])))
        except (ValueError, TypeError) as error:
            raise InputError.of(
                str(path), f"annotation {one.get('id')}", str(error), "export it again"
            ) from None
        found = disc_about(mask)
        if found is not None:
            (x, y), core, reach, _ = found
            return Row(name, x, y, core=core, reach=reach), True
        return None, True
    box = one.get("bbox")
    if mask_given or not isinstance(box, list) or len(box) != 4:
        return None, bool(mask_given)
    left, top, width, height = map(float, box)
    middle = left + width / 2 - 0.5, top + height / 2 - 0.5
    return Row(name, *middle, core=min(width, height) / 2, reach=float(np.hypot(width, height)) / 2), False


MOST_IDS = 1000
"""In a picture: more are no ids, but a photo."""
COLOURS = 65536
"""Numbers from here on are colours, red first: black is the background."""


def pictures_in(folder: Path) -> list[Path]:
    """By name, in their natural order; `ids-*.png` alone where there are such."""
    found = [path for path in folder.iterdir() if path.suffix.lower() == ".png" and path.is_file()]
    own = [path for path in found if path.name.startswith("ids-")]
    return sorted(own or found, key=lambda path: natural(path.name))


def from_pictures(folder: Path, asked: Request) -> Tracks:
    """Raises InputError for different sizes, and pictures that are no maps."""
    paths = pictures_in(folder)
    ids, places, forms, areas = tracked(gathered(_maps(paths)))
    if not ids:
        raise InputError.of(str(folder), "", "has no tracks: all is background", "give bodies ids above 0")
    assumed = "" if asked.fps else ", 30 frames a second assumed"
    return Tracks(
        folder.resolve().name, np.arange(len(places)) / (asked.fps or FPS), tuple(map(_name, ids)), places,
        np.full(places.shape[:2], np.nan), forms, areas, False, asked.view, SHAKE, f"centroids of masks{assumed}",
        flat=False,
    )  # fmt: skip


def _maps(paths: list[Path]) -> Iterator[Ids]:
    size = None
    for path in paths:
        ids = _read(path)
        if size is not None and ids.shape != size:
            found = f"{ids.shape[1]} x {ids.shape[0]} px"
            raise InputError.of(
                str(path), found, f"is not the size of {paths[0].name}", "give frames of one size"
            )
        size = ids.shape
        values = len(np.unique(ids))
        if values > MOST_IDS:
            fix = "give maps with a number or colour a body"
            raise InputError.of(str(path), f"{values:,} values", "are no ids: it is a photo", fix)
        yield ids


def _name(one: int) -> str:
    return f"id {one}" if one < COLOURS else f"#{one:06x}"


def _read(path: Path) -> Ids:
    try:
        with Image.open(path, formats=("PNG",)) as picture:
            if picture.width * picture.height > MOST_PIXELS:
                raise InputError.of(
                    str(path), f"{picture.width} x {picture.height} px", "are too many", "make it smaller"
                )
            if picture.mode in ("RGB", "RGBA"):
                rgb = np.asarray(picture.convert("RGB"), np.int64)
                return np.asarray((rgb[..., 0] << 16) + (rgb[..., 1] << 8) + rgb[..., 2])
            return np.asarray(picture).astype(np.int64)
    except (OSError, UnidentifiedImageError, SyntaxError) as error:
        raise InputError.of(str(path), "", f"cannot be read: {error}", "save it as PNG") from None
