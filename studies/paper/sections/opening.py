"""The page's beginning: what it is, the verdicts in short, and statement by statement."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from studies.paper.judges.criteria import SYMMETRY
from studies.paper.sections.text import commits, short_commit, table
from studies.paper.statements import Statement
from studies.paper.verdicts import AGREE, DIFFER, NOT_MEASURED, UNDECIDED, Data, Finding

__all__ = ["head", "short", "statements"]


def head(data: Data, command: str, written: str | None) -> str:
    """Return what the page is, where its numbers come from, and what a bar is."""
    missing = data["units"] - data["done"]
    note = f" **{missing} of them are missing.**" if missing else ""
    return (
        "# The paper, side by side\n\n"
        "S. Leyendecker & E. Kanso, *Locomotion of a submerged Cosserat beam*, DETC2009-87198: "
        "what it states, what this project measures, and whether the two agree.\n\n"
        f"Made by `{command}`: figures computed at commit {commits(data)} on "
        f"{', '.join(data['dates']) or 'no day'}, page written by commit "
        f"{short_commit(written) if written else 'unknown'}. There are {data['units']} units of "
        f"work, one data file each.{note} Numbers of ours are read from those files; those of the "
        "paper are marked as such.\n\n"
        "`±` is an error bar. Figures converge at first order in the time step and in the panels, "
        "so at the paper's settings they are off by about twice the change that half the step "
        "makes, plus one and a half times the change that three times as many panels make, those "
        "of the ends included. The number of elements is the paper's and not in the bar. A number "
        "without a bar is exact, or an error itself, or a count.\n"
    )


def short(data: Data, findings: Sequence[tuple[Statement, Finding]]) -> str:
    """Return the counts of the verdicts and what differs."""
    counts = Counter(finding.verdict for _, finding in findings)
    shown = ", ".join(
        f"{counts[verdict]} {verdict}"
        for verdict in (AGREE, DIFFER, UNDECIDED, NOT_MEASURED)
        if counts[verdict]
    )
    differ = [statement.says for statement, finding in findings if finding.verdict == DIFFER]
    text = f"## In short\n\n{len(findings)} statements: {shown}.\n"
    if differ:
        text += "\nWhat differs:\n\n" + "".join(f"* {says}\n" for says in differ)
    return text


def statements(findings: Sequence[tuple[Statement, Finding]]) -> str:
    """Return the table of all statements with what was found."""
    rows = [
        (
            f"{statement.where}: {statement.says}",
            finding.measured,
            f"**{finding.verdict}**" if finding.verdict != AGREE else finding.verdict,
            statement.criterion,
            finding.why,
        )
        for statement, finding in findings
    ]
    heads = ("the paper (in other words)", "ours", "verdict", "agrees if", "why")
    return (
        "## Statement by statement\n\nBL is a body length. Left and right of a turn or a curve are "
        "the swimmer's own, as seen by one who swims along; swimming *to the left*, towards -x, is "
        "the left of the figures, and head first. A turn is the change of the mean element angle "
        "from its mean over the first second to that over the last; it is positive to the left.\n\n"
        "One rule gives all verdicts: a figure **agrees** where its whole error bar meets the "
        "criterion, **differs** where none of it does, and is **undecided** where the bar spans "
        "the limit.\n\n" + table(heads, rows) + f"\nMirror symmetry: {SYMMETRY}\n"
    )
