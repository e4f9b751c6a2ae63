"""The paper's sentences that state a result, and the criteria by which ours agree or differ.

Each is a short paraphrase with its place and a function that reads the data and returns a finding.
Criteria are fixed here; the paper's own numbers are the only ones that are written down. One rule
holds for all (`studies.paper.verdicts`): where an error bar spans the criterion's limit, the
statement is undecided.
"""

from __future__ import annotations

import itertools

from studies.paper.statements.method import METHOD, ORDER, PRINCIPLE
from studies.paper.statements.passive import FIG8, PASSIVE
from studies.paper.statements.statement import Statement
from studies.paper.statements.swimmers import FIG4, FIG5, FIG6, FIG7
from studies.paper.verdicts import NOT_MEASURED, Data, Finding, MissingError

__all__ = ["STATEMENTS", "Statement", "find_all"]

#: In the order of the paper.
STATEMENTS: tuple[Statement, ...] = tuple(
    itertools.chain(ORDER, METHOD, FIG4, FIG5, FIG6, FIG7, PASSIVE, FIG8, PRINCIPLE)
)
assert len({statement.key for statement in STATEMENTS}) == len(STATEMENTS)


def find_all(data: Data) -> list[tuple[Statement, Finding]]:
    """Return every statement with what the data say of it; missing data are said to be missing."""
    found = []
    for statement in STATEMENTS:
        try:
            finding = statement.judge(data)
        except MissingError as error:
            finding = Finding(str(error), NOT_MEASURED)
        found.append((statement, finding))
    return found
