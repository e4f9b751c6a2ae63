"""Self-contact: when a body is said to touch itself, and what that does to a run."""

import math

import numpy as np
import pytest

from swim_env import Scene, SimulationEndedError, Simulator, load_scene
from tests.support import Array


def _point_gap(point: Array, start: Array, end: Array) -> float:
    """Return the distance of a point from a segment."""
    along = np.clip((point - start) @ (end - start) / ((end - start) @ (end - start)), 0.0, 1.0)
    return float(np.linalg.norm(point - start - along * (end - start)))


def _segment_gap(a: Array, b: Array, c: Array, d: Array) -> float:
    """Return the distance of the segments ab and cd.

    It is the least value of a convex function over a square: the best of the corners, of the edges,
    and of the inside where the lines meet there.
    """
    gap = min(_point_gap(a, c, d), _point_gap(b, c, d), _point_gap(c, a, b), _point_gap(d, a, b))
    sides = np.column_stack([b - a, c - d])
    if abs(np.linalg.det(sides)) > 1e-14:
        s, t = np.linalg.solve(sides, c - a)
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            return 0.0
    return gap


def _touches(angles: Array, length: float, radius: float) -> tuple[bool, float]:
    """Tell whether stadia overlap that are half a turn around the radius apart along the body.

    Also how close the decision was (m).
    """
    dl = length / len(angles)
    steps = dl * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    nodes = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    touching, margin = False, np.inf
    for k in range(len(angles)):
        for m in range(k + 1, len(angles)):
            # Neighbours share a node, their other ends are an element apart.
            if max(m - k - 1, 1) * dl < math.pi * radius:
                continue
            here, there = (nodes[k], nodes[k + 1]), (nodes[m], nodes[m + 1])
            if m == k + 1:
                gap = min(_point_gap(there[1], *here), _point_gap(here[0], *there))
            else:
                gap = _segment_gap(*here, *there)
            touching |= gap < 2.0 * radius
            margin = min(margin, abs(gap - 2.0 * radius))
    return touching, margin


def _watched(elements: int, half_thickness: float, **changes: object) -> Scene:
    return load_scene(
        "paper_i",
        {
            "fluid": None,
            "actuation": None,
            "self_contact": {},
            "beam.elements": elements,
            "beam.half_thickness": half_thickness,
            **changes,
        },
    )


def _is_reported(simulator: Simulator, angles: Array) -> bool:
    coordinates = np.concatenate([[0.3, -0.2, angles[0]], np.diff(angles)])
    try:
        simulator.reset_to(coordinates, np.zeros(len(coordinates)))
    except SimulationEndedError as error:
        assert error.reason == "self_contact"
        return True
    return False


@pytest.mark.parametrize("elements", [2, 3, 5, 9, 20])
@pytest.mark.parametrize("share", [0.001, 0.1, 0.31, 0.33, 0.7, 2.0])
def test_contact_is_that_of_the_stadia(elements: int, share: float) -> None:
    # Half thicknesses around dl/pi, from where on neighbours are too near to touch.
    radius = share / elements
    simulator = Simulator(_watched(elements, radius))
    rng = np.random.default_rng(elements)
    found = []
    for bend in np.linspace(0.2, 3.1, 30):
        joints = rng.uniform(-bend, bend, elements - 1)
        # Half of the poses curl one way, the others fold both ways.
        angles = np.cumsum(np.concatenate([rng.uniform(-3.0, 3.0, 1), joints]))
        if rng.random() < 0.5:
            angles = np.linspace(0.0, 2.5 * bend, elements) + 0.3 * rng.normal()
        wanted, margin = _touches(angles, 1.0, radius)
        if margin > 1e-12:
            assert _is_reported(simulator, angles) == wanted, f"{angles.tolist()}, {margin:.2g}"
            found.append(wanted)
    assert len(found) > 25
    # Both answers came up, but where all elements are too near along the body to touch. Two alone
    # touch in poses that chance may not find, see below.
    possible = (elements - 2) / elements >= math.pi * radius
    if elements > 2:
        assert any(found) == possible, f"{sum(found)} of {len(found)} touch"
    assert not all(found)


def test_segments_that_cross_are_seen_however_thin() -> None:
    # No end is near the other segment: only the crossing shows it.
    simulator = Simulator(_watched(3, 1e-9))
    crossing = np.array([0.0, 0.75 * math.pi, 1.5 * math.pi])
    assert _touches(crossing, 1.0, 1e-9)[0]
    assert _is_reported(simulator, crossing)
    assert not _is_reported(simulator, np.array([0.0, 0.6 * math.pi, 1.2 * math.pi]))


@pytest.mark.parametrize("half_thickness", [0.001, 0.05, 0.2, 0.249])
@pytest.mark.parametrize("elements", [2, 9, 40, 150])
def test_a_straight_body_does_not_touch_itself(elements: int, half_thickness: float) -> None:
    # However many elements are within its thickness of each other.
    simulator = Simulator(_watched(elements, half_thickness))
    assert not _is_reported(simulator, np.full(elements, 0.4))
    # Nor does one that is bent less than its own thickness allows.
    radius = max(1.5 * half_thickness, 0.25)
    gentle = np.linspace(0.0, (1.0 - 1.0 / elements) / radius, elements)
    assert not _is_reported(simulator, gentle)


def test_neighbours_touch_where_the_joint_folds() -> None:
    # The far end of one is 2 dl sin(a/2) off the other's, and dl sin(a) off its line, when folded
    # back by pi - a.
    radius, dl = 0.02, 0.5
    simulator = Simulator(_watched(2, radius))
    limit = math.asin(2.0 * radius / dl)
    for off, touching in ((-1e-9, True), (1e-9, False)):
        angle = math.pi - (limit + off)
        assert _is_reported(simulator, np.array([0.0, angle])) is touching
        assert _is_reported(simulator, np.array([0.7, 0.7 - angle])) is touching


CURLS: dict[str, dict[str, object]] = {
    "none": {"fluid": None},
    "strip": {"fluid.model": "strip"},
    "frozen": {"fluid.model": "frozen"},
    "expansion": {"fluid.model": "expansion"},
    "panels": {},
    "composed": {"fluid.model": "strip", "integrator.scheme": "composed"},
    "drag in a stream": {
        "fluid.model": "strip",
        "cross_flow_drag": {},
        "stream": {"velocity": (0.3, -0.2)},
    },
}


@pytest.mark.parametrize("name", CURLS)
def test_a_run_that_curls_ends_before_it_touches(name: str) -> None:
    scene = load_scene(
        "paper_i",
        {
            "actuation": None,
            "beam.bending_stiffness": 0.5,
            "damping": {"retardation_time": 0.02},
            "integrator.time_step": 0.005,
            "self_contact": {},
            **CURLS[name],
        },
    )
    torques = np.full((200, 8), 8.0)
    simulator = Simulator(scene)
    run = simulator.rollout(torques)
    assert run.termination_reason == simulator.termination_reason == "self_contact"
    assert 3 < run.steps < 100
    assert np.array_equal(simulator.angles, run.angles[-1])
    assert np.isfinite(simulator.energy())
    assert not any(_touches(angles, 1.0, 0.01)[0] for angles in run.angles)
    with pytest.raises(SimulationEndedError, match="self_contact"):
        simulator.step(np.zeros(8))
    # Without the effect the same run reaches the pose that touches, unless the panels refuse it.
    unwatched = Simulator(scene.replace("self_contact", None))
    beyond = unwatched.rollout(torques[: run.steps + 1])
    assert np.array_equal(beyond.angles[: run.steps + 1], run.angles)
    if beyond.steps > run.steps:
        assert _touches(beyond.angles[-1], 1.0, 0.01)[0], "the next pose does not touch"
    else:
        assert scene.fluid is not None and scene.fluid.model == "panels", beyond.termination_reason


def test_a_start_that_touches_is_refused() -> None:
    with pytest.raises(SimulationEndedError, match="t = 0 s: self_contact"):
        Simulator(_watched(9, 0.01, **{"initial.joint_angles": 0.9}))
