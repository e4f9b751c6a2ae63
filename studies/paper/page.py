"""The page: the words of ``page.md`` filled with verdicts, tables and figures from the data."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from string import Formatter
from typing import Any

from studies.paper.sections import ends, maps, onset, scenes, variants
from studies.paper.statements import find_all
from studies.paper.verdicts import Data

#: By section, the text between its comment and the next.
_SECTIONS = dict(
    re.findall(
        r"<!-- (\w+) -->\n\n(.*?)\n(?=\n<!--|\Z)",
        Path(__file__).with_name("page.md").read_text(encoding="utf-8"),
        re.DOTALL,
    )
)


def make_page(
    data: Data, pictures: Mapping[str, str], command: str, written: str | None = None
) -> str:
    """Return the page as Markdown.

    A number of ours that is not in the data, those of `studies.paper.suite.collect`, is not on it.

    Parameters
    ----------
    pictures : mapping
        Paths of the pictures that were drawn, relative to the page, by name.
    command, written : str
        What made it, and the commit of that code, which may be newer than that of the figures.
    """
    findings = find_all(data)
    fields = {
        "opening": ends.opening(data, findings, command, written),
        "runs": scenes.runs(data),
        "onset": onset.onset(data),
        "variants": variants.variants(data),
        "constants": scenes.constants(data),
        "forces": scenes.forces(data),
        "maps": maps.maps(data, lambda found: filled(_SECTIONS["map"], found, {})),
        "discussion": ends.discussion(data, findings, written),
    }
    parts = [
        filled(_SECTIONS[name], known, pictures)
        for name, known in fields.items()
        if known is not None
    ]
    return "\n\n".join(parts) + "\n"


def filled(text: str, fields: Mapping[str, Any], pictures: Mapping[str, str]) -> str:
    """Return a text with its fields filled in.

    What is in [[double brackets]], and a whole paragraph, is left out where one of its fields is
    missing or None. A paragraph ``!NAME CAPTION`` is a picture, left out where it was not drawn.
    """

    def is_known(part: str) -> bool:
        names = {name for _, name, *_ in Formatter().parse(part) if name}
        return all(fields.get(name) is not None for name in names)

    paragraphs = []
    for paragraph in text.split("\n\n"):
        # Every other piece is optional.
        pieces = re.split(r"\[\[(.*?)\]\]", paragraph)
        if not is_known("".join(pieces[::2])):
            continue
        found = "".join(one for i, one in enumerate(pieces) if i % 2 == 0 or is_known(one))
        found = found.format_map(fields)
        if found.startswith("!"):
            name, _, caption = found[1:].partition(" ")
            if name not in pictures:
                continue
            found = f"![{caption}]({pictures[name]})\n\n*{caption}*"
        paragraphs.append(found)
    return "\n\n".join(paragraphs)
