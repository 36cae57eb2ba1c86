"""Find the browser that tests drive, and install Debian's Chromium if there is none.

    python tests/install_browser.py

Exit code 0: a browser is there, or the tests run without those that need it. With CI=true a missing browser ends with
exit code 1.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PACKAGES = ("chromium", "fonts-dejavu-core")
"""Debian's. The golden pictures of pages are drawn with these fonts."""
VARIABLE = "PHYSGEN_CHROMIUM"
"""Environment variable with the path of a browser of the user's choice."""
ERROR_LINES = 3
"""Last lines of apt-get's messages that are repeated: its errors come last."""


class InstallError(Exception):
    """The browser could not be installed; the text is the reason."""


def find_browser() -> str | None:
    """Return the path of the browser, or None if there is none."""
    chosen_path = os.environ.get(VARIABLE)
    if chosen_path:
        return shutil.which(chosen_path)
    for name in NAMES:
        path = shutil.which(name)
        if path is not None:
            return path
    return None


def describe_installation() -> str:
    """Return what to do if there is no browser."""
    chosen_path = os.environ.get(VARIABLE)
    if chosen_path:
        return (
            f"{VARIABLE} is {chosen_path!r}, which is not a program; "
            "write the path of Chromium or Chrome"
        )
    return (
        f"run `apt-get install {' '.join(PACKAGES)}` as root, "
        f"or set {VARIABLE} to the path of Chromium or Chrome"
    )


def is_required() -> bool:
    """Return whether tests must not run without a browser."""
    return os.environ.get("CI", "").lower() in ("1", "true")


def install_browser() -> None:
    """Install Debian's Chromium. Raise InstallError if that is not possible."""
    if shutil.which("apt-get") is None:
        raise InstallError("this system has no apt-get")
    prefix = _root_prefix()
    environment = [*prefix, "env", "DEBIAN_FRONTEND=noninteractive"]
    _run([*environment, "apt-get", "update", "-qq"])
    options = ["-y", "-qq", "--no-install-recommends"]
    _run([*environment, "apt-get", "install", *options, *PACKAGES])


def _root_prefix() -> list[str]:
    """Return the words in front of a command that root must run."""
    if os.geteuid() == 0:
        return []
    if shutil.which("sudo") is None:
        raise InstallError("installing needs root, and this system has no sudo")
    answer = subprocess.run(
        ["sudo", "-n", "true"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
    )
    if answer.returncode != 0:
        raise InstallError("installing needs root, and sudo asks for a password")
    return ["sudo", "-n"]


def _run(command: Sequence[str]) -> None:
    # without an input of its own, apt-get would stop a background job at a question
    result = subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        check=False,
    )
    if result.returncode != 0:
        last_lines = result.stdout.strip().splitlines()[-ERROR_LINES:]
        raise InstallError("\n".join(["apt-get failed:", *last_lines]))


def main() -> int:
    """Print the path of the browser, or how to install one."""
    path = find_browser()
    if path is None and not os.environ.get(VARIABLE):
        print(
            f"no browser: installing {' and '.join(PACKAGES)} with apt-get", flush=True
        )
        try:
            install_browser()
        except InstallError as error:
            print(error, file=sys.stderr)
        path = find_browser()
    if path is not None:
        print(f"browser: {path}", flush=True)
        return 0
    print(f"no browser: {describe_installation()}", file=sys.stderr)
    if is_required():
        return 1
    print("the tests that need a browser will not run", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
