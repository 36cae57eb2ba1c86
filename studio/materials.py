"""Surfaces as Mitsuba BSDFs: a colour (linear, (3,)) or a texture ((H, W, 3) linear) in, a dictionary out.

Everything that can be seen from behind is wrapped in `twosided` by `both`.
"""

import numpy as np
from optics import T, mi


def texture(
    rgb: np.ndarray, repeat: tuple[float, float] = (1, 1), turn: float = 0.0
) -> dict:
    """A reflectance texture from (H, W, 3) linear light; row 0 lies at v = 0 (flip prints). It repeats beyond 0..1."""
    bitmap = mi.Bitmap(np.ascontiguousarray(rgb[..., :3], dtype=np.float32))
    to_uv = T().rotate([0, 0, 1], turn).scale([repeat[0], repeat[1], 1])
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "to_uv": to_uv}


def paint(colour: object) -> dict:
    """A colour or texture as a slot of a BSDF."""
    if isinstance(colour, dict):
        return colour
    value = np.asarray(colour, float)
    return (
        texture(value) if value.ndim == 3 else {"type": "rgb", "value": value.tolist()}
    )


def matt(colour: object) -> dict:
    """Cloth, cardboard, chalk, raw wood, plaster."""
    return {"type": "diffuse", "reflectance": paint(colour)}


def satin(colour: object, rough: float = 0.25, ior: float = 1.45) -> dict:
    """Varnished wood, printed paper, eggshell paint: matt below a rough clear coat."""
    return {
        "type": "roughplastic",
        "alpha": rough,
        "int_ior": ior,
        "nonlinear": True,
        "diffuse_reflectance": paint(colour),
    }


def rubber(colour: object) -> dict:
    """A dull sheen."""
    return satin(colour, 0.38, 1.5)


def glossy(colour: object, ior: float = 1.52) -> dict:
    """Glazed ceramic, polished plastic, phenolic resin: a mirror-smooth clear coat."""
    return {
        "type": "plastic",
        "int_ior": ior,
        "nonlinear": True,
        "diffuse_reflectance": paint(colour),
    }


def metal(material: str = "Al", rough: float = 0.12, tint: object = None) -> dict:
    """Bare metal by its chemical name (Al, Cu, Au, Ag, Cr, W) or, with `tint`, of that colour (BRASS, STEEL)."""
    bsdf: dict = {"type": "roughconductor", "alpha": rough, "distribution": "ggx"}
    if tint is None:
        return bsdf | {"material": material}
    return bsdf | {"material": "none", "specular_reflectance": paint(tint)}


BRASS = (0.80, 0.58, 0.26)
STEEL = (0.60, 0.59, 0.57)


def glass(tint: object = (1.0, 1.0, 1.0), ior: float = 1.5) -> dict:
    """Clear or tinted glass; close the mesh."""
    return {"type": "dielectric", "int_ior": ior, "specular_transmittance": paint(tint)}


def both(bsdf: dict) -> dict:
    """Seen from behind as from the front."""
    return {"type": "twosided", "bsdf": bsdf}


def bumpy(
    bsdf: dict, height: np.ndarray, depth: float, repeat: tuple[float, float] = (1, 1)
) -> dict:
    """Relief: (H, W) height in 0..1 as a bump map of strength `depth`."""
    bitmap = mi.Bitmap(np.ascontiguousarray(height[..., None], dtype=np.float32))
    relief = {
        "type": "bitmap",
        "bitmap": bitmap,
        "raw": True,
        "to_uv": T().scale([repeat[0], repeat[1], 1]),
    }
    return {"type": "bumpmap", "arbitrary": relief, "scale": depth, "bsdf": bsdf}
