"""Mitsuba, found and set up once: every other studio module takes `mi`, `dr` and `T` from here.

Mitsuba's fast processor variant needs an LLVM library, which must be named before Dr.Jit is loaded.
"""

import ctypes.util
import glob
import os
import re

OLDEST_LLVM = 17  # LLVM 14 to 16 abort inside Dr.Jit 1.x; 19 is what these scenes were rendered with
LLVM_PLACES = (
    "/usr/lib/*/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib*/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
    "/opt/homebrew/opt/llvm*/lib/libLLVM*.dylib",
    "/usr/local/opt/llvm*/lib/libLLVM*.dylib",
)


def find_llvm() -> str:
    """The newest LLVM shared library in the standard folders. Raises SystemExit that names the package to install."""
    found = [path for place in LLVM_PLACES for path in glob.glob(place)]
    found += filter(
        None, (ctypes.util.find_library(f"LLVM-{n}") for n in range(OLDEST_LLVM, 30))
    )

    def version(path: str) -> int:
        match = re.search(r"(?:LLVM-|LLVM\.so\.|llvm-|llvm@)(\d+)", path)
        return int(match.group(1)) if match else 0

    newest = max(found, key=version, default="")
    if version(newest) < OLDEST_LLVM:
        seen = ", ".join(sorted(found)) or "none"
        raise SystemExit(
            f"LLVM: found {seen}; Mitsuba's llvm_ad_rgb needs version {OLDEST_LLVM} or newer; "
            "install it (Debian: apt install libllvm19) or set DRJIT_LIBLLVM_PATH"
        )
    return newest


os.environ.setdefault(
    "DRJIT_LIBLLVM_PATH", find_llvm() if "DRJIT_LIBLLVM_PATH" not in os.environ else ""
)
import drjit as dr  # noqa: E402  (Dr.Jit reads the variable when it is loaded)
import mitsuba as mi  # noqa: E402

mi.set_variant("llvm_ad_rgb")
T = mi.ScalarTransform4f

__all__ = ["T", "dr", "mi"]
