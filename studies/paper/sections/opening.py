"""The page's beginning: what it is, the verdicts in short, and statement by statement."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from studies.paper.sections.text import blocks, commits, short_commit, table
from studies.paper.statements import Statement
from studies.paper.statements.statement import SYMMETRY
from studies.paper.verdicts import AGREE, DIFFER, NOT_MEASURED, UNDECIDED, Data, Finding

__all__ = ["Findings", "head", "short", "statements"]

#: Of `studies.paper.statements.find_all`.
Findings = Sequence[tuple[Statement, Finding]]


def head(data: Data, command: str, written: str | None) -> str:
    """Return what the page is, where its numbers come from, and what a bar is."""
    missing = data["units"] - data["done"]
    note = f" **{missing} of them are missing.**" if missing else ""
    return (
        "# The paper, side by side\n\n"
        "S. Leyendecker & E. Kanso, *Locomotion of a submerged Cosserat beam*, DETC2009-87198: "
        "what it states, what this project measures, and whether the two agree.\n\n"
        f"Made by `{command}`: figures computed at commit {commits(data)} on "
        f"{', '.join(data['dates']) or 'no day'}, page written by commit {short_commit(written)}. "
        f"There are {data['units']} units of work, one record each.{note} Numbers of ours are read "
        "from those records; those of the paper are marked as such.\n\n"
        "`±` is an error bar. Figures converge at first order in the time step and in the panels, "
        "so at the paper's settings they are off by about twice the change that half the step "
        "makes, plus one and a half times the change that three times as many panels make, those "
        "of the ends included. The number of elements is the paper's and not in the bar. A number "
        "without a bar is exact, or an error itself, or a count."
    )


def short(findings: Findings) -> str:
    """Return the counts of the verdicts and what differs."""
    counts = Counter(finding.verdict for _, finding in findings)
    order = (AGREE, DIFFER, UNDECIDED, NOT_MEASURED)
    shown = ", ".join(f"{counts[verdict]} {verdict}" for verdict in order if counts[verdict])
    differ = [f"* {statement.says}" for statement, found in findings if found.verdict == DIFFER]
    return blocks(
        "## In short",
        f"{len(findings)} statements: {shown}.",
        "What differs:" if differ else "",
        "\n".join(differ),
    )


def statements(findings: Findings) -> str:
    """Return the table of all statements with what was found."""
    return blocks(
        "## Statement by statement",
        "BL is a body length. Left and right of a turn or a curve are the swimmer's own, as seen "
        "by one who swims along; swimming *to the left*, towards -x, is the left of the figures, "
        "and head first. A turn is the change of the mean element angle from its mean over the "
        "first second to that over the last; it is positive to the left.",
        "One rule gives all verdicts: a figure **agrees** where its whole error bar meets the "
        "criterion, **differs** where none of it does, and is **undecided** where the bar spans "
        "the limit.",
        table(
            {
                "the paper (in other words)": lambda one: f"{one[0].where}: {one[0].says}",
                "ours": lambda one: one[1].measured,
                "verdict": lambda one: _shown(one[1].verdict),
                "agrees if": lambda one: one[0].criterion,
                "why": lambda one: one[1].why,
            },
            findings,
        ),
        f"Mirror symmetry: {SYMMETRY}",
    )


def _shown(verdict: str) -> str:
    return verdict if verdict == AGREE else f"**{verdict}**"
