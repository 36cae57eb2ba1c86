"""Cryptomatte: ids of objects and their shares of each pixel, in an OpenEXR file.

Friedman and Jones, "Fully automatic ID mattes with support for motion blur and
transparency", SIGGRAPH 2015; version 1.2.0 of the specification.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from physgen.maps import F32

NAME = "physgen"
"""Name of the layer: its channels are `physgen00.R` ..."""
RANKS = 6
"""Maximum number of objects in a pixel, the largest share first. Two share a layer of
four channels.
"""
CHANNELS = (("R", "G"), ("B", "A"))
"""Channels of an id and its share."""
KEY_LENGTH = len("cryptomatte/") + 7
"""Length of a key with seven digits of the hash of the layer's name."""
WORD = 0xFFFFFFFF
FACTORS = 0xCC9E2D51, 0x1B873593
"""Multipliers of MurmurHash3."""
MIXERS = 0x85EBCA6B, 0xC2B2AE35


def murmur_hash(name: str) -> int:
    """Return MurmurHash3 of 32 bits, seed 0, of a name in UTF-8."""
    data = name.encode()
    hash_ = 0
    blocks = len(data) // 4 * 4
    # The body mixes whole words; the tail and the length follow.
    for start in range(0, blocks, 4):
        hash_ ^= _mix(int.from_bytes(data[start : start + 4], "little"))
        hash_ = (_rotate(hash_, 13) * 5 + 0xE6546B64) & WORD
    hash_ ^= _mix(int.from_bytes(data[blocks:], "little"))
    hash_ ^= len(data)
    # The final mix makes every bit depend on all bits of the name.
    for shift, factor in ((16, MIXERS[0]), (13, MIXERS[1])):
        hash_ = ((hash_ ^ (hash_ >> shift)) * factor) & WORD
    return hash_ ^ (hash_ >> 16)


def _mix(block: int) -> int:
    product = block * FACTORS[0] & WORD
    return (_rotate(product, 15) * FACTORS[1]) & WORD


def _rotate(word: int, bits: int) -> int:
    return (word << bits | word >> (32 - bits)) & WORD


def object_id(name: str) -> int:
    """Return the hash of a name as the bits of an ordinary float, neither denormal nor
    infinite.
    """
    hash_ = murmur_hash(name)
    exponent = hash_ >> 23 & 255
    # Denormal and infinite floats do not survive all programs; the specification flips
    # this bit.
    if exponent in (0, 255):
        return hash_ ^ 1 << 23
    return hash_


def write_cryptomatte(
    path: Path, shares: Mapping[str, F32], names: Sequence[str]
) -> None:
    """Write the shares (h, w) of objects by name; `names` are all names of the clip."""
    import OpenEXR

    key = f"cryptomatte/{murmur_hash(NAME):08x}"[:KEY_LENGTH]
    manifest = {name: f"{object_id(name):08x}" for name in names}
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        f"{key}/name": NAME,
        f"{key}/hash": "MurmurHash3_32",
        f"{key}/conversion": "uint32_to_float32",
        f"{key}/manifest": json.dumps(manifest, ensure_ascii=False),
    }
    with OpenEXR.File(header, ranked_channels(shares)) as file:
        file.write(str(path))


def ranked_channels(shares: Mapping[str, F32]) -> dict[str, F32]:
    """Return channels (h, w) of the RANKS largest shares of each pixel, and of their
    ids.
    """
    if shares:
        size = next(iter(shares.values())).shape
    else:
        size = (1, 1)
    # Some empty ranks more than objects, so that each pixel always has all ranks.
    stack = np.zeros((RANKS + len(shares), *size), np.float32)
    ids = np.zeros(len(stack), np.uint32)
    for index, (name, share) in enumerate(shares.items()):
        stack[index], ids[index] = share, object_id(name)
    # A stable order: equal shares give equal files.
    ranks = np.argsort(-stack, axis=0, kind="stable")[:RANKS]
    coverage = np.take_along_axis(stack, ranks, axis=0)
    ranked_ids = np.where(coverage > 0, ids[ranks], np.uint32(0))
    # The standard stores the 32 bits of a hash as a float, without a conversion of its
    # value.
    values = ranked_ids.view(np.float32)
    channels = {}
    for rank in range(RANKS):
        first, second = CHANNELS[rank % len(CHANNELS)]
        layer = f"{NAME}{rank // len(CHANNELS):02d}"
        channels[f"{layer}.{first}"] = np.ascontiguousarray(values[rank])
        channels[f"{layer}.{second}"] = np.ascontiguousarray(coverage[rank])
    return channels
