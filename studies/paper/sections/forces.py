"""Forces, moments and strains along the beam."""

from __future__ import annotations

from collections.abc import Mapping

from studies.paper.constants import RESOLVED
from studies.paper.runs import NUMERALS
from studies.paper.sections.text import picture, run_with_bar, table
from studies.paper.verdicts import Data

__all__ = ["section"]


def section(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section, nothing where its figures are missing."""
    rows = []
    peaks = []
    for name in NUMERALS:
        found = data["runs"].get(name, {}).get("internal")
        if found is None:
            continue

        def largest(run: Data, key: str) -> float:
            return float(max(run["internal"][key]))

        half = data["runs"].get(f"{name}_half", {}).get("internal")
        if half is not None and found["peak_shear"] > 0.0:
            peaks.append(half["peak_shear"] / found["peak_shear"])
        rows.append(
            (
                name,
                *(
                    run_with_bar(data, name, lambda run, key=key: largest(run, key))
                    for key in ("shear", "axial", "elastic", "total")
                ),
                f"{1 + found['total'].index(max(found['total']))} of {len(found['total'])}",
                ", ".join(f"{found['above'][key]:.0%}" for key in ("shear", "axial", "total")),
                run_with_bar(data, name, lambda run: 1e3 * largest(run, "strain")),
            )
        )
    if not rows:
        return ""
    heads = (
        "scene",
        "force across (N)",
        "force along (N)",
        "spring's moment (N m)",
        "sum of moments (N m)",
        "at joint",
        f"variance above {RESOLVED:g} Hz: across, along, sum",
        "largest strain at the skin (1e-3)",
    )
    text = (
        "### Forces and moments along the beam\n\n"
        "The paper names stresses and strains, and the energy needed for locomotion, as what the "
        "model is for. Forces come from each element's momentum balance, the fluid's impulse on "
        "its own panels included, so they need no multipliers of the constraints; moments are "
        "those of torque and spring (all per metre of depth). The undamped beam rings, and steps "
        f"of 10 ms resolve motions up to {RESOLVED:g} Hz (2π f dt = 0.5). What is stated is the "
        "root mean square of each series below that frequency, at the joint where it is largest; "
        "the share of the variance above it is what these runs do not resolve. "
    )
    if peaks:
        text += (
            "Largest instantaneous forces are not stated: half the step makes them "
            f"{min(peaks):.1f} to {max(peaks):.1f} times as large. "
        )
    text += (
        "The strain is the half thickness times the largest curvature of the run, from the shapes "
        "and not filtered.\n\n"
    )
    return (
        text
        + table(heads, rows)
        + "\n"
        + picture(
            pictures,
            "internal",
            f"Moments and forces along the beam below {RESOLVED:g} Hz, scenes i and v: root mean "
            "squares of the run with error bars, and the sum of moments in the last second but "
            "one.",
        )
    )
