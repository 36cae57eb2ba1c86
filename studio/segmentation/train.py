"""Stored pictures -> weights: `python studio/segmentation/train.py STORE=SHARE ... -o out/segmentation`; CPU or GPU, seeds fixed."""

from __future__ import annotations

import argparse
import copy
import json
import math
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import torch
from batches import batches
from network import BOUNDARY, FOREGROUND, MOVABLE, NORMALS, PAIRS, SHADOW, Network
from store import Store
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

BATCH = 16
RATE = 2e-3
"""Of learning, at most."""
ENCODER = 0.15
"""Of that, for the pretrained encoder."""
AHEAD = 12
"""Batches that wait."""


def losses(out: Tensor, batch: dict[str, Tensor]) -> dict[str, Tensor]:
    """What the network has wrong, by part; each about 1 at the start."""
    said, weight = batch["said"], batch["weight"]
    on = batch["foreground"]

    def crossed(channel: Tensor, truth: Tensor, share: Tensor) -> Tensor:
        return (
            F.binary_cross_entropy_with_logits(channel, truth, reduction="none") * share
        ).sum() / share.sum().clamp(min=1)

    foreground = out[:, FOREGROUND]
    sure = torch.sigmoid(foreground) * said
    dice = 1 - (2 * (sure * on).sum((1, 2)) + 20) / (
        sure.sum((1, 2)) + on.sum((1, 2)) + 20
    )
    asked = batch["asked"]
    normals = (out[:, NORMALS] - batch["normals"]).abs().sum(1)
    known = (batch["normals"].abs().sum(1) > 0).float() * (0.2 + on)
    return {
        "foreground": crossed(
            foreground, on, said * weight * (1 + 1.5 * batch["boundary"])
        )
        + 0.5 * dice.mean(),
        "boundary": crossed(
            out[:, BOUNDARY], batch["boundary"], said * (1 + 3 * batch["boundary"])
        ),
        "pairs": 1.5 * crossed(out[:, PAIRS], batch["pairs"], asked * weight[:, None]),
        "normals": 0.2 * (normals * known).sum() / known.sum().clamp(min=1),
        "shadow": 0.4
        * crossed(
            out[:, SHADOW], batch["shadow"], said * batch["rendered"][:, None, None]
        ),
        "movable": 0.3 * crossed(out[:, MOVABLE], batch["movable"], said * on),
    }


def ahead(source: Iterator[Any], device: torch.device) -> Iterator[dict[str, Tensor]]:
    """The batches, made by a thread while the network learns."""
    line: queue.Queue[dict[str, Tensor] | Exception] = queue.Queue(AHEAD)

    def work() -> None:
        cv2.setNumThreads(1)
        try:
            for batch in source:
                line.put(
                    {name: torch.from_numpy(part) for name, part in vars(batch).items()}
                )
        except Exception as error:  # told where somebody waits
            line.put(error)

    threading.Thread(target=work, daemon=True).start()
    while True:
        batch = line.get()
        if isinstance(batch, Exception):
            raise batch
        yield {name: part.to(device) for name, part in batch.items()}


@dataclass(frozen=True)
class Run:
    """One of `jobs` processes that share each batch and agree on every step; this one is number `rank`.

    A process keeps to one thread: on processors two processes learn several times as fast as one with two threads.
    """

    rank: int
    jobs: int
    steps: int
    out: Path
    device: str
    seed: int

    def begin(self) -> torch.device:
        """Meet the other processes; returns where tensors live."""
        if self.jobs > 1:
            torch.distributed.init_process_group(
                "gloo",
                rank=self.rank,
                world_size=self.jobs,
                init_method=f"file://{self.out}/meet",
            )
        torch.set_num_threads(1)
        torch.manual_seed(self.seed)
        return torch.device(self.device)


Shares = list[tuple[Path, float]]
"""Stores of pictures, and how much of a batch comes from each."""


def train(
    rank: int, jobs: int, stores: Shares, steps: int, seed: int, out: Path, device: str
) -> None:
    """Learn so many steps; `out` gets what `learn` writes, as weights.pt."""
    run = Run(rank, jobs, steps, out, device, seed)
    where = run.begin()
    network = (
        Network(pretrained=True).to(where, memory_format=torch.channels_last).train()
    )
    encoder = network.encoder()
    own = {id(p) for p in encoder}
    rest = [p for p in network.parameters() if p.requires_grad and id(p) not in own]
    opened = [Store.at(folder) for folder, _ in stores]
    shares = [share for _, share in stores]
    learn(
        run,
        network,
        [{"params": rest, "share": 1.0}, {"params": encoder, "share": ENCODER}],
        lambda step: ahead(
            batches(opened, shares, BATCH // jobs, seed + 1000 * rank + step), where
        ),
        lambda batch: losses(
            network(batch["x"].contiguous(memory_format=torch.channels_last)), batch
        ),
        "weights",
    )


def learn(
    run: Run,
    model: nn.Module,
    groups: list[dict[str, Any]],
    source: Callable[[int], Iterator[dict[str, Tensor]]],
    losses: Callable[[dict[str, Tensor]], dict[str, Tensor]],
    name: str,
) -> None:
    """Learn from the batches of `source`, from a step on; `groups` are parameters with their shares of the rate.

    `run.out` gets NAME.pt (the mean of the last steps' weights), NAME.json (the losses), and NAME.state, from which an
    interrupted run goes on.
    """
    mean = copy.deepcopy(model).eval()
    optimizer = torch.optim.AdamW(groups, lr=RATE, weight_decay=0.02)
    log: list[dict[str, float]] = []
    step, minutes, state_path = 0, 0.0, run.out / f"{name}.state"
    if state_path.exists():
        state = torch.load(state_path, map_location=run.device, weights_only=True)
        model.load_state_dict(state["model"])
        mean.load_state_dict(state["mean"])
        optimizer.load_state_dict(state["optimizer"])
        step, minutes, log = state["step"], state["minutes"], state["log"]
    batches_ahead = source(step)
    running: dict[str, float] = {}
    started, saved = time.monotonic() - 60 * minutes, time.monotonic()
    if run.rank == 0:
        print(f"{sum(p.numel() for p in model.parameters()):,} parameters", flush=True)
    while step < run.steps:
        rate = (
            RATE
            * min(1, (step + 1) / 100)
            * (0.5 + 0.5 * math.cos(math.pi * step / run.steps) + 0.004)
        )
        for group in optimizer.param_groups:
            group["lr"] = rate * group["share"]
        parts = losses(next(batches_ahead))
        optimizer.zero_grad()
        torch.stack(list(parts.values())).sum().backward()
        agreed(model, run.jobs)
        torch.nn.utils.clip_grad_norm_(model.parameters(), 5.0)
        optimizer.step()
        step += 1
        keep = min(0.995, 1 - 1 / (step / 5 + 2))
        with torch.no_grad():
            for ours, theirs in zip(
                mean.state_dict().values(), model.state_dict().values(), strict=True
            ):
                if ours.dtype.is_floating_point:
                    ours.lerp_(theirs, 1 - keep)
                else:
                    ours.copy_(theirs)
        for key, part in parts.items():
            running[key] = 0.98 * running.get(key, float(part.detach())) + 0.02 * float(
                part.detach()
            )
        if run.rank:
            continue
        minutes = (time.monotonic() - started) / 60
        if step % 50 == 0:
            log.append(
                {
                    "step": step,
                    "minutes": round(minutes, 2),
                    **{k: round(v, 4) for k, v in running.items()},
                }
            )
            print(json.dumps(log[-1]), flush=True)
            (run.out / f"{name}.json").write_text(json.dumps(log, indent=1))
        if step in {run.steps * k // 6 for k in range(1, 6)}:
            torch.save(mean.state_dict(), run.out / f"{name}-after-{step}.pt")
        if time.monotonic() - saved > 120 or step == run.steps:
            saved = time.monotonic()
            state = {"model": model.state_dict(), "mean": mean.state_dict(), "log": log}
            state |= {
                "optimizer": optimizer.state_dict(),
                "step": step,
                "minutes": minutes,
            }
            torch.save(state, run.out / "state.tmp")
            (run.out / "state.tmp").replace(state_path)
    if run.rank == 0:
        torch.save(mean.state_dict(), run.out / f"{name}.pt")
        state_path.unlink(missing_ok=True)


def agreed(network: nn.Module, jobs: int) -> None:
    """Give all processes the mean of their gradients."""
    if jobs == 1:
        return
    gradients = [p.grad for p in network.parameters() if p.grad is not None]
    row = torch.cat([g.reshape(-1) for g in gradients])
    torch.distributed.all_reduce(row)
    row /= jobs
    at = 0
    for gradient in gradients:
        gradient.copy_(row[at : at + gradient.numel()].view_as(gradient))
        at += gradient.numel()


def arguments(
    text: str | None, steps: int, *flags: str
) -> tuple[int, Shares, argparse.Namespace]:
    """Processes, stores and the other arguments of a training script; the output's folder is there then."""
    parser = argparse.ArgumentParser(description=text)
    parser.add_argument(
        "stores", nargs="+", help="FOLDER or FOLDER=SHARE of stored pictures"
    )
    parser.add_argument("--steps", type=int, default=steps)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2, help="processes, without a GPU")
    parser.add_argument(
        "--device", default="cuda" if torch.cuda.is_available() else "cpu"
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("out/segmentation"))
    for flag in flags:
        parser.add_argument(flag, action="store_true")
    args = parser.parse_args()
    missing = [
        text
        for text in args.stores
        if not (Path(text.partition("=")[0]) / "done.npy").exists()
    ]
    if missing:
        parser.error(f"{missing[0]}: no store of pictures; make one with gather.py")
    stores = [
        (Path(folder), float(share or 1))
        for folder, _, share in (text.partition("=") for text in args.stores)
    ]
    args.output = args.output.resolve()
    args.output.mkdir(parents=True, exist_ok=True)
    (args.output / "meet").unlink(missing_ok=True)
    return 1 if args.device != "cpu" else args.jobs, stores, args


def main() -> None:
    """See the module."""
    jobs, stores, args = arguments(__doc__, 4000)
    spawn(train, jobs, (stores, args.steps, args.seed, args.output, args.device))


def spawn(work: Callable[..., None], jobs: int, told: tuple[Any, ...]) -> None:
    """Call `work` with its rank, how many there are, and `told`, in so many processes."""
    torch.multiprocessing.spawn(work, (jobs, *told), jobs) if jobs > 1 else work(
        0, jobs, *told
    )


if __name__ == "__main__":
    main()
