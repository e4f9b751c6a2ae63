"""The page: statements, figures and verdicts side by side, every number of ours from the data."""

from __future__ import annotations

from collections.abc import Mapping

from studies.paper.sections import (
    closing,
    constants,
    forces,
    maps,
    onset,
    opening,
    scenes,
    variants,
)
from studies.paper.statements import find_all
from studies.paper.verdicts import Data

__all__ = ["make_page"]


def make_page(
    data: Data, pictures: Mapping[str, str], command: str, written: str | None = None
) -> str:
    """Return the page as Markdown.

    Parameters
    ----------
    data : mapping
        Of `studies.paper.suite.collect`, and nothing else: a number of ours that is not in it is
        not on the page.
    pictures : mapping
        Paths of the pictures that were drawn, relative to the page, by name.
    command : str
        What made it.
    written : str, optional
        The commit of the code that writes the page, which may be newer than that of the figures.
    """
    findings = find_all(data)
    parts = [
        opening.head(data, command, written),
        opening.short(data, findings),
        opening.statements(findings),
        scenes.section(data, pictures),
        onset.section(data, pictures),
        variants.section(data, pictures),
        constants.section(data, pictures),
        forces.section(data, pictures),
        maps.section(data, pictures),
        closing.discussion(data, findings),
        closing.settings(data, written),
    ]
    return "\n".join(part for part in parts if part)
