"""A model of transformers on this machine, through the real path: built small, saved, loaded, asked.

Its weights are random: this proves the plumbing (pictures and words go in, text comes out, nonsense is told), and says
nothing of what a trained model answers.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from physgen import registry
from physgen.cli.main import main
from physgen.geometry.polygon import Disc
from physgen.perceive.roles import PhotoObject
from physgen.problems import InputError
from physgen.registry import Setup

pytestmark = pytest.mark.slow

TEMPLATE = (
    "{% for m in messages %}{{ m['role'] }}: {% for c in m['content'] %}{% if c['type'] == 'image' %}<image>"
    "{% else %}{{ c['text'] }}{% endif %}{% endfor %}\n{% endfor %}"
    "{% if add_generation_prompt %}assistant: {% endif %}"
)


@pytest.fixture(scope="module")
def llava(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """LLaVA of two layers, whose words are bytes."""
    import torch
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers
    from transformers import (
        CLIPVisionConfig,
        LlamaConfig,
        LlavaConfig,
        LlavaForConditionalGeneration,
        LlavaProcessor,
        PreTrainedTokenizerFast,
    )
    from transformers.models.clip.image_processing_pil_clip import CLIPImageProcessorPil

    special = ["<s>", "</s>", "<pad>", "<image>"]
    vocabulary = {word: k for k, word in enumerate([*sorted(pre_tokenizers.ByteLevel.alphabet()), *special])}
    words = Tokenizer(models.BPE(vocab=vocabulary, merges=[]))
    words.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    words.decoder = decoders.ByteLevel()
    tokenizer = PreTrainedTokenizerFast(
        tokenizer_object=words, bos_token="<s>", eos_token="</s>", pad_token="<pad>",
        additional_special_tokens=["<image>"],
    )  # fmt: skip
    pictures = CLIPImageProcessorPil(size={"shortest_edge": 28}, crop_size={"height": 28, "width": 28})
    small = {
        "initializer_range": 0.5,
        "hidden_size": 32,
        "intermediate_size": 32,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
    }
    image = vocabulary["<image>"]
    config = LlavaConfig(
        vision_config=CLIPVisionConfig(**small, image_size=28, patch_size=14),
        text_config=LlamaConfig(**small, vocab_size=len(vocabulary), max_position_embeddings=16384),
        image_token_index=image,
        image_token_id=image,
    )
    folder = tmp_path_factory.mktemp("llava")
    torch.set_num_threads(1)  # it is small, and cores are shared
    torch.manual_seed(0)
    LlavaForConditionalGeneration(config).save_pretrained(folder)
    LlavaProcessor(
        image_processor=pictures, tokenizer=tokenizer, patch_size=14, num_additional_image_tokens=1,
        vision_feature_select_strategy="default", chat_template=TEMPLATE,
    ).save_pretrained(folder)  # fmt: skip
    return folder


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("PHYSGEN_VLM_URL", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def setup(weights: Path | str, **options: object) -> Setup:
    return Setup(str(weights), "cpu", options={"max_tokens": 16, "attempts": 2} | options)


def scene() -> tuple[np.ndarray, np.ndarray, list[PhotoObject]]:
    labels = np.zeros((48, 64), np.uint16)
    labels[np.hypot(*(np.mgrid[:48, :64] - np.array([24, 30])[:, None, None])) <= 10] = 1
    rgb = np.where(labels[..., None] == 1, (200, 40, 30), (90, 120, 90)).astype(np.uint8)
    return rgb, labels, [PhotoObject(1, Disc(np.array([30.0, 24.0]), 10.0), "ball")]


def test_random_weights_answer_nonsense_and_that_is_told(llava: Path):
    rgb, labels, things = scene()
    for role, arguments in (
        ("categories", (rgb,)), ("label", (rgb, labels, things)), ("physics", (rgb, things, None)),
    ):  # fmt: skip
        run = registry.make(role, "vlm", setup(llava))
        with pytest.raises(InputError) as error:
            run(*arguments)
        assert f"transformers (model {llava}), asked for {role} of" in str(error.value)
        assert "answered nonsense 2 times: it had no JSON in it" in str(error.value)
        assert "cut off for its length; choose a model that sees pictures" in str(error.value)
        note = run.note()
        assert (note["requests"], note["asked_again"], note["tokens_out"]) == (2, 1, 32)
        assert note["tokens_in"] > 500
        run.close()


def test_an_answer_of_a_local_model_is_used_and_kept(llava: Path, monkeypatch: pytest.MonkeyPatch):
    """Only the last step, tokens to text, is replaced by what a trained model would have said."""
    import vlm_stub
    from transformers import LlavaProcessor

    good = "<think>a {red} ball</think>" + json.dumps(vlm_stub.BALL)
    monkeypatch.setattr(LlavaProcessor, "decode", lambda *_, **__: good)
    rgb, _, things = scene()
    run = registry.make("physics", "vlm", setup(llava))
    matter = run(rgb, things, None)
    assert matter[1].mass == 72
    run.close()
    monkeypatch.setattr(LlavaProcessor, "from_pretrained", None)  # a second run loads nothing
    again = registry.make("physics", "vlm", setup(llava))
    assert again(rgb, things, None) == matter
    assert again.note()["cached"] == 1
    (llava / "config.json").touch()  # other weights in the same folder
    changed = registry.make("physics", "vlm", setup(llava))
    with pytest.raises(InputError):
        changed(rgb, things, None)
    changed.close()


def test_the_same_seed_says_the_same_and_pictures_are_seen(llava: Path):
    from transformers import LlavaForConditionalGeneration

    from physgen.perceive.backends import vlm_local
    from physgen.perceive.backends.vlm_client import read_settings
    from physgen.perceive.backends.vlm_prompts import categories_query

    rgb, _, _ = scene()
    told = setup(llava, samples=2)
    model = vlm_local.load(read_settings("categories", told), told)
    query = categories_query(rgb)
    words = [model.complete(query, [], seed).text for seed in (0, 0, 1)]
    assert words[0] == words[1] != words[2]
    held, given = vlm_local._LOADED[model._key], []

    def generate(**talk):
        given.append(talk["pixel_values"])
        return LlavaForConditionalGeneration.generate(held.model, **talk)

    held.model.generate = generate
    for photo in (rgb, 255 - rgb):
        model.complete(categories_query(photo), [], 0)
    assert given[0].shape == given[1].shape == (1, 3, 28, 28)
    assert (given[0] - given[1]).abs().max() > 1
    model.close()


def test_one_model_serves_all_roles(llava: Path):
    from physgen.perceive.backends import vlm_local

    rgb, labels, things = scene()
    label, physics = (registry.make(role, "vlm", setup(llava)) for role in ("label", "physics"))
    for run, arguments in ((label, (rgb, labels, things)), (physics, (rgb, things, None))):
        with pytest.raises(InputError):
            run(*arguments)
        assert len(vlm_local._LOADED) == 1
    label.close()
    label.close()
    assert len(vlm_local._LOADED) == 1
    physics.close()
    assert not vlm_local._LOADED


def test_a_model_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    from misbehaviours import photo

    image, masks = photo(tmp_path)
    words = ["perceive", str(image), "--masks", str(masks), "--backend", f"physics=vlm:{tmp_path}/no-such"]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert "no-such" in told
    assert "is not there: the weights of a vision-language model" in told
    assert "Traceback" not in told
