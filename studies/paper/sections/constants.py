"""What is kept, momentum and energy, and what swimming costs."""

from __future__ import annotations

from collections.abc import Mapping

from studies.paper.constants import RESOLVED
from studies.paper.measures import transport_cost
from studies.paper.runs import NUMERALS
from studies.paper.sections.text import picture, run_with_bar, table
from studies.paper.verdicts import Data

__all__ = ["section"]


def section(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section, nothing where its figures are missing."""
    rows = []
    for name in NUMERALS:
        run = data["runs"].get(name)
        if run is None:
            continue
        energy, momentum = run["energy"], run["momentum"]
        rows.append(
            (
                name,
                f"{momentum['drift']:.1e}",
                f"{momentum['bound']:.1e}",
                run_with_bar(data, name, lambda run: run["energy"]["largest"]),
                f"{energy['unexplained']:.1e}" + _at_half(data, name),
                f"{energy['first']:+.1e}, {energy['last']:+.1e}",
                *(
                    run_with_bar(data, name, lambda run, key=key: run["energy"][key])
                    for key in ("work", "positive_work")
                ),
                "" if energy["positive_work"] == 0.0 else run_with_bar(data, name, transport_cost),
            )
        )
    if not rows:
        return ""
    heads = (
        "scene",
        "momentum drift",
        "its bound",
        "largest energy (J)",
        "unexplained (at half the step)",
        "mean of first and last quarter",
        "net work (J)",
        "positive work (J)",
        f"positive work below {RESOLVED:g} Hz per way (J/m)",
    )
    text = (
        "## What is kept, and what it costs\n\n"
        "Momentum drift: max |J_n - J_0| in kg m/s and kg m²/s; its bound is 10 tolerances of "
        "Newton's method plus 1e-15 n times the size of its terms. Energy: H - H(0) - work, as a "
        "share of the largest H. These are errors and so have no bar; that of the energy at half "
        "the step stands beside it. Positive work counts every swing of the modes that ring "
        "undamped, which the steps do not resolve: its bar is often as large as itself. The "
        f"steps resolve only what the torques spend on motion below {RESOLVED:g} Hz: the last "
        "column, and the power in the table of scenes.\n\n" + table(heads, rows)
    )
    return (
        text
        + "\n"
        + picture(
            pictures,
            "constants",
            "Energy that the work does not explain, and the drift of momentum.",
        )
    )


def _at_half(data: Data, name: str) -> str:
    half = data["runs"].get(f"{name}_half")
    return "" if half is None or half["end"] else f" ({half['energy']['unexplained']:.1e})"
