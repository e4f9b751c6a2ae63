"""Makes names of files, and text that can be shown, out of names that users gave."""

from __future__ import annotations

import hashlib
import re

#: Longest part of a name that is kept; file systems take 255 bytes.
_LONGEST = 150


def plain_name(name: str) -> str:
    """Return a name of letters, digits, underscores and hyphens only, empty if none is left."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_")


def file_name(name: str, content: str = "") -> str:
    """Return what a file is called after a name: one plain part of a path.

    Parameters
    ----------
    name : str
        Any text; kept as it is where it is plain.
    content : str
        What tells things of one name apart. With it, and where the name is not plain or too long,
        a digest of both is added, so that unlike things have unlike files.
    """
    plain = plain_name(name)[:_LONGEST]
    if plain and plain == name and not content:
        return plain
    both = f"{name}\0{content}".encode("utf-8", "surrogatepass")
    return f"{plain}-{hashlib.sha256(both).hexdigest()[:8]}".lstrip("-")


def shown_name(name: str) -> str:
    """Return a name with everything escaped that no file, picture or terminal can show."""
    return "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in name
    )
