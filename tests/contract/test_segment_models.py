"""Segmenters by models: coordinates, names and prompts, with tiny models of the real classes.

What random weights say means nothing, so where a place is checked the model's own output is replaced by a known one.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physgen import registry
from physgen.perceive.backends import segment_sam2
from physgen.perceive.backends.segment_grounded import GroundingDino, Sam, pixels
from physgen.perceive.backends.segment_sam2 import StretchedSam
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

    def __init__(self, cutter, fits=(0.5, 2 / 3, 0.1)):
        """The cutter works at the side of the real models from here on."""
        self.side = cutter.side = 1024
        self.fits = fits
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
            iou_scores=torch.tensor(self.fits).repeat(1, len(masks), 1),
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
    assert np.array_equal(cutter._restore_size(logits[0, 0, 1]), masks[1].numpy())


def found_objects(size) -> Segments:
    """A ball with a hole in its mask, and a block."""
    labels = np.zeros(size, np.uint16)
    labels[rectangle(size, 0.1, 0.5, 0.4, 0.8)] = 1
    labels[rectangle(size, 0.2, 0.6, 0.3, 0.7)] = 0
    labels[rectangle(size, 0.6, 0.2, 0.8, 0.9)] = 2
    return Segments(labels, np.array([0.9, 0.6]))


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_sam2_draws_found_objects_in_their_boxes(size, tiny, monkeypatch):
    found = found_objects(size)
    monkeypatch.setattr(segment_sam2, "learned", lambda: lambda rgb: found)
    run = registry.make("segment", "sam2", tiny.setup("segment", "sam2"))
    answers = Answering(run._model)
    drawn = run(photo(*size))
    assert drawn.confidence == pytest.approx([0.9, 0.6])
    assert agree(drawn.labels == 1, rectangle(size, 0.1, 0.5, 0.4, 0.8)) > 0.94
    assert agree(drawn.labels == 2, rectangle(size, 0.6, 0.2, 0.8, 0.9)) > 0.94
    corners = np.array(answers.prompts[0]) / answers.side
    assert corners == pytest.approx((0.1, 0.5, 0.4, 0.8), abs=0.02)
    # an unsure mask does not replace ours
    Answering(run._model, fits=(0.1, 0.4, 0.1))
    assert np.array_equal(run(photo(*size)).labels, found.labels)
    run.close()


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_sam2_draws_prompts_of_a_person(size, tiny):
    run = registry.make("segment", "sam2", tiny.setup("segment", "sam2"))
    Answering(run._model)
    height, width = size
    box = (0.2 * width, 0.3 * height, 0.4 * width, 0.5 * height)
    point = (0.8 * width, 0.2 * height)
    masks = [
        one.mask for one in run.segment_meant_objects(photo(*size), [box], [point])
    ]
    assert agree(masks[0], rectangle(size, 0.2, 0.3, 0.6, 0.8)) > 0.93
    y, x = np.argwhere(masks[1]).mean(0)
    assert (x, y) == pytest.approx(point, abs=0.03 * max(size))
    run.close()


def test_sam2_prompts_agree_with_its_own_forward_pass(tiny):
    """The features that are kept between prompts are those of a whole pass."""
    cutter = StretchedSam(str(tiny["segment", "sam2"]), "cpu", torch.float32)
    rgb = photo(48, 64)
    cutter.encode(rgb)
    ((mask, fit),) = cutter.boxes([(8.0, 6.0, 40.0, 30.0)])
    with torch.inference_mode():
        whole = cutter.model(
            pixel_values=pixels(rgb, (64, 64)),
            input_boxes=torch.tensor([[[8.0, 8.0, 40.0, 40.0]]]),
            multimask_output=True,
        )
    best = int(whole.iou_scores[0, 0].argmax())
    assert fit == pytest.approx(
        float(whole.iou_scores[0, 0, best].clamp(0, 1)), abs=1e-5
    )
    theirs = torch.nn.functional.interpolate(
        whole.pred_masks[0, :, best][None],
        (48, 64),
        mode="bilinear",
        align_corners=False,
    )
    assert np.array_equal(mask, (theirs[0, 0] > 0).numpy())


class AnsweringNouns:
    """In place of SAM 3: masks of nouns that it knows, and the nouns that it was asked for."""

    def __init__(self, tokens, model, masks):
        self.tokens, self.masks, self.asked = tokens, masks, []
        self.config = model.config
        self.get_vision_features = model.get_vision_features

    def __call__(self, vision_embeds, input_ids, attention_mask):
        text = self.tokens.decode(input_ids[0], skip_special_tokens=True)
        noun = text.replace(" ", "")
        self.asked.append(noun)
        logits, masks = torch.full((1, 10), -9.0), torch.full((1, 10, 72, 72), -9.0)
        for k, mask in enumerate(self.masks.get(noun, [])):
            logits[0, k] = 2.0 - k
            masks[0, k] = torch.from_numpy(np.where(mask, 9.0, -9.0))
        return SimpleNamespace(
            pred_logits=logits, presence_logits=torch.tensor([[3.0]]), pred_masks=masks
        )


@pytest.mark.parametrize("size", SIZES[:2], ids=str)
def test_sam3_answers_noun_by_noun(size, tiny):
    run = registry.make("segment", "sam3", tiny.setup("segment", "sam3"))
    tokens, model = run._model
    ball = rectangle((72, 72), 0.1, 0.5, 0.4, 0.8)
    cup = rectangle((72, 72), 0.6, 0.2, 0.8, 0.9)
    known = {"redball": [ball, ball], "cup": [cup], "wall": [~cup]}
    answers = AnsweringNouns(tokens, model, known)
    run._model = tokens, answers
    found = run(photo(*size), [*KINDS, Category("CUP", True)])
    assert sorted(answers.asked) == ["cup", "domino", "redball", "wall"]
    assert {i: one.label for i, one in found.names.items()} == {1: "Red Ball", 2: "cup"}
    sure = 1 / (1 + np.exp(-2.0)) / (1 + np.exp(-3.0))
    assert found.confidence == pytest.approx([sure, sure])
    assert agree(found.labels == 1, rectangle(size, 0.1, 0.5, 0.4, 0.8)) > 0.93
    assert agree(found.labels == 2, rectangle(size, 0.6, 0.2, 0.8, 0.9)) > 0.93
    assert found.scenery.nouns == {1: "wall"}
    assert not hasattr(run, "meant")  # prompts are another network
    run.close()


def test_sam3_answers_are_those_of_a_whole_pass(tiny):
    """Its processor, which needs torchvision, multiplies the same two probabilities."""
    run = registry.make("segment", "sam3", tiny.setup("segment", "sam3"))
    rgb, half = photo(56, 56), (0.5, 0.5, 0.5)
    found = run._instances(rgb, ["cup", "ball"])
    tokens, model = run._model
    text = tokens("ball", return_tensors="pt", padding="max_length", max_length=16)
    with torch.inference_mode():
        output = model(
            pixel_values=pixels(rgb, (56, 56), half, half),
            input_ids=text.input_ids,
            attention_mask=text.attention_mask,
        )
    presence, scores = output.presence_logits.sigmoid(), output.pred_logits.sigmoid()
    sure = torch.nonzero((scores * presence)[0] >= 0.1)[:, 0].tolist()
    balls = [one for one in found if one.noun == "ball"]
    assert len(balls) == len(sure) > 0
    for one, k in zip(balls, sure, strict=True):
        assert one.score == pytest.approx(
            float(scores[0, k] * presence[0, 0]), abs=1e-5
        )
        assert torch.allclose(one.logits, output.pred_masks[0, k], atol=1e-4)


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

        def segment_meant_objects(self, rgb, boxes, points):
            return [PromptedMask(mask, 0.9) for _ in (*boxes, *points)]

    found = from_prompts(rgb, [(38, 28, 44, 34)], [], only(Blind()))
    assert np.count_nonzero(found.labels[30:60, 40:80]) > 0.8 * 1200
