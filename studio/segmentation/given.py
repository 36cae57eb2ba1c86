"""The published weights of PicoDet-S, from which the training of our detector starts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
import torch
from coco_classes import MOVABLE_INDICES
from detector import Detector
from numpy.typing import NDArray
from onnx import numpy_helper
from torch import nn


def given_convolutions(detector: Detector) -> Iterator[nn.Conv2d]:
    """Yield the convolutions that PicoDet has, in the order of its file."""
    for module in (detector.backbone, detector.neck):
        for layer in module.modules():
            if isinstance(layer, nn.Conv2d):
                yield layer
    for head in detector.heads:
        for module in (head.first, head.second, head.out):
            for layer in module.modules():
                if isinstance(layer, nn.Conv2d):
                    yield layer


def load_given(detector: Detector, path: Path) -> None:
    """Load the weights of a PicoDet-S file (ONNX, batch norms folded)."""
    graph = onnx.load(str(path)).graph
    arrays: dict[str, NDArray[np.float32]] = {}
    for initializer in graph.initializer:
        arrays[initializer.name] = numpy_helper.to_array(initializer)
    for node in graph.node:
        if node.op_type == "Constant":
            arrays[node.output[0]] = numpy_helper.to_array(node.attribute[0].t)
    nodes = [node for node in graph.node if node.op_type == "Conv"]
    with torch.no_grad():
        for layer, node in zip(given_convolutions(detector), nodes, strict=True):
            weight = torch.tensor(arrays[node.input[1]])
            if weight.shape != layer.weight.shape:
                raise ValueError(
                    f"{path}: {node.name} has {tuple(weight.shape)} weights,"
                    f" not {tuple(layer.weight.shape)}"
                )
            layer.weight.copy_(weight)
            bias = arrays[node.input[2]]
            layer.bias.copy_(torch.tensor(bias.reshape(-1)))
        for head in detector.heads:
            head.start_wholes(MOVABLE_INDICES)
