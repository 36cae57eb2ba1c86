"""Video models from frames to frames: what stays, what changes, and what is refused; on tiny ones of the real classes.

`test_refine_pipelines.py` holds their arithmetic against diffusers' own pipelines.
"""

from __future__ import annotations

import gc
import json
import pickle
import shutil
import weakref
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import torch

from physgen import registry
from physgen.problems import InputError
from physgen.refine.backends import sampling
from physgen.refine.backends import sampling as loading
from physgen.refine.denoiser import Denoiser, PromptSettings
from physgen.refine.fusion import Refinement, RefineSettings
from physgen.registry import Setup
from tests.contract import tiny_ltx, tiny_video, tiny_wan
from tests.contract.tiny_maps import Trap
from tests.contract.tiny_video import animatediff
from tests.contract.tiny_wan import wan

VARIANTS = [*tiny_video.VARIANTS, *tiny_wan.VARIANTS, *tiny_ltx.VARIANTS]
ROWS = {"animatediff": "animatediff", "wan": "wan", "ltx-video": "ltx-video"}
"""A kind of weights for each backend."""
SIZE = 37, 23
HOW = RefineSettings(
    0.5,
    1,
    4,
    0,
    PromptSettings("a red ball", "blur", 3.0),
    lock=0.0,
    detail=1.0,
    hold=0,
)
Video = Callable[..., Any]


def clip(count: int, size=SIZE) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """A disc that moves over a ramp, and its coverage."""
    width, height = size
    y, x = np.mgrid[:height, :width]
    frames, coverage = [], []
    for k in range(count):
        cover = np.clip(6.5 - np.hypot(x - 8 - k, y - 11), 0, 1).astype(np.float32)
        ramp = np.stack([40 + 3 * x, 60 + 4 * y, 0 * x + 120], axis=-1)
        frames.append(
            np.rint(ramp + cover[..., None] * (np.array([220, 200, 60]) - ramp)).astype(
                np.uint8
            )
        )
        coverage.append(cover)
    return frames, coverage


def refined(
    model: Denoiser,
    how: RefineSettings = HOW,
    count: int = 7,
    size=SIZE,
    covers: float | None = None,
    **more,
):
    frames, coverage = clip(count, size)
    if covers is not None:
        coverage = [np.full(cover.shape, covers, np.float32) for cover in coverage]
    made = list(Refinement(model, how, size, count, **more).frames(frames, coverage))
    assert [(frame.shape, frame.dtype) for frame in made] == [
        (f.shape, f.dtype) for f in frames
    ]
    return np.stack(made)


def change(made: np.ndarray, size=SIZE) -> np.ndarray:
    """(F,) mean grey levels by which frames differ from the guidance."""
    return np.abs(made.astype(float) - clip(len(made), size)[0]).mean(axis=(1, 2, 3))


# ---- what stays --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 7])
@pytest.mark.parametrize("variant", VARIANTS)
def test_all_objects_and_no_weight_give_the_guidance_to_the_byte(
    variant: str, count: int, video: Video
):
    """Odd sizes and counts, which no model takes, come back as they were."""
    model = video(variant)
    made = refined(
        model, replace(HOW, stop=0), count, covers=1.0, weight=lambda k, n: 0.0
    )
    assert np.array_equal(made, clip(count)[0])


@pytest.mark.parametrize("variant", VARIANTS)
def test_one_step_gives_a_picture(variant: str, video: Video):
    made = refined(video(variant), replace(HOW, steps=1, strength=1.0))
    assert change(made).max() > 0


@pytest.fixture
def apart(monkeypatch: pytest.MonkeyPatch) -> Callable[..., np.ndarray]:
    """How far refined latents are from the guidance's, by latent frame: a decoder of random numbers tells little."""
    decoded: list[np.ndarray] = []

    def distance(model: Denoiser, how: RefineSettings, count: int = 7) -> np.ndarray:
        decoded.clear()
        real = type(model).decode
        monkeypatch.setattr(
            type(model), "decode", lambda own, z: decoded.append(z) or real(own, z)
        )
        made = refined(model, how, count, covers=0.0)
        monkeypatch.undo()
        z, guidance = decoded
        assert np.array_equal(made[0], clip(1)[0][0]) == bool(how.hold)
        return np.abs(z - guidance).mean(axis=(1, 2, 3))

    return distance


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_first_frame_is_the_photo_and_the_next_ones_leave_it_step_by_step(
    variant: str, video: Video, apart
):
    model = video(variant)
    span = 6 * max(1, model.grid.stride // 4)  # two latent frames or more
    far = apart(model, replace(HOW, hold=span), 1 + span)
    assert far[0] == 0
    assert far.max() > 0.1
    assert np.diff(far).max() < 0.7 * far.max()


@pytest.mark.parametrize("variant", ROWS.values())
def test_words_are_heard_as_much_as_is_said(variant: str, video: Video):
    """Classifier-free guidance is linear in its scale, and at 1 there is nothing to be guided from."""
    model, frames = video(variant), clip(5, (32, 32))[0]
    said, passes = {}, []

    def counted(real: Callable[..., Any], scale: float, *told: Any) -> Any:
        passes.append(scale)
        return real(*told)

    for scale in (1.0, 2.0, 4.0):
        z = model.begin(frames, PromptSettings("a red ball", "blur", scale), 4, 2)
        network = model._network
        network.predict = partial(counted, network.predict, scale)
        said[scale] = model.predict(model.add_noise(z, np.ones_like(z), 0), 0, 0)
        del network.predict
    assert [passes.count(scale) for scale in said] == [1, 2, 2]
    step = said[2.0] - said[1.0]
    assert np.abs(step).max() > 0
    assert np.allclose(
        said[4.0] - said[1.0], 3 * step, atol=1e-4 * np.abs(said[4.0]).max()
    )


# ---- windows -----------------------------------------------------------------------------------------------------


class Watched:
    """A network whose windows and first frames are noted."""

    def __init__(self, network: Any) -> None:
        self.pipe, self._network = network.pipe, network
        self.lengths: list[int] = []
        self.first_frames: list[tuple[np.ndarray, int]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._network, name)

    def predict(self, z: Any, *more: Any) -> Any:
        self.lengths.append(len(z))
        return self._network.predict(z, *more)

    def condition(self, frame: Any, latents: int) -> Any:
        levels = ((frame.numpy() + 1) * 127.5).round().astype(np.uint8)
        self.first_frames.append((levels.transpose(1, 2, 0), latents))
        return self._network.condition(frame, latents)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("variant", "window", "latents"),
    [
        ("animatediff", 8, 8),
        ("wan", 9, 3),
        ("wan-framed", 9, 3),
        ("ltx-video", 17, 3),
    ],
)
def test_a_long_clip_is_seen_in_windows(
    variant: str, window: int, latents: int, video: Video
):
    model = video(variant, window=window)
    frames, coverage = clip(21)
    run = Refinement(model, HOW, SIZE, 21)
    model.load()
    network = model._network
    model.__dict__["_network"] = watched = Watched(network)
    made = np.stack(list(run.frames(frames, coverage)))
    model.__dict__["_network"] = network
    windows = run.note()["windows"]
    assert set(watched.lengths) == {latents}
    assert len(windows) > 1
    # each window gets its first frame once, whatever the steps
    stride = model.grid.stride
    for (frame, many), (first, last) in zip(watched.first_frames, windows, strict=True):
        assert many == last - first == latents
        place = 1 + (first - 1) * stride if first else 0
        assert np.array_equal(frame[:23, :37], frames[place])
    far = change(made)
    assert np.abs(np.diff(far)).max() < far.max()


@pytest.mark.parametrize("variant", ["wan-framed", "wan-framed-experts"])
def test_the_first_frame_of_a_window_guides(variant: str, video: Video):
    model, frames = video(variant), clip(13, (32, 32))[0]
    other = [np.full_like(frames[0], 200), *frames[1:]]
    z = model.begin(frames, PromptSettings("", "", 1.0), 4, 2)
    one = model.predict(z, 0, 0)
    model.begin(other, PromptSettings("", "", 1.0), 4, 2)
    assert np.abs(one - model.predict(z, 0, 0)).max() > 1e-4
    model.begin([frames[0], *other[1:]], PromptSettings("", "", 1.0), 4, 2)
    assert np.allclose(one, model.predict(z, 0, 0))


# ---- numbers and memory ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", ROWS.values())
def test_half_the_digits(variant: str, video: Video):
    model, whole = video(variant, "bfloat16"), video(variant)
    made = refined(model, count=2)
    assert model.note()["dtype"] == "bfloat16"
    network = model._network.pipe
    assert (
        network.vae.dtype == torch.float32
    )  # what is shown are differences of what it decodes
    assert (
        network.unet if variant == "animatediff" else network.transformer
    ).dtype == torch.bfloat16
    assert (
        np.abs(made.astype(int) - refined(whole, count=2)).mean()
        < 0.5 * change(made).mean()
    )


@pytest.mark.parametrize(
    ("variant", "kind"),
    [("animatediff", "device"), ("wan", "processor")],
)
def test_memory_that_does_not_suffice_is_reported(
    variant: str, kind: str, video: Video
):
    model, size = video(variant), (64, 64) if variant == "wan" else (32, 32)
    side = size[0] * 3 // 4
    model.begin(clip(1, size)[0], HOW.prompt, 4, 2)
    real = model._network.predict

    def short(z: Any, *told: Any) -> Any:
        if z.shape[-1] * model.grid.cell > side:
            if kind == "device":
                raise torch.OutOfMemoryError(
                    "CUDA out of memory. Tried to allocate 20.00 GiB."
                )
            torch.empty(1 << 50)  # the processor's own words
        return real(z, *told)

    model._network.predict = short
    with pytest.raises(InputError) as caught:
        refined(model, size=size)
    del model._network.predict
    (problem,) = caught.value.problems
    assert f"{size[0]} x {size[1]} px do not fit into the memory" in str(problem)
    assert "write a smaller resolution" in problem.fix
    assert refined(model, size=size).shape[0] == 7  # and nothing is broken


@pytest.mark.slow
@pytest.mark.parametrize("name", ROWS)
def test_a_closed_model_is_gone_and_comes_back(name: str, tiny: Any):
    model = registry.make("refine", name, tiny.setup("refine", name))
    first = refined(model, count=2)
    gone = weakref.ref(model._network.pipe.vae)
    model.close()
    gc.collect()
    assert gone() is None
    # weights lie elsewhere in memory now, where sums may be taken in another order
    assert np.abs(first.astype(int) - refined(model, count=2)).max() <= 1


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["animatediff", "wan-framed"])
def test_parts_that_come_and_go_do_the_same(
    variant: str, video: Video, monkeypatch: pytest.MonkeyPatch
):
    """The processor stands for the GPU: the same hooks bring each part when it is called."""

    def in_parts(pipe: Any, device: str) -> str:
        pipe.enable_model_cpu_offload(device=device)
        return "model"

    with monkeypatch.context() as patch:
        patch.setattr(sampling, "place_pipeline", in_parts)
        model = video(variant)
        model.close()  # other tests share it
        made = refined(model, count=5)
        assert model.note()["offload"] == "model"
        assert {type(hook).__name__ for hook in model._network.pipe._all_hooks} == {
            "UserCpuOffloadHook"
        }
        model.close()
    assert np.abs(made.astype(int) - refined(video(variant), count=5)).max() <= 1


def test_what_fills_the_gpu_is_brought_in_parts(monkeypatch: pytest.MonkeyPatch):
    class Pipe:
        """A pipeline of 4,000 bytes."""

        components: ClassVar = {"vae": torch.nn.Linear(999, 1), "scheduler": object()}
        told: ClassVar[list[str]] = []

        def to(self, device: str) -> None:
            self.told.append("all")

        def enable_model_cpu_offload(self, device: str) -> None:
            self.told.append("parts")

    for free, how in ((5000, "model"), (6000, "none")):
        monkeypatch.setattr(
            torch.cuda, "mem_get_info", lambda device, free=free: (free, 10**9)
        )
        assert loading.place_pipeline(Pipe(), "cuda:0") == how
    assert Pipe.told == ["parts", "all"]
    assert loading.place_pipeline(Pipe(), "cpu") == "none"


# ---- options -----------------------------------------------------------------------------------------------------


def test_a_resolution_is_shown_and_the_full_size_comes_back(video: Video):
    model = video("animatediff", resolution=16)
    run = Refinement(model, HOW, SIZE, 2)
    made = list(run.frames(*clip(2)))
    assert run.note()["size"] == [20, 13]  # 16 x 16 px, in the photo's shape
    assert made[0].shape == (23, 37, 3)
    assert np.array_equal(
        refined(model, replace(HOW, stop=0), 2, covers=1.0, weight=lambda k, n: 0.0),
        clip(2)[0],
    )


def test_a_resolution_that_no_model_takes_is_told(video: Video):
    with pytest.raises(
        InputError,
        match=r"wan.resolution: 8 is less than the minimum of 16; leave it out",
    ):
        video("wan", resolution=8)


# ---- weights -----------------------------------------------------------------------------------------------------


def made(name: str, weights: str) -> Any:
    return registry.make("refine", name, Setup(weights, "cpu"))


@pytest.mark.parametrize("name", ROWS)
def test_missing_weights_are_named_before_any_work(name: str):
    own = [weights.id for weights in registry.find("refine", name).weights]
    others = [f"nobody/no-{k}" for k in range(len(own))]
    for said, ids in ((",".join(others), others), ("", own)):
        with pytest.raises(InputError) as caught:
            made(name, said)
        told = {str(problem): problem.fix for problem in caught.value.problems}
        assert len(told) == len(ids)  # all that is missing, at once
        for id_ in ids:
            (fix,) = [
                fix
                for text, fix in told.items()
                if f'--refine: "{id_}" has the weights of' in text
            ]
            assert fix == f"run hf download {id_}, or write NAME:PATH"
    with pytest.raises(
        InputError, match=r'--refine: "no/such/folder" does not exist: the weights of'
    ):
        made(name, "no/such/folder")


@pytest.mark.parametrize("name", ROWS)
def test_a_folder_of_something_else_is_refused(name: str, tmp_path: Path):
    (tmp_path / "notes.txt").write_text("no weights")
    count = len(registry.find("refine", name).weights)
    with pytest.raises(
        InputError, match=r'--refine: ".*" does not load as .*; fetch it again'
    ):
        made(name, ",".join([str(tmp_path)] * count))


def test_weights_of_another_model_are_refused_with_whose_they_are(tmp_path: Path):
    wans, two = wan(tmp_path / "wan"), animatediff(tmp_path / "two")
    adapter, base = two.split(",")
    for name, said, message in (
        (
            "wan",
            base,
            r"is a StableDiffusionPipeline: not for Wan; name weights of a WanPipeline",
        ),
        (
            "animatediff",
            f"{adapter},{wans}",
            r"is a WanPipeline that the adapter does not fit; name weights of",
        ),
        (
            "animatediff",
            f"{base}/unet,{base}",
            r"is a UNet2DConditionModel, not a motion adapter; name a motion",
        ),
        (
            "animatediff",
            f"{two},{base}",
            r"names 3 weights for animatediff; write at most 2",
        ),
    ):
        with pytest.raises(InputError, match=message):
            made(name, said)
    narrow = json.loads((Path(adapter) / "config.json").read_text()) | {
        "block_out_channels": [16, 64]
    }
    (Path(adapter) / "config.json").write_text(json.dumps(narrow))
    with pytest.raises(
        InputError, match=r"is a StableDiffusionPipeline that the adapter does not fit"
    ):
        made("animatediff", two)


def test_broken_weights_are_told_when_they_are_read(tmp_path: Path):
    folder = Path(wan(tmp_path / "wan"))
    (folder / "transformer/diffusion_pytorch_model.safetensors").write_bytes(
        b"no numbers"
    )
    model = made("wan", str(folder))
    with pytest.raises(
        InputError, match=r'--refine: ".*" does not load as Wan .*; fetch it again'
    ):
        refined(model)


def test_pickled_weights_are_not_opened(tmp_path: Path):
    folder = Path(wan(tmp_path / "wan"))
    (folder / "vae/diffusion_pytorch_model.safetensors").unlink()
    (folder / "vae/diffusion_pytorch_model.bin").write_bytes(
        pickle.dumps(Trap(str(tmp_path / "ran")))
    )
    with pytest.raises(InputError, match="safetensors"):
        refined(made("wan", str(folder)))
    assert not (tmp_path / "ran").exists()


def test_the_record_tells_which_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    here = Path(wan(tmp_path / "wan"))
    model = made("wan", str(here))
    refined(model, count=1)
    note = model.note()
    assert note.items() >= {
        "weights": str(here), "device": "cpu", "dtype": "float32", "scheduler": "FlowMatchEulerDiscreteScheduler",
        "guidance": 3.0, "offload": "none", "tiling": False, "torch": torch.__version__,
    }.items()  # fmt: skip
    json.dumps(note)
    # from the hub's cache: the commit
    home = tmp_path / "hub/models--some--wan"
    shutil.copytree(here, home / "snapshots/5af5c01")
    (home / "refs").mkdir()
    (home / "refs/main").write_text("5af5c01")
    from huggingface_hub import constants

    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    cached = made("wan", "some/wan")
    assert cached.note()["revision"] == "5af5c01"
    assert cached.grid == model.grid
