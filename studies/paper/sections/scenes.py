"""The twelve scenes: runs and the paper's figures, what is kept, and forces along the beam."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from studies.paper.bars import PANELS, coarse_error, with_bar
from studies.paper.constants import RESOLVED
from studies.paper.measures import (
    Run,
    heading_turn,
    largest_bend,
    mean_power,
    transport_cost,
    turn_per_way,
    way_ahead,
)
from studies.paper.runs import NUMERALS
from studies.paper.sections.text import blocks, picture, run_with_bar, table
from studies.paper.verdicts import Data

__all__ = ["constants", "forces", "runs"]

#: From the name of a run to a cell.
Cell = Callable[[str], object]

#: Of Figs. 4 to 7.
_SAME_PHASE = (
    " All shapes are at the same phase of the drive, that of t = 0; they differ as the undamped "
    "body still rings from its start."
)
_CAPTIONS = {
    "fig3": "Fig. 3: the torque at every joint of scene i, from head (dark) to tail; l is the "
    "body's length.",
    "fig4": "Fig. 4: scenes i, ii, iii. Both directors stand at every element's centre."
    + _SAME_PHASE,
    "fig5": "Fig. 5: scenes iv and v." + _SAME_PHASE,
    "fig6": "Fig. 6: scenes vi and vii." + _SAME_PHASE,
    "fig7": "Fig. 7: scenes viii and ix." + _SAME_PHASE,
    "fig8": "Fig. 8: scenes x, xi and xii.",
}


def _barred(data: Data, pick: Callable[[Run], float | None], sign: str = "") -> Cell:
    return lambda name: run_with_bar(data, name, pick, sign)


def runs(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section on the runs, nothing where their figures are missing."""
    names = [name for name in NUMERALS if name in data["runs"]]
    if not names:
        return ""

    def frequencies(name: str) -> str:
        """Return the first two natural frequencies with the bar of the panels."""
        modes = data["modes"].get(name, {})
        pairs = list(zip(modes.get("frequencies", []), modes.get("fine", []), strict=False))[:2]
        return ", ".join(with_bar(f, coarse_error(fine - f, PANELS)) for f, fine in pairs)

    columns: dict[str, Cell] = {
        "scene": str,
        "head first (BL)": _barred(data, way_ahead, "+"),
        "to its right, +y (BL)": _barred(
            data, lambda run: run["displacement"][1] / run["length"], "+"
        ),
        "net speed (mm/s)": _barred(data, lambda run: 1e3 * run["speed"]),
        "turn (°), left +": _barred(data, heading_turn, "+"),
        "turn per way (°/m)": _barred(data, turn_per_way, "+"),
        "largest joint angle (rad)": _barred(data, largest_bend),
        "natural frequencies (Hz)": frequencies,
        f"mean positive power below {RESOLVED:g} Hz (W)": _barred(data, mean_power),
    }
    duration = max(data["runs"][name]["duration"] for name in names)
    return blocks(
        f"## The twelve scenes, {duration:g} s",
        "Displacements and turns are between the means of the first and of the last second. The "
        "body lies along +x and swims head first towards -x, to the left in the paper's "
        "figures. Natural frequencies are those of the straight body in its fluid, with the bar of "
        "the panels alone.",
        table(columns, names),
        *(picture(pictures, name, caption) for name, caption in _CAPTIONS.items()),
    )


def constants(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section on momentum and energy, nothing where their figures are missing."""
    names = [name for name in NUMERALS if name in data["runs"]]
    if not names:
        return ""

    def energy(key: str, form: str) -> Cell:
        return lambda name: f"{data['runs'][name]['energy'][key]:{form}}"

    def at_half(name: str) -> str:
        half = data["runs"].get(f"{name}_half")
        return "" if half is None or half["end"] else f" ({half['energy']['unexplained']:.1e})"

    def cost(name: str) -> str:
        spent = data["runs"][name]["energy"]["positive_work"]
        return run_with_bar(data, name, transport_cost) if spent != 0.0 else ""

    unexplained, first, last = (
        energy(*one) for one in (("unexplained", ".1e"), ("first", "+.1e"), ("last", "+.1e"))
    )
    columns: dict[str, Cell] = {
        "scene": str,
        "momentum drift": lambda name: f"{data['runs'][name]['momentum']['drift']:.1e}",
        "its bound": lambda name: f"{data['runs'][name]['momentum']['bound']:.1e}",
        "largest energy (J)": _barred(data, lambda run: run["energy"]["largest"]),
        "unexplained (at half the step)": lambda name: f"{unexplained(name)}{at_half(name)}",
        "mean of first and last quarter": lambda name: f"{first(name)}, {last(name)}",
        "net work (J)": _barred(data, lambda run: run["energy"]["work"]),
        "positive work (J)": _barred(data, lambda run: run["energy"]["positive_work"]),
        f"positive work below {RESOLVED:g} Hz per way (J/m)": cost,
    }
    return blocks(
        "## What is kept, and what it costs",
        "Momentum drift: max |J_n - J_0| in kg m/s and kg m²/s; its bound is 10 tolerances of "
        "Newton's method plus 1e-15 n times the size of its terms. Energy: H - H(0) - work, as a "
        "share of the largest H. These are errors and so have no bar; that of the energy at half "
        "the step stands beside it. Positive work counts every swing of the modes that ring "
        "undamped, which the steps do not resolve: its bar is often as large as itself. The "
        f"steps resolve only what the torques spend on motion below {RESOLVED:g} Hz: the last "
        "column, and the power in the table of scenes.",
        table(columns, names),
        picture(
            pictures,
            "constants",
            "Energy that the work does not explain, and the drift of momentum.",
        ),
    )


def forces(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section on forces and moments, nothing where their figures are missing."""
    found = {
        name: data["runs"][name]["internal"]
        for name in NUMERALS
        if "internal" in data["runs"].get(name, {})
    }
    if not found:
        return ""

    def largest(key: str, factor: float = 1.0) -> Cell:
        return _barred(data, lambda run: factor * max(run["internal"][key]))

    def joint(name: str) -> str:
        total = found[name]["total"]
        return f"{1 + total.index(max(total))} of {len(total)}"

    def above(name: str) -> str:
        return ", ".join(f"{found[name]['above'][key]:.0%}" for key in ("shear", "axial", "total"))

    columns: dict[str, Cell] = {
        "scene": str,
        "force across (N)": largest("shear"),
        "force along (N)": largest("axial"),
        "spring's moment (N m)": largest("elastic"),
        "sum of moments (N m)": largest("total"),
        "at joint": joint,
        f"variance above {RESOLVED:g} Hz: across, along, sum": above,
        "largest strain at the skin (1e-3)": largest("strain", 1e3),
    }
    halves = {name: data["runs"].get(f"{name}_half", {}).get("internal") for name in found}
    peaks = [
        half["peak_shear"] / found[name]["peak_shear"]
        for name, half in halves.items()
        if half is not None and found[name]["peak_shear"] > 0.0
    ]
    not_stated = (
        "Largest instantaneous forces are not stated: half the step makes them "
        f"{min(peaks):.1f} to {max(peaks):.1f} times as large. "
        if peaks
        else ""
    )
    return blocks(
        "### Forces and moments along the beam",
        "The paper names stresses and strains, and the energy needed for locomotion, as what the "
        "model is for. Forces come from each element's momentum balance, the fluid's impulse on "
        "its own panels included, so they need no multipliers of the constraints; moments are "
        "those of torque and spring (all per metre of depth). The undamped beam rings, and steps "
        f"of 10 ms resolve motions up to {RESOLVED:g} Hz (2π f dt = 0.5). What is stated is the "
        "root mean square of each series below that frequency, at the joint where it is largest; "
        "the share of the variance above it is what these runs do not resolve. "
        f"{not_stated}The strain is the half thickness times the largest curvature of the run, "
        "from the shapes and not filtered.",
        table(columns, found),
        picture(
            pictures,
            "internal",
            f"Moments and forces along the beam below {RESOLVED:g} Hz, scenes i and v: root mean "
            "squares of the run with error bars, and the sum of moments in the last second but "
            "one.",
        ),
    )
