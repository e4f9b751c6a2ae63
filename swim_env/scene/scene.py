"""A scene: everything that decides a run, checked as a whole, to and from YAML.

Other rooms take a `Scene` and never read files of their own.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swim_env.errors import SceneError
from swim_env.files.names import file_name
from swim_env.scene.block import Block, plain
from swim_env.scene.body import Beam, Chain
from swim_env.scene.checks import text
from swim_env.scene.drive import Actuation
from swim_env.scene.effects import (
    EFFECT_BLOCKS,
    AxialAddedMass,
    CrossFlowDrag,
    Damping,
    InternalForces,
    Recording,
    SelfContact,
    Stream,
)
from swim_env.scene.fluid import Fluid
from swim_env.scene.initial import Initial
from swim_env.scene.library import find_scene_file, scene_names
from swim_env.scene.making import KINDS, changed, elsewhere, from_file, unresolved
from swim_env.scene.run import Episode, Integrator
from swim_env.scene.yaml import dump_yaml, parse_overrides, write_text

_NOTHING: Any = object()

AUTOMATIC: tuple[str, ...] = (
    "fluid.panels_per_element",
    "integrator.time_step",
    "episode.control_interval",
    "episode.duration",
    "damping.retardation_time",
    "actuation.torque_limit",
    "actuation.amplitude",
    "actuation.frequency",
)
"""Fields that may be ``auto``: their values follow from the body, see `Scene.from_dict`."""

Floats = NDArray[np.float64]

#: Static bend of a body (rad) by the torque limit that follows from it: that of scene swimmer.
BEND_AT_LIMIT = 0.2

#: Frames of moving pictures in a period of a fast drive, about.
_FRAMES_IN_PERIOD = 10

#: Largest number of time steps in a control interval, which are recorded one by one, and of actions
#: in an episode.
MOST_STEPS_PER_ACTION, MOST_ACTIONS = 100_000, 1_000_000_000


@dataclass(frozen=True)
class Scene:
    """A body in the plane, its fluid, effects, drive, start and integrator.

    Base of `SpatialScene`, whose blocks are others: `dimension` tells which a scene is.

    Attributes
    ----------
    name : str
        Short name on one line.
    description : str
        What the scene shows.
    beam : Beam
        The body.
    fluid : Fluid or None
        The fluid; None for none.
    axial_added_mass, damping, cross_flow_drag, stream : blocks or None
        Effects, present or not. The axial added mass needs a fluid of panels, damping a beam with
        stiffness, drag and stream a fluid.
    self_contact, internal_forces, recording : blocks or None
        Effects, present or not. Self-contact needs a thickness.
    actuation : Actuation or None
        The prescribed torque; None for a passive body.
    initial : Initial
        The state at time zero.
    integrator : Integrator
        Time step, tolerance, scheme.
    episode : Episode
        Duration; and for environments the control interval, the heading and the start's noise.
    """

    name: str = "unnamed"
    description: str = ""
    beam: Beam = Beam()
    fluid: Fluid | None = None
    axial_added_mass: AxialAddedMass | None = None
    damping: Damping | None = None
    cross_flow_drag: CrossFlowDrag | None = None
    stream: Stream | None = None
    self_contact: SelfContact | None = None
    internal_forces: InternalForces | None = None
    recording: Recording | None = None
    actuation: Actuation | None = None
    initial: Initial = Initial()
    integrator: Integrator = Integrator()
    episode: Episode = Episode()

    #: Of the space that the body moves in: 2, or 3 for a `SpatialScene`.
    dimension: ClassVar[int] = 2

    #: Blocks by name, those that may be absent, and the fields that may be ``auto``.
    _blocks: ClassVar[dict[str, type[Block]]] = {
        "beam": Beam,
        "fluid": Fluid,
        **EFFECT_BLOCKS,
        "actuation": Actuation,
        "initial": Initial,
        "integrator": Integrator,
        "episode": Episode,
    }
    _optional: ClassVar[tuple[str, ...]] = ("fluid", *EFFECT_BLOCKS, "actuation")
    _automatic: ClassVar[tuple[str, ...]] = AUTOMATIC

    #: What `for_accuracy` and ``auto`` call. They compute motions, so they are in a higher room,
    #: which puts them here.
    _choose: ClassVar[Callable[[Scene, float, bool, float | None], Scene]]
    _resolve: ClassVar[Callable[[Scene, Collection[str]], Scene]]

    #: The file that the scene was read from; None for others. It is no part of the scene.
    source: ClassVar[str | None] = None

    def __post_init__(self) -> None:
        """Check names and types, then what the blocks cannot check alone."""
        if not text(self.name, "name").strip() or not self.name.isprintable():
            raise SceneError(
                f"name must be text on one line, of printable characters, got {self.name!r}"
            )
        if not re.sub(r"[\n\t]", "", text(self.description, "description")).isprintable():
            raise SceneError("description must be text of printable characters, tabs and newlines")
        for block, cls in self._blocks.items():
            value = getattr(self, block)
            if not isinstance(value, cls) and not (value is None and block in self._optional):
                raise SceneError(
                    f"{block} must be of type {cls.__name__}, got {type(value).__name__}"
                )
        for block in EFFECT_BLOCKS:
            if block not in self._blocks and getattr(self, block) is not None:
                raise elsewhere(type(self), block)
        self._check_together()

    def _check_together(self) -> None:
        """Refuse blocks that do not fit together."""
        if self.fluid is not None:
            self.fluid.check_body(self.beam)
        if not self.has_fluid and self.beam.rotary_inertia == 0.0:
            raise SceneError(
                "beam.rotary_inertia must be above 0 kg m without a fluid, as the mass matrix is "
                "singular otherwise, got 0.0"
            )
        for name in EFFECT_BLOCKS:
            effect = getattr(self, name)
            if effect is not None:
                effect.check_scene(self.beam, self.fluid)
        self.initial.check_sizes(self.beam)
        self.initial.check_inextensible(self.beam)

    # ---- views ---------------------------------------------------------------------------------

    @property
    def has_fluid(self) -> bool:
        """Whether there is any fluid around the body."""
        return self.fluid is not None and self.fluid.present

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that are present, in the order of `EFFECT_NAMES`."""
        stiff = bool(self.beam.stiffness_at_joints().any())
        there = tuple(name for name in EFFECT_BLOCKS if getattr(self, name) is not None)
        return ("bending_stiffness", *there) if stiff else there

    @property
    def steps_per_action(self) -> int:
        """Number of time steps over which an environment holds an action.

        Raises
        ------
        SceneError
            If the control interval is not a whole number of time steps, or too many of them.
        """
        ratio = self.episode.control_interval / self.integrator.time_step
        steps = round(min(ratio, 1.0 + MOST_STEPS_PER_ACTION))
        if not ratio <= MOST_STEPS_PER_ACTION:
            raise SceneError(
                f"episode.control_interval must be at most {MOST_STEPS_PER_ACTION:,} steps of "
                f"integrator.time_step, {self.integrator.time_step!r} s, got "
                f"{self.episode.control_interval!r} s"
            )
        if steps < 1 or abs(ratio - steps) > 1e-9 * ratio:
            raise SceneError(
                f"episode.control_interval must be a whole number of steps of "
                f"integrator.time_step, {self.integrator.time_step!r} s, got "
                f"{self.episode.control_interval!r} s, which is {ratio:.6g} steps"
            )
        return steps

    @property
    def frame_interval(self) -> float:
        """Time from one frame of a moving picture to the next [s], which follows the body's own.

        It is the control interval, or a whole part of it that makes about 10 frames in a period of
        a fast drive.
        """
        interval = self.episode.control_interval
        frequency = abs(self.actuation.frequency) / math.tau if self.actuation else 0.0
        return interval / max(1, round(_FRAMES_IN_PERIOD * frequency * interval))

    @property
    def torque_limit(self) -> float:
        """Torque of an environment's action of 1 [N m].

        A scene without a prescribed torque has the limit that ``auto`` means, or 1 N m where
        joints have no stiffness.
        """
        if self.actuation is not None:
            return self.actuation.torque_limit
        return limit_of(self.bend_per_torque)

    @property
    def mass(self) -> float:
        """Mass of the body [kg]."""
        return self.beam.line_density * self.beam.length

    @property
    def action_limits(self) -> Floats:
        """Torque limit of each of an environment's actions [N m], shape (n,).

        There is one action for each joint from head to tail; in three dimensions one for each
        actuated axis of every joint, joint by joint.
        """
        per_joint = np.atleast_1d(np.array(self.torque_limit, dtype=np.float64))
        return np.tile(per_joint, self.joints)

    @property
    def action_places(self) -> NDArray[np.int64]:
        """Where the actions' torques are among those of a step, flattened; shape (n,)."""
        return np.arange(self.joints)

    @property
    def action_torques(self) -> Floats:
        """Torque of each action of 1 [N m], shape (n,); 0 at joints that nothing drives."""
        limits = self.action_limits
        until = self.actuation.active_until if self.actuation else 1.0
        active = np.repeat(self.beam.joint_fractions <= until, limits.size // self.joints)
        return np.where(active, limits, 0.0)

    @property
    def axes(self) -> tuple[str, ...]:
        """The actuated axes of the joints, of `swim_env.scene.AXIS_NAMES`: yaw in the plane."""
        return ("yaw",)

    @property
    def joints(self) -> int:
        """Number of joints, N - 1."""
        return self.beam.elements - 1

    def actions_of(self, torques: ArrayLike) -> Floats:
        """Return actions, (..., n), that command torques [N m], (..., N-1) or (..., N-1, 3).

        They are shares of the limits, and beyond 1 where the torques are beyond those. Torques
        about axes that are not actuated are left out.
        """
        given = np.asarray(torques, dtype=np.float64)
        flat = given if self.dimension == 2 else given.reshape(*given.shape[:-2], -1)
        shares: Floats = flat[..., self.action_places] / self.action_limits
        return shares

    @property
    def bend_per_torque(self) -> float | None:
        """Static bend of the whole body under the same torque everywhere [rad / (N m)].

        It is l times the mean of 1/EI over the joints; None where some have no stiffness. In three
        dimensions there is one for each of `axes`, a twist for roll.
        """
        return bend_of(self.beam, self.beam.stiffness_at_joints())

    @property
    def has_period(self) -> bool:
        """Whether all joints have stiffness about the actuated axes, which gives a period."""
        return self.bend_per_torque is not None

    @property
    def actions_per_episode(self) -> int:
        """Number of actions that an environment takes in an episode, at least 1.

        Raises
        ------
        SceneError
            If there are too many to count.
        """
        ratio = self.episode.duration / self.episode.control_interval
        if not ratio <= MOST_ACTIONS:
            raise SceneError(
                f"episode.duration must be at most {MOST_ACTIONS:,} times "
                f"episode.control_interval, {self.episode.control_interval!r} s, got "
                f"{self.episode.duration!r} s"
            )
        return max(1, round(ratio))

    def to_dict(self) -> dict[str, Any]:
        """Return every field as mappings, lists and scalars; absent blocks are left out."""
        data = {spec.name: plain(getattr(self, spec.name)) for spec in fields(self)}
        present = {key: value for key, value in data.items() if value is not None}
        return present if self.dimension == 2 else {"dimension": self.dimension, **present}

    def to_yaml(self) -> str:
        """Return the scene as YAML text, with all defaults written out."""
        return dump_yaml(self.to_dict())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the scene as a YAML file, whole or not at all.

        Parameters
        ----------
        path : str or os.PathLike
            The file; its folder must exist.

        Raises
        ------
        SceneError
            If the file cannot be written.
        """
        write_text(path, self.to_yaml())

    # ---- making scenes -------------------------------------------------------------------------

    @classmethod
    def from_dict(cls, mapping: Mapping[str, Any], source: str | None = None) -> Self:
        """Make a scene from mappings, lists and scalars, a `SpatialScene` from ``dimension: 3``.

        Parameters
        ----------
        mapping : mapping
            Fields and blocks by name; what is left out has its default, optional blocks left
            out or null are absent. Only those that have no fields may not be null, since a bare
            ``axial_added_mass:`` might be meant as its presence. The fields of `AUTOMATIC` may be
            ``auto``; the scene that is returned has numbers. With T1 the period of the straight
            body's first bending mode in its fluid (in three dimensions the lowest one about an
            actuated axis, see `driven_axis`): a control interval of T1/10, time steps of
            about T1/40 (T1/80 with the scheme ``paper``; shorter with more than 13 elements, in
            proportion), a whole number of them in an action,
            episodes of 100 T1, a retardation time of T1/200; a torque limit that bends the body by
            0.2 rad (0.2 EI/l of a uniform one; in three dimensions one for each axis), a wave of
            this amplitude with the period T1.
            ``integrator: auto`` is the scheme ``composed`` with a tolerance of 1e-4 and that step.
            Few elements have more panels each: the least even number from 4 on that makes 36 in
            all.
        source : str, optional
            Where the mapping came from, for messages.

        Raises
        ------
        SceneError
            If a field is unknown, missing, of the wrong type, out of range, or if fields do not
            fit together; or if one is ``auto`` and joints have no stiffness.
        """
        try:
            scene, automatic = unresolved(cls, mapping)
            return scene._resolve(automatic) if automatic else scene  # type: ignore[return-value]
        except SceneError as error:
            raise error.located(source) from None

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> Self:
        """Read a scene from a YAML file; without a name it takes the file's.

        What a file leaves out of time step, control interval, duration, a planar fluid's panels per
        element and an actuation's torque limit is ``auto``, see `from_dict`, unless joints have no
        stiffness. So is its integrator if it has no such block.

        Parameters
        ----------
        path : str or os.PathLike
            The file.

        Raises
        ------
        SceneError
            If the file cannot be read or does not hold a valid scene.
        """
        data = from_file(cls, path, os.fspath(path), {})
        return cls.from_dict(data, os.fspath(path))._from(os.path.abspath(path))

    def replace(self, path: str | Mapping[str, object], value: object = _NOTHING) -> Self:
        """Return a scene with one or several fields changed; it is checked with all changes.

        Parameters
        ----------
        path : str or mapping
            Dotted path of a field (``"beam.elements"``) or block (``"damping"``), or a mapping
            from such paths to values, for changes that are valid only together.
        value : object
            The new value. None removes an optional block. A path into an absent optional block
            makes the block. Setting `fluid.model` to ``none`` also drops the density.

        Returns
        -------
        Scene
            The changed scene.

        Raises
        ------
        SceneError
            If a path is unknown or the changed scene is not valid.

        Examples
        --------
        >>> Scene().replace("beam.elements", 27).beam.elements
        27
        """
        if isinstance(path, Mapping):
            if value is not _NOTHING:
                raise TypeError("replace takes a mapping, or a path and a value, not both")
            changes = dict(path)
        elif value is _NOTHING:
            raise TypeError("replace needs a value for the path")
        else:
            changes = {path: value}
        scene = self.from_dict(changed(type(self), self.to_dict(), changes))
        return scene._from(self.source)

    def _from(self, source: str | None) -> Self:
        """Remember the file that a new scene comes from."""
        if source is not None:
            object.__setattr__(self, "source", source)
        return self

    def for_accuracy(
        self, tolerance: float, keep_elements: bool = False, duration: float | None = None
    ) -> Scene:
        """Return the scene with the cheapest settings that compute it to a tolerance.

        Fluid model, panels, elements, time step and scheme are chosen from the measured front of
        accuracy against cost (docs/reports/accuracy.md), by playing the scene with its prescribed
        torque, which takes seconds. Body, drive and effects stay as they are; what was chosen and
        why is appended to the description. `swim_env.accuracy.choose` returns more about it.

        Parameters
        ----------
        tolerance : float
            Largest relative error of the net displacement, |dX - dX_ref| / max(|dX_ref|, 0.01 l),
            averaged over the last period of the drive; 0.001 to 0.3.
        keep_elements : bool
            Whether to keep the number of elements, as an agent for so many joints needs it. The
            error is then that of a body of so many elements.
        duration : float, optional
            Simulated time over which the error is taken (s), by default the scene's own; at most
            20 s.

        Raises
        ------
        SwimError
            If no settings are known to be good enough, or the scene has no converged reference.
        """
        return self._choose(tolerance, keep_elements, duration)


KINDS[Scene.dimension] = Scene


def bend_of(beam: Chain, stiffness: Floats) -> float | None:
    """Return the `Scene.bend_per_torque` of a body with these stiffnesses, (N-1,) [N m^2]."""
    return float(beam.length * np.mean(1.0 / stiffness)) if stiffness.all() else None


def limit_of(bend: float | None) -> float:
    """Return the torque limit that follows from a `Scene.bend_per_torque` [N m]; 1 without one."""
    return BEND_AT_LIMIT / bend if bend else 1.0


def require_planar(scene: Scene, wish: str) -> None:
    """Refuse a scene of dimension 3 (SceneError) for what cannot be done with one yet.

    Parameters
    ----------
    scene : Scene
        The scene.
    wish : str
        What needs a planar scene: ``a recording``.
    """
    if scene.dimension != 2:
        raise SceneError(
            f"{wish} needs a scene of dimension 2, got {scene.name} of dimension {scene.dimension}"
        )


def load_scene(
    scene: str | os.PathLike[str] | Scene | Mapping[str, Any],
    overrides: str | Iterable[str] | Mapping[str, object] | None = None,
) -> Scene:
    """Find a scene and change fields of it.

    Parameters
    ----------
    scene : str, os.PathLike, Scene or mapping
        A shipped name (see `scene_names`), the path of a YAML file, a scene, or what its `to_dict`
        returns.
    overrides : str, iterable of str, or mapping, optional
        Changes by dotted path, as ``"fluid.panels_per_element=12"`` (the value read as YAML) or
        as a mapping. They are applied together.

    Returns
    -------
    Scene
        The scene.

    Raises
    ------
    SceneError
        If there is no such scene, or it or an override is not valid.

    Examples
    --------
    >>> load_scene("paper_i", ["beam.elements=27"]).beam.elements
    27
    """
    changes = {} if overrides is None else parse_overrides(overrides)
    if isinstance(scene, Mapping):
        plainly, _ = unresolved(Scene, scene)  # its errors are not those of the changes
        return Scene.from_dict(changed(type(plainly), scene, changes))
    if isinstance(scene, Scene):
        return scene.replace(changes) if changes else scene
    path, source = find_scene_file(scene)
    data = from_file(Scene, path, source, changes)
    if changes:
        source = f"{source} with overrides"
    return Scene.from_dict(data, source)._from(os.path.abspath(path))


def scene_label(scene: Scene) -> str:
    """Return what files of a scene are called: its name, with a digest unless it is as shipped.

    The duration of the episode does not count for a shipped scene.
    """
    if scene.name in scene_names():
        shipped = load_scene(scene.name)
        if shipped.replace("episode.duration", scene.episode.duration) == scene:
            return scene.name
    return file_name(scene.name, scene.to_yaml())
