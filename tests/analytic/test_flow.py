"""The flow around bodies against closed forms, and against the energy that the swimmer feels."""

import numpy as np
import pytest
from numpy.typing import NDArray

from swim_env import OptionError, Simulator, Trajectory, load_scene
from swim_env.analysis.flow import BodyFlow, Flow, flow_of_sources, pressure_between
from swim_env.physics.fluid.outline import CT, CX, CY, LENGTH, ST, X, Y
from swim_env.physics.fluid.sources import LAYERS, influence, normal_influence
from swim_env.physics.runtime.views import padded

Array = NDArray[np.float64]


class PolygonFlow:
    """A rigid closed polygon that translates and turns about the origin of its frame."""

    def __init__(self, corners: Array) -> None:
        following = np.roll(corners, -1, axis=0)
        edges = following - corners
        self.length = np.hypot(*edges.T)
        self.count = len(corners)
        size = padded(self.count)
        self.panels = np.zeros((7, size))
        self.panels[[X, Y], : self.count] = corners.T
        self.panels[[X, Y], self.count :] = corners[:1].T
        self.middles = 0.5 * (corners + following)
        self.panels[[CX, CY], : self.count] = self.middles.T
        self.panels[CT] = 1.0
        self.panels[[CT, ST], : self.count] = (edges / self.length[:, None]).T
        self.panels[LENGTH, : self.count] = self.length
        self.normals = np.stack(
            [self.panels[ST, : self.count], -self.panels[CT, : self.count]], axis=1
        )
        layers = np.zeros((LAYERS, size, size))
        influence(self.panels, self.count, 1.0, np.empty(size + 1), layers)
        normal = np.empty((size, size))
        normal_influence(self.panels, self.count, layers, normal)
        self.normal_influence = normal[: self.count, : self.count]

    def surface_velocity(self, velocity: Array, turning: float) -> Array:
        across = np.stack([-self.middles[:, 1], self.middles[:, 0]], axis=1)
        return velocity + turning * across

    def at(self, points: Array, velocity: Array, turning: float = 0.0) -> Flow:
        moving = (self.surface_velocity(velocity, turning) * self.normals).sum(axis=1)
        strengths = np.linalg.solve(self.normal_influence, moving)
        return flow_of_sources(self.panels, self.count, strengths, points, 1.0)

    def moved(self, points: Array, place: Array, velocity: Array) -> Flow:
        return self.at(points - place, velocity)


def ellipse(a: float, b: float, count: int) -> Array:
    t = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return np.stack([a * np.cos(t), b * np.sin(t)], axis=1)


def ring(radius: float, count: int = 40) -> Array:
    t = 2.0 * np.pi * np.arange(count) / count + 0.03
    return radius * np.stack([np.cos(t), np.sin(t)], axis=1)


CIRCLE = ellipse(0.5, 0.5, 360)


def test_circle_in_translation() -> None:
    """phi = -R^2 U.x / r^2 and its gradient; so the flow decays like 1/r^2."""
    velocity = np.array([0.8, -0.3])
    body = PolygonFlow(CIRCLE)
    for radius in (0.55, 1.0, 5.0):
        points = ring(radius)
        found = body.at(points, velocity)
        r2 = (points**2).sum(axis=1)
        along = points @ velocity
        potential = -0.25 * along / r2
        exact = -0.25 * (velocity / r2[:, None] - 2.0 * along[:, None] * points / r2[:, None] ** 2)
        scale = 0.25 * np.hypot(*velocity) / radius**2
        assert np.abs(found.potential - potential).max() < 5e-3 * scale * radius
        # Close to the surface the corners of the panels are felt.
        assert np.abs(found.velocity - exact).max() < (2e-2 if radius < 0.6 else 5e-3) * scale
        assert not found.inside.any()
    assert body.at(ring(0.45), velocity).inside.all()


def test_pressure_on_a_circle_at_constant_velocity() -> None:
    """p = rho U^2 (cos 2t R^2/r^2 - R^4/r^4 / 2): 0.5 rho U^2 ahead and behind, -1.5 beside."""
    speed, density, interval = 0.7, 10.0, 1e-3
    body = PolygonFlow(CIRCLE)
    points = ring(0.9)
    velocity = np.array([speed, 0.0])
    sides = [body.moved(points, side * 0.5 * interval * velocity, velocity) for side in (-1.0, 1.0)]
    found = pressure_between(sides[0], sides[1], interval, density)
    ratio = (0.5 / 0.9) ** 2
    angle = np.arctan2(points[:, 1], points[:, 0])
    exact = density * speed**2 * (ratio * np.cos(2.0 * angle) - 0.5 * ratio**2)
    assert found == pytest.approx(exact, abs=5e-3 * density * speed**2)


@pytest.mark.parametrize("axes", [(0.5, 0.5), (0.5, 0.2)])
def test_dalembert(axes: tuple[float, float]) -> None:
    """A body at constant velocity along an axis feels no force; an accelerated one -m a."""
    density, interval = 10.0, 1e-3
    body = PolygonFlow(ellipse(*axes, 240))
    velocity = np.array([0.7, 0.0])
    surface = body.middles + 1e-3 * body.normals
    fluid = [body.moved(surface, side * interval * velocity, velocity) for side in (-0.5, 0.5)]
    steady = pressure_between(fluid[0], fluid[1], interval, density)
    scale = density * 0.49
    assert np.abs(steady).max() > 0.3 * scale
    assert np.abs((steady * body.length) @ body.normals).max() < 0.02 * scale
    # From rest with an acceleration of 1 m/s^2: the added mass of an ellipse along a is rho pi b^2.
    rest, later = body.at(surface, np.zeros(2)), body.at(surface, np.array([interval, 0.0]))
    started = pressure_between(rest, later, interval, density)
    load = -(started * body.length) @ body.normals
    assert load[0] == pytest.approx(-density * np.pi * axes[1] ** 2, rel=0.03)
    assert abs(load[1]) < 1e-6


def test_turning_ellipse() -> None:
    """phi = -w (a+b)^2 / 4 * e^(-2 xi) sin(2 eta), and its kinetic energy."""
    a, b, turning = 0.5, 0.2, 1.3
    body = PolygonFlow(ellipse(a, b, 400))
    focus = np.sqrt(a * a - b * b)
    points = ring(0.8)
    zeta = np.arccosh((points[:, 0] + 1j * points[:, 1]) / focus)
    xi, eta = np.abs(zeta.real), zeta.imag * np.sign(zeta.real)
    exact = -0.25 * turning * (a + b) ** 2 * np.exp(-2.0 * xi) * np.sin(2.0 * eta)
    found = body.at(points, np.zeros(2), turning)
    assert found.potential == pytest.approx(exact, abs=5e-3 * np.abs(exact).max())


def test_no_flux_through_the_surface() -> None:
    """Just outside of the panels' middles, the fluid moves with the body along the normal."""
    body = PolygonFlow(ellipse(0.5, 0.2, 200))
    velocity, turning = np.array([0.4, 0.9]), -0.7
    found = body.at(body.middles + 1e-9 * body.normals, velocity, turning)
    through = (found.velocity * body.normals).sum(axis=1)
    moving = (body.surface_velocity(velocity, turning) * body.normals).sum(axis=1)
    assert through == pytest.approx(moving, abs=1e-6)


# ---- the swimmer's own -------------------------------------------------------------------------

SCENE = load_scene("swimmer")


@pytest.fixture(scope="module")
def run() -> Trajectory:
    simulator = Simulator(SCENE)
    return simulator.rollout(simulator.prescribed_torques(120))


def test_velocity_follows_the_body(run: Trajectory) -> None:
    """Fluid beside an element's middle moves along its normal as the element does."""
    flow = BodyFlow(SCENE)
    angles, centres = run.angles[100], run.centres[100]
    velocities, turning = (np.gradient(x, 0.005, axis=0)[100] for x in (run.centres, run.angles))
    normals = np.stack([-np.sin(angles), np.cos(angles)], axis=-1)
    tangents = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    # Two panels on a side: their middles are a quarter of an element from the centre.
    arm = 0.25 * SCENE.beam.element_length
    inner = slice(2, -2)
    for side in (-1.0, 1.0):
        points = centres + arm * tangents + side * (SCENE.beam.half_thickness + 1e-9) * normals
        found = flow.at(points, centres.mean(axis=0), angles, velocities, turning)
        through = (found.velocity * normals).sum(axis=1)
        moving = ((velocities + (arm * turning)[:, None] * normals) * normals).sum(axis=1)
        scale = np.abs(moving).max()
        # Mitres shift the middles a little; the ends' caps are close to the first and last.
        assert np.abs(through - moving)[inner].max() < 0.1 * scale


def test_kinetic_energy_is_that_of_the_field(run: Trajectory) -> None:
    """rho |u|^2 / 2 summed over the plane is V^T A V / 2.

    Inside of a circle on a fine grid; outside of it by Green's theorem, as -rho/2 of the circle's
    integral of phi du/dn.
    """
    flow = BodyFlow(SCENE)
    angles, centre = run.angles[80], run.path[80]
    velocities, turning = (np.gradient(x, 0.005, axis=0)[80] for x in (run.centres, run.angles))
    radius, cell, parts = 0.7, 0.004, 400
    normals = ring(1.0, parts)
    around = flow.at(centre + radius * normals, centre, angles, velocities, turning)
    through = (around.velocity * normals).sum(axis=1)
    outside = -0.5 * flow.density * 2.0 * np.pi * radius / parts * (around.potential @ through)
    at = np.arange(-radius, radius, cell) + 0.5 * cell
    points = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    points = centre + points[np.hypot(*points.T) < radius]
    found = flow.at(points, centre, angles, velocities, turning)
    squares = (found.velocity**2).sum(axis=1)[~found.inside]
    within = 0.5 * flow.density * cell * cell * squares.sum()
    both, alone = Simulator(SCENE), Simulator(SCENE.replace("fluid", None))
    for simulator in (both, alone):
        simulator.reset_to([*centre, angles[0], *np.diff(angles)], [*velocities.mean(0), *turning])
    assert within + outside == pytest.approx(both.energy() - alone.energy(), rel=0.03)
    assert found.inside.sum() * cell * cell == pytest.approx(0.02, rel=0.03)


def test_flow_moves_with_the_stream() -> None:
    """A body that drifts with a stream has the flow of one at rest, and the stream on top."""
    still = load_scene("swimmer", {"initial.velocity": [0.0, 0.0]})
    drifting = still.replace("stream", {"velocity": [0.3, 0.1]}).replace(
        "initial.velocity", [0.3, 0.1]
    )
    found = []
    for scene in (still, drifting):
        simulator = Simulator(scene)
        run = simulator.rollout(simulator.prescribed_torques(40))
        points = ring(0.7) + run.path[30]
        found.append(BodyFlow(scene).during(run, 30, points))
    (rest, rest_pressure), (moved, moved_pressure) = found
    assert moved.velocity - [0.3, 0.1] == pytest.approx(rest.velocity, abs=1e-7)
    assert moved_pressure == pytest.approx(rest_pressure, abs=1e-5)


def test_a_scene_without_fluid_has_no_flow() -> None:
    """It is refused in one line."""
    with pytest.raises(OptionError, match="has no fluid"):
        BodyFlow(SCENE.replace("fluid", None))


def test_far_pressure_is_that_of_the_net_source() -> None:
    """Which a bending body has, the same from everywhere, and a rigid one not."""
    scene = load_scene("swimmer")
    flow, length = BodyFlow(scene), scene.beam.length
    turns = 2.0 * np.pi * np.arange(64) / 64
    ring = np.stack([np.cos(turns), np.sin(turns)], axis=1)

    def source(angles: Array, turning: Array, radius: float) -> float:
        at = radius * length * ring
        arms = scene.beam.element_length * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        rates = turning[:, None] * np.stack([-arms[:, 1], arms[:, 0]], axis=-1)
        velocities = np.cumsum(rates, axis=0) - 0.5 * rates
        velocities -= velocities.mean(axis=0)
        found = flow.at(at, np.zeros(2), angles, velocities, turning)
        assert found is not None
        return float((found.velocity * ring).sum(axis=1).mean() * 2.0 * np.pi * radius * length)

    bent, bending = np.linspace(0.0, 1.2, 9), np.linspace(-3.0, 3.0, 9)
    near, far = source(bent, bending, 20.0), source(bent, bending, 100.0)
    assert abs(near) > 1e-2 and far == pytest.approx(near, rel=1e-3)
    assert abs(source(np.zeros(9), np.full(9, 2.0), 20.0)) < 1e-9


@pytest.mark.parametrize(
    ("change", "instant", "message"),
    [
        ({"fluid.density": 20.0}, 1, "a flow of scene .*: fluid differs"),
        ({"beam.length": 2.0}, 1, "a flow of scene .*: beam differs"),
        ({"integrator.time_step": 1e-3}, 1, "a flow with steps of"),
        ({}, -1, "instant must be 0 to 3 for this trajectory, got -1"),
        ({}, 4, "instant must be 0 to 3 for this trajectory, got 4"),
    ],
)
def test_a_flow_shows_its_own_scene_and_instants_that_there_are(
    change: dict[str, object], instant: int, message: str
) -> None:
    scene = load_scene("swimmer")
    run = Simulator(scene).rollout(np.zeros((3, scene.beam.elements - 1)))
    with pytest.raises(OptionError, match=message):
        BodyFlow(scene.replace(change)).during(run, instant, np.zeros((1, 2)))


def test_a_flow_takes_the_motion_of_its_own_number_of_elements():
    flow, points = BodyFlow(load_scene("paper_iv")), np.array([[9.0, 9.0]])
    good = (np.zeros(2), np.zeros(3), np.zeros((3, 2)), np.zeros(3))
    assert flow.at(points, *good) is not None
    for place, wrong in enumerate((np.zeros(3), np.zeros(9), np.zeros((9, 2)), np.zeros(9))):
        with pytest.raises(
            OptionError, match=r"scene paper_iv takes a centre \(2,\), angles \(3,\)"
        ):
            flow.at(points, *good[:place], wrong, *good[place + 1 :])
