"""Stored truth agrees with itself: read with other libraries than wrote it, checked against optics and geometry."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image

from physgen import pipeline

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "studio"))
from darkroom import decode, undevelop  # noqa: E402  (the studio's inverse of its film; neither needs Mitsuba)

NAMES = sorted(
    path.parent.name for path in (ROOT / "studio/truth").glob("*/truth.json")
)
DIFFUSE = [
    n
    for n in NAMES
    if json.loads((ROOT / f"studio/truth/{n}/truth.json").read_text())["diffuse"]
]
QUICK = ("billiards", "wall-ball")
EVERY = [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in NAMES]
FILMED = [n for n in NAMES if (ROOT / f"studio/truth/{n}/film").exists()]

NOT_QUITE_ROUND = {
    "apple",
    "curling stone",
    "toy ball",
    "foam ball",
    "clay ball",
    "leather ball",
    "orange",
}
"""Labels of spheres with relief or dents, whose normals are those beneath."""
MIRRORED = {"dominoes"}
"""Scenes whose varnished table shows pale things upside down."""


def picture(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


@dataclass(frozen=True)
class Truth:
    told: dict
    photo: np.ndarray
    background: np.ndarray
    clean: np.ndarray
    labels: np.ndarray
    coverage: np.ndarray
    instances: np.ndarray
    depth: np.ndarray
    normals: np.ndarray
    albedo: np.ndarray
    shading: np.ndarray

    def away(self, px: int) -> np.ndarray:
        """Pixels farther than `px` from every thing."""
        return (
            cv2.distanceTransform((self.coverage == 0).astype(np.uint8), cv2.DIST_L2, 5)
            > px
        )


@cache
def truth(name: str) -> Truth:
    scene, proof = ROOT / "scenes" / name, ROOT / "studio/truth" / name
    assets = scene / "photo.assets"
    told = json.loads((proof / "truth.json").read_text())
    near, far = told["depth"]["near"], told["depth"]["far"]
    raw = picture(proof / "depth.png").astype(float)
    depth = near + raw / 65534 * (far - near)
    return Truth(
        told,
        picture(scene / "photo.png"),
        picture(assets / "background.png"),
        picture(assets / "clean.png"),
        picture(assets / "masks.png").astype(int),
        picture(assets / "coverage.png").astype(float) / 255,
        picture(proof / "instances.png").astype(int),
        depth,
        (picture(proof / "normals.webp").astype(float) - 128) / 127,
        decode(picture(proof / "albedo.webp") / 255.0),
        decode(picture(proof / "shading.webp") / 255.0) * told["shading"]["scale"],
    )


def drawn(entry: dict, size: tuple[int, int], grow: float = 0.0) -> np.ndarray:
    """(H, W) bool: the inside of an object's shape."""
    width, height = size
    y, x = np.mgrid[:height, :width]
    if "circle" in entry:
        (cx, cy), radius = entry["circle"]["center"], entry["circle"]["radius"]
        return (x - cx) ** 2 + (y - cy) ** 2 <= (radius + grow) ** 2
    if "box" in entry:
        (cx, cy), (w, h) = entry["box"]["center"], entry["box"]["size"]
        a = np.radians(entry["box"].get("angle", 0))
        u, v = (
            (x - cx) * np.cos(a) + (y - cy) * np.sin(a),
            (y - cy) * np.cos(a) - (x - cx) * np.sin(a),
        )
        return (np.abs(u) <= w / 2 + grow) & (np.abs(v) <= h / 2 + grow)
    mask = np.zeros((height, width), np.uint8)
    cv2.fillPoly(
        mask, [np.round(np.array(entry["polygon"]) * 16).astype(np.int32)], 1, shift=4
    )
    if grow:
        side = 2 * round(grow) + 1
        mask = cv2.dilate(
            mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        )
    return mask > 0


@pytest.mark.parametrize("name", EVERY)
def test_maps_are_whole(name: str) -> None:
    t = truth(name)
    size = tuple(t.told["size"][::-1])
    assert all(
        getattr(t, part.name).shape[:2] == size
        for part in fields(Truth)
        if part.name != "told"
    )
    ids = [entry["id"] for entry in t.told["objects"]]
    assert ids == list(range(1, len(ids) + 1))
    assert set(np.unique(t.labels)) == {0, *ids}, (
        "every object is seen, and nothing else"
    )


@pytest.mark.parametrize("name", EVERY)
def test_coverage_and_masks_are_of_one_mind(name: str) -> None:
    t = truth(name)
    first, share, second = np.moveaxis(t.instances, -1, 0)
    assert np.array_equal(first, t.labels)
    mine = t.labels > 0
    assert np.all(share[mine] / 255 >= 1 - t.coverage[mine] - 0.006), (
        "the background has no more of it than the owner"
    )
    assert np.all(t.coverage[~mine] < 0.76), (
        "no more than three things beat the background together"
    )
    assert np.all(share / 255 <= t.coverage + 0.005)
    assert not np.any((second == first) & (first > 0))


@pytest.mark.parametrize("name", EVERY)
def test_shapes_in_the_file_are_what_the_photo_shows(name: str) -> None:
    """The section through the plane of motion lies in the silhouette; a lens a little above also shows tops."""
    t = truth(name)
    for entry in t.told["objects"]:
        inside, seen = drawn(entry, t.told["size"]), t.labels == entry["id"]
        others = (t.labels > 0) & ~seen
        # a handle is a bay of the outline, closed so that nothing catches in it
        assert (inside & ~seen & ~others).sum() <= 0.10 * inside.sum() + 20, (
            f"{entry['name']}: shape without pixels"
        )
        reach = 0.16 * np.sqrt(seen.sum()) + 3
        whole = entry
        if (
            "polygon" in entry
        ):  # of a bowl the outside is seen, and the section is its wall
            whole = {
                "polygon": cv2.convexHull(np.array(entry["polygon"], np.float32))[
                    :, 0
                ].tolist()
            }
        strays = (seen & ~drawn(whole, t.told["size"], reach)).astype(np.uint8)
        strays = cv2.morphologyEx(
            strays, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)
        )  # a thread is no shape
        assert strays.sum() <= 0.16 * seen.sum(), f"{entry['name']}: strays"


@pytest.mark.parametrize("name", EVERY)
def test_normals_are_unit_and_face_the_viewer(name: str) -> None:
    t = truth(name)
    length = np.linalg.norm(t.normals, axis=-1)
    assert np.abs(length - 1).max() < 0.02, "eight bits keep them within a degree"
    assert (t.normals[..., 2] < -0.15).mean() < 0.001


@pytest.mark.parametrize("name", EVERY)
def test_depth_and_normals_are_of_one_surface(name: str) -> None:
    """Normals from the slope of depth, through the shift lens, against the stored ones, inside things."""
    t = truth(name)
    camera, ppm = t.told["camera"], t.told["pixels_per_meter"]
    height, width = t.labels.shape
    y, x = np.mgrid[:height, :width].astype(float)
    flat = np.stack([(x - (width - 1) / 2) / ppm, (y - (height - 1) / 2) / ppm], -1)
    depth = t.depth
    eye = np.array([camera["rise"][0], -camera["rise"][1]])
    spot = eye + (flat - eye) * (1 + depth[..., None] / camera["distance"])
    points = np.concatenate([spot, -depth[..., None]], -1)  # +z to the viewer
    across, down = (np.gradient(points, axis=axis) for axis in (1, 0))
    slope = np.cross(across, down)
    slope /= np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-12)
    inner = np.zeros_like(t.labels, bool)
    for entry in t.told["objects"]:
        inner |= (
            cv2.erode(
                (t.labels == entry["id"]).astype(np.uint8), np.ones((7, 7), np.uint8)
            )
            > 0
        )
    angle = np.degrees(np.arccos(np.clip(np.sum(slope * t.normals, -1), -1, 1)))[
        inner & (t.normals[..., 2] > 0.3)
    ]
    assert (
        np.median(angle) < 6.0
    )  # a few pixels make a curve; an axis turned round makes tens of degrees
    assert np.percentile(angle, 75) < 20.0


def spheres(t: Truth) -> list[tuple[float, float, float, np.ndarray]]:
    """Centre, radius and pixels of every plain sphere, its outermost rim left out."""
    found = []
    y, x = np.mgrid[: t.labels.shape[0], : t.labels.shape[1]]
    for entry in t.told["objects"]:
        if entry.get("solid") == "sphere" and entry["label"] not in NOT_QUITE_ROUND:
            (cx, cy), r = entry["circle"]["center"], entry["circle"]["radius"]
            inside = (np.hypot(x - cx, y - cy) < 0.85 * r) & (t.labels == entry["id"])
            if inside.sum() > 200:
                found.append((cx, cy, r, inside))
    return found


@pytest.mark.parametrize("name", EVERY)
def test_normals_of_spheres_are_within_a_degree(name: str) -> None:
    """A lens at a distance sees a sphere from its own place: the outline is the section's, moved by a little."""
    t = truth(name)
    y, x = np.mgrid[: t.labels.shape[0], : t.labels.shape[1]]
    camera, ppm = t.told["camera"], t.told["pixels_per_meter"]
    height, width = t.labels.shape
    for cx, cy, r, inside in spheres(t):
        # rays from the lens through the pixels, in px; the plane of motion is z = 0, +z to the viewer
        eye = np.array(
            [
                (width - 1) / 2 + camera["rise"][0] * ppm,
                (height - 1) / 2 - camera["rise"][1] * ppm,
                camera["distance"] * ppm,
            ]
        )
        way = np.stack([x - eye[0], y - eye[1], np.full(x.shape, -eye[2])], -1)[inside]
        way /= np.linalg.norm(way, axis=-1, keepdims=True)
        off = eye - [cx, cy, 0]
        b = way @ off
        hit = (
            eye
            + way * (-b - np.sqrt(np.maximum(b * b - off @ off + r * r, 0)))[:, None]
        )
        exact = (hit - [cx, cy, 0]) / r
        stored = t.normals[inside] / np.linalg.norm(
            t.normals[inside], axis=-1, keepdims=True
        )  # of 8 bits
        angle = np.degrees(2 * np.arcsin(np.linalg.norm(exact - stored, axis=-1) / 2))
        assert np.median(angle) < 0.6
        assert np.percentile(angle, 95) < 1.0


@pytest.mark.parametrize("name", EVERY)
def test_light_explains_what_falls_on_the_things(name: str) -> None:
    """The light in the file, over the true normals, against the true shading; and where its own fit left little."""
    t = truth(name)
    light = t.told["light"]
    assert np.linalg.norm(light["direction"]) == pytest.approx(1, abs=1e-3)
    assert light["residual"] < 0.3
    for _, _, _, inside in spheres(t):
        facing = np.maximum(t.normals[inside] @ np.array(light["direction"]), 0)
        said = light["ambient"] + light["intensity"] * facing
        fell = (t.shading[inside] * t.told["exposure"]).mean(-1)
        assert np.corrcoef(said, fell)[0, 1] > 0.6


@pytest.mark.parametrize("name", EVERY)
def test_albedo_is_what_comes_back_diffusely(name: str) -> None:
    """Highlights add to albedo x shading, nothing takes away: a low quantile of photo / shading is the albedo."""
    t = truth(name)
    light = undevelop(t.photo, t.told["exposure"], t.told["vignette"])
    for _, _, _, inside in spheres(t):
        clear = (
            inside
            & (t.photo.max(-1) < 240)
            & (t.shading.mean(-1) * t.told["exposure"] > 0.05)
        )
        if clear.sum() < 200 or np.median(t.albedo[clear]) < 0.03:
            continue
        ratio = light[clear].sum(-1) / np.maximum(
            (t.albedo * t.shading)[clear].sum(-1), 1e-3
        )
        assert 0.8 < np.percentile(ratio, 25) < 1.3


@pytest.mark.parametrize("name", EVERY)
def test_depth_breaks_where_masks_end(name: str) -> None:
    """Across an outline against the background depth jumps, or turns; inside a thing it runs smoothly."""
    t = truth(name)
    depth = t.depth
    jump, inside, turned = [], [], []
    for axis in (0, 1):
        a, b = (
            np.take(t.labels, range(s, t.labels.shape[axis] - 2 + s), axis)
            for s in (0, 2)
        )
        step = np.abs(
            np.take(depth, range(2, depth.shape[axis]), axis)
            - np.take(depth, range(depth.shape[axis] - 2), axis)
        )
        n1, n2 = (
            np.take(t.normals, range(s, t.labels.shape[axis] - 2 + s), axis)
            for s in (0, 2)
        )
        turn = np.sum(n1 * n2, -1) < 0.9
        edge = (a == 0) != (b == 0)
        jump.append(step[edge])
        turned.append(turn[edge])
        inside.append(step[(a == b) & (a > 0)])
    jump, inside, turned = (
        np.concatenate(jump),
        np.concatenate(inside),
        np.concatenate(turned),
    )
    smooth = max(np.percentile(inside, 50), 1e-5)
    assert np.mean((jump > 3 * smooth) | turned) > 0.85


@pytest.mark.parametrize("name", EVERY)
def test_background_is_the_photo_where_no_thing_is(name: str) -> None:
    t = truth(name)
    assert np.array_equal(t.background[t.away(2)], t.photo[t.away(2)])


@pytest.mark.parametrize("name", EVERY)
def test_clean_plate_is_the_photo_but_for_things_and_their_shadows(name: str) -> None:
    """Far from things the same light; where they differ, the photo is the darker one, or has a reflection's tint."""
    t = truth(name)
    ours, theirs = (
        cv2.GaussianBlur(p, (0, 0), 1.5).astype(float) for p in (t.photo, t.clean)
    )
    apart = (ours - theirs).mean(-1)
    far = t.away(0.12 * t.labels.shape[0])
    if far.mean() > 0.05:
        assert np.median(np.abs(apart[far])) < 2.0
    changed = np.abs(apart) > 10
    open_ = t.away(3)
    brighter = (apart > 10) & open_
    if name not in MIRRORED:
        assert brighter.sum() < 0.25 * max((changed & open_).sum(), 200), (
            "things mostly take light away"
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", DIFFUSE)
def test_photo_is_albedo_times_shading_where_all_is_matt(name: str) -> None:
    """Shading was found apart from the photo, by sampling lamps and the hemisphere on a white surface."""
    t = truth(name)
    light = undevelop(t.photo, t.told["exposure"], t.told["vignette"])
    sharp = (
        np.abs(t.depth) < 0.1
    )  # farther off, the lens blurs what the maps have sharp
    clear = (
        cv2.erode(
            (sharp & (t.photo.max(-1) < 245)).astype(np.uint8),
            np.ones((5, 5), np.uint8),
        )
        > 0
    )
    said = t.albedo * t.shading
    smooth = [cv2.GaussianBlur(v, (0, 0), 2.0)[clear] for v in (light, said)]
    ratio = smooth[0].sum(-1) / np.maximum(smooth[1].sum(-1), 1e-4)
    assert abs(np.median(ratio) - 1) < 0.03
    assert np.percentile(np.abs(ratio - 1), 90) < 0.15


@pytest.mark.parametrize("name", EVERY)
def test_scene_file_is_one_to_enjoy(name: str) -> None:
    """It loads without a problem, tells a story, has variants that load too, and what it says is the truth."""
    path = ROOT / "scenes" / name / "scene.yaml"
    scene = pipeline.load(path)
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    assert [str(p) for p in pipeline.lint(scene, compiled, maps)] == []
    told = truth(name).told
    assert {o.name for o in scene.objects} == {o["name"] for o in told["objects"]}
    masses = {o["name"]: o["mass_g"] for o in told["objects"]}
    assert all(
        body.mass == pytest.approx(masses[body.name], rel=1e-6)
        for body in compiled.world.bodies
    )
    written = yaml.safe_load(path.read_text())
    for entry in told["objects"]:
        item = written["objects"][entry["name"]]
        assert item["mask"] == entry["id"]
        for key in ("label", "friction", "elasticity"):
            assert item[key] == entry[key], (entry["name"], key)
        ((kind, form),) = item["shape"].items()
        assert form == entry[kind], entry["name"]
    for boundary, line in told["boundaries"].items():
        item = written["boundaries"][boundary]
        assert item.get("segment", item.get("polyline")) == line["points"]
        assert (item["friction"], item["elasticity"]) == (
            line["friction"],
            line["elasticity"],
        )
    assert written["light"]["direction"] == pytest.approx(
        told["light"]["direction"], abs=6e-4
    )
    assert written["world"].get("combine", "geometric") == told["combine"]
    text = path.read_text()
    assert len(re.findall(r"^# ", text, re.M)) >= 3
    variants = re.search(r"^variants:\n((?:  .*\n?)+)", text, re.M)
    assert variants, "no variants"
    for variant in re.findall(r"^  ([\w-]+):", variants.group(1), re.M):
        pipeline.compile(pipeline.load(path, variant=variant), maps)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILMED)
def test_film_shows_things_where_its_poses_say(name: str) -> None:
    """Outlines at t = 0, moved by the stored poses, against the ids that the film's frames show."""
    t, folder = truth(name), ROOT / "studio/truth" / name / "film"
    film = json.loads((folder / "film.json").read_text())
    assert len(film["times_s"]) >= 12
    assert np.all(np.diff(film["times_s"]) > 0)
    world = pipeline.compile(
        s := pipeline.load(ROOT / film["scene"], variant=film["variant"]),
        pipeline.percepts(s),
    ).world
    starts = {body.name: body.center for body in world.bodies}
    size = t.told["size"]
    agree, moved = [], 0.0
    for k in range(len(film["times_s"])):
        ids = picture(folder / f"ids-{k + 1:02}.png")
        assert picture(folder / f"{k + 1:02}.webp").shape == t.photo.shape
        for entry in t.told["objects"]:
            if entry["name"] not in film["objects"]:
                continue
            x, y, degrees = film["objects"][entry["name"]][k][:3]
            a, (cx, cy) = np.radians(degrees), starts[entry["name"]]
            matrix = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0]])
            matrix[:, 2] = [x, y] - matrix[:, :2] @ [cx, cy]
            there = (
                cv2.warpAffine(drawn(entry, size).astype(np.uint8), matrix, tuple(size))
                > 0
            )
            moved = max(moved, float(np.hypot(x - cx, y - cy)))
            seen = ids == entry["id"]
            if (
                there.sum() > 60
                and (there & (ids > 0) & ~seen).sum() < 0.02 * there.sum()
            ):
                agree.append((there & seen).sum() / (there | seen).sum())
    assert moved > 20, "something moves"
    assert np.median(agree) > 0.85
    assert np.percentile(agree, 5) > 0.6
