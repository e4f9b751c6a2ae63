"""The twelve scenes: their runs, what is kept, and forces along the beam."""

from __future__ import annotations

from collections.abc import Callable

from studies.paper.bars import PANELS, coarse_error, with_bar
from studies.paper.constants import RESOLVED
from studies.paper.measures import (
    Fields,
    Run,
    heading_turn,
    largest_bend,
    mean_power,
    run_with_bar,
    table,
    transport_cost,
    turn_per_way,
    way_ahead,
)
from studies.paper.runs import NUMERALS
from studies.paper.verdicts import Data

#: From the name of a run to a cell.
Cell = Callable[[str], object]

#: Of Figs. 4 to 7.
_SAME_PHASE = (
    "All shapes are at the same phase of the drive, that of t = 0; they differ as the undamped "
    "body still rings from its start."
)


def _names(data: Data) -> list[str]:
    return [name for name in NUMERALS if name in data["runs"]]


def _barred(data: Data, pick: Callable[[Run], float | None], sign: str = "") -> Cell:
    return lambda name: run_with_bar(data, name, pick, sign)


def runs(data: Data) -> Fields | None:
    """Return what is said of the runs."""
    names = _names(data)
    if not names:
        return None

    def frequencies(name: str) -> str:
        """Return the first two natural frequencies with the bar of the panels."""
        modes = data["modes"].get(name, {})
        pairs = list(zip(modes.get("frequencies", []), modes.get("fine", []), strict=False))[:2]
        return ", ".join(with_bar(f, coarse_error(fine - f, PANELS)) for f, fine in pairs)

    def to_the_right(run: Run) -> float:
        return float(run["displacement"][1] / run["length"])

    columns: dict[str, Cell] = {
        "scene": str,
        "head first (BL)": _barred(data, way_ahead, "+"),
        "to its right, +y (BL)": _barred(data, to_the_right, "+"),
        "net speed (mm/s)": _barred(data, lambda run: 1e3 * run["speed"]),
        "turn (°), left +": _barred(data, heading_turn, "+"),
        "turn per way (°/m)": _barred(data, turn_per_way, "+"),
        "largest joint angle (rad)": _barred(data, largest_bend),
        "natural frequencies (Hz)": frequencies,
        f"mean positive power below {RESOLVED:g} Hz (W)": _barred(data, mean_power),
    }
    return {
        "duration": max(data["runs"][name]["duration"] for name in names),
        "table": table(columns, names),
        "same_phase": _SAME_PHASE,
    }


def constants(data: Data) -> Fields | None:
    """Return what is said of momentum and energy."""
    known = data["runs"]
    names = _names(data)
    if not names:
        return None

    def errors(name: str) -> str:
        half = known.get(f"{name}_half")
        text = f"{known[name]['energy']['unexplained']:.1e}"
        if half is None or half["end"]:
            return text
        return f"{text} ({half['energy']['unexplained']:.1e})"

    def quarters(name: str) -> str:
        return ", ".join(f"{known[name]['energy'][key]:+.1e}" for key in ("first", "last"))

    def cost(name: str) -> str:
        spent = known[name]["energy"]["positive_work"]
        return run_with_bar(data, name, transport_cost) if spent != 0.0 else ""

    columns: dict[str, Cell] = {
        "scene": str,
        "momentum drift": lambda name: f"{known[name]['momentum']['drift']:.1e}",
        "its bound": lambda name: f"{known[name]['momentum']['bound']:.1e}",
        "largest energy (J)": _barred(data, lambda run: run["energy"]["largest"]),
        "unexplained (at half the step)": errors,
        "mean of first and last quarter": quarters,
        "net work (J)": _barred(data, lambda run: run["energy"]["work"]),
        "positive work (J)": _barred(data, lambda run: run["energy"]["positive_work"]),
        f"positive work below {RESOLVED:g} Hz per way (J/m)": cost,
    }
    return {"resolved": RESOLVED, "table": table(columns, names)}


def forces(data: Data) -> Fields | None:
    """Return what is said of forces and moments along the beam."""
    known = data["runs"]
    found = {x: known[x]["internal"] for x in _names(data) if "internal" in known[x]}
    if not found:
        return None

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
    halves = {name: known.get(f"{name}_half", {}).get("internal") for name in found}
    peaks = [
        half["peak_shear"] / found[name]["peak_shear"]
        for name, half in halves.items()
        if half is not None and found[name]["peak_shear"] > 0.0
    ]
    return {
        "resolved": RESOLVED,
        "peaks_low": min(peaks, default=None),
        "peaks_high": max(peaks, default=None),
        "table": table(columns, found),
    }
