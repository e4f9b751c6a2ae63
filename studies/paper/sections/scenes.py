"""The twelve scenes: what came of each run, and the paper's figures redrawn."""

from __future__ import annotations

from collections.abc import Mapping

from studies.paper.bars import PANELS, coarse_error, with_bar
from studies.paper.constants import RESOLVED
from studies.paper.measures import heading_turn, largest_bend, mean_power, turn_per_way, way_ahead
from studies.paper.runs import NUMERALS
from studies.paper.sections.text import picture, run_with_bar, table
from studies.paper.verdicts import Data

__all__ = ["section"]

_CAPTIONS = {
    "fig3": "Fig. 3: the torque at every joint of scene i, from head (dark) to tail; l is the "
    "body's length.",
    "fig4": "Fig. 4: scenes i, ii, iii. Both directors stand at every element's centre.",
    "fig5": "Fig. 5: scenes iv and v.",
    "fig6": "Fig. 6: scenes vi and vii.",
    "fig7": "Fig. 7: scenes viii and ix.",
    "fig8": "Fig. 8: scenes x, xi and xii.",
}
#: Of Figs. 4 to 7.
_SAME_PHASE = (
    " All shapes are at the same phase of the drive, that of t = 0; they differ as the undamped "
    "body still rings from its start."
)


def section(data: Data, pictures: Mapping[str, str]) -> str:
    """Return the section, nothing where its figures are missing."""
    rows = []
    for name in NUMERALS:
        run = data["runs"].get(name)
        if run is None:
            continue
        modes = data["modes"].get(name)
        rows.append(
            (
                name,
                run_with_bar(data, name, way_ahead, "+"),
                run_with_bar(data, name, lambda r: r["displacement"][1] / r["length"], "+"),
                run_with_bar(data, name, lambda r: 1e3 * r["speed"]),
                run_with_bar(data, name, heading_turn, "+"),
                run_with_bar(data, name, turn_per_way, "+"),
                run_with_bar(data, name, largest_bend),
                "" if modes is None else _frequencies(modes),
                run_with_bar(data, name, mean_power),
            )
        )
    if not rows:
        return ""
    heads = (
        "scene",
        "head first (BL)",
        "to its right, +y (BL)",
        "net speed (mm/s)",
        "turn (°), left +",
        "turn per way (°/m)",
        "largest joint angle (rad)",
        "natural frequencies (Hz)",
        f"mean positive power below {RESOLVED:g} Hz (W)",
    )
    duration = max(data["runs"][row[0]]["duration"] for row in rows)
    text = (
        f"## The twelve scenes, {duration:g} s\n\n"
        "Displacements and turns are between the means of the first and of the last second. The "
        "body lies along +x and swims head first towards -x, to the left in the paper's "
        "figures. Natural frequencies are those of the straight body in its fluid, with the bar of "
        "the panels alone.\n\n"
    )
    text += table(heads, rows)
    for name, caption in _CAPTIONS.items():
        phase = _SAME_PHASE if name in ("fig4", "fig5", "fig6", "fig7") else ""
        shown = picture(pictures, name, caption + phase)
        text += "\n" + shown if shown else ""
    return text


def _frequencies(modes: Data) -> str:
    """Return the first two natural frequencies with the bar of the panels."""
    pairs = list(zip(modes["frequencies"], modes.get("fine", []), strict=False))[:2]
    return ", ".join(with_bar(f, coarse_error(fine - f, PANELS)) for f, fine in pairs)
