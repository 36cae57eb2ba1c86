"""Refinement measured: what must stay, what our part costs; on a GPU seconds and memory; quality with weights.

    python benchmarks/run.py refine                    # tiny models: identities; the cost of all but the network
    python benchmarks/refine.py --full                 # AnimateDiff full-size, random: 512 x 512, 16 frames, 25 steps
    python benchmarks/refine.py --weights animatediff  # real weights, against the studio's truth videos
    python benchmarks/refine.py --weights animatediff:PATHS --scenes billiards cups --set strength=0.3 --out out.json

`--full` needs no weights and no disk: networks of the published sizes are filled with random numbers where they run, so
that figures tell of speed and memory alone; the text encoder is a small one. `--weights` is the measure of quality:
nothing here or in docs/ was measured with it yet. It prints, for each truth video, the frames as drawn and as refined
against truth (PSNR, SSIM, flicker), and the refined ones against the drawn ones on objects.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from physgen import pipeline, registry
from physgen.evaluate import fidelity
from physgen.photometry import decode
from physgen.refine.denoiser import Grid, PromptSettings
from physgen.refine.fusion import Refinement, RefineSettings, hold_frames, prompt_of
from physgen.registry import Setup
from physgen.render.mattes import matte_stage

ROOT = Path(__file__).resolve().parent.parent
HOW = RefineSettings(
    0.5,
    5,
    50,
    0,
    PromptSettings("billiard ball", "", None),
    lock=0.0,
    detail=1.0,
    hold=0,
)
"""Of the paper: 25 of 50 steps, 20 fused."""
F32 = np.ndarray


def clip(
    count: int, size: tuple[int, int]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """A disc over a ramp, and its coverage."""
    width, height = size
    y, x = np.mgrid[:height, :width].astype(np.float32)
    ramp = np.stack([40 + 160 * x / width, 60 + 120 * y / height, 0 * x + 120], axis=-1)
    frames, coverage = [], []
    for k in range(count):
        cover = np.clip(
            height / 5 + 0.5 - np.hypot(x - width * (0.3 + 0.02 * k), y - height / 2),
            0,
            1,
        ).astype(np.float32)
        frames.append(
            np.rint(ramp + cover[..., None] * (np.array([220, 200, 60]) - ramp)).astype(
                np.uint8
            )
        )
        coverage.append(cover)
    return frames, coverage


# ---- tiny models: run.py refine ----------------------------------------------------------------------------------


class Idle:
    """Latents as Stable Diffusion's of 512 x 512 px, and a network that costs nothing: what is left is ours."""

    grid = Grid(cell=8, side=64, area=512 * 512, window=16)

    def begin(self, frames: Any, said: PromptSettings, steps: int, count: int) -> F32:
        height, width = frames[0].shape[:2]
        self._size, self._count = (height, width), count
        return np.zeros((len(frames), 4, height // 8, width // 8), np.float32)

    def add_noise(self, latents: F32, noise: F32, k: int) -> F32:
        return latents + np.float32(1 - k / self._count) * noise

    def predict(self, latents: F32, k: int, first: int) -> F32:
        return latents

    def step(self, prediction: F32, latents: F32, k: int) -> F32:
        return np.float32(0.9) * latents + np.float32(0.1) * prediction

    def decode(self, latents: F32) -> Iterator[F32]:
        for _ in latents:
            yield np.zeros((1, *self._size, 3), np.float32)

    def note(self) -> dict[str, Any]:
        return {}

    def close(self) -> None:
        pass


def refining(folder: Path) -> list[dict]:
    """Identities on tiny models of the real classes, and seconds of CPU: ours at full size, theirs at tiny size."""
    sys.path.insert(0, str(ROOT))
    import torch

    from tests.contract.tiny_video import MODELS

    torch.set_num_threads(1)
    rows = []
    for (_, name), build in MODELS.items():
        model = registry.make("refine", name, Setup(build(folder / name), "cpu"))
        size, count = (61, 43), 13
        frames, coverage = clip(count, size)
        whole = [np.ones_like(cover) for cover in coverage]

        def run(
            how: RefineSettings,
            covers: list[np.ndarray],
            model: Any = model,
            frames: Any = frames,
            **more: Any,
        ) -> F32:
            made = Refinement(model, how, (61, 43), 13, **more).frames(frames, covers)
            return np.stack(list(made)).astype(int)

        still = run(replace(HOW, stop=0), whole, weight=lambda k, n: 0.0)
        before = time.process_time()
        made = run(HOW, coverage)
        spent = time.process_time() - before
        rows.append({
            "backend": name, "frames": count, "size": list(size),
            "guidance_off": int(np.abs(still - frames).max()),
            "photo_off": int(np.abs(run(replace(HOW, hold=4), coverage)[0] - frames[0]).max()),
            "again_off": int(np.abs(run(HOW, coverage) - made).max()),
            "seed_off": round(float(np.abs(run(replace(HOW, seed=1), coverage) - made).mean()), 2),
            "cpu": round(spent, 2),
        })  # fmt: skip
        model.close()
    frames, coverage = clip(16, (512, 512))
    before = time.process_time()
    list(Refinement(Idle(), HOW, (512, 512), 16).frames(frames, coverage))
    spent = time.process_time() - before
    rows.append(
        {
            "backend": "ours alone",
            "frames": 16,
            "size": [512, 512],
            "cpu": round(spent, 2),
        }
    )
    return rows


# ---- full-size models of random numbers --------------------------------------------------------------------------


def full(
    name: str,
    size: tuple[int, int],
    count: int,
    how: RefineSettings,
    device: str,
    dtype: str,
) -> dict:
    """Seconds and peak memory of one clip."""
    import torch
    from full_models import FULL

    with tempfile.TemporaryDirectory() as folder:
        model = FULL[name](Path(folder), Setup("", device, dtype))
        frames, coverage = clip(count, size)
        where, marks = model.note()["device"], []
        cuda = where.startswith("cuda")
        if cuda:
            torch.cuda.reset_peak_memory_stats()

        def mark(*_: Any) -> None:
            if cuda:
                torch.cuda.synchronize()
            marks.append(time.perf_counter())

        def begin(*told: Any, real: Any = model.begin) -> F32:
            latents = real(*told)
            mark()
            return latents

        model.begin = begin
        list(Refinement(model, how, size, count, mark).frames(frames, coverage))
        ended = time.perf_counter()
        peak = (
            torch.cuda.max_memory_allocated()
            if cuda
            else 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        )
        begun, encoded, *_ = marks
        note = model.note()
        return {
            "backend": name, "device": torch.cuda.get_device_name() if cuda else where, "dtype": note["dtype"],
            "frames": count, "size": list(size), "steps": how.count, "offload": note["offload"],
            "load_and_encode_s": round(encoded - begun, 2),
            "step_s": round(float(np.median(np.diff(marks[1:]))), 3),
            "decode_s": round(ended - marks[-1], 2), "all_s": round(ended - begun, 2),
            "peak_gib": round(peak / 2**30, 2),
        }  # fmt: skip


# ---- real weights, against truth ---------------------------------------------------------------------------------


def quality(
    said: str, names: list[str], changed: dict[str, float], device: str, dtype: str
) -> list[dict]:
    """Each truth video as drawn and as refined."""
    name, _, weights = said.partition(":")
    model = registry.make("refine", name, Setup(weights, device, dtype))
    rows = []
    for truth in fidelity.truths(ROOT / "studio/truth", names):
        scene, maps = fidelity.perceive_truth(truth)
        compiled = pipeline.compile(scene, maps)
        run, stage = (
            fidelity.replay(truth, compiled),
            pipeline.stage(scene, compiled, maps),
        )
        drawn = [frame.rgb for frame in pipeline.render(stage, run)]
        coverage = [
            np.asarray(decode(frame.rgb[..., 0]), np.float32)
            for frame in pipeline.render(matte_stage(stage), run)
        ]
        height, width = drawn[0].shape[:2]
        fps = (len(drawn) - 1) / float(run.times[-1])
        prompt = prompt_of(item.label for item in scene.objects)
        how = replace(
            HOW, prompt=PromptSettings(prompt, "", None), hold=hold_frames(fps)
        )
        how = replace(how, **changed)
        refinement = Refinement(model, how, (width, height), len(drawn))
        before = time.perf_counter()
        made = list(refinement.frames(drawn, coverage))
        row = {"scene": truth.name, "seconds": round(time.perf_counter() - before, 1)}
        row |= {
            f"drawn_{key}": value
            for key, value in fidelity.compare(truth, iter(drawn[1:])).items()
        }
        row |= {
            f"refined_{key}": value
            for key, value in fidelity.compare(truth, iter(made[1:])).items()
        }
        rows.append(
            row | kept(drawn, made, coverage) | {"note": dict(refinement.note())}
        )
        print(line(rows[-1]), flush=True)
    model.close()
    return rows


def kept(
    drawn: list[np.ndarray], made: list[np.ndarray], coverage: list[np.ndarray]
) -> dict:
    """Objects of the refined frames against those of the drawn ones, and how much the change flickers anywhere."""
    sums: dict[str, list[float]] = {
        "kept_psnr": [],
        "kept_ssim": [],
        "change_flicker": [],
    }
    before = None
    for guidance, refined, cover in zip(drawn, made, coverage, strict=True):
        change = (refined.astype(np.float64) - guidance) / 255
        where = cover > 0.5
        if where.any():
            sums["kept_psnr"].append(fidelity.psnr((change**2).mean(-1), where) or 0.0)
            sums["kept_ssim"].append(
                float(fidelity.ssim(refined, guidance)[where].mean())
            )
        if before is not None:
            sums["change_flicker"].append(float(np.abs(change - before).mean() * 255))
        before = change
    return {key: float(np.mean(values)) for key, values in sums.items() if values}


def line(row: dict) -> str:
    """One row as text."""
    keys = ("psnr_objects", "psnr_shadows", "psnr_rest", "flicker")
    cells = "  ".join(
        f"{key} {row[f'drawn_{key}'] or 0:.2f} -> {row[f'refined_{key}'] or 0:.2f}"
        for key in keys
    )
    return f"{row['scene']:<14} {row['seconds']:6.1f} s  {cells}  objects kept {row.get('kept_psnr', 0):.1f} dB"


def pair(kind: Callable[[str], Any], sign: str) -> Callable[[str], tuple[Any, Any]]:
    """`AxB` or `A=B`."""
    return lambda text: tuple(kind(part) for part in text.split(sign, 1))  # type: ignore[return-value]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--full", action="store_true", help="a full-size random model")
    what.add_argument(
        "--weights", metavar="NAME[:WEIGHTS]", help="as --refine of physgen render"
    )
    parser.add_argument("--frames", type=int, default=16)
    parser.add_argument(
        "--size", type=pair(int, "x"), default=(512, 512), metavar="WxH"
    )
    parser.add_argument(
        "--scenes", nargs="*", default=[], help="truth videos; default: all"
    )
    parser.add_argument("--set", action="append", default=[], type=pair(str, "="), metavar="KEY=NUMBER",
                        help="strength, stop, steps, seed, lock, detail or hold; may be repeated")  # fmt: skip
    parser.add_argument("--device", default="auto")
    parser.add_argument("--dtype", default="auto")
    parser.add_argument("--out", type=Path, help="figures as JSON")
    options = parser.parse_args()
    whole = ("stop", "steps", "seed", "hold")
    changed = {
        key: int(value) if key in whole else float(value) for key, value in options.set
    }
    if options.weights:
        rows = quality(
            options.weights, options.scenes, changed, options.device, options.dtype
        )
    else:
        how = replace(HOW, **changed)
        rows = [
            full(
                "animatediff",
                options.size,
                options.frames,
                how,
                options.device,
                options.dtype,
            )
        ]
        print(json.dumps(rows[-1]), flush=True)
    if options.out:
        options.out.write_text(json.dumps({"rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
