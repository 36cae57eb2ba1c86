"""Weights and devices that are not here, and options that mean nothing: what a person is told, and how soon."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
import torch

from physgen import registry
from physgen.perceive.backends import models
from physgen.problems import InputError
from physgen.registry import Setup

pytestmark = pytest.mark.slow


def photo(height, width):
    return np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (
            "",
            '"IDEA-Research/grounding-dino-tiny" has the weights of Grounding DINO, and is not on this machine',
        ),
        (
            "/nowhere/dino",
            '"/nowhere/dino" does not exist: the weights of Grounding DINO; write ROLE=NAME:PATH',
        ),
        ("a,b,c", '"a,b,c" names 3 weights for grounding-dino+sam; write at most 2'),
    ],
)
def test_weights_that_are_not_here_are_named(weights, message):
    with pytest.raises(InputError) as error:
        registry.make("segment", "grounding-dino+sam", Setup(weights, "cpu"))(
            photo(30, 40)
        )
    assert message in str(error.value)
    if not weights:
        assert (
            "run hf download IDEA-Research/grounding-dino-tiny, or write ROLE=NAME:PATH"
            in str(error.value)
        )


def test_the_second_weights_alone_can_be_named(tiny, tmp_path):
    dino, sam = tiny.setup("segment", "grounding-dino+sam").weights.split(",")
    run = registry.make("segment", "grounding-dino+sam", Setup(f"{dino}", "cpu"))
    assert run._weights == (dino, "facebook/sam-vit-huge")
    run = registry.make("segment", "grounding-dino+sam", Setup(f",{sam}", "cpu"))
    assert run._weights == ("IDEA-Research/grounding-dino-tiny", sam)
    (tmp_path / "config.json").write_text("{")
    run = registry.make(
        "segment", "grounding-dino+sam", Setup(f"{dino},{tmp_path}", "cpu")
    )
    with pytest.raises(InputError, match="does not load as SAM"):
        run.segment_meant_objects(photo(30, 40), [(1, 1, 9, 9)], [])
    with pytest.raises(
        InputError,
        match=r"grounding-dino\+sam\.threshold: 'high' is not of type 'number'",
    ):
        registry.make(
            "segment",
            "grounding-dino+sam",
            Setup("", "cpu", options={"threshold": "high"}),
        )


def test_a_device_that_is_not_here_is_refused():
    assert models.device_of(Setup(device="auto")) in ("cpu", "cuda", "mps")
    with pytest.raises(InputError, match='"tpu" is not a device; choose auto or'):
        models.device_of(Setup(device="tpu"))
    if not torch.cuda.is_available():
        with pytest.raises(InputError, match='device "cuda:1" is missing'):
            models.device_of(Setup(device="cuda:1"))
        assert models.dtype_of(Setup(), "cpu") == torch.float32


def test_a_hub_that_does_not_answer_is_not_waited_for():
    code = (
        "import time\n"
        "from physgen.perceive.backends.models import load_weights\n"
        "began = time.monotonic()\n"
        "try:\n    load_weights(print, 'facebook/sam-vit-huge', 'SAM')\n"
        "except Exception as error:\n    print(type(error).__name__, error)\n"
        "assert time.monotonic() - began < 8\n"
    )
    away = {
        "HF_ENDPOINT": "http://127.0.0.1:9",
        "HF_HUB_OFFLINE": "0",
        "HF_HOME": "/nowhere",
    }
    run = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **away},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert (
        "the hub cannot be asked; run hf download facebook/sam-vit-huge" in run.stdout
    )
