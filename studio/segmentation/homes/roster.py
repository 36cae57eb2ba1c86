"""Which kinds of things there are."""

from __future__ import annotations

import os
from collections.abc import Callable

from studio.segmentation.homes import goods, living, scans, tableware, toys
from studio.segmentation.homes.parts import Thing
from studio.segmentation.homes.prints import Rng

Maker = Callable[[Rng], Thing]

KINDS: dict[str, Maker] = {
    "mug": tableware.mug,
    "plate": tableware.plate,
    "bowl": tableware.bowl,
    "tumbler": tableware.tumbler,
    "bottle": tableware.bottle,
    "jar": tableware.jar,
    "can": tableware.can,
    "cutlery": tableware.cutlery,
    "book": goods.book,
    "carton": goods.carton,
    "candle": goods.candle,
    "pencil": goods.pencil,
    "apple": living.apple,
    "citrus": living.orange,
    "plant": living.plant,
    "ball": toys.ball,
    "car": toys.car,
    "block": goods.block,
    "totem": tableware.totem,
    "driver": goods.driver,
    "hammer": goods.hammer,
    "dice": goods.dice,
    "gadget": goods.gadget,
    "mushroom": living.mushroom,
    "robot": toys.robot,
    "rings": toys.rings,
    "duck": toys.duck,
}


def makers() -> dict[str, Maker]:
    """Name -> maker of every kind; scans where PHYSGEN_MATERIAL names them."""
    return KINDS | ({"scan": scans.scan} if "PHYSGEN_MATERIAL" in os.environ else {})
