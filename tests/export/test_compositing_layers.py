"""Layers are composed again by formulas of their own, and give the frames; Cryptomatte is read by OpenEXR."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import OpenEXR
import pytest

from physgen.cli.main import main
from physgen.export.cryptomatte import murmur_hash, object_id

SCENE = """\
physgen: 1
size: [61, 48]
world: {duration: 0.2}
objects:
  ball: {layer: 2, shape: {circle: {center: [16, 30], radius: 7}}, velocity: [150, 0]}
  crate: {shape: {box: {center: [40, 32], size: [12, 16]}}, mass: 200}
boundaries:
  floor: {segment: [[-100, 40], [300, 40]]}
render: {fps: 20, motion_blur: 0.8}
"""


def linear(codes: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, of values 0..1."""
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def grey_levels(light: np.ndarray) -> np.ndarray:
    light = np.clip(light, 0, 1)
    curve = 1.055 * light ** (1 / 2.4) - 0.055
    return 255 * np.where(light <= 0.0031308, 12.92 * light, curve)


def png(path: Path) -> np.ndarray:
    """R, G, B and alpha, 0..1."""
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert picture.dtype == np.uint16
    kind = cv2.COLOR_BGRA2RGBA if picture.shape[2] == 4 else cv2.COLOR_BGR2RGB
    return cv2.cvtColor(picture, kind) / 65535


def clip(path: Path, size: tuple[int, int], has_alpha: bool) -> list[np.ndarray]:
    """Linear and premultiplied pictures of a video, by FFmpeg's and libvpx' decoders."""
    width, height = size
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        if path.suffix == ".webm" and has_alpha:  # FFmpeg's own decoder drops alpha
            decoder = av.CodecContext.create("libvpx-vp9", "r")
            packets = container.demux(stream)
            frames = [frame for packet in packets for frame in decoder.decode(packet)]
        else:
            frames = list(container.decode(stream))
    kind = "rgba64le" if has_alpha else "rgb48le"
    pictures = []
    for frame in frames:
        codes = frame.reformat(format=kind, src_colorspace="ITU709").to_ndarray()
        codes = codes[:height, :width] / 65535
        colour, alpha = codes[..., :3], codes[..., 3:]
        if not has_alpha:
            pictures.append(linear(colour))
            continue
        if path.suffix == ".mov":
            colour = np.clip(colour / np.maximum(alpha, 1e-6), 0, 1)
        pictures.append(np.dstack([linear(colour) * alpha, alpha]))
    return pictures


class Layers:
    """An exported folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.about: dict[str, Any] = json.loads((folder / "layers.json").read_text())
        self.count = len(self.about["frames"])

    def pictures(self, path: str, has_alpha: bool = False) -> list[np.ndarray]:
        if path.endswith("%05d.png"):
            return [png(self.folder / (path % k)) for k in range(self.count)]
        if path.endswith(".png"):
            return [png(self.folder / path)] * self.count
        return clip(self.folder / path, self.about["size"], has_alpha)

    def objects(self) -> dict[str, list[np.ndarray]]:
        items = self.about["objects"]
        return {item["name"]: self.pictures(item["path"], True) for item in items}

    def composed(self, is_corrected: bool = True) -> list[np.ndarray]:
        """Frames in grey levels."""
        plate, shadow, multiply, add = (
            self.pictures(self.about[name])
            for name in ("plate", "shadow", "multiply", "add")
        )
        objects = self.objects().values()
        frames = []
        for k in range(self.count):
            picture = plate[k] * shadow[k]
            for item in objects:
                picture = picture * (1 - item[k][..., 3:]) + item[k][..., :3]
            if is_corrected:
                picture = picture * multiply[k] + add[k]
            frames.append(grey_levels(picture))
        return frames


def frames_of(folder: Path) -> list[np.ndarray]:
    files = sorted((folder / "frames").iterdir())
    return [cv2.imread(str(file))[..., ::-1].astype(float) for file in files]


def least_psnr(pictures: list[np.ndarray], frames: list[np.ndarray]) -> float:
    assert len(pictures) == len(frames)
    errors = [((a - b) ** 2).mean() for a, b in zip(pictures, frames, strict=True)]
    return 10 * np.log10(255**2 / max(*errors, 1e-9))


def exported(scene: Path, out: Path, formats: str, *flags: str) -> Path:
    command = ["export", str(scene), "--format", formats, "-o", str(out), *flags]
    assert main(command) == 0
    (folder,) = out.iterdir()
    return folder


@pytest.fixture
def flat(tmp_path: Path) -> Path:
    path = tmp_path / "flat.yaml"
    path.write_text(SCENE)
    return path


def test_layers_compose_to_the_frames(flat: Path, tmp_path: Path) -> None:
    folder = exported(flat, tmp_path / "out", "frames,layers")
    layers, frames = Layers(folder / "layers"), frames_of(folder)
    for picture, frame in zip(layers.composed(), frames, strict=True):
        assert np.abs(picture - frame).max() <= 1.0
    assert least_psnr(layers.composed(is_corrected=False), frames) > 40
    assert [item["name"] for item in layers.about["objects"]] == ["crate", "ball"]
    assert layers.about["size"] == [61, 48]
    assert (
        (folder / "layers" / "blender.py").read_text().startswith('"""Build the clip')
    )


def test_lossy_layers_reach_40_db(flat: Path, tmp_path: Path) -> None:
    folder = exported(flat, tmp_path / "out", "frames,layers-prores,layers-vp9")
    frames = frames_of(folder)
    assert least_psnr(Layers(folder / "layers-prores").composed(), frames) > 50
    assert least_psnr(Layers(folder / "layers-vp9").composed(), frames) > 40


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["side.yaml", "top.yaml"])
def test_layers_of_a_photo_with_shadows_and_a_camera(
    photo: Path, tmp_path: Path, scene: str
) -> None:
    camera = "render.camera=[{time: 0}, {time: 0.3, zoom: 1.7, center: [60, 60]}]"
    lit = "light={direction: [0.4, -0.6, 0.69], intensity: 0.7, ambient: 0.4}"
    flags = ["--set", "render.relight=true", "--set", "render.shadows=true"]
    flags += ["--set", lit, "--set", "render.motion_blur=0.5", "--set", camera]
    folder = exported(
        photo / scene, tmp_path / "out", "frames,layers,layers-vp9", *flags
    )
    layers, frames = Layers(folder / "layers"), frames_of(folder)
    for picture, frame in zip(layers.composed(), frames, strict=True):
        assert np.abs(picture - frame).max() <= 1.0
    assert least_psnr(layers.composed(is_corrected=False), frames) > 30
    assert min(shadow.min() for shadow in layers.pictures("shadow/%05d.png")) < 0.9
    assert least_psnr(Layers(folder / "layers-vp9").composed(), frames) > 40


def test_transforms_carry_an_object_along(flat: Path, tmp_path: Path) -> None:
    """Its picture of frame 0, moved by the transforms, lies on that of each other frame."""
    folder = exported(flat, tmp_path / "o", "layers", "--set", "render.motion_blur=0")
    layers = Layers(folder / "layers")
    alphas = [picture[..., 3] for picture in layers.objects()["ball"]]
    first = layers.about["frames"][0]["objects"]["ball"]
    for frame, alpha in zip(layers.about["frames"], alphas, strict=True):
        place = frame["objects"]["ball"]
        turn = place["angle_rad"] - first["angle_rad"]
        matrix = np.array(
            [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0]]
        )
        start, end = np.array([[p["x"], p["y"]] for p in (first, place)])
        matrix[:, 2] = end - matrix[:, :2] @ start
        moved = cv2.warpAffine(alphas[0], matrix, alpha.shape[::-1])
        assert np.abs(moved - alpha).sum() / alpha.sum() < 0.08
    places = [frame["objects"]["ball"]["x"] for frame in layers.about["frames"]]
    assert places[-1] - places[0] > 10


def test_hash_is_that_of_the_specification() -> None:
    """Values of the specification of Cryptomatte, as floats."""
    floats = {
        "hello": 6.0705627102400005616e-17,
        "cube": -4.08461912519e15,
        "sphere": 2.79018604383e15,
        "plane": 3.66557617593e-11,
    }
    for name, value in floats.items():
        bits = np.array([object_id(name)], np.uint32)
        assert bits.view(np.float32)[0] == pytest.approx(value, rel=1e-6)
    assert murmur_hash("") == 0
    assert murmur_hash("test") == 0xBA6BD213


def share_of(channels: dict[str, np.ndarray], layer: str, id_: int) -> np.ndarray:
    """The share of an object, of all ranks."""
    total = np.zeros_like(next(iter(channels.values())))
    for rank in range(3):
        for code, amount in ("RG", "BA"):
            ids = channels[f"{layer}{rank:02d}.{code}"].view(np.uint32)
            total += np.where(ids == id_, channels[f"{layer}{rank:02d}.{amount}"], 0)
    return total


def test_cryptomatte_has_the_visible_share_of_each_object(
    flat: Path, tmp_path: Path
) -> None:
    folder = exported(flat, tmp_path / "out", "layers") / "layers"
    path = str(folder / "cryptomatte" / "00003.exr")
    with OpenEXR.File(path, separate_channels=True) as file:
        header = dict(file.header())
        channels = {name: part.pixels.copy() for name, part in file.channels().items()}
    (key,) = (name for name in header if name.endswith("/manifest"))
    manifest = json.loads(header[key])
    assert set(manifest) == {"ball", "crate"}
    assert header[key.replace("manifest", "conversion")] == "uint32_to_float32"
    objects = Layers(folder).objects()
    ball, crate = (objects[name][3][..., 3] for name in ("ball", "crate"))
    layer = header[key.replace("manifest", "name")]
    for name, share in {"ball": ball, "crate": crate * (1 - ball)}.items():
        total = share_of(channels, layer, int(manifest[name], 16))
        assert np.abs(total - share).max() < 1e-4  # the ball is in front
