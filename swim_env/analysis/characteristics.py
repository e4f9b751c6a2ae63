"""What a body can do in its own units: masses, periods, bend per torque, and what resolves them."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from swim_env.analysis.modes import bending_frequencies, mass_matrix
from swim_env.errors import SceneError
from swim_env.scene import Scene, require_planar
from swim_env.scene.scene import BEND_AT_LIMIT
from swim_env.sim.simulator import Simulator

__all__ = ["Characteristics", "characterise", "resolve"]

#: What ``auto`` means, about what scene swimmer has: actions in the first period T1, and time steps
#: in an action with the scheme ``composed`` (twice as many with ``paper``); periods in an episode,
#: and retardation times in a period.
_ACTIONS, _STEPS_IN_ACTION = 10, 4
_PERIODS_IN_EPISODE, _RETARDATIONS_IN_PERIOD = 100, 200
#: Bodies of more elements take more steps in proportion: torques reach higher modes of theirs.
_FEW_ELEMENTS = 13
#: Fewer than so many in a period of a mode do not command, or resolve, it.
_LEAST_ACTIONS, _LEAST_STEPS = 4, 8
#: Bends of the whole body (rad) under the torque limit at every joint that are suspiciously little,
#: and much, for swimming.
_LITTLE_BEND, _MUCH_BEND = 0.02, 2.0
#: Panels of the sides of the whole body: with fewer, scores change by a tenth with more of them.
_LEAST_PANELS = 36
#: Periods of the first mode that are too few for an episode.
_FEW_PERIODS = 20.0


@dataclass(frozen=True)
class Characteristics:
    """The straight body of a scene, in its fluid.

    Attributes
    ----------
    scene : str
        The scene's name.
    mass : float
        Of the body [kg].
    added_mass_along, added_mass_across : float
        Of the fluid, for rigid motions along the body and at a right angle to it [kg].
    rotary_inertia, added_rotary_inertia : float
        About the mean centre [kg m^2].
    natural_frequencies : tuple of float
        Of all bending modes in the fluid [Hz], lowest first; empty without stiffness.
    period : float or None
        T1, of the first mode [s].
    bend_per_torque : float or None
        Static bend of the whole body under the same torque everywhere, l times the mean of 1/EI
        [rad / (N m)].
    torque_limit : float
        Torque of an action of 1 [N m].
    bend_at_limit : float or None
        The static bend under the torque limit [rad].
    control_interval, time_step : float
        Of the scene [s].
    actions_per_period, steps_per_period : float or None
        How many of them there are in T1.
    commanded_modes, resolved_modes : int
        How many modes have at least 4 actions, and 8 time steps, in their period.
    advice : tuple of str
        What would keep the body from swimming, and what would help; empty where nothing does.
    """

    scene: str
    mass: float
    added_mass_along: float
    added_mass_across: float
    rotary_inertia: float
    added_rotary_inertia: float
    natural_frequencies: tuple[float, ...]
    period: float | None
    bend_per_torque: float | None
    torque_limit: float
    bend_at_limit: float | None
    control_interval: float
    time_step: float
    actions_per_period: float | None
    steps_per_period: float | None
    commanded_modes: int
    resolved_modes: int
    advice: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, lists and text."""
        found = asdict(self)
        return {key: list(one) if isinstance(one, tuple) else one for key, one in found.items()}

    def __str__(self) -> str:
        """Return the figures as lines of text, then the advice."""
        lines = [
            f"scene {self.scene}",
            f"mass             {self.mass:.4g} kg; the fluid adds {self.added_mass_along:.4g} "
            f"along the body, {self.added_mass_across:.4g} across it",
            f"rotary inertia   {self.rotary_inertia:.4g} kg m^2; the fluid adds "
            f"{self.added_rotary_inertia:.4g}",
        ]
        if self.period is not None:
            shown = ", ".join(f"{one:.4g}" for one in self.natural_frequencies[:5])
            more = ", ..." if len(self.natural_frequencies) > 5 else ""
            lines += [
                f"bending modes    {shown}{more} Hz in the fluid; first period T1 = "
                f"{_seconds(self.period)}",
                f"actions          held for {_seconds(self.control_interval)}, "
                f"{self.actions_per_period:.3g} in T1; {self.commanded_modes} of "
                f"{len(self.natural_frequencies)} modes can be commanded",
                f"time steps       {_seconds(self.time_step)}, {self.steps_per_period:.3g} in T1; "
                f"{self.resolved_modes} modes are resolved",
                f"static bend      {self.bend_per_torque:.4g} rad per N m; "
                f"{self.bend_at_limit:.3g} rad at the torque limit of {self.torque_limit:.4g} N m",
            ]
        return "\n".join([*lines, *(f"advice           {one}" for one in self.advice)])


def characterise(scene: Scene) -> Characteristics:
    """Return what a scene's body can do, and what would keep it from swimming.

    Masses and frequencies are those of the straight body at rest, undamped and linearised, see
    `natural_frequencies`.

    Examples
    --------
    >>> found = swim_env.characterise(swim_env.load_scene("swimmer"))
    >>> round(found.actions_per_period, 1), found.advice
    (9.8, ())
    """
    require_planar(scene, "characterise")
    straight = scene.replace({"initial": {}, "stream": None})
    matrix = mass_matrix(Simulator(straight))
    beam, n = scene.beam, scene.beam.elements
    mass, segment = beam.line_density * beam.length, beam.element_length
    rigid = np.zeros((3, n + 2))
    rigid[0, 0] = rigid[1, 1] = 1.0
    rigid[2, 2:] = 1.0
    whole = rigid @ matrix @ rigid.T
    centres = (np.arange(n) - 0.5 * (n - 1)) * segment
    inertia = beam.rotary_inertia * beam.length + beam.line_density * segment * float(
        centres @ centres
    )
    bend = scene.bend_per_torque
    frequencies = () if bend is None else tuple(bending_frequencies(straight, matrix))
    period = 1.0 / frequencies[0] if frequencies else None
    control, step = scene.episode.control_interval, scene.integrator.time_step
    found: dict[str, Any] = {
        "scene": scene.name,
        "mass": mass,
        "added_mass_along": _added(whole[0, 0], mass),
        "added_mass_across": _added(whole[1, 1], mass),
        "rotary_inertia": float(inertia),
        "added_rotary_inertia": _added(whole[2, 2], inertia),
        "natural_frequencies": frequencies,
        "period": period,
        "bend_per_torque": bend,
        "torque_limit": scene.torque_limit,
        "bend_at_limit": bend and scene.torque_limit * bend,
        "control_interval": control,
        "time_step": step,
        "actions_per_period": period / control if period else None,
        "steps_per_period": period / step if period else None,
        "commanded_modes": sum(one * control * _LEAST_ACTIONS <= 1.0 for one in frequencies),
        "resolved_modes": sum(one * step * _LEAST_STEPS <= 1.0 for one in frequencies),
    }
    return Characteristics(**found, advice=_advice(scene, found))


def _added(whole: float, own: float) -> float:
    """Return what the fluid adds, none where the difference is rounding."""
    added = float(whole) - float(own)
    return added if added > 1e-9 * whole else 0.0


def _advice(scene: Scene, found: dict[str, Any]) -> tuple[str, ...]:
    period = found["period"]
    if period is None:
        return (
            "some joints have no bending stiffness, so the body has no period of its own; give "
            "control_interval and time_step in seconds",
        )
    advice = []
    control = period / _ACTIONS
    held = f"torques are held for {_seconds(found['control_interval'])}, the first bending mode "
    held += f"has a period of {_seconds(period)}: {found['actions_per_period']:.2g} actions in a "
    held += "period {}" + f"; take episode.control_interval={control:.3g} (or auto)"
    if found["actions_per_period"] < _LEAST_ACTIONS:
        advice.append(held.format("cannot excite it"))
    elif found["actions_per_period"] > 10 * _ACTIONS:
        advice.append(held.format("make learning slow"))
    step = period / (_ACTIONS * _steps_in_action(scene))
    if found["time_step"] > 2.0 * step:
        advice.append(
            f"a time step of {_seconds(found['time_step'])} hardly resolves the first bending "
            f"mode's period of {_seconds(period)}; take integrator.time_step={step:.3g} (or auto)"
        )
    if scene.damping is None:
        advice.append(
            "nothing damps the body, so near a natural frequency its motion grows until it breaks "
            "down; take damping.retardation_time="
            f"{period / _RETARDATIONS_IN_PERIOD:.3g} (or auto)"
        )
    bend = found["bend_at_limit"]
    if not _LITTLE_BEND <= bend <= _MUCH_BEND:
        advice.append(
            f"the torque limit of {found['torque_limit']:.3g} N m bends the body by {bend:.2g} rad "
            f"in all, {'little' if bend < _LITTLE_BEND else 'much'} for swimming; take "
            f"actuation.torque_limit={BEND_AT_LIMIT / found['bend_per_torque']:.3g} (or auto)"
        )
    periods = scene.episode.duration / period
    if periods < _FEW_PERIODS:
        advice.append(
            f"an episode of {_seconds(scene.episode.duration)} has {periods:.2g} periods of the "
            "first bending mode, too few to get under way; take "
            f"episode.duration={_PERIODS_IN_EPISODE * period:.3g} (or auto)"
        )
    return tuple(advice)


def _seconds(time: float) -> str:
    """Return a time in the unit that suits it."""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if time >= size:
            return f"{time / size:.3g} {unit}"
    return f"{time * 1e6:.3g} us"


def _steps_in_action(scene: Scene) -> int:
    """Return how many time steps an action of T1/10 takes, the more the more modes there are."""
    steps = _STEPS_IN_ACTION * max(_FEW_ELEMENTS, scene.beam.elements) // _FEW_ELEMENTS
    return 2 * steps if scene.integrator.scheme == "paper" else steps


# ---- what scenes leave to the body -------------------------------------------------------------


def resolve(scene: Scene, paths: Collection[str]) -> Scene:
    """Return a scene in which fields have the values that follow from its body.

    Parameters
    ----------
    scene : Scene
        Its values of these fields do not matter; all others do.
    paths : collection of str
        Some of `swim_env.scene.scene.AUTOMATIC`; the rules are those of `Scene.from_dict`.

    Raises
    ------
    SceneError
        If the body has no period, as joints have no stiffness.
    """
    rest = set(paths)
    if "fluid.panels_per_element" in rest:
        rest.remove("fluid.panels_per_element")
        panels = max(4, 2 * math.ceil(_LEAST_PANELS / scene.beam.elements / 2))
        scene = scene.replace("fluid.panels_per_element", panels)
    if not rest:
        return scene
    found = characterise(scene)
    period = found.period
    if period is None:
        raise SceneError(
            f"{min(rest)} cannot be auto without bending stiffness at every joint, which gives "
            "the body its period; give a number"
        )
    assert found.bend_per_torque is not None
    steps_in_action = _steps_in_action(scene)
    step, control = scene.integrator.time_step, scene.episode.control_interval
    limit = BEND_AT_LIMIT / found.bend_per_torque
    if "episode.control_interval" in rest:
        control = period / _ACTIONS
        if "integrator.time_step" not in rest:
            control = step * max(1, round(control / step))
    if "integrator.time_step" in rest:
        step = control / max(1, math.ceil(control / period * _ACTIONS * steps_in_action - 1e-9))
    values = {
        "integrator.time_step": step,
        "episode.control_interval": control,
        "episode.duration": _PERIODS_IN_EPISODE * period,
        "damping.retardation_time": period / _RETARDATIONS_IN_PERIOD,
        "actuation.torque_limit": limit,
        "actuation.amplitude": limit if "actuation.torque_limit" in rest else scene.torque_limit,
        "actuation.frequency": math.tau / period,
    }
    return scene.replace({path: values[path] for path in rest})
