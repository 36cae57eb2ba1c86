"""Segmenters by models: coordinates, names and prompts, with tiny models of the real classes.

What random weights say means nothing, so where a place is checked the model's own output is replaced by a known one.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physgen import registry
from physgen.perceive.backends.segment_grounded import GroundingDino, Sam, pixels
from physgen.perceive.roles import Category, PromptedMask, Segments
from physgen.perceive.segment.prompts import Segmenter, from_prompts
from physgen.registry import Backends

pytestmark = pytest.mark.slow

GROUNDED = "grounding-dino+sam"
KINDS = [
    Category("wall", False),
    Category("Red Ball", True),
    Category("domino", True),
    Category("cup", True),
]
SIZES = [(384, 512), (512, 384), (101, 67)]
"""(H, W)."""


def photo(height, width, seed=0):
    return np.random.default_rng(seed).integers(0, 255, (height, width, 3), np.uint8)


def rectangle(size, x0, y0, x1, y1):
    """A mask of parts of the photo, 0..1."""
    y, x = np.mgrid[: size[0], : size[1]] + 0.5
    return (
        (x > x0 * size[1])
        & (x < x1 * size[1])
        & (y > y0 * size[0])
        & (y < y1 * size[0])
    )


def agree(one, other):
    return np.count_nonzero(one & other) / np.count_nonzero(one | other)


class Answering:
    """In place of a model: the prompts that it was given, and for each box the mask that fills it, two thirds sure."""

    def __init__(self, cutter):
        """The cutter works at the side of the real models from here on."""
        self.side = cutter.side = 1024
        self.prompts = []
        cutter.model = self

    def get_image_embeddings(self, pixel_values):
        assert pixel_values.shape == (1, 3, self.side, self.side)
        return torch.zeros(1)

    def __call__(
        self,
        image_embeddings,
        multimask_output,
        input_boxes=None,
        input_points=None,
        input_labels=None,
    ):
        assert multimask_output
        corners = input_boxes[0] if input_boxes is not None else None
        if corners is None:
            assert input_labels.shape == input_points.shape[:3]
            corners = torch.cat(
                [input_points[0, :, 0] - 6, input_points[0, :, 0] + 6], -1
            )
        self.prompts += corners.tolist()
        there = (torch.arange(256) + 0.5) * self.side / 256
        masks = torch.stack([
            ((there > x0) & (there < x1))[None, :] & ((there > y0) & (there < y1))[:, None]
            for x0, y0, x1, y1 in corners.tolist()
        ])  # fmt: skip
        empty = torch.full(masks.shape, -8.0)
        logits = torch.stack([empty, torch.where(masks, 8.0, -8.0), empty], 1)
        return SimpleNamespace(
            pred_masks=logits[None],
            iou_scores=torch.tensor([0.5, 2 / 3, 0.1]).repeat(1, len(masks), 1),
        )


def light(detector, said):
    """The detector's answers: per query a box, as parts of the photo, the token that lights up, and its chance."""
    model = detector.model

    def told(**inputs):
        ids = inputs["input_ids"][0].tolist()
        logits = torch.full((1, 12, 256), -9.0)
        boxes = torch.full((1, 12, 4), 0.5)
        for query, (box, token, chance) in enumerate(said):
            place = detector.tokens.convert_tokens_to_ids(token)
            if place in ids:
                x0, y0, x1, y1 = box
                boxes[0, query] = torch.tensor(
                    [(x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0]
                )
                logits[0, query, ids.index(place)] = torch.logit(torch.tensor(chance))
        assert inputs["pixel_values"].shape[1] == 3
        return SimpleNamespace(logits=logits, pred_boxes=boxes)

    told.config = model.config
    detector.model = told


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_masks_land_where_the_boxes_are(size, tiny):
    run = registry.make("segment", GROUNDED, tiny.setup("segment", GROUNDED))
    ball, wall, domino = (
        (0.1, 0.5, 0.4, 0.8),
        (0.0, 0.1, 1.0, 0.45),
        (0.6, 0.5, 0.7, 0.95),
    )
    light(
        run._dino,
        [
            (domino, "domino", 0.9),
            (ball, "ball", 0.75),
            (wall, "wall", 0.6),
            (ball, "cup", 0.3),
            (ball, "red", 0.5),
        ],
    )
    cutter = run._sam
    Answering(cutter)
    found = run(photo(*size), KINDS)
    assert {i: one.label for i, one in found.names.items()} == {
        1: "Red Ball",
        2: "domino",
    }
    assert found.confidence == pytest.approx([0.75 * 2 / 3, 0.9 * 2 / 3])
    assert agree(found.labels == 1, rectangle(size, *ball)) > 0.94
    assert (
        agree(found.labels == 2, rectangle(size, *domino)) > 0.9
    )  # few pixels wide where the photo is small
    assert found.scenery.nouns == {1: "wall"}
    assert agree(found.scenery.labels == 1, rectangle(size, *wall)) > 0.94
    assert run.note()["asked"] == len(KINDS)
    # and those of a person
    height, width = size
    box = (0.2 * width, 0.3 * height, 0.4 * width, 0.5 * height)
    point = (0.8 * width, 0.2 * height)
    # in a small photo the answer has too few pixels for an object
    points = [point] if min(size) > 100 else []
    told = from_prompts(photo(*size), [box], points, only(run))
    assert agree(told.labels == 1, rectangle(size, 0.2, 0.3, 0.6, 0.8)) > 0.93
    assert told.confidence[1] == pytest.approx(2 / 3)
    if points:
        y, x = np.argwhere(told.labels == 2).mean(0)
        assert (x, y) == pytest.approx(point, abs=0.03 * max(size))
    run.close()


def test_long_lists_are_asked_for_in_several_texts(tiny):
    dino = GroundingDino(tiny.setup("segment", GROUNDED).weights.split(",")[0], "cpu")
    nouns = [f"toy {a}{b}" for a in "bcdfg" for b in "klmnp"] + [
        "Ball.",
        "ball",
        "?!",
        "b " * 100,
    ]
    texts = dino.texts(nouns)
    assert len(texts) > 1
    assert sorted(k for text in texts for k in text) == list(
        range(26)
    )  # once each; nothing, and too much, left out
    light(dino, [((0.2, 0.2, 0.4, 0.4), "ball", 0.8)])
    found = dino(photo(40, 60), nouns)
    assert [(one.noun, one.box) for one in found] == [
        (25, pytest.approx((12, 8, 24, 16), abs=1e-4))
    ]
    ids = dino.tokens("red ball. cup.", return_tensors="pt").input_ids[0].tolist()
    assert ids[0] == 101
    assert ids[-1] == 102
    assert ids.count(dino.dot) == 2


def test_many_prompts_are_those_of_one_at_a_time(tiny):
    cutter = Sam(
        tiny.setup("segment", GROUNDED).weights.split(",")[1], "cpu", torch.float32
    )
    cutter.encode(photo(90, 120))
    boxes = [(k, 5.0, k + 30.0, 60.0) for k in range(0, 80, 4)]
    together = list(cutter.boxes(boxes))
    alone = [next(cutter.boxes([box])) for box in boxes]
    assert len(together) == 20
    for (mask, fit), (other, same) in zip(together, alone, strict=True):
        assert mask.shape == (90, 120)
        assert mask.dtype == np.bool_
        assert 0 <= fit <= 1
        assert fit == pytest.approx(same, abs=1e-4)
        assert np.mean(mask != other) < 0.01
    assert list(cutter.boxes([])) == []


def test_sam_sees_what_its_own_processor_makes_of_a_photo(tiny):
    from transformers.models.sam.image_processing_pil_sam import SamImageProcessorPil

    rgb = photo(90, 120)
    theirs = SamImageProcessorPil(
        size={"longest_edge": 64}, pad_size={"height": 64, "width": 64}
    )
    ready = theirs(images=rgb, return_tensors="pt")
    cutter = Sam(
        tiny.setup("segment", GROUNDED).weights.split(",")[1], "cpu", torch.float32
    )
    cutter.encode(rgb)
    assert cutter._inner == tuple(ready["reshaped_input_sizes"][0].tolist()) == (48, 64)
    assert torch.allclose(
        pixels(rgb, (48, 64)), ready["pixel_values"][..., :48, :], atol=0.02
    )
    assert ready["pixel_values"][..., 48:, :].abs().max() == 0
    logits = torch.randn(1, 1, 3, 16, 16)
    masks = theirs.post_process_masks(
        logits, ready["original_sizes"], ready["reshaped_input_sizes"]
    )[0][0]
    assert np.array_equal(cutter._restored(logits[0, 0, 1]), masks[1].numpy())


def only(backend) -> Segmenter:
    """The segmenter of this backend."""
    crew = Backends()
    crew._made["segment"] = backend
    return Segmenter(crew)


def test_what_a_model_does_not_know_is_found_without_it():
    rgb = np.full((90, 120, 3), 200, np.uint8)
    rgb[30:60, 40:80] = (200, 30, 30)
    mask = np.zeros((90, 120), bool)

    class Blind:
        def __call__(self, rgb):
            return Segments(np.zeros(rgb.shape[:2], np.uint16), np.zeros(0))

        def meant(self, rgb, boxes, points):
            return [PromptedMask(mask, 0.9) for _ in (*boxes, *points)]

    found = from_prompts(rgb, [(38, 28, 44, 34)], [], only(Blind()))
    assert np.count_nonzero(found.labels[30:60, 40:80]) > 0.8 * 1200
