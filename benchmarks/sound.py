"""The sound of contacts: closed forms, cost, and a picture of five materials.

python benchmarks/sound.py               # draws docs/sound.webp
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from layout import number, table

from physgen.export.labels import Clip
from physgen.materials import kind
from physgen.pipeline import stages
from physgen.scene.scene import SoundLevel
from physgen.sound.impact import Surface, contact_time
from physgen.sound.modes import Elasticity, bar_frequencies, disc_roots, sphere_roots
from physgen.sound.resonators import GIGA, LIMITS, Resonator, solid_frequencies
from physgen.sound.synthesis import RATE, Strike, click, ring
from physgen.sound.track import sound_track

ROOT = Path(__file__).resolve().parent.parent
MATERIALS = ("wood", "glass", "steel", "rubber", "ceramic")
BAR = (0.16, 0.02)
"""m: the bar of each material in the picture."""
SECONDS = 0.8
PICTURE = (300, 260)
"""px of each spectrogram."""
RANGE = 70.0
"""dB from black to white."""
TOP = 12_000
"""Hz at the upper border."""


def sound(folder: Path) -> list[dict]:
    """Return each closed form with what the synthesis gives, and the cost of billiards."""
    steel = Elasticity(205e9, 0.29, 7850)
    bar = bar_frequencies(steel, 0.3, 0.01, 3)
    rows = [
        row("free bar, second over first mode", bar[1] / bar[0], 2.756),
        row("free bar, third over first mode", bar[2] / bar[0], 5.404),
        row("sphere 0S2 (Lamb, .25), k a / pi", sphere_roots(0.25)[0] / np.pi, 0.840),
        row("disc (Leissa, .33), lowest root", disc_roots(0.33)[0], 5.253),
        row("disc (Leissa, .33), second root", disc_roots(0.33)[1], 9.084),
        row("impact of two billiard balls at 1 m/s, us", *hertz()),
        row("decay of a mode, 1/s", *decay()),
    ]
    return [*rows, *costs()]


def row(what: str, value: float, expected: float) -> dict:
    return {"what": what, "value": float(value), "expected": float(expected)}


def hertz() -> tuple[float, float]:
    """Return the contact time (us) by the formula and by integrating the motion."""
    ball = Surface(0.17, 0.0286, 5.8e9, 0.34)
    stiffness = 4 / 3 * np.sqrt(0.0143) * 5.8e9 / (2 * (1 - 0.34**2))
    depth, velocity, step, seconds = 0.0, 1.0, 2e-8, 0.0
    while depth >= 0:
        velocity -= stiffness * max(depth, 0.0) ** 1.5 / 0.085 * step
        depth += velocity * step
        seconds += step
    return contact_time(ball, ball, 1.0) * 1e6, seconds * 1e6


def decay() -> tuple[float, float]:
    """Return the rate (1/s) at which a mode of 1 kHz fades, measured and by its loss factor."""
    loss = 0.004
    surface = Surface(0.2, 0.003, 205e9, 0.29)
    material = kind("steel").material
    bar = Resonator("bar", material, np.array([1000.0]), 0.2, 0.01, surface, loss)
    strike = Strike(0.1, 0, 0.02, 1e-4, (1.0, 1.0), False)
    heard = ring([bar], [strike], RATE)[RATE // 5 : RATE // 5 + 24_000, 0]
    levels = np.log(np.sqrt((heard.reshape(-1, 480) ** 2).mean(axis=1)))
    slope = np.polyfit(np.arange(len(levels)) * 480 / RATE, levels, 1)[0]
    return -float(slope), np.pi * 1000 * loss


def costs() -> list[dict]:
    """Return CPU seconds of the sound of bundled scenes, motions known."""
    rows = []
    for name in ("billiards", "dominoes", "cups"):
        scene = stages.load(ROOT / "scenes" / name / "scene.yaml")
        maps = stages.percepts(scene)
        compiled, _ = stages.ended(scene, stages.compile(scene, maps))
        motion = stages.simulate(compiled.world)
        shot = stages.shot(scene, motion)
        size, fps, count = scene.video_size, scene.render.fps, len(shot.order)
        clip = Clip(name, scene, compiled.world, motion, None, size, fps, count, shot)
        sound_track(clip, SoundLevel.PEAK)  # tables are read once
        begun = time.process_time()
        track = sound_track(clip, SoundLevel.PEAK)
        cpu = time.process_time() - begun
        assert track is not None
        rows.append(
            {
                "what": f"{name}: {count / fps:.1f} s, {len(track.captions)} impacts",
                "cpu": round(cpu, 3),
            }
        )
    return rows


def section(rows: list[dict]) -> list[str]:
    """Return the part of docs/benchmarks.md."""
    lines = []
    for one in rows:
        if "cpu" in one:
            lines.append((one["what"], f"{number(one['cpu'])} CPU s", "", ""))
        else:
            off = abs(one["value"] / one["expected"] - 1)
            cells = (f"{one['value']:.4g}", f"{one['expected']:.4g}", f"{off:.2%}")
            lines.append((one["what"], *cells))
    return table(("", "Synthesis", "Expected", "Off"), lines)


def strike_of(name: str) -> np.ndarray:
    """Return the sound of a bar of a material that is struck by a steel ball of 10 g at 0.5 m/s."""
    material = kind(name).material
    solid = Elasticity(material.young * GIGA, material.poisson, material.density * 1000)
    frequencies = solid_frequencies(solid, *BAR)
    frequencies = frequencies[(frequencies > 40) & (frequencies < LIMITS.highest)]
    mass = material.density * 1000 * BAR[0] * BAR[1] ** 2
    own = Surface(mass, LIMITS.edge, solid.young, solid.poisson)
    ball = Surface(0.01, 0.0067, 205e9, 0.29)
    bar = Resonator(name, material, frequencies, mass, 0.0128, own, material.loss)
    duration = contact_time(own, ball, 0.5)
    strike = Strike(0.05, 0, 0.005, duration, (1.0, 1.0), False)
    count = round(SECONDS * RATE)
    heard = ring([bar], [strike], count) + click([bar], [replace(strike)], count)
    return np.asarray(heard[:, 0])


def spectrogram(heard: np.ndarray) -> np.ndarray:
    """Return (H, W, 3) BGR: time to the right, frequency upwards, in dB below the loudest."""
    window, hop = 1024, 128
    parts = np.lib.stride_tricks.sliding_window_view(heard, window)[::hop]
    power = np.abs(np.fft.rfft(parts * np.hanning(window), axis=1))
    shown = power[:, : TOP * window // RATE].T[::-1]
    level = 20 * np.log10(shown / shown.max() + 1e-9)
    codes = np.clip((level + RANGE) / RANGE * 255, 0, 255).astype(np.uint8)
    picture = cv2.resize(codes, PICTURE, interpolation=cv2.INTER_AREA)
    return cv2.applyColorMap(picture, cv2.COLORMAP_MAGMA)


def draw(file: Path) -> None:
    """Write the spectrograms of the materials beside each other."""
    panels = []
    for name in MATERIALS:
        panel = spectrogram(strike_of(name))
        cv2.putText(
            panel,
            name,
            (10, 24),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.7,
            (255,) * 3,
            1,
            cv2.LINE_AA,
        )
        panels.append(np.pad(panel, ((0, 0), (0, 4), (0, 0))))
    cv2.imwrite(str(file), np.hstack(panels), [cv2.IMWRITE_WEBP_QUALITY, 80])


if __name__ == "__main__":
    draw(ROOT / "docs" / "sound.webp")
