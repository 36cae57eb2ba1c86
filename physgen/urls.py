"""Texts that name scenes and folders -> whether they are URLs, and what those are called; nothing is opened."""

from __future__ import annotations

import re

from physgen.problems import InputError

_URL = re.compile(r"(?P<protocol>[a-zA-Z][a-zA-Z0-9+.-]+)://")
LOCAL = ("file", "local")
PRIVATE = ("memory",)
"""Protocols of places that only one process sees."""


def protocol(text: str) -> str:
    """In small letters; empty for a path.

    >>> protocol("S3://films/pool"), protocol("c://pool"), protocol("out")
    ('s3', '', '')
    """
    match = _URL.match(text)
    return match["protocol"].lower() if match else ""


def is_url(text: str) -> bool:
    """Whether it names a place by a protocol."""
    return bool(protocol(text))


def is_private(text: str) -> bool:
    """Whether it is a place that no other process can see."""
    return protocol(text) in PRIVATE


def plain(text: str) -> str:
    """The path that a `file://` URL means; any other text as it is. Raises InputError for another machine's.

    >>> plain("file:///tmp/a%20b"), plain("s3://films"), plain("out")
    ('/tmp/a b', 's3://films', 'out')
    """
    if protocol(text) not in LOCAL:
        return text
    from urllib.parse import unquote, urlsplit

    parts = urlsplit(text)
    if parts.netloc not in ("", "localhost"):
        fix = f"for a path on this machine, write {parts.scheme}:///{parts.netloc}{parts.path}"
        raise InputError.of(text, "", "names a file of another machine", fix)
    return unquote(parts.path)


def url_below(url: str, name: str) -> str:
    """The URL of what is called `name` in a folder.

    >>> url_below("s3://films/", "pool"), url_below("memory://", "pool")
    ('s3://films/pool', 'memory://pool')
    """
    return f"{url}{name}" if url.endswith("://") else f"{url.rstrip('/')}/{name}"
