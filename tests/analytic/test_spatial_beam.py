"""The beam in space alone: natural frequencies, and shapes under loads that do not change."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import eigh

from swim_env import Scene, Simulator
from tests.invariants.runs import orders
from tests.reference.spatial import Body, hat, mass_of, pose
from tests.support import Array, rollout

START = np.eye(3)[:, [1, 2, 0]]
PITCH, YAW, ROLL = range(3)
#: EI1, EI2, GJ (N m^2) of the rod that swings.
STIFFNESS = (3.0, 2.0, 1.0)
DENSITY, HALF_WIDTH, HALF_HEIGHT = 1000.0, 0.02, 0.03
SIZES = (9, 18, 36)


def _rod(elements: int, axis: int) -> Scene:
    beam = {
        "elements": elements,
        "density": DENSITY,
        "section": {"profile": "uniform", "half_width": HALF_WIDTH, "half_height": HALF_HEIGHT},
        "dorsoventral_stiffness": STIFFNESS[PITCH],
        "lateral_stiffness": STIFFNESS[YAW],
        "torsional_stiffness": STIFFNESS[ROLL],
    }
    if axis != ROLL:  # Euler's beam has no rotary inertia
        beam |= {"rotary_inertia_1": 1e-7, "rotary_inertia_2": 1e-7}
    return Scene.from_dict({"dimension": 3, "beam": beam, "integrator": {"tolerance": 1e-13}})


def _first_mode(scene: Scene, axis: int) -> tuple[float, Array]:
    """Return angular frequency (rad/s) and joints (N - 1, 3) of the first mode about an axis."""
    body, n = Body.of(scene), scene.beam.elements
    mass = mass_of(pose(np.zeros(3), np.tile(START, (n, 1, 1)), body.dl), body)
    joints = np.zeros((3 * n - 3, 3 * n + 3))
    for j in range(n - 1):
        joints[3 * j : 3 * j + 3, 3 * j + 3 : 3 * j + 9] = np.hstack([-START.T, START.T])
    squares, shapes = eigh(joints.T @ (body.stiffness.reshape(-1, 1) * joints), mass)
    turns = (joints @ shapes[:, 6:]).T.reshape(-1, n - 1, 3)
    share = (turns[:, :, axis] ** 2).sum(axis=1) / (turns**2).sum(axis=(1, 2))
    first = int(np.argmax(share > 0.9))
    return float(np.sqrt(squares[6 + first])), turns[first] / np.abs(turns[first]).max()


def _measured(scene: Scene, guess: float, shape: Array) -> float:
    """Return the angular frequency (rad/s) at which a body that starts in a mode's shape swings."""
    start = {"joint_rotations": (1e-4 * shape).tolist()}
    step = 2.0 * np.pi / guess / 40.0
    run = rollout(
        scene.replace({"initial": start, "integrator.time_step": step}),
        np.zeros((60, *shape.shape)),
    )
    # Other modes are orthogonal to it in the elastic energy.
    swing = (run.joint_rotations * Body.of(scene).stiffness * shape).sum(axis=(1, 2))
    middle = swing[1:-1]
    turn = np.arccos(middle @ (swing[2:] + swing[:-2]) / (2.0 * middle @ middle))
    # The midpoint rule turns a linear oscillator by 2 atan(omega dt/2) a step.
    return float(2.0 / step * np.tan(0.5 * turn))


#: What an independent implementation found, in per cent.
EXPECTED = {PITCH: (2.67, 0.64, 0.16), YAW: (2.67, 0.64, 0.16), ROLL: (-0.51, -0.13, -0.03)}


@pytest.mark.parametrize("axis", EXPECTED, ids=["dorsoventral", "lateral", "torsion"])
def test_natural_frequencies_converge_to_those_of_the_free_rod(axis: int) -> None:
    area = np.pi * HALF_WIDTH * HALF_HEIGHT
    polar = 0.25 * DENSITY * area * (HALF_WIDTH**2 + HALF_HEIGHT**2)
    exact = np.pi * np.sqrt(STIFFNESS[ROLL] / polar)
    if axis != ROLL:
        exact = 4.730040744862704**2 * np.sqrt(STIFFNESS[axis] / (DENSITY * area))
    errors = []
    for elements in SIZES:
        scene = _rod(elements, axis)
        frequency, shape = _first_mode(scene, axis)
        measured = _measured(scene, frequency, shape)
        assert abs(measured / frequency - 1.0) < 1e-6
        errors.append(100.0 * (measured / exact - 1.0))
    print("per cent off:", *(f"{each:.3f}" for each in errors), "orders", orders(errors))
    np.testing.assert_allclose(errors, EXPECTED[axis], rtol=0.0, atol=0.006)
    np.testing.assert_allclose(orders(errors), 2.0, rtol=0.0, atol=0.06)


# ---- loads that do not change --------------------------------------------------------------------


def _conjugate(simulator: Simulator, moments: Array) -> Array:
    """Return the torques (N - 1, 3) that put moments (N m), given in space, on the joints.

    tau . dtheta is to be the moment's work on the turn of one element against the other, which is
    J dtheta on the axes of the element behind: J is the right Jacobian of the exponential.
    """
    rotations = simulator.joint_rotations
    angle = np.maximum(np.linalg.norm(rotations, axis=1), 1e-6)[:, None, None]
    cross = hat(rotations)
    jacobian = np.eye(3) - (1.0 - np.cos(angle)) / angle**2 * cross
    jacobian += (angle - np.sin(angle)) / angle**3 * cross @ cross
    own = np.einsum("jxi,jx->ji", simulator.directors[1:], moments)
    return np.asarray(np.einsum("jik,ji->jk", jacobian, own))


def _settle(
    scene: Scene, moments: Callable[[Simulator], Array], duration: float = 1.5
) -> Simulator:
    """Return a damped body after the joints have carried these moments (N - 1, 3) for a while."""
    simulator = Simulator(scene)
    for _ in range(round(duration / scene.integrator.time_step)):
        simulator.step(_conjugate(simulator, moments(simulator)))
    return simulator


def _damped(elements: int, strain: str, beam: dict[str, object], bend: float = 0.0) -> Scene:
    section = {"profile": "uniform", "half_width": 0.1, "half_height": 0.1}
    joints = [[0.0, bend, 0.0]] * (elements - 1)
    return Scene.from_dict(
        {
            "dimension": 3,
            "beam": {"elements": elements, "density": 100.0, "section": section, **beam},
            "damping": {"retardation_time": 0.05},
            "initial": {"joint_rotations": joints},
            "integrator": {"time_step": 0.005, "strain": strain},
        }
    )


def _helix(elements: int, strain: str) -> tuple[float, float]:
    """Return the errors of radius and pitch under couples at both ends, as shares.

    Couples at the ends are the same as one moment in space on every joint. The tangent turns about
    the couple's axis at M/EI per length, at one angle to it, whatever GJ is.
    """
    bending, torsion, couple, tilt = 2.0, 1.3, 6.0, np.radians(50.0)
    axis = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    beam: dict[str, object] = dict.fromkeys(
        ("lateral_stiffness", "dorsoventral_stiffness"), bending
    )
    scene = _damped(elements, strain, {**beam, "torsional_stiffness": torsion})
    end = _settle(scene, lambda _: np.tile(couple * axis, (elements - 1, 1)))
    along = end.directors[:, :, 2] @ axis
    assert np.ptp(along) < 2e-3, "the tangent's angle to the axis changes along the body"
    first = np.cross(axis, [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    across = np.stack([first, np.cross(axis, first)], axis=1)
    tangents = end.directors[:, :, 2] @ across
    turn = np.diff(np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0]))).mean()
    nodes = end.centres @ across
    # A circle through the nodes: |x|^2 = 2 x . c + R^2 - |c|^2.
    columns = np.column_stack([2.0 * nodes, np.ones(len(nodes))])
    fit = np.linalg.lstsq(columns, (nodes**2).sum(axis=1), rcond=None)[0]
    radius = np.sqrt(fit[2] + fit[:2] @ fit[:2])
    cosine = along.mean()
    pitch = 2.0 * np.pi * cosine / elements / turn
    scale = bending / couple
    exact = scale * np.sqrt(1.0 - cosine**2), 2.0 * np.pi * scale * cosine
    return float(radius / exact[0] - 1.0), float(pitch / exact[1] - 1.0)


@pytest.mark.parametrize(
    ("strain", "sizes"), [("joint_angle", (9, 18)), ("averaged_directors", (18, 36))]
)
def test_end_couples_about_a_tilted_axis_make_a_helix(strain: str, sizes: tuple[int, int]) -> None:
    errors = np.array([_helix(elements, strain) for elements in sizes])
    print(f"{strain}, N = {sizes}: radius and pitch off by", errors.round(5).tolist())
    assert np.abs(errors[1]).max() < 0.01
    radius = orders(errors[:, 0])
    assert radius[0] > 1.9
    assert np.abs(errors[1, 1]) < 5e-4 or orders(errors[:, 1])[0] > 1.9


def _behind(simulator: Simulator, half: float) -> Array:
    """Return the nodes behind the elements, (N, 3) (m)."""
    nodes: Array = simulator.centres + half * simulator.directors[:, :, 2]
    return nodes


#: Tips (lateral, along the clamp, up) of the arc of radius 100 under a force of 600: Bathe and
#: Bolourchi (1979), Simo and Vu-Quoc (1986). Their beams shear and stretch a little.
TIPS = ((15.9, 47.2, 53.4), (15.79, 47.23, 53.37))


@pytest.mark.parametrize("strain", ["joint_angle", "averaged_directors"])
def test_the_45_degree_bend_comes_to_where_the_literature_has_it(strain: str) -> None:
    tips = []
    # The radius is the unit of length, EI/radius^2 that of force; EI = GJ = 1e7/12 there.
    force = 600.0 * 100.0**2 / (1e7 / 12.0)
    for elements in (10, 20):
        # The clamp is the middle of element 1.
        length = np.pi / 4.0 * elements / (elements - 0.5)
        half = 0.5 * length / elements
        names = ("lateral_stiffness", "dorsoventral_stiffness", "torsional_stiffness")
        beam = {"length": length, "natural_curvature": [0.0, 1.0, 0.0], **dict.fromkeys(names, 1.0)}
        scene = _damped(elements, strain, beam, 2.0 * half)

        def moments(simulator: Simulator, half: float = half) -> Array:
            """Return the moments of a force at the tip along d2 of the clamp, after a ramp."""
            nodes = _behind(simulator, half)
            pull = force * min(1.0, 2.0 * simulator.time) * simulator.directors[0, :, 1]
            return np.cross(nodes[-1] - nodes[:-1], pull)

        end = _settle(scene, moments)
        arm = (_behind(end, half)[-1] - end.centres[0]) @ end.directors[0]
        tips.append(100.0 * arm[[0, 2, 1]])
    limit = (4.0 * tips[1] - tips[0]) / 3.0
    print(f"{strain}: N = 10, 20 and the limit", *(each.round(2).tolist() for each in tips), limit)
    for literature in TIPS:
        assert np.abs(limit - literature).max() < 0.25
