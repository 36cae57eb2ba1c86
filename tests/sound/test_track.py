"""Sound tracks of whole scenes."""

from __future__ import annotations

import io
import wave
from pathlib import Path

import av
import numpy as np
import pytest

from physgen.export.video import Format
from physgen.pipeline import RenderOptions, render_scene

MIRRORED = """
physgen: 1
size: [200, 120]
world: {{view: side, duration: 1.2, pixels_per_meter: 1000}}
objects:
  ball: {{shape: {{circle: {{center: [{x}, 40], radius: 10}}}}, label: steel ball, solid: sphere, mass: 8}}
boundaries:
  floor: {{polyline: [[0, 100], [200, 100]]}}
render: {{{render}}}
"""


def write(folder: Path, *, x: float = 60, render: str = "sound: true") -> Path:
    path = folder / f"scene-{x:g}.yaml"
    path.write_text(MIRRORED.format(x=x, render=render))
    return path


def render_to(folder: Path, scene: Path, **changes: object) -> Path:
    options = RenderOptions(**changes)  # type: ignore[arg-type]
    return render_scene(scene, folder, options)


def samples_of(folder: Path) -> np.ndarray:
    with wave.open(str(folder / "sound.wav"), "rb") as file:
        assert file.getframerate() == 48_000
        data = file.readframes(file.getnframes())
    return np.frombuffer(data, "<i2").reshape(-1, 2).astype(float)


def test_sound_starts_with_the_first_contact(tmp_path: Path) -> None:
    out = render_to(tmp_path / "out", write(tmp_path))
    sound = samples_of(out)
    # falls 50 px of 1,000 px/m
    expected = np.sqrt(2 * 0.05 / 9.81)
    level = np.abs(sound).max(axis=1)
    first = int(np.flatnonzero(level > 0.02 * level.max())[0])
    assert first / 48_000 == pytest.approx(expected, abs=0.004)
    assert level.max() == pytest.approx(32767 * 10 ** (-3 / 20), abs=2)
    captions = (out / "sound.vtt").read_text()
    assert captions.startswith("WEBVTT")
    assert "steel ball hits floor" in captions


def test_slow_motion_stretches_events_and_keeps_pitch(tmp_path: Path) -> None:
    fast = render_to(tmp_path / "fast", write(tmp_path))
    slow = render_to(tmp_path / "slow", write(tmp_path, render="sound: true, slow: 2"))
    heights, firsts = [], []
    for folder in (fast, slow):
        sound = samples_of(folder)[:, 0]
        first = int(np.flatnonzero(np.abs(sound) > 0.05 * np.abs(sound).max())[0])
        spectrum = np.abs(np.fft.rfft(sound[first : first + 4096]))
        firsts.append(first)
        heights.append(int(spectrum.argmax()))
    assert firsts[1] / firsts[0] == pytest.approx(2, rel=0.02)
    assert heights[1] == pytest.approx(heights[0], abs=2)


def test_mirrored_scene_swaps_channels(tmp_path: Path) -> None:
    left = samples_of(render_to(tmp_path / "left", write(tmp_path, x=60)))
    right = samples_of(render_to(tmp_path / "right", write(tmp_path, x=140)))
    assert left == pytest.approx(right[:, ::-1], abs=40)
    assert np.abs(left[:, 0]).max() > 1.2 * np.abs(left[:, 1]).max()


def test_fixed_level_keeps_quiet_scenes_quiet(tmp_path: Path) -> None:
    loud = render_to(tmp_path / "a", write(tmp_path, render="sound: {level: fixed}"))
    quiet = write(tmp_path, render="sound: {level: fixed}")
    text = quiet.read_text()
    assert "60, 40]" in text
    quiet.write_text(text.replace("60, 40]", "60, 88]"))
    hushed = render_to(tmp_path / "b", quiet)
    assert np.abs(samples_of(hushed)).max() < 0.5 * np.abs(samples_of(loud)).max()


def test_mp4_has_the_track_in_step(tmp_path: Path) -> None:
    out = render_to(tmp_path / "out", write(tmp_path))
    with av.open(str(out / "video.mp4")) as container:
        (stream,) = container.streams.audio
        decoded = [frame.to_ndarray() for frame in container.decode(stream)]
    heard = np.concatenate(decoded, axis=1)[0]
    sound = samples_of(out)[:, 0] / 32768
    count = min(len(heard), len(sound))
    # the lag of the best correlation of both
    size = 1 << (2 * count).bit_length()
    product = np.fft.rfft(heard[:count], size).conj() * np.fft.rfft(sound[:count], size)
    lag = int(np.fft.irfft(product, size).argmax())
    lag = lag - size if lag > size // 2 else lag
    assert abs(lag) < 48_000 * 0.025
    assert count / 48_000 == pytest.approx(1.2, abs=0.05)


@pytest.mark.parametrize("render", ["", "sound: false", "sound: true, play: backward"])
def test_clips_without_sound(tmp_path: Path, render: str) -> None:
    out = render_to(tmp_path / "out", write(tmp_path, render=render))
    assert not (out / "sound.wav").exists()
    with av.open(str(out / "video.mp4")) as container:
        assert not container.streams.audio


def test_gif_alone_has_no_track(tmp_path: Path) -> None:
    out = render_to(tmp_path / "out", write(tmp_path), formats=(Format.GIF,))
    assert not (out / "sound.wav").exists()


def test_wav_is_read_by_pyav(tmp_path: Path) -> None:
    out = render_to(tmp_path / "out", write(tmp_path))
    with av.open(io.BytesIO((out / "sound.wav").read_bytes())) as container:
        assert container.streams.audio[0].rate == 48_000
