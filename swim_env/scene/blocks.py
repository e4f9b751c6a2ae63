"""The blocks of a scene: frozen, validated, compared by value.

Every block checks itself when it is made. What concerns several blocks at once is checked by
`swim_env.scene.Scene`. Units are SI; the fluid is two-dimensional with unit depth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import SceneError
from swim_env.scene.checks import (
    Pair,
    check_fields,
    check_integer,
    check_name,
    check_pair,
    check_real,
    check_reals,
    got,
    is_number,
    listed,
)

FLUID_MODEL_NAMES: tuple[str, ...] = (
    "none",
    "strip",
    "frozen",
    "expansion",
    "panels",
    "centreline",
)
"""Names that `Fluid.model` may have, from the crudest to the full one; the last one is there for
comparison with the printed equations only."""

CENTRELINE_VARIANTS: tuple[str, ...] = (
    "consistent",
    "printed_factor",
    "arm_from_start",
    "printed_factor_arm_from_start",
)
"""Names that `Fluid.variant` may have."""

PROPORTIONAL = "proportional"
"""What `Fluid.cap_panels` may be instead of a number."""

MOST_ELEMENTS_OF_EXPANSION = 27
"""Largest `Beam.elements` with the fluid model ``expansion``, whose tensor grows as N^4."""

SCHEME_NAMES: tuple[str, ...] = ("paper", "composed")
"""Names that `Integrator.scheme` may have: of first order, and of second."""

STRAIN_NAMES: tuple[str, ...] = ("averaged_directors", "mean_angles", "joint_angle")
"""Names that `Integrator.strain` may have."""

ENERGY_EXCESSES: tuple[str, ...] = ("warn", "end")
"""Names that `Integrator.energy_excess` may have."""

TOLERANCE_RANGE: tuple[float, float] = (1e-13, 1e-4)
"""Smallest and largest `Integrator.tolerance`."""

MOST_ELEMENTS, MOST_PANELS = 1000, 1000
"""Largest `Beam.elements`, and largest `Fluid.panels_per_element` and `Fluid.cap_panels`."""

MOST_PANELS_IN_ALL = 5000
"""Largest number of panels of the whole outline: matrices of more do not fit into memory."""

Floats = NDArray[np.float64]
_Block = TypeVar("_Block")


def build_block(cls: type[_Block], value: object, field: str) -> _Block:
    """Make a block from a mapping of its fields (or return a block as it is).

    Raises
    ------
    SceneError
        If a field is unknown, missing, of the wrong type or out of range.
    """
    if isinstance(value, cls):
        return value
    assert is_dataclass(cls)
    specs = fields(cls)
    given = check_fields(value, field, [spec.name for spec in specs])
    for spec in specs:
        if spec.default is MISSING and spec.name not in given:
            raise SceneError(f"{field}.{spec.name} is missing")
    return cls(**given)


def plain(value: object) -> Any:
    """Return a block or a value inside one as mappings, lists and scalars fit for YAML."""
    if isinstance(value, LinearStiffness):
        return {"linear": {"head": value.head, "tail": value.tail}}
    if is_dataclass(value):
        return {spec.name: plain(getattr(value, spec.name)) for spec in fields(value)}
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    return value


def _set(block: object, **values: object) -> None:
    """Store checked values in a frozen dataclass; only for use in ``__post_init__``."""
    for name, value in values.items():
        object.__setattr__(block, name, value)


# ---- beam --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StiffnessPiece:
    """A stretch of constant bending stiffness, ending before `until`.

    Attributes
    ----------
    until : float
        End of the stretch as s/l, in (0, 1]; a joint exactly there belongs to the next one.
    value : float
        Bending stiffness EI on the stretch [N m^2], at least 0.
    """

    until: float
    value: float

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        field = "beam.bending_stiffness.pieces"
        _set(
            self,
            until=check_real(self.until, f"{field}.until", above=0.0, at_most=1.0),
            value=check_real(self.value, f"{field}.value", "N m^2", at_least=0.0),
        )


@dataclass(frozen=True)
class PiecewiseStiffness:
    """Bending stiffness that is constant on stretches of the body.

    Attributes
    ----------
    pieces : tuple of StiffnessPiece
        The stretches from head to tail; `until` [s/l] increases and ends at 1.
    """

    pieces: tuple[StiffnessPiece, ...]

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        field = "beam.bending_stiffness.pieces"
        items = listed(self.pieces)
        if not items:
            raise SceneError(
                f"{field} must be a list of {{until: s/l, value: EI}}, got {got(self.pieces)}"
            )
        pieces = tuple(self._piece(item, f"{field}[{i}]") for i, item in enumerate(items))
        for i, (left, right) in enumerate(zip(pieces, pieces[1:], strict=False)):
            if not right.until > left.until:
                raise SceneError(
                    f"{field}[{i + 1}].until must be above the one before it, {left.until!r}, "
                    f"got {right.until!r}"
                )
        if pieces[-1].until != 1.0:
            raise SceneError(
                f"{field}[{len(pieces) - 1}].until must be 1.0, the tail, as the last one, "
                f"got {pieces[-1].until!r}"
            )
        _set(self, pieces=pieces)

    @staticmethod
    def _piece(item: object, field: str) -> StiffnessPiece:
        try:
            return build_block(StiffnessPiece, item, field)
        except SceneError as error:  # a piece does not know its place in the list
            message = error.problem.replace("beam.bending_stiffness.pieces.", f"{field}.", 1)
            raise SceneError(message) from None

    def at(self, fraction: Floats) -> Floats:
        """Bending stiffness [N m^2] at the places s/l = `fraction`."""
        ends = np.array([piece.until for piece in self.pieces])
        values = np.array([piece.value for piece in self.pieces])
        return values[np.searchsorted(ends[:-1], fraction, side="right")]


@dataclass(frozen=True)
class LinearStiffness:
    """Bending stiffness that varies linearly along the body, EI = head + (tail - head) s/l.

    Attributes
    ----------
    head : float
        Bending stiffness at the head, s = 0 [N m^2], at least 0.
    tail : float
        Bending stiffness at the tail, s = l [N m^2], at least 0.
    """

    head: float
    tail: float

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        field = "beam.bending_stiffness.linear"
        _set(
            self,
            head=check_real(self.head, f"{field}.head", "N m^2", at_least=0.0),
            tail=check_real(self.tail, f"{field}.tail", "N m^2", at_least=0.0),
        )

    def at(self, fraction: Floats) -> Floats:
        """Bending stiffness [N m^2] at the places s/l = `fraction`."""
        return np.asarray(self.head + (self.tail - self.head) * fraction, dtype=np.float64)


Stiffness = float | tuple[float, ...] | PiecewiseStiffness | LinearStiffness


def _check_stiffness(value: object, elements: int) -> Stiffness:
    """Return any of the four ways to give EI in its stored form."""
    field = "beam.bending_stiffness"
    if isinstance(value, (PiecewiseStiffness, LinearStiffness)):
        return value
    if isinstance(value, Mapping):
        given = check_fields(value, field, ["pieces", "linear"])
        if set(given) == {"pieces"}:
            return PiecewiseStiffness(given["pieces"])
        if set(given) == {"linear"}:
            return build_block(LinearStiffness, given["linear"], f"{field}.linear")
        raise SceneError(f"{field} must have either pieces or linear, got {len(given)} of them")
    if listed(value) is not None:
        values = check_reals(value, field, "N m^2", at_least=0.0)
        if len(values) != elements - 1:
            raise SceneError(
                f"{field} must list one value per joint, {elements - 1} for beam.elements = "
                f"{elements}, got {len(values)}"
            )
        return values
    if value is None:
        return 0.0
    if is_number(value):
        return check_real(value, field, "N m^2", at_least=0.0)
    raise SceneError(
        f"{field} must be a number in N m^2, a list of them, pieces or linear, got {got(value)}"
    )


@dataclass(frozen=True)
class Beam:
    """The elastic body: a chain of equal rigid elements with bending springs at the joints.

    Attributes
    ----------
    length : float
        Length l [m], above 0.
    elements : int
        Number of elements N, 2 to 1000.
    half_thickness : float
        Half the thickness in the plane of motion [m], at least 0. Only the fluid sees it; where
        there is one it must be above 0 and below a quarter of the length. How far a body may
        bend hangs on it: the inner side of every element keeps a tenth of its length.
    line_density : float
        Mass per length rho_B A [kg/m], above 0.
    rotary_inertia : float
        Rotary inertia per length rho_B I_1 [kg m], at least 0.
    bending_stiffness : float, tuple of float, PiecewiseStiffness or LinearStiffness
        Bending stiffness EI [N m^2], at least 0: one value, one value for each of the N - 1
        joints, or a law in s/l, which means the same at every N. Lists and mappings, as YAML
        has them, are converted. The effect is absent at 0 or null.
    """

    length: float = 1.0
    elements: int = 9
    half_thickness: float = 0.01
    line_density: float = 0.31
    rotary_inertia: float = 7.8e-6
    bending_stiffness: Stiffness = 5.0

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        elements = check_integer(self.elements, "beam.elements", at_least=2, at_most=MOST_ELEMENTS)
        _set(
            self,
            length=check_real(self.length, "beam.length", "m", above=0.0),
            elements=elements,
            half_thickness=check_real(
                self.half_thickness, "beam.half_thickness", "m", at_least=0.0
            ),
            line_density=check_real(self.line_density, "beam.line_density", "kg/m", above=0.0),
            rotary_inertia=check_real(
                self.rotary_inertia, "beam.rotary_inertia", "kg m", at_least=0.0
            ),
            bending_stiffness=_check_stiffness(self.bending_stiffness, elements),
        )

    @property
    def element_length(self) -> float:
        """Length of one element, dl = l/N [m]."""
        return self.length / self.elements

    @property
    def joint_fractions(self) -> Floats:
        """Places of the joints as s/l, (N-1,): (k-1)/N for the joint of elements k-1 and k."""
        return np.arange(1, self.elements, dtype=np.float64) / self.elements

    def stiffness_at_joints(self) -> Floats:
        """Bending stiffness at the joints, from head to tail.

        Returns
        -------
        numpy.ndarray
            EI [N m^2], shape (N-1,), float64; entry k-2 belongs to the joint between elements
            k-1 and k, at s = (k-1) dl.
        """
        law = self.bending_stiffness
        if isinstance(law, (PiecewiseStiffness, LinearStiffness)):
            return law.at(self.joint_fractions)
        if isinstance(law, tuple):
            return np.array(law, dtype=np.float64)
        return np.full(self.elements - 1, law, dtype=np.float64)


# ---- fluid and effects -------------------------------------------------------------------------


@dataclass(frozen=True)
class Fluid:
    """The fluid around the body: inviscid, irrotational, at rest far away.

    Attributes
    ----------
    model : str
        One of `FLUID_MODEL_NAMES`. ``none`` is the same as no fluid at all; ``strip`` gives every
        element the added mass of its own length; ``frozen`` takes the straight body's whatever the
        shape; ``expansion`` adds its second derivatives by the joint angles; ``panels`` evaluates
        every shape; ``centreline`` is the letter of the printed equations, for comparison only:
        sources on one side of the centre line.
    density : float or None
        Fluid density [kg/m^3, at unit depth], above 0; None with the model ``none``.
    panels_per_element : int
        Panels on both sides of an element together, or on its centre line; even, 2 to 1000.
    cap_panels : int or str
        Panels that close each end of the body, 1 to 1000; or ``proportional`` for as many as make
        them about a third as long as those of the sides, which refines the ends with the sides
        (one for the paper's body with 4 panels per element). Strips have no panels and leave both
        alone, the centre line has no ends.
    added_mass_per_length : float or None
        With the model ``strip`` alone: an element's added mass per length [kg/m], above 0; the
        mean value of a straight plate, pi/4 density length, where None.
    variant : str or None
        With the model ``centreline`` alone: one of `CENTRELINE_VARIANTS`, the boundary value of a
        turning element; ``consistent`` where None.
    """

    model: str = "panels"
    density: float | None = None
    panels_per_element: int = 4
    cap_panels: int | str = 1
    added_mass_per_length: float | None = None
    variant: str | None = None

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        model = check_name(self.model, "fluid.model", FLUID_MODEL_NAMES)
        density = self.density
        if model == "none":
            if density is not None:
                raise SceneError(
                    "fluid.density has no meaning with fluid.model none, which needs null, "
                    f"got {got(density)}"
                )
        elif density is None:
            raise SceneError(
                f"fluid.model {model} needs fluid.density, a number above 0 in kg/m^3, got null"
            )
        else:
            density = check_real(density, "fluid.density", "kg/m^3", above=0.0)
        panels = check_integer(
            self.panels_per_element, "fluid.panels_per_element", at_least=2, at_most=MOST_PANELS
        )
        if panels % 2:
            raise SceneError(
                "fluid.panels_per_element must be even, as it counts both sides of an element, "
                f"got {panels}"
            )
        caps = self.cap_panels
        if isinstance(caps, str):
            check_name(caps, "fluid.cap_panels", ("a whole number", PROPORTIONAL))
        else:
            try:
                caps = check_integer(caps, "fluid.cap_panels", at_least=1, at_most=MOST_PANELS)
            except SceneError as error:
                raise SceneError(f"{error.problem}; or {PROPORTIONAL}") from None
        variant = self.variant
        if variant is not None:
            if model != "centreline":
                raise SceneError(
                    f"fluid.variant has no meaning with fluid.model {model}, only with centreline; "
                    f"it needs null, got {got(variant)}"
                )
            variant = check_name(variant, "fluid.variant", CENTRELINE_VARIANTS)
        strip = self.added_mass_per_length
        if strip is not None:
            if model != "strip":
                raise SceneError(
                    f"fluid.added_mass_per_length has no meaning with fluid.model {model}, only "
                    f"with strip; it needs null, got {got(strip)}"
                )
            strip = check_real(strip, "fluid.added_mass_per_length", "kg/m", above=0.0)
        _set(
            self,
            density=density,
            panels_per_element=panels,
            cap_panels=caps,
            added_mass_per_length=strip,
            variant=variant,
        )

    def panels_per_end(self, beam: Beam) -> int:
        """Return the number of panels that close each end of a body."""
        if isinstance(self.cap_panels, str):
            on_a_side = 2.0 * beam.element_length / self.panels_per_element
            return max(1, round(2.0 * beam.half_thickness / (on_a_side / 3.0)))
        return self.cap_panels

    @property
    def has_outline(self) -> bool:
        """Whether the body's closed outline is cut into panels, if only once."""
        return self.model in ("frozen", "expansion", "panels")

    @property
    def present(self) -> bool:
        """Whether there is a fluid to speak of, that is, the model is not ``none``."""
        return self.model != "none"


@dataclass(frozen=True)
class AxialAddedMass:
    """Effect: the added mass of the elements' motion along themselves. It has no fields."""


@dataclass(frozen=True)
class Damping:
    """Effect: Kelvin-Voigt damping, a joint moment (EI/dl) t_kv d(dth)/dt.

    Attributes
    ----------
    retardation_time : float
        Retardation time t_kv [s], above 0.
    """

    retardation_time: float

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        time = check_real(self.retardation_time, "damping.retardation_time", "s", above=0.0)
        _set(self, retardation_time=time)


@dataclass(frozen=True)
class CrossFlowDrag:
    """Effect: quadratic drag of the flow across the body, -rho C |u| u/2 per length.

    u is the velocity along the normal, relative to the stream. It stands for the vortices that an
    ideal fluid does not shed, and is the one force here that takes momentum from the body.

    Attributes
    ----------
    coefficient : float
        Drag coefficient C, above 0; about 2 for a flat plate across a steady flow.
    """

    coefficient: float = 1.0

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        value = check_real(self.coefficient, "cross_flow_drag.coefficient", above=0.0)
        _set(self, coefficient=value)


@dataclass(frozen=True)
class Stream:
    """Effect: the fluid far away moves with one velocity.

    A body in a uniform stream does what it would do at rest and is carried along; what drag feels
    is the velocity relative to the stream. `initial.velocity` is over ground, so a body that starts
    at rest moves against the stream.

    Attributes
    ----------
    velocity : tuple of float
        (x, y) [m/s].
    """

    velocity: Pair

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        _set(self, velocity=check_pair(self.velocity, "stream.velocity", "m/s"))


@dataclass(frozen=True)
class SelfContact:
    """Effect: a run ends where the body, as thick as it is, touches itself. It has no fields."""


@dataclass(frozen=True)
class InternalForces:
    """Effect: trajectories hold the forces between the elements. It has no fields."""


@dataclass(frozen=True)
class Recording:
    """Effect: simulators and environments keep the trajectory since the start. It has no fields."""


# ---- actuation ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Actuation:
    """The prescribed torque: a wave that travels along the body.

    Attributes
    ----------
    amplitude : float
        Torque amplitude A [N m].
    frequency : float
        Angular frequency f [rad/s]; the paper's 2 pi unless given.
    wave_number : float
        Wave number kappa [rad per body length]; the paper's 2 pi unless given.
    torque_limit : float
        Torque that an environment's action of 1 stands for [N m], above 0. It does not limit
        the amplitude.
    phase : float
        Phase [rad].
    end_time : float or None
        Time from which on all torques are zero [s], at least 0; None for never.
    active_until : float
        Joints with s/l above this get no torque, in (0, 1].
    """

    amplitude: float
    frequency: float = 2.0 * math.pi
    wave_number: float = 2.0 * math.pi
    torque_limit: float = 1.0
    phase: float = 0.0
    end_time: float | None = None
    active_until: float = 1.0

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        end = self.end_time
        _set(
            self,
            amplitude=check_real(self.amplitude, "actuation.amplitude", "N m"),
            frequency=check_real(self.frequency, "actuation.frequency", "rad/s"),
            wave_number=check_real(
                self.wave_number, "actuation.wave_number", "rad per body length"
            ),
            torque_limit=check_real(self.torque_limit, "actuation.torque_limit", "N m", above=0.0),
            phase=check_real(self.phase, "actuation.phase", "rad"),
            end_time=None
            if end is None
            else check_real(end, "actuation.end_time", "s", at_least=0.0),
            active_until=check_real(
                self.active_until, "actuation.active_until", above=0.0, at_most=1.0
            ),
        )

    def torques(self, times: ArrayLike, beam: Beam) -> Floats:
        """Joint torques tau = A cos(f t - kappa s/l + phase) at given times.

        Parameters
        ----------
        times : array_like
            Times [s], shape (T,). For an exact end, compute them as step number times time step
            and not by summing.
        beam : Beam
            The body whose joints are driven.

        Returns
        -------
        numpy.ndarray
            Torques [N m], shape (T, N-1): positive turns the element behind the joint
            counter-clockwise and the one before it clockwise. Zero from `end_time` on and at
            joints with s/l above `active_until`.
        """
        moments = np.atleast_1d(np.asarray(times, dtype=np.float64))
        place = beam.joint_fractions
        angle = self.frequency * moments[:, None] - self.wave_number * place + self.phase
        active = np.broadcast_to(place <= self.active_until, angle.shape)
        if self.end_time is not None:
            active = active & (moments < self.end_time)[:, None]
        return np.where(active, self.amplitude * np.cos(angle), 0.0)


# ---- initial state, integrator, episode --------------------------------------------------------


def _per_element(value: Sequence[Any], count: int, field: str, what: str) -> None:
    """Refuse a list that does not have one entry per joint or element."""
    if len(value) != count:
        raise SceneError(f"{field} must list one value per {what}, {count}, got {len(value)}")


@dataclass(frozen=True)
class Initial:
    """The state at time zero. By default straight along +x, head at the origin, at rest.

    Attributes
    ----------
    position : tuple of float
        The head's end node (x, y) [m].
    heading : float
        Angle of element 1 [rad].
    joint_angles : float or tuple of float
        Angle of each element relative to the one before it [rad]: one value for all joints or
        one for each of the N - 1.
    velocity : tuple of float, or tuple of such pairs
        Velocity (x, y) [m/s] of all element centres, or one pair for each of the N.
    velocity_slope : float
        Lateral velocity added per x [1/s]: a centre at (x, y) gets (0, slope x) more.
    turning_rate : float, tuple of float, or None
        Angular velocity of all elements or of each of the N [rad/s]; None for `velocity_slope`.
    """

    position: Pair = (0.0, 0.0)
    heading: float = 0.0
    joint_angles: float | tuple[float, ...] = 0.0
    velocity: Pair | tuple[Pair, ...] = (0.0, 0.0)
    velocity_slope: float = 0.0
    turning_rate: float | tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        rate = self.turning_rate
        _set(
            self,
            position=check_pair(self.position, "initial.position", "m"),
            heading=check_real(self.heading, "initial.heading", "rad"),
            joint_angles=self._one_or_many(self.joint_angles, "initial.joint_angles", "rad"),
            velocity=self._velocity(self.velocity),
            velocity_slope=check_real(self.velocity_slope, "initial.velocity_slope", "1/s"),
            turning_rate=None
            if rate is None
            else self._one_or_many(rate, "initial.turning_rate", "rad/s"),
        )

    @staticmethod
    def _one_or_many(value: object, field: str, unit: str) -> float | tuple[float, ...]:
        if listed(value) is None:
            return check_real(value, field, unit)
        return check_reals(value, field, unit)

    @staticmethod
    def _velocity(value: object) -> Pair | tuple[Pair, ...]:
        field = "initial.velocity"
        items = listed(value)
        if items and all(listed(item) is not None for item in items):
            return tuple(check_pair(item, f"{field}[{i}]", "m/s") for i, item in enumerate(items))
        return check_pair(value, field, "m/s")

    def check_sizes(self, beam: Beam) -> None:
        """Refuse lists that do not fit the beam's number of elements."""
        count = beam.elements
        if isinstance(self.joint_angles, tuple):
            _per_element(self.joint_angles, count - 1, "initial.joint_angles", "joint")
        if isinstance(self.velocity[0], tuple):
            _per_element(self.velocity, count, "initial.velocity", "element")
        if isinstance(self.turning_rate, tuple):
            _per_element(self.turning_rate, count, "initial.turning_rate", "element")

    def pose(self, beam: Beam) -> tuple[Floats, Floats]:
        """Element centres and angles at time zero.

        Parameters
        ----------
        beam : Beam
            The body.

        Returns
        -------
        centres : numpy.ndarray
            Centres r^k [m], shape (N, 2).
        angles : numpy.ndarray
            Angles th_k from +x [rad], shape (N,).
        """
        self.check_sizes(beam)
        angles = np.full(beam.elements, self.heading, dtype=np.float64)
        angles[1:] += np.cumsum(np.broadcast_to(self.joint_angles, beam.elements - 1))
        tangents = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        ends = np.cumsum(tangents, axis=0) * beam.element_length
        return ends - 0.5 * beam.element_length * tangents + np.array(self.position), angles

    def velocities(self, beam: Beam) -> tuple[Floats, Floats]:
        """Velocities of the element centres and turning rates at time zero.

        Parameters
        ----------
        beam : Beam
            The body.

        Returns
        -------
        centre_velocities : numpy.ndarray
            Velocities of the centres [m/s], shape (N, 2).
        turning_rates : numpy.ndarray
            Angular velocities of the elements [rad/s], shape (N,).
        """
        centres, _ = self.pose(beam)
        moving = np.empty((beam.elements, 2))
        moving[:] = self.velocity
        moving[:, 1] += self.velocity_slope * centres[:, 0]
        rate = self.velocity_slope if self.turning_rate is None else self.turning_rate
        return moving, np.array(np.broadcast_to(rate, beam.elements), dtype=np.float64)

    def check_inextensible(self, beam: Beam) -> None:
        """Refuse velocities that would pull neighbouring elements apart, equation (15).

        The node shared by elements k-1 and k must have one velocity: the centres' velocities
        may differ only by dl/2 (thdot_k d1^k + thdot_{k-1} d1^{k-1}), up to 1e-9 of the largest
        speed.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # gaps that are not finite are refused
            _, angles = self.pose(beam)
            moving, rates = self.velocities(beam)
            normals = np.stack([-np.sin(angles), np.cos(angles)], axis=1)
            swing = 0.5 * beam.element_length * rates[:, None] * normals
            gaps = np.hypot(*(np.diff(moving, axis=0) - swing[1:] - swing[:-1]).T)
        scale = max(float(np.abs(moving).max()), float(np.abs(swing).max()))
        wrong = np.flatnonzero(~(gaps <= 1e-9 * scale))
        if wrong.size:
            joint = int(wrong[0])
            raise SceneError(
                f"initial.velocity, velocity_slope and turning_rate break inextensibility (15) at "
                f"the joint of elements {joint + 1} and {joint + 2}: the velocities of their "
                f"common node differ by {gaps[joint]:.3g} m/s, must be equal"
            )


@dataclass(frozen=True)
class Integrator:
    """How the motion is computed in time.

    Attributes
    ----------
    time_step : float
        Time step dt [s], above 0.
    tolerance : float
        Largest scaled residual of the step equations, dimensionless, 1e-13 to 1e-4.
    scheme : str
        One of `SCHEME_NAMES`: ``paper`` has the fluid's inertia at the beginning of a step and is
        of first order in it; ``composed`` is half a step of that followed by its adjoint, of
        second order, and takes prescribed torques at the middle of a step.
    strain : str
        One of `STRAIN_NAMES`: that of the directors averaged over a step, as in the paper, which
        softens where elements turn far in a step; sin(a)/dl at the mean joint angle a; or a/dl,
        whose moment does not fall again beyond 45 degrees.
    energy_tolerance : float
        Largest energy that a run may leave unexplained, |H - H_0 - work + dissipated| as a share
        of its largest energy, before it is said not to be trusted; above 0.
    energy_excess : str
        One of `ENERGY_EXCESSES`, what happens then: ``warn`` says so in every summary, ``end`` ends
        the run with the reason ``energy_unexplained``.
    """

    time_step: float = 0.01
    tolerance: float = 1e-10
    scheme: str = "paper"
    strain: str = "averaged_directors"
    energy_tolerance: float = 0.05
    energy_excess: str = "warn"

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        low, high = TOLERANCE_RANGE
        _set(
            self,
            time_step=check_real(self.time_step, "integrator.time_step", "s", above=0.0),
            tolerance=check_real(
                self.tolerance, "integrator.tolerance", at_least=low, at_most=high
            ),
            scheme=check_name(self.scheme, "integrator.scheme", SCHEME_NAMES),
            strain=check_name(self.strain, "integrator.strain", STRAIN_NAMES),
            energy_tolerance=check_real(
                self.energy_tolerance, "integrator.energy_tolerance", above=0.0
            ),
            energy_excess=check_name(
                self.energy_excess, "integrator.energy_excess", ENERGY_EXCESSES
            ),
        )


@dataclass(frozen=True)
class Episode:
    """How the scene is played: how long, and for learners, how often they act and for what.

    Attributes
    ----------
    duration : float
        Simulated time of an episode, and of a replay unless it is told otherwise [s], above 0.
    control_interval : float
        Time over which an environment holds an action [s], above 0; environments need a whole
        number of time steps in it.
    heading : tuple of float
        Direction (x, y) in which an environment counts displacement, a unit vector. By default
        -x, which is head first for a body that starts along +x.
    bend_noise : float
        Environments start with joint angles that are off by up to this [rad], 0 to pi.
    heading_noise : float
        They start with the body turned by up to this [rad], 0 to pi.
    velocity_noise : float
        They start with a rigid motion whose components are off by up to this [m/s], at least 0:
        the velocity along x and y, and the turning rate times the body length. In an ideal fluid
        this momentum stays for the whole episode, so it has to be small.
    """

    duration: float = 20.0
    control_interval: float = 0.02
    heading: Pair = (-1.0, 0.0)
    bend_noise: float = 0.01
    heading_noise: float = 0.05
    velocity_noise: float = 1e-4

    def __post_init__(self) -> None:
        """Check every field and store it in its final form."""
        heading = check_pair(self.heading, "episode.heading")
        norm = math.hypot(*heading)
        if not abs(norm - 1.0) <= 1e-6:
            raise SceneError(
                f"episode.heading must be a unit vector (x, y), got {list(heading)} of length "
                f"{norm:.6g}"
            )
        _set(
            self,
            duration=check_real(self.duration, "episode.duration", "s", above=0.0),
            control_interval=check_real(
                self.control_interval, "episode.control_interval", "s", above=0.0
            ),
            heading=(heading[0] / norm, heading[1] / norm),
            bend_noise=check_real(
                self.bend_noise, "episode.bend_noise", "rad", at_least=0.0, at_most=math.pi
            ),
            heading_noise=check_real(
                self.heading_noise, "episode.heading_noise", "rad", at_least=0.0, at_most=math.pi
            ),
            velocity_noise=check_real(
                self.velocity_noise, "episode.velocity_noise", "m/s", at_least=0.0
            ),
        )
