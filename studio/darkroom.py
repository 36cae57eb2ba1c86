"""Mitsuba scene in, photograph and exact truth out: photo.png and photo.assets/ with masks, clean plate, truth.json.

Import this module before mitsuba: it finds the LLVM library that Mitsuba's fast processor variant needs.
"""

import argparse
import ctypes.util
import glob
import json
import os
import re
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

OLDEST_LLVM = 17  # LLVM 14 to 16 abort inside Dr.Jit 1.x; 19 is what these scenes were rendered with
LLVM_PLACES = (
    "/usr/lib/*/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib*/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
    "/opt/homebrew/opt/llvm*/lib/libLLVM*.dylib",
    "/usr/local/opt/llvm*/lib/libLLVM*.dylib",
)


def find_llvm() -> str:
    """The newest LLVM shared library in the standard folders. Raises SystemExit that names the package to install."""
    found = [path for place in LLVM_PLACES for path in glob.glob(place)]
    found += filter(None, (ctypes.util.find_library(f"LLVM-{n}") for n in range(OLDEST_LLVM, 30)))

    def version(path: str) -> int:
        match = re.search(r"(?:LLVM-|LLVM\.so\.|llvm-|llvm@)(\d+)", path)
        return int(match.group(1)) if match else 0

    newest = max(found, key=version, default="")
    if version(newest) < OLDEST_LLVM:
        seen = ", ".join(sorted(found)) or "none"
        raise SystemExit(
            f"LLVM: found {seen}; Mitsuba's llvm_ad_rgb needs version {OLDEST_LLVM} or newer; "
            "install it (Debian: apt install libllvm19) or set DRJIT_LIBLLVM_PATH"
        )
    return newest


os.environ.setdefault("DRJIT_LIBLLVM_PATH", find_llvm() if "DRJIT_LIBLLVM_PATH" not in os.environ else "")
import drjit as dr  # noqa: E402  (Dr.Jit reads the variable when it is loaded)
import mitsuba as mi  # noqa: E402

mi.set_variant("llvm_ad_rgb")
T = mi.ScalarTransform4f


def flags(about: str, default_out: Path, default_spp: int) -> argparse.Namespace:
    """--spp, --scale, -o: the same three for every photo."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument(
        "--spp", type=int, default=default_spp, help="light paths a pixel (default %(default)s)"
    )
    parser.add_argument(
        "--scale",
        type=float,
        default=1.0,
        help="size of the photo, 0.25 for a quick look (default %(default)s)",
    )
    parser.add_argument(
        "-o",
        type=Path,
        dest="out",
        default=default_out,
        help="the photo; its truth goes to PHOTO-STEM.assets/ beside it",
    )
    return parser.parse_args()


def texture(rgb: np.ndarray, repeat: tuple[float, float] = (1, 1)) -> dict:
    """A reflectance texture from (H, W, 3) linear light; row 0 lies at v = 1 (the top)."""
    bitmap = mi.Bitmap(np.ascontiguousarray(rgb[..., :3], dtype=np.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "to_uv": T().scale([repeat[0], repeat[1], 1])}


def environment(light: np.ndarray) -> dict:
    """Light from far away, (H, W, 3) longitude-latitude, row 0 straight up (+z)."""
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(light.astype(np.float32)),
        "to_world": T().rotate([1, 0, 0], 90),
    }


def mesh(
    vertices: np.ndarray, normals: np.ndarray | None, uv: np.ndarray, faces: np.ndarray, bsdf: dict
) -> dict:
    """A triangle mesh: vertices (V, 3) m, normals (V, 3) or None for flat faces, uv (V, 2), faces (F, 3)."""
    shape = mi.Mesh(
        "mesh", len(vertices), len(faces), has_vertex_normals=normals is not None, has_vertex_texcoords=True
    )
    slots = mi.traverse(shape)
    slots["vertex_positions"] = vertices.astype(np.float32).ravel()
    if normals is not None:
        slots["vertex_normals"] = normals.astype(np.float32).ravel()
    slots["vertex_texcoords"] = uv.astype(np.float32).ravel()
    slots["faces"] = faces.astype(np.uint32).ravel()
    slots.update()
    with tempfile.NamedTemporaryFile(suffix=".ply", delete=False) as file:
        path = file.name
    shape.write_ply(path)
    _meshes.append(path)
    return {"type": "ply", "filename": path, "face_normals": normals is None, "bsdf": bsdf}


_meshes: list[str] = []


def expose(scene: mi.Scene, spp: int, batch: int = 64) -> np.ndarray:
    """(H, W, 3) float64 linear light, the mean of `spp` paths a pixel, in batches of some 2 GB of memory."""
    counts = [batch] * (spp // batch) + [spp % batch] * (spp % batch > 0)
    seeds = np.random.default_rng(0).integers(
        2**31, size=len(counts)
    )  # seeds in a row would leave streaks (measured)
    return (
        sum(
            n * np.array(mi.render(scene, spp=n, seed=int(s)), dtype=np.float64)[..., :3]
            for n, s in zip(counts, seeds, strict=True)
        )
        / spp
    )


def develop(light: np.ndarray, exposure: float, vignette: float) -> np.ndarray:
    """(H, W, 3) uint8 sRGB: exposure, a slight vignette, a film-like shoulder, and the sRGB curve.

    Below 0.55 the shoulder is the identity, so that mid-tones stay proportional to light; above it, light is
    rolled off smoothly (first derivative continuous) towards 1. Rounding is dithered to keep walls free of bands.
    """
    height, width = light.shape[:2]
    y, x = np.mgrid[:height, :width]
    radius2 = ((x - (width - 1) / 2) ** 2 + (y - (height - 1) / 2) ** 2) / (
        (width / 2) ** 2 + (height / 2) ** 2
    )
    value = light * exposure * (1 - vignette * radius2[..., None])
    knee, over = 0.55, np.maximum(value - 0.55, 0)
    value = np.where(value < knee, value, knee + (1 - knee) * over / (over + 1 - knee))
    srgb = np.where(value <= 0.0031308, 12.92 * value, 1.055 * np.maximum(value, 1e-9) ** (1 / 2.4) - 0.055)
    dither = np.random.default_rng(0).uniform(
        -0.5, 0.5, (height, width, 1)
    )  # the same for photo and clean plate
    return np.clip(np.round(srgb * 255 + dither), 0, 255).astype(np.uint8)


def masks(scene: mi.Scene, ids: dict[str, int], side: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) uint16 id by majority of coverage, 0 = background; (H, W) uint8 coverage of all objects, 255 = 1.

    Rays through a side x side grid of points in each pixel, with the lens of the photo; `ids` maps shape name to id.
    """
    sensor = scene.sensors()[0]
    width, height = sensor.film().crop_size()
    lookup = np.zeros(int(np.array(dr.reinterpret_array(mi.UInt32, scene.shapes_dr())).max()) + 1, np.uint16)
    for shape, key in zip(
        scene.shapes(), np.array(dr.reinterpret_array(mi.UInt32, scene.shapes_dr())), strict=True
    ):
        lookup[key] = ids.get(shape.id(), 0)
    count = np.zeros((len(ids) + 1, height, width), np.uint16)
    pixel = dr.arange(mi.UInt32, width * height)
    x, y = mi.Float(pixel % width), mi.Float(pixel // width)
    rng = np.random.default_rng(1)
    for k in range(side * side):
        film = mi.Point2f((x + (k % side + 0.5) / side) / width, (y + (k // side + 0.5) / side) / height)
        lens = mi.Point2f(mi.Float(rng.random(width * height)), mi.Float(rng.random(width * height)))
        ray, _ = sensor.sample_ray(0.0, 0.5, film, lens)
        hit = scene.ray_intersect_preliminary(ray)
        key = np.array(dr.select(hit.is_valid(), dr.reinterpret_array(mi.UInt32, hit.shape), 0))
        seen = lookup[key].reshape(height, width)
        np.put_along_axis(count, seen[None], np.take_along_axis(count, seen[None], 0) + 1, 0)
    coverage = np.round(count[1:].sum(0) * (255 / side**2)).astype(np.uint8)
    return count.argmax(0).astype(np.uint16), coverage


def photograph(
    world: dict,
    objects: dict[str, dict],
    truth: dict,
    *,
    out: Path,
    spp: int,
    exposure: float,
    vignette: float = 0.10,
) -> None:
    """Render `world` with and without `objects` and write the photo and its truth.

    `truth["objects"]` is a list in the order of `objects`; ids 1..N are added here, and the counts and times.
    """
    start = time.monotonic()
    camera = {
        **world["camera"],
        "sampler": {"type": "multijitter", "sample_count": 64},
    }  # half to a quarter of independent's variance
    world = {**world, "camera": camera}
    assets = out.parent / f"{out.stem}.assets"
    assets.mkdir(parents=True, exist_ok=True)
    ids = {name: k for k, name in enumerate(objects, 1)}
    full = mi.load_dict({**world, **objects}, optimize=False)  # merging of meshes would lose who is who
    label, coverage = masks(full, ids)
    cv2.imwrite(str(assets / "masks.png"), label)
    cv2.imwrite(str(assets / "coverage.png"), coverage)
    picture = {}
    for path, scene in ((out, full), (assets / "clean.png", mi.load_dict(world, optimize=False))):
        picture[path] = develop(expose(scene, spp), exposure, vignette)
        cv2.imwrite(str(path), picture[path][..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
        print(f"{path}: {path.stat().st_size / 1e6:.2f} MB, {time.monotonic() - start:.0f} s so far")
    height, width = label.shape
    truth = {
        "image": out.name,
        "size": [width, height],
        "spp": spp,
        "exposure": exposure,
        "vignette": vignette,
        **truth,
    }
    truth["objects"] = [{"id": ids[entry["name"]], **entry} for entry in truth["objects"]]
    (assets / "truth.json").write_text(_readable(truth) + "\n")
    for path in _meshes:
        Path(path).unlink(missing_ok=True)
    _check(label, picture[out], picture[assets / "clean.png"], truth)


def _readable(truth: dict) -> str:
    """JSON with one object a line."""
    rows = ",\n".join("    " + json.dumps(entry) for entry in truth["objects"])
    head = json.dumps({k: v for k, v in truth.items() if k != "objects"}, indent=2)
    head = re.sub(r"\[\s+([^\[\]{}]*?)\s+\]", lambda m: "[" + re.sub(r"\s+", " ", m.group(1)) + "]", head)
    return head[:-2] + ',\n  "objects": [\n' + rows + "\n  ]\n}"


def _check(label: np.ndarray, photo: np.ndarray, clean: np.ndarray, truth: dict) -> None:
    """Print how well the outlines in `truth` agree with the masks, and the plates with each other far from objects."""
    worst = 1.0
    for entry in truth["objects"]:
        seen = label == entry["id"]
        y, x = np.mgrid[: label.shape[0], : label.shape[1]]
        if "circle" in entry:
            (cx, cy), radius = entry["circle"]["center"], entry["circle"]["radius"]
            inside = (x - cx) ** 2 + (y - cy) ** 2 <= radius**2
        else:  # a convex outline: on the same side of every edge
            corners = np.array(entry["polygon"])
            edges = zip(corners, np.roll(corners, -1, 0), strict=True)
            turns = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for (ax, ay), (bx, by) in edges]
            inside = np.all(np.array(turns) >= 0, 0) | np.all(np.array(turns) <= 0, 0)
        worst = min(worst, (seen & inside).sum() / (seen | inside).sum())
    far = cv2.distanceTransform((label == 0).astype(np.uint8), cv2.DIST_L2, 5) > label.shape[0] / 4
    apart = np.abs(photo.astype(float) - clean)[far]
    print(f"worst IoU of outline and mask: {worst:.4f}")
    print(
        f"photo against clean, far from objects: mean {apart.mean():.2f}, "
        f"99 % {np.percentile(apart, 99):.1f} of 255, {far.mean():.0%} of the picture"
    )
