"""What a body can do in its own units: masses, periods, bend per torque, and what resolves them."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from swim_env.analysis.modes import (
    MODE_NAMES,
    bending_frequencies,
    driven_axis,
    mass_matrix,
    mode_frequencies,
)
from swim_env.errors import SceneError
from swim_env.scene import AXIS_NAMES, WAVE_AXES, Scene, SpatialScene
from swim_env.scene.scene import BEND_AT_LIMIT, limit_of
from swim_env.sim.simulator import Simulator

__all__ = ["Characteristics", "SpatialCharacteristics", "characterise", "resolve"]

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
#: Density of the body as a multiple of the fluid's, or the other way round, that is suspicious.
_MUCH_DENSER = 20.0
#: Panels of the sides of the whole body: with fewer, scores change by a tenth with more of them.
_LEAST_PANELS = 36
#: Periods of the first mode that are too few for an episode.
_FEW_PERIODS = 20.0


class _Figures:
    """What characteristics in the plane and in space share."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, lists and text."""
        found = asdict(self)  # type: ignore[call-overload]
        return {key: list(one) if isinstance(one, tuple) else one for key, one in found.items()}


@dataclass(frozen=True)
class Characteristics(_Figures):
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


@dataclass(frozen=True)
class SpatialCharacteristics(_Figures):
    """The straight body of a scene in space, in its fluid.

    Attributes
    ----------
    scene : str
        The scene's name.
    mass : float
        Of the body [kg].
    added_mass_along, added_mass_lateral, added_mass_dorsoventral : float
        Of the fluid, for rigid motions along d3 (the body), d1 and d2 [kg].
    rotary_inertia, added_rotary_inertia : tuple of float
        About d1, d2 and d3 (pitch, yaw, roll) through the mean of the element centres [kg m^2].
    natural_frequencies : tuple of float
        Of all modes in the fluid [Hz], lowest first; of an axis about which joints have no
        stiffness there are none.
    modes : tuple of str
        Which of them each is: lateral, dorsoventral or torsion.
    axes : tuple of str
        The actuated axes, in whose order the limits below are.
    driven_axis : str
        The one whose first mode counts, see `swim_env.analysis.modes.driven_axis`.
    period : float or None
        T1, of that mode [s].
    bend_per_torque : tuple of float or None
        Static bend (twist for roll) of the whole body under the same torque everywhere, about each
        of `axes` [rad / (N m)]; None about one without stiffness.
    torque_limit : tuple of float
        Torque of an action of 1 [N m].
    bend_at_limit : tuple of float or None
        The static bend under the torque limit [rad].
    control_interval, time_step : float
        Of the scene [s].
    actions_per_period, steps_per_period : float or None
        How many of them there are in T1.
    commanded_modes, resolved_modes : int
        How many modes about `axes` have at least 4 actions, and how many of all 8 time steps, in
        their period.
    advice : tuple of str
        What would keep the body from swimming, and what would help; empty where nothing does.
    """

    scene: str
    mass: float
    added_mass_along: float
    added_mass_lateral: float
    added_mass_dorsoventral: float
    rotary_inertia: tuple[float, ...]
    added_rotary_inertia: tuple[float, ...]
    natural_frequencies: tuple[float, ...]
    modes: tuple[str, ...]
    axes: tuple[str, ...]
    driven_axis: str
    period: float | None
    bend_per_torque: tuple[float | None, ...]
    torque_limit: tuple[float, ...]
    bend_at_limit: tuple[float | None, ...]
    control_interval: float
    time_step: float
    actions_per_period: float | None
    steps_per_period: float | None
    commanded_modes: int
    resolved_modes: int
    advice: tuple[str, ...]

    def __str__(self) -> str:
        """Return the figures as lines of text, then the advice."""
        inertia, added = (
            ", ".join(f"{one:.4g}" for one in triple)
            for triple in (self.rotary_inertia, self.added_rotary_inertia)
        )
        lines = [
            f"scene {self.scene}",
            f"mass             {self.mass:.4g} kg; the fluid adds {self.added_mass_along:.4g} "
            f"along the body, {self.added_mass_lateral:.4g} laterally, "
            f"{self.added_mass_dorsoventral:.4g} dorsoventrally",
            f"rotary inertia   {inertia} kg m^2 ({', '.join(AXIS_NAMES)}); the fluid adds {added}",
        ]
        for name in MODE_NAMES.values():
            pairs = zip(self.natural_frequencies, self.modes, strict=True)
            own = [f"{one:.4g}" for one, mode in pairs if mode == name]
            if own:
                shown = ", ".join([*own[:4], *(["..."] if len(own) > 4 else [])])
                lines.append(f"{name:<16} natural frequencies {shown} Hz in the fluid")
        if self.period is not None:
            lines += [
                f"period           T1 = {_seconds(self.period)}, of the first "
                f"{MODE_NAMES[self.driven_axis]} mode",
                f"actions          held for {_seconds(self.control_interval)}, "
                f"{self.actions_per_period:.3g} in T1; {self.commanded_modes} modes can be "
                "commanded",
                f"time steps       {_seconds(self.time_step)}, {self.steps_per_period:.3g} in T1; "
                f"{self.resolved_modes} of {len(self.natural_frequencies)} modes are resolved",
            ]
        for axis, per_torque, limit in zip(
            self.axes, self.bend_per_torque, self.torque_limit, strict=True
        ):
            if per_torque is not None:
                lines.append(
                    f"{f'static {axis}':<16} {per_torque:.4g} rad per N m; {limit * per_torque:.3g}"
                    f" rad at the torque limit of {limit:.4g} N m"
                )
        return "\n".join([*lines, *(f"advice           {one}" for one in self.advice)])


def characterise(scene: Scene) -> Characteristics | SpatialCharacteristics:
    """Return what a scene's body can do, and what would keep it from swimming.

    Masses and frequencies are those of the straight body at rest, undamped and linearised, see
    `natural_frequencies`. Of a scene in space these are `SpatialCharacteristics`.

    Examples
    --------
    >>> found = swim_env.characterise(swim_env.load_scene("swimmer"))
    >>> round(found.actions_per_period, 1), found.advice
    (9.8, ())
    """
    if isinstance(scene, SpatialScene):
        return _characterise_in_space(scene)
    straight = scene.replace({"initial": {}, "stream": None})
    matrix = mass_matrix(Simulator(straight))
    beam, n = scene.beam, scene.beam.elements
    mass, segment = scene.mass, beam.element_length
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
        **_clock(scene, period, frequencies, frequencies),
    }
    return Characteristics(**found, advice=_advice(scene, found))


def _characterise_in_space(scene: SpatialScene) -> SpatialCharacteristics:
    matrix = mass_matrix(Simulator(scene.replace({"initial": {}, "stream": None})))
    beam, n = scene.beam, scene.beam.elements
    # Of each element: line density, and rotary inertias of d1 and d2, which turn about all axes but
    # their own. The straight body lies along x, pitch is about y, yaw about z.
    line, first, second = (beam.element_length * scene.inertia_per_length()).T
    centres = (np.arange(n) - 0.5 * (n - 1)) * beam.element_length
    across = line @ centres**2
    inertia = across + second.sum(), across + first.sum(), first.sum() + second.sum()
    rigid = np.zeros((6, 3 * n + 3))
    for axis in range(3):
        rigid[axis, axis] = 1.0
        rigid[3 + axis, 3 + axis :: 3] = 1.0
    whole = np.diag(rigid @ matrix @ rigid.T)
    along, lateral, dorsoventral = (_added(one, line.sum()) for one in whole[:3])
    stiffness = beam.stiffness_at_joints()
    modes = {
        axis: found
        for (axis, found), own in zip(
            mode_frequencies(scene, matrix).items(), stiffness.T, strict=True
        )
        if own.all()
    }
    ranked = sorted((one, MODE_NAMES[axis]) for axis, some in modes.items() for one in some)
    bends, limits, driven = scene.bend_per_torque, scene.torque_limit, driven_axis(scene)
    period = 1.0 / modes[driven][0] if scene.has_period else None
    commanded = [one for axis in scene.axes for one in modes.get(axis, ())]
    figures: dict[str, Any] = {
        "scene": scene.name,
        "mass": scene.mass,
        "added_mass_along": along,
        "added_mass_lateral": lateral,
        "added_mass_dorsoventral": dorsoventral,
        "rotary_inertia": tuple(map(float, inertia)),
        "added_rotary_inertia": tuple(map(_added, whole[[4, 5, 3]], inertia)),
        "natural_frequencies": tuple(one for one, _ in ranked),
        "modes": tuple(mode for _, mode in ranked),
        "axes": scene.axes,
        "driven_axis": driven,
        "period": period,
        "bend_per_torque": bends,
        "torque_limit": limits,
        "bend_at_limit": tuple(
            bend and limit * bend for bend, limit in zip(bends, limits, strict=True)
        ),
        **_clock(scene, period, commanded, [one for one, _ in ranked]),
    }
    return SpatialCharacteristics(**figures, advice=_advice(scene, figures))


def _clock(
    scene: Scene, period: float | None, commanded: Sequence[float], every: Sequence[float]
) -> dict[str, Any]:
    """Return how actions and time steps resolve a period, frequencies to command, and all (Hz)."""
    control, step = scene.episode.control_interval, scene.integrator.time_step
    return {
        "control_interval": control,
        "time_step": step,
        "actions_per_period": period / control if period else None,
        "steps_per_period": period / step if period else None,
        "commanded_modes": sum(one * control * _LEAST_ACTIONS <= 1.0 for one in commanded),
        "resolved_modes": sum(one * step * _LEAST_STEPS <= 1.0 for one in every),
    }


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
    if scene.dimension == 2 and scene.fluid is not None and scene.fluid.density is not None:
        as_dense = 2.0 * scene.beam.half_thickness * scene.fluid.density
        times = scene.beam.line_density / as_dense
        if not 1.0 / _MUCH_DENSER <= times <= _MUCH_DENSER:
            advice.append(
                f"the body is {times:.2g} times as dense as the fluid, a layer one metre deep that "
                f"it reaches through; as dense as that it has beam.line_density={as_dense:.3g}"
            )
    control = period / _ACTIONS
    mode = f"first {MODE_NAMES[found['driven_axis']] if scene.dimension == 3 else 'bending'} mode"
    held = f"torques are held for {_seconds(found['control_interval'])}, the {mode} "
    held += f"has a period of {_seconds(period)}: {found['actions_per_period']:.2g} actions in a "
    held += "period {}" + f"; take episode.control_interval={control:.3g} (or auto)"
    if found["actions_per_period"] < _LEAST_ACTIONS:
        advice.append(held.format("cannot excite it"))
    elif found["actions_per_period"] > 10 * _ACTIONS:
        advice.append(held.format("make learning slow"))
    step = period / (_ACTIONS * _steps_in_action(scene))
    if found["time_step"] > 2.0 * step:
        advice.append(
            f"a time step of {_seconds(found['time_step'])} hardly resolves the {mode}'s "
            f"period of {_seconds(period)}; take integrator.time_step={step:.3g} (or auto)"
        )
    if scene.damping is None:
        advice.append(
            "nothing damps the body, so near a natural frequency its motion grows until it breaks "
            "down; take damping.retardation_time="
            f"{period / _RETARDATIONS_IN_PERIOD:.3g} (or auto)"
        )
    bends, limits = np.atleast_1d(found["bend_at_limit"]), np.atleast_1d(found["torque_limit"])
    better = ",".join(
        f"{BEND_AT_LIMIT / per_torque:.3g}"
        for per_torque in np.atleast_1d(found["bend_per_torque"])
    )
    for axis, bend, limit in zip(scene.axes, bends, limits, strict=True):
        if not _LITTLE_BEND <= bend <= _MUCH_BEND:
            of = f" of {axis}" if scene.dimension == 3 else ""
            does = "twists" if axis == "roll" else "bends"
            advice.append(
                f"the torque limit of {limit:.3g} N m{of} {does} "
                f"the body by {bend:.2g} rad in all, {'little' if bend < _LITTLE_BEND else 'much'} "
                "for swimming; take actuation.torque_limit="
                f"{f'[{better}]' if scene.dimension == 3 else better} (or auto)"
            )
    periods = scene.episode.duration / period
    if periods < _FEW_PERIODS:
        advice.append(
            f"an episode of {_seconds(scene.episode.duration)} has {periods:.2g} periods of the "
            f"{mode}, too few to get under way; take "
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
    steps_in_action = _steps_in_action(scene)
    step, control = scene.integrator.time_step, scene.episode.control_interval
    limit: Any
    if isinstance(found, Characteristics):
        limit = limit_of(found.bend_per_torque)
    else:
        limit = tuple(limit_of(bend) for bend in found.bend_per_torque)
    if "episode.control_interval" in rest:
        control = period / _ACTIONS
        if "integrator.time_step" not in rest:
            control = step * max(1, round(control / step))
    if "integrator.time_step" in rest:
        step = control / max(1, math.ceil(control / period * _ACTIONS * steps_in_action - 1e-9))
    values: dict[str, object] = {
        "integrator.time_step": step,
        "episode.control_interval": control,
        "episode.duration": _PERIODS_IN_EPISODE * period,
        "damping.retardation_time": period / _RETARDATIONS_IN_PERIOD,
        "actuation.torque_limit": limit,
        "actuation.amplitude": _amplitude(
            scene, limit if "actuation.torque_limit" in rest else scene.torque_limit
        ),
        "actuation.frequency": math.tau / period,
    }
    return scene.replace({path: values[path] for path in rest})


def _amplitude(scene: Scene, limit: Any) -> float:
    """Return the largest amplitude of a scene's wave within its torque limits [N m]."""
    if not isinstance(scene, SpatialScene):
        return float(limit)
    limits = dict(zip(scene.axes, limit, strict=True))
    wave = scene.actuation.wave if scene.actuation else "planar"
    return float(min(limits.get(axis, math.inf) for axis in WAVE_AXES[wave]))
