"""Train the detector of whole objects: `python studio/segmentation/train_detector.py -o out/segmentation/detector`.

It starts from the weights of PicoDet in PHYSGEN_MATERIAL, and writes detector.pt, the
mean of the weights of the last steps. The same command resumes an interrupted run.
"""

from __future__ import annotations

import argparse
import copy
import json
import math
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from coco import material
from detector import DEVIATION, MEAN, WHOLES, Detector, cells
from detector_loss import Target, distillation, losses
from detector_views import SET_SHARES, WEIGHT_STEP, Example, View, load_sets, view
from given import load_given
from labelled_photos import OPEN_LICENCES
from torch import Tensor

SIDES = (320, 320, 416)
"""Sides of the views, px, in turn: small ones cost 0.6 of the large ones."""
BATCH = 8
RATES = {"backbone": 1e-4, "neck": 2e-4, "known": 3e-4, "wholes": 1e-3}
"""Highest rates: pretrained layers change less than the new ones."""
WARMUP = 50
"""Steps in which the rates rise."""
DECAY = 0.02
"""Weight decay of AdamW."""
LARGEST_GRADIENT = 10.0
AVERAGE = 0.99
"""Share of the earlier mean of weights that a step keeps."""
DISTILLED_STEPS = 2
"""In one of so many steps the given network teaches its class scores; it costs 0.3 of a
step."""
SAVE_SECONDS = 60.0
"""Time between saved states."""
LOG_STEPS = 20


def groups_of(model: Detector) -> list[dict[str, Any]]:
    """Return the parameters in groups with their rates."""
    grouped: dict[str, list[torch.nn.Parameter]] = {name: [] for name in RATES}
    for name, parameter in model.named_parameters():
        part = name.split(".")[0]
        if part == "heads":
            is_new = ".wholes" in name or ".class_roles" in name
            part = "wholes" if is_new else "known"
        grouped[part].append(parameter)
    return [
        {"params": grouped[name], "rate": rate, "lr": rate}
        for name, rate in RATES.items()
    ]


def batches(
    sets: dict[str, list[Example]], seed: int, step: int, device: str
) -> Iterator[tuple[Tensor, list[Target]]]:
    """Yield batches from a step on; a step's batch depends on the seed and the step."""
    with ThreadPoolExecutor(1) as pool:
        ahead = pool.submit(batch, sets, seed, step, device)
        while True:
            ready = ahead.result()
            step += 1
            ahead = pool.submit(batch, sets, seed, step, device)
            yield ready


def batch(
    sets: dict[str, list[Example]], seed: int, step: int, device: str
) -> tuple[Tensor, list[Target]]:
    """Return photos (B, 3, S, S) and their targets."""
    rng = np.random.default_rng([seed, step])
    names = list(sets)
    shares = np.array([SET_SHARES[name] for name in names])
    side = SIDES[step % len(SIDES)]

    def draw_example() -> Example:
        examples = sets[names[rng.choice(len(names), p=shares / shares.sum())]]
        return examples[rng.integers(len(examples))]

    views = [view(draw_example, side, rng) for _ in range(BATCH)]
    pixels = np.stack([one.bgr for one in views]).astype(np.float32)
    pixels = (pixels - np.float32(MEAN)) / np.float32(DEVIATION)
    photos = torch.from_numpy(np.ascontiguousarray(pixels.transpose(0, 3, 1, 2)))
    centres, _ = cells(side)
    targets = [target_of(one, centres, device) for one in views]
    return photos.to(device), targets


def target_of(shown: View, centres: Tensor, device: str) -> Target:
    """Return the target of a view."""
    place = (centres / WEIGHT_STEP).long().clamp(max=shown.weights.shape[0] - 1)
    weights = torch.from_numpy(np.ascontiguousarray(shown.weights))
    class_weights = torch.from_numpy(np.ascontiguousarray(shown.class_weights))
    return Target(
        torch.from_numpy(shown.boxes.astype(np.float32)).to(device),
        torch.from_numpy(shown.roles).to(device),
        torch.from_numpy(shown.classes).to(device),
        weights[place[:, 1], place[:, 0]].to(device),
        class_weights[place[:, 1], place[:, 0]].to(device),
    )


def rate_at(step: int, steps: int) -> float:
    """Return the share of the highest rate at a step: a rise, then a cosine."""
    rise = min(1.0, (step + 1) / WARMUP)
    return rise * (0.5 + 0.5 * math.cos(math.pi * step / steps)) + 0.005


def average(mean: Detector, model: Detector, step: int) -> None:
    """Move the mean of weights towards the weights of this step."""
    share = min(AVERAGE, 1 - 1 / (step / 5 + 2))
    with torch.no_grad():
        for ours, theirs in zip(mean.parameters(), model.parameters(), strict=True):
            ours.lerp_(theirs, 1 - share)


def save(state: dict[str, Any], path: Path) -> None:
    """Write a state under its final name once it is complete."""
    temporary = path.with_suffix(".tmp")
    torch.save(state, temporary)
    temporary.replace(path)


def train(args: argparse.Namespace) -> None:
    """Train from the last saved state on."""
    torch.manual_seed(args.seed)
    model = Detector()
    load_given(model, material() / "material/networks/picodet_s_416_coco.onnx")
    # Channels last takes 0.8 of the time on a processor.
    model = model.to(args.device, memory_format=torch.channels_last).train()
    mean, teacher = copy.deepcopy(model), copy.deepcopy(model)
    optimizer = torch.optim.AdamW(groups_of(model), weight_decay=DECAY)
    step, minutes, log = 0, 0.0, []
    state_path = args.output / "detector.state"
    if state_path.exists():
        state = torch.load(state_path, map_location=args.device, weights_only=True)
        model.load_state_dict(state["model"])
        mean.load_state_dict(state["mean"])
        optimizer.load_state_dict(state["optimizer"])
        step, minutes, log = state["step"], state["minutes"], state["log"]
    licences = None if args.all_licences else OPEN_LICENCES
    sets = load_sets(args.output, licences)
    print({name: len(examples) for name, examples in sets.items()}, flush=True)
    source = batches(sets, args.seed, step, args.device)
    running: dict[str, float] = {}
    started, saved = time.monotonic() - 60 * minutes, time.monotonic()
    while step < args.steps:
        for group in optimizer.param_groups:
            group["lr"] = group["rate"] * rate_at(step, args.steps)
        is_taught = step % DISTILLED_STEPS == 0
        parts = learn_step(
            model, optimizer, next(source), teacher if is_taught else None
        )
        step += 1
        average(mean, model, step)
        for name, value in parts.items():
            running[name] = 0.95 * running.get(name, value) + 0.05 * value
        minutes = (time.monotonic() - started) / 60
        if step % LOG_STEPS == 0:
            row = {name: round(value, 4) for name, value in running.items()}
            log.append({"step": step, "minutes": round(minutes, 1), **row})
            print(json.dumps(log[-1]), flush=True)
        if step % args.keep == 0:
            save(mean.state_dict(), args.output / f"detector-{step}.pt")
        if time.monotonic() - saved > SAVE_SECONDS or step == args.steps:
            saved = time.monotonic()
            state = {"model": model.state_dict(), "mean": mean.state_dict()}
            state |= {"optimizer": optimizer.state_dict(), "step": step}
            save(state | {"minutes": minutes, "log": log}, state_path)
    save(mean.state_dict(), args.output / "detector.pt")
    (args.output / "detector.json").write_text(json.dumps(log, indent=1) + "\n")


def learn_step(
    model: Detector,
    optimizer: torch.optim.Optimizer,
    examples: tuple[Tensor, list[Target]],
    teacher: Detector | None,
) -> dict[str, float]:
    """Change the weights by one batch; return the parts of the loss."""
    photos, targets = examples
    centres, strides = cells(photos.shape[-1])
    photos = photos.contiguous(memory_format=torch.channels_last)
    scores, bins = model.logits(photos)
    parts = losses(
        scores, bins, targets, centres.to(photos.device), strides.to(photos.device)
    )
    if teacher is not None:
        with torch.no_grad():
            taught = teacher.logits(photos)[0][..., WHOLES:].sigmoid()
        parts["distilled"] = distillation(scores[..., WHOLES:], taught)
    optimizer.zero_grad()
    torch.stack(list(parts.values())).sum().backward()
    torch.nn.utils.clip_grad_norm_(model.parameters(), LARGEST_GRADIENT)
    optimizer.step()
    return {name: float(part.detach()) for name, part in parts.items()}


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=450)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--keep", type=int, default=100, help="steps between weights that are kept"
    )
    parser.add_argument(
        "--all-licences", action="store_true",
        help="use all photos of coco-minis, not only those of licences 4, 5 and 7",
    )  # fmt: skip
    parser.add_argument(
        "--threads", type=int, default=1, help="more of them wait for each other"
    )
    parser.add_argument(
        "--device", default="cuda" if torch.cuda.is_available() else "cpu"
    )
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/segmentation/detector")
    )
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(args.threads)
    cv2.setNumThreads(1)
    train(args)


if __name__ == "__main__":
    main()
