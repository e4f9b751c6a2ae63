"""A chain of a scene's links in MuJoCo: the scene's beam without its fluid model.

MuJoCo has no added mass that couples the links, which is most of what the swimming beam computes:

* ``none`` leaves the fluid out.
* ``ellipsoid`` is drag, quadratic in the velocity, lift, and the part of each link's own added mass
  that comes with products of velocities. The part that comes with accelerations is in MuJoCo's
  documentation but not in what it computes: a link at rest accelerates as in a vacuum. And every
  link is alone in its fluid: there are no terms between links and none for the shape of the body.

The viscosity is zero, as the scene's fluid is ideal. MuJoCo's joint springs are linear where the
scene's moment is EI/(2 dl) sin(2 a); at the paper's 0.05 rad that is 0.2 %.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from studies.benchmark.peer_tools import load_peer, wave_of
from swim_env.errors import OptionError
from swim_env.scene import Scene

Array = NDArray[np.float64]

#: MuJoCo's integrators. The explicit springs bound the step of all but `discrete`, which is
#: implicit in them too and exists only in recent versions; at large steps it damps vibrations.
_INTEGRATORS = ("Euler", "implicitfast", "implicit", "RK4", "discrete")


class ChainVariant(NamedTuple):
    """One of the ways to build and run the chain: MuJoCo's integrator, the fluid, the links.

    Links are ``lumped`` for the scene's, whose mass is in their centres but for the rotary inertia
    of the section, or ``rod`` for uniform rods, as one would build the chain in MuJoCo. The beam is
    the same to the order of the discretisation. The fastest mode of the lumped links is several
    times faster, and explicit integrators need steps as much smaller.
    """

    integrator: str
    fluid: Literal["none", "ellipsoid"] = "none"
    links: Literal["lumped", "rod"] = "rod"

    @property
    def name(self) -> str:
        """The parts, with slashes between them."""
        return "/".join(self)

    @property
    def description(self) -> str:
        """The parts, as tables show them."""
        fluid = "no fluid" if self.fluid == "none" else f"{self.fluid} drag"
        return f"{self.integrator}, {fluid}, {self.links} links"


#: What the benchmark runs.
CHAIN_VARIANTS = (
    *(ChainVariant(name, "none", "rod") for name in _INTEGRATORS),
    *(ChainVariant(name, "ellipsoid", "rod") for name in _INTEGRATORS),
    *(ChainVariant(name, "none", "lumped") for name in ("Euler", "RK4", "discrete")),
)

#: How steps are taken: with a call of `mj_step` for each control interval, which takes all its
#: steps without Python between them, or with a call for each step.
Way = Literal["held", "single"]


def chain_xml(scene: Scene, variant: ChainVariant, time_step: float) -> str:
    """Write the MJCF of a chain of the scene's links, straight along +x, the head at the origin.

    The root has two slides and a hinge, the joints springs of EI/dl (with the scene's Kelvin-Voigt
    damping, where it has any) and motors of unit gear. Gravity, contacts and constraints are off. A
    variant that needs a fluid which the scene does not have is an OptionError.
    """
    beam, fluid = scene.beam, scene.fluid
    density = 0.0
    if variant.fluid != "none":
        if fluid is None or fluid.density is None:
            raise OptionError(f"fluid {variant.fluid} needs a scene with a fluid density")
        density = fluid.density
    length = beam.element_length
    mass = beam.line_density * length
    # Squared half sides of the box that has the link's inertia, half a metre of the unit depth. In
    # the plane only the sum of the first two acts; equal ones keep MuJoCo from refusing the
    # inertia of a flat body for a rounding error.
    along = 0.25 * length**2 if variant.links == "rod" else 0.0
    side, deep = 0.5 * (along + 3.0 * beam.rotary_inertia / beam.line_density), 0.25
    inertia = [mass * float(sides) / 3.0 for sides in (side + deep, side + deep, side + side)]
    link = (
        f'<inertial pos="{0.5 * length!r} 0 0" mass="{mass!r}" '
        f'diaginertia="{" ".join(map(repr, inertia))}"/>'
    )
    if variant.fluid == "ellipsoid":
        link += (
            f'<geom type="ellipsoid" fluidshape="ellipsoid" pos="{0.5 * length!r} 0 0" '
            f'size="{0.5 * length!r} {beam.half_thickness!r} 0.5" '
            'contype="0" conaffinity="0"/>'
        )
    retardation = 0.0 if scene.damping is None else scene.damping.retardation_time
    springs = (beam.stiffness_at_joints() / length).tolist()
    bodies = motors = ""
    for index, spring in reversed(list(enumerate(springs, start=1))):
        bodies = (
            f'<body pos="{length!r} 0 0"><joint name="joint{index}" type="hinge" axis="0 0 1" '
            f'stiffness="{spring!r}" damping="{retardation * spring!r}"/>{link}{bodies}</body>'
        )
        motors = f'<motor joint="joint{index}" gear="1"/>{motors}'
    return (
        '<mujoco model="chain"><compiler angle="radian" inertiafromgeom="false"/>'
        f'<option integrator="{variant.integrator}" timestep="{time_step!r}" gravity="0 0 0" '
        f'density="{density!r}" viscosity="0">'
        '<flag contact="disable" constraint="disable"/></option><worldbody><body>'
        '<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>'
        f'<joint name="heading" type="hinge" axis="0 0 1"/>{link}{bodies}</body></worldbody>'
        f"<actuator>{motors}</actuator></mujoco>"
    )


class MuJoCoChain:
    """A chain of the scene's links in MuJoCo, driven by the scene's wave of torque.

    Torques are held over the scene's control interval, in which the chain takes `substeps` steps.
    `model` and `data` are MuJoCo's own. A scene without a wave is a SceneError.
    """

    def __init__(self, scene: Scene, variant: ChainVariant, substeps: int) -> None:
        self._mujoco: Any = load_peer("mujoco", "MuJoCo")
        self.scene, self.substeps = scene, substeps
        step = scene.episode.control_interval / substeps
        self.model = self._mujoco.MjModel.from_xml_string(chain_xml(scene, variant, step))
        self.data = self._mujoco.MjData(self.model)
        self._wave = wave_of(scene)

    def controls(self, count: int) -> Array:
        """Joint torques of the first control intervals, (count, N - 1) (N m)."""
        times = np.arange(count) * self.scene.episode.control_interval
        return self._wave.torques(times, self.scene.beam)

    def swim(self, count: int) -> Array | None:
        """Return the joint angles (count, N - 1) at the ends of the first control intervals (rad).

        It is None when MuJoCo warned.
        """
        step, model, data = self._mujoco.mj_step, self.model, self.data
        self._mujoco.mj_resetData(model, data)
        angles = np.empty((count, self.scene.beam.elements - 1))
        with _without_log(self._mujoco):
            for index, torques in enumerate(self.controls(count)):
                data.ctrl[:] = torques
                step(model, data, self.substeps)
                if data.warning.number.any():
                    return None
                angles[index] = data.qpos[3:]
        return angles

    def calls(self, count: int) -> dict[Way, Callable[[], object]]:
        """Return a call for each way that runs `count` control intervals from the start."""
        mujoco, model, data = self._mujoco, self.model, self.data
        step, substeps, torques = mujoco.mj_step, self.substeps, self.controls(count)

        def held() -> None:
            mujoco.mj_resetData(model, data)
            for row in torques:
                data.ctrl[:] = row
                step(model, data, substeps)

        def single() -> None:
            mujoco.mj_resetData(model, data)
            for row in torques:
                data.ctrl[:] = row
                for _ in range(substeps):
                    step(model, data)

        return {"held": held, "single": single}


@contextmanager
def _without_log(mujoco: Any) -> Iterator[None]:
    """Keep MuJoCo from writing MUJOCO_LOG.TXT where its warnings are expected."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
