"""Two sweeps that the study's scenes do not show: over the bend, and across the first resonance."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from swim_agents.tables import markdown_table

from swim_env.accuracy.outcome import Outcome, play, relative_error
from swim_env.accuracy.settings import PAPER_SETTINGS, Settings
from swim_env.errors import SimulationEndedError
from swim_env.plots import style
from swim_env.scene import Scene, load_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Torque amplitudes of the soft, heavily damped body (N m), and how it is computed.
_AMPLITUDES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
_BENT = Settings("panels", 9, 8, "proportional", 0.005, "composed")
_MODELS = {"strip": style.SILVER, "frozen": style.BLUE, "expansion": style.GREEN}
_BENT_SECONDS = 4.0

#: Frequencies across the first resonance of `paper_i` (Hz), about 5.1 Hz.
_FREQUENCIES = tuple(float(f) for f in np.arange(3.0, 8.01, 0.25))
_RESONANT_SECONDS = 20.0
#: Ways to compute it. All are frozen with the same panels: the differences are those of time.
_FROZEN = replace(PAPER_SETTINGS, fluid_model="frozen")
_COMPOSED = replace(_FROZEN, scheme="composed")
_CONVERGED = "composed, 1.25 ms"
_WAYS: dict[str, Settings] = {
    "paper, 10 ms": _FROZEN,
    "paper, 10 ms, mean angles": replace(_FROZEN, strain="mean_angles"),
    "composed, 10 ms": _COMPOSED,
    "composed, 10 ms, mean angles": replace(_COMPOSED, strain="mean_angles"),
    _CONVERGED: replace(_COMPOSED, time_step=0.00125),
}
_COLOURS = (style.BLUE, style.SKY, style.ORANGE, style.AMBER)


def sweep_bends(progress: Callable[[int], object] = lambda _: None) -> list[dict[str, Any]]:
    """Bend a soft body further and further, and compare the fluid models with panels.

    Returns ``amplitude`` (N m), ``largest_bend`` of a joint (rad), ``errors`` of the displacement
    by model, relative to panels; None where a run ended early, with ``reasons`` by model.
    """
    damped = {"damping.retardation_time": 0.05, "actuation.wave_number": math.pi}
    soft = load_scene("swimmer", {"name": "soft", "beam.bending_stiffness": 0.2, **damped})
    found = []
    for amplitude in _AMPLITUDES:
        scene = soft.replace("actuation.amplitude", amplitude)
        full = _played(_BENT.apply(scene), _BENT_SECONDS)
        line: dict[str, Any] = {"amplitude": amplitude, "largest_bend": None}
        line |= {"errors": dict.fromkeys(_MODELS), "reasons": {}}
        if isinstance(full, Outcome):
            line["largest_bend"] = full.largest_bend
        for model in _MODELS:
            other = _played(replace(_BENT, fluid_model=model).apply(scene), _BENT_SECONDS)
            if isinstance(full, str) or isinstance(other, str):
                line["reasons"][model] = full if isinstance(full, str) else other
            else:
                error = relative_error(other.displacement, full.displacement, 1.0)
                line["errors"][model] = error
        found.append(line)
        progress(1)
    return found


def sweep_frequencies(
    scene: Scene, progress: Callable[[int], object] = lambda _: None
) -> list[dict[str, Any]]:
    """Drive a scene across its first resonance and compute it in several ways.

    Returns ``frequency`` (Hz), ``displacement`` along x (m) by way, None where a run ended early,
    and the ``reasons`` for it.
    """
    found = []
    for frequency in _FREQUENCIES:
        driven = scene.replace("actuation.frequency", 2.0 * math.pi * frequency)
        line: dict[str, Any] = {"frequency": frequency}
        line |= {"displacement": dict.fromkeys(_WAYS), "reasons": {}}
        for way, settings in _WAYS.items():
            outcome = _played(settings.apply(driven), _RESONANT_SECONDS)
            if isinstance(outcome, str):
                line["reasons"][way] = outcome
            else:
                line["displacement"][way] = float(outcome.displacement[0])
        found.append(line)
        progress(1)
    return found


def _played(scene: Scene, duration: float) -> Outcome | str:
    """Return a run, or the reason why it ended early."""
    try:
        outcome = play(scene, duration)
    except SimulationEndedError as error:
        return error.reason
    return outcome.termination_reason or outcome


def sweep_tables(bends: list[dict[str, Any]], resonance: Mapping[str, Any]) -> str:
    """Return the sweeps as Markdown."""

    def cells(one: Mapping[str, Any], figure: str, form: str) -> list[str]:
        reasons, values = one["reasons"], one[figure]
        return [
            reasons.get(key, "") if value is None else f"{value:{form}}"
            for key, value in values.items()
        ]

    rows = []
    for one in bends:
        bend = "" if one["largest_bend"] is None else f"{one['largest_bend']:.2f}"
        rows.append([f"{one['amplitude']:g}", bend, *cells(one, "errors", ".1e")])
    parts = [
        "# Sweeps",
        "## Fluid models over the bend",
        "A soft body (EI = 0.2 N m², 50 ms of damping) under half a wave of torque for 4 s: error "
        "of the displacement relative to panels, everything else the same.",
        markdown_table(["amplitude (N m)", "largest joint angle (rad)", *_MODELS], rows),
    ]
    for name, sweep in resonance.items():
        rows = [[f"{one['frequency']:g}", *cells(one, "displacement", "+.4f")] for one in sweep]
        parts += [
            f"## Across the first resonance: {name}",
            "Displacement along x after 20 s (m), frozen added mass, 9 elements, 4 panels.",
            markdown_table(["frequency (Hz)", *_WAYS], rows),
        ]
    return "\n\n".join(parts) + "\n"


def draw_sweeps(bends: list[dict[str, Any]], resonance: Mapping[str, Any]) -> Figure:
    """Draw both sweeps."""
    figure = style.new_figure(9.5, 3.6)
    axes = figure.subplots(1, 1 + len(resonance))
    _draw_bends(axes[0], bends)
    for place, (name, sweep) in zip(axes[1:], resonance.items(), strict=True):
        _draw_resonance(place, sweep)
        place.set_title(f"resonance: {name}", fontsize=style.SMALL + 1)
    look: dict[str, Any] = {"ncols": 4, "fontsize": style.SMALL, "frameon": False}
    figure.legend(handles=axes[1].get_lines(), loc="outside lower right", **look)
    return figure


def _draw_bends(axes: Axes, bends: list[dict[str, Any]]) -> None:
    for model, colour in _MODELS.items():
        some = [one for one in bends if one["errors"][model] is not None]
        points = [(one["largest_bend"], one["errors"][model]) for one in some]
        look: dict[str, Any] = {"marker": "o", "markersize": 3, "linewidth": style.LINE}
        axes.plot(*_columns(points), color=colour, label=model, **look)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title("models against panels", fontsize=style.SMALL + 1)
    axes.legend(fontsize=style.SMALL, frameon=False)
    style.style_axes(axes, "largest joint angle (rad)", "relative error of displacement")


def _draw_resonance(axes: Axes, sweep: list[dict[str, Any]]) -> None:
    for way, colour in zip([name for name in _WAYS if name != _CONVERGED], _COLOURS, strict=True):
        points = []
        for one in sweep:
            value, fine = one["displacement"][way], one["displacement"][_CONVERGED]
            if value is not None and fine is not None:
                points.append((one["frequency"], abs(value - fine) / max(abs(fine), 0.01)))
        look: dict[str, Any] = {"marker": "o", "markersize": 2.5, "linewidth": style.LINE}
        look["linestyle"] = "--" if "mean" in way else "-"
        axes.plot(*_columns(points), color=colour, label=way, **look)
    axes.set_yscale("log")
    axes.set_ylim(1e-4, 10.0)
    against = f"relative difference to {_CONVERGED}"
    style.style_axes(axes, "frequency of the drive (Hz)", against)


def _columns(points: list[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [y for _, y in points]
