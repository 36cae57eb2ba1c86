"""Which things there are, in which family, how often. Kinds of one family only never appear in the other."""

from __future__ import annotations

import os
from collections.abc import Callable

from studio.segmentation.homes import goods, living, scans, tableware, toys
from studio.segmentation.homes.parts import Thing
from studio.segmentation.homes.prints import Rng

Maker = Callable[[Rng, str], Thing]

BOTH: dict[str, Maker] = {
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
}
TRAIN_ONLY: dict[str, Maker] = {
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
HOMES_ONLY: dict[str, Maker] = {
    "wineglass": tableware.wineglass,
    "vase": tableware.vase,
    "teapot": tableware.teapot,
    "pan": tableware.pan,
    "brush": goods.brush,
    "phone": goods.phone,
    "remote": goods.remote,
    "key": goods.key,
    "scissors": goods.scissors,
    "clock": goods.clock,
    "lamp": goods.lamp,
    "pear": living.pear,
    "banana": living.banana,
    "bouquet": living.bouquet,
    "bear": toys.bear,
    "shoe": toys.shoe,
}


def makers(family: str) -> dict[str, Maker]:
    """Name -> maker of every kind of `family` ("train" or "homes"); scans where PHYSGEN_MATERIAL names them."""
    scanned = {"scan": scans.scan} if family == "train" and "PHYSGEN_MATERIAL" in os.environ else {}
    return BOTH | {"train": TRAIN_ONLY, "homes": HOMES_ONLY}[family] | scanned
