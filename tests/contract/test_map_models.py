"""Models that draw maps and paint: sizes, options, what is refused, and memory; on tiny models of the real classes."""

from __future__ import annotations

import functools
import gc
import pickle
import weakref

import numpy as np
import pytest
import torch

from physgen import registry
from physgen.perceive.perceive import perceive
from physgen.perceive.roles import Detections
from physgen.problems import InputError
from physgen.registry import Backends, Setup, choices
from physgen.registry import Plan as Chosen
from tests.contract.test_backends_contract import photo
from tests.contract.tiny_maps import MODELS, Trap, stable_diffusion
from tests.perceive.lambertian import beyond_halos

pytestmark = pytest.mark.slow

ROWS = [*MODELS, ("depth", "depth-anything"), ("inpaint", "lama")]
IDS = ["-".join(row) for row in ROWS]


def asked(role: str, run, rgb: np.ndarray):
    """A map, whatever the role."""
    labels = np.zeros(rgb.shape[:2], np.uint16)
    if role == "depth":
        return run(rgb)
    if role == "normals":
        return run(rgb, labels, [], None)
    if role == "intrinsic":
        return run(rgb, labels, np.zeros(rgb.shape, np.float32)).shading
    hole = labels > 0
    hole[: len(hole) // 2, : hole.shape[1] // 3] = True
    filled = run(rgb, hole)
    assert np.array_equal(filled[~hole], rgb[~hole])
    return filled


@pytest.mark.parametrize("row", ROWS, ids=IDS)
def test_photos_of_any_size(row, tiny):
    run = registry.make(*row, tiny.setup(*row))
    random = np.random.default_rng(3)
    for shape in ((97, 301), (301, 97), (1, 1), (3, 900), (16, 16)):
        rgb = random.integers(0, 256, (*shape, 3), np.uint8)
        assert asked(row[0], run, rgb).shape[:2] == shape


@pytest.mark.parametrize(
    "row", [row for row in ROWS if row[1] in ("marigold", "diffusion")], ids="-".join
)
def test_the_seed_decides_and_nothing_else(row, tiny):
    rgb = photo()[0]
    torch.manual_seed(1)
    first = asked(row[0], registry.make(*row, tiny.setup(*row)), rgb)
    torch.manual_seed(2)
    again = asked(row[0], registry.make(*row, tiny.setup(*row, seed=0)), rgb)
    other = asked(row[0], registry.make(*row, tiny.setup(*row, seed=1)), rgb)
    assert first.tobytes() == again.tobytes()
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("row", ROWS, ids=IDS)
def test_a_closed_model_is_gone(row, tiny):
    run = registry.make(*row, tiny.setup(*row))
    asked(row[0], run, photo()[0])
    held = run._model
    network = getattr(held, "unet", held)
    gone = weakref.ref(network)
    del held, network
    run.close()
    gc.collect()
    assert gone() is None
    assert (
        asked(row[0], run, photo()[0]).shape[:2] == photo()[0].shape[:2]
    )  # and comes back when it is asked


HUB_ROWS = [row for row in ROWS if row[1] != "lama"]


@pytest.mark.parametrize("row", HUB_ROWS, ids="-".join)
def test_missing_weights_are_named(row):
    with pytest.raises(InputError) as caught:
        registry.make(*row, Setup("nobody/no-such-weights"))  # before any work
    (problem,) = caught.value.problems
    assert problem.found == '"nobody/no-such-weights"'
    assert "hf download nobody/no-such-weights" in problem.fix
    with pytest.raises(InputError) as caught:
        registry.make(*row, Setup())
    assert registry.find(*row).weights[0].id in str(caught.value)


@pytest.mark.parametrize("row", HUB_ROWS, ids="-".join)
def test_a_folder_of_something_else_is_refused(row, tmp_path):
    (tmp_path / "notes.txt").write_text("no weights")
    with pytest.raises(InputError, match="does not load as"):
        asked(row[0], registry.make(*row, Setup(str(tmp_path), "cpu")), photo()[0])


def test_marigolds_weights_for_another_role_are_refused(tiny):
    path = tiny["normals", "marigold"]
    with pytest.raises(
        InputError,
        match=r"is a MarigoldNormalsPipeline: not for depth; write normals=marigold:",
    ):
        registry.make("depth", "marigold", Setup(str(path), "cpu"))(photo()[0])


def test_pickled_weights_are_not_opened(tmp_path, tiny):
    path = stable_diffusion(tmp_path / "pickled")
    (path / "unet" / "diffusion_pytorch_model.safetensors").rename(
        path / "unet" / "elsewhere.safetensors"
    )
    (path / "unet" / "diffusion_pytorch_model.bin").write_bytes(
        pickle.dumps(Trap(str(tmp_path / "ran")))
    )
    with pytest.raises(InputError, match="safetensors"):
        asked(
            "inpaint",
            registry.make("inpaint", "diffusion", Setup(str(path), "cpu")),
            photo()[0],
        )
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "is not a file; write inpaint=lama:PATH"),
        (b"hello", "does not load as LaMa"),
        (pickle.dumps({"weight": 0}), "does not load as LaMa"),
    ],
    ids=["missing", "text", "pickle"],
)
def test_lama_refuses_files_that_are_no_torchscript(tmp_path, content, message):
    path = tmp_path / "big-lama.pt"
    if content is not None:
        path.write_bytes(content)

    def paint():
        run = registry.make("inpaint", "lama", Setup(str(path), "cpu"))
        return asked("inpaint", run, photo()[0])

    with pytest.raises(InputError, match=message):
        paint()


def test_lama_gets_numbers_of_its_kind(tmp_path):
    class Asks(torch.nn.Module):
        def forward(self, image: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
            assert image.shape[2] % 8 == 0
            assert image.shape[3] % 8 == 0
            assert mask.shape[1] == 1
            assert bool(((mask == 0) | (mask == 1)).all())
            assert bool((image >= 0).all())
            assert bool((image <= 1).all())
            assert float(image.max()) > 0.5
            return image

    torch.jit.script(Asks()).save(str(tmp_path / "asks.pt"))
    run = registry.make("inpaint", "lama", Setup(str(tmp_path / "asks.pt"), "cpu"))
    rgb, labels, _ = photo()
    rgb, hole = rgb[:117, :149], labels[:117, :149] > 0
    filled = run(rgb, hole)
    gap = np.abs(filled.astype(int) - rgb)[hole]
    # the network painted what is there: padding, cropping and scale go back and forth
    assert np.median(gap) <= 2


def test_lama_refuses_a_network_that_answers_no_picture(tmp_path):
    class Odd(torch.nn.Module):
        def forward(self, image: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
            return mask

    torch.jit.script(Odd()).save(str(tmp_path / "odd.pt"))
    run = registry.make("inpaint", "lama", Setup(str(tmp_path / "odd.pt"), "cpu"))
    with pytest.raises(InputError, match="it is not LaMa"):
        asked("inpaint", run, photo()[0])


def test_what_the_safety_checker_withholds_is_refused(tiny, monkeypatch):
    run = registry.make("inpaint", "diffusion", tiny.setup("inpaint", "diffusion"))
    kind = type(run._model)
    real = kind.__call__

    @functools.wraps(real)
    def strict(pipe, **arguments):
        found = real(pipe, **arguments)
        found.nsfw_content_detected = [True]
        return found

    monkeypatch.setattr(kind, "__call__", strict)
    rgb, labels, _ = photo()
    with pytest.raises(InputError, match="safety checker"):
        run(rgb, labels == 1)


def test_a_photo_is_perceived_with_models_in_four_roles(tiny):
    rgb, labels, _ = photo()
    rows = [
        ("depth", "marigold"),
        ("normals", "marigold"),
        ("intrinsic", "marigold"),
        ("inpaint", "diffusion"),
    ]
    plan = Chosen(
        choices([f"{role}={name}:{tiny[role, name]}" for role, name in rows]),
        device="cpu",
        options=tiny.options,
    )
    crew = Backends(plan)
    seen = perceive(
        rgb, Detections(labels, "given", {1: 1.0, 2: 1.0}, {}), backends=crew
    )
    maps = seen.percepts
    assert maps.depth is not None
    assert np.ptp(maps.depth) > 0
    assert maps.background.shape == rgb.shape
    far = beyond_halos(maps.coverage)
    assert far.any()
    assert np.array_equal(maps.background[far], rgb[far])
    notes = {step["role"]: step["note"] for step in crew.record()}
    for role, name in rows:
        assert notes[role]["weights"] == str(tiny[role, name])
        assert notes[role]["device"] == "cpu"
    assert not {role for role, _ in rows} & set(crew._made)  # their models are gone
