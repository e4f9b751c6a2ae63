"""The paper's sentences that state a result, and the criteria by which ours agree or differ.

``statements.yaml`` has the sentences, in short paraphrases, and the criteria; a judge for each
reads the data and returns a finding. The paper's own numbers are the only ones that are written
down. One rule holds for all (`studies.paper.verdicts`): where an error bar spans the limit of the
criterion, the statement is undecided.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from studies.paper.statements import limits, method, passive, swimmers
from studies.paper.verdicts import NOT_MEASURED, Data, Finding, MissingError


@dataclass(frozen=True)
class Statement:
    """A sentence of the paper that states a result."""

    #: Short name.
    key: str
    #: Section, and paragraph or figure.
    where: str
    #: The paragraph of the page's end that counts it: orders, paths, times, onset or method.
    group: str
    #: What it says, in few words.
    says: str
    #: When the two agree.
    criterion: str
    #: The reason for what is found, where it needs no figures.
    why: str


def _read() -> tuple[Statement, ...]:
    text = Path(__file__).with_name("statements.yaml").read_text(encoding="utf-8")
    found = []
    for where, some in yaml.safe_load(text).items():
        for key, one in some.items():
            says, criterion, why = (
                one.get(name, "").format(**vars(limits)) for name in ("says", "agrees if", "why")
            )
            found.append(Statement(key, where, one["group"], says, criterion, why))
    return tuple(found)


#: In the order of the paper.
STATEMENTS = _read()
_JUDGES = method.JUDGES | swimmers.JUDGES | passive.JUDGES
assert {one.key for one in STATEMENTS} == set(_JUDGES), "every statement needs a judge"


def find_all(data: Data) -> list[tuple[Statement, Finding]]:
    """Return every statement with what the data say of it; missing data are said to be missing."""
    found = []
    for statement in STATEMENTS:
        try:
            finding = _JUDGES[statement.key](data)
            finding = replace(finding, why=finding.why or statement.why)
        except MissingError as error:
            finding = Finding(str(error), NOT_MEASURED)
        found.append((statement, finding))
    return found
