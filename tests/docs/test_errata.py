"""Errors in print in the source paper, each with numbers that show it (docs/paper.md lists them)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import paper_numbers as numbers
import paper_table5 as table5
import pytest
from paper_steps import stiffness_rows

from qsf_plugins.spring_triangle import SpringTriangle, spring
from qsframework.elastostatics import Site, make_model
from qsframework.elastostatics.motion import move, nominal_actuators
from qsframework.elastostatics.state import place as place_chain
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Plan, example, read_plan, simulate
from qsframework.fits import identify
from qsframework.plans import check_poses
from qsframework.plans.candidates import reference_point
from qsframework.plugin import Actuator, Array, Context, Parameter, Poses, RobotFacts, Spring, find as find_effect

TRIANGLE = SpringTriangle(*numbers.FITTED)


# The parallelogram: (12) and (16)


def planar(first: float, second: float) -> Array:
    """Columns of a two-link arm's Jacobian (2, 2) per link angle, the links at these elevations."""
    l2, l3 = 1.12, 1.285
    return np.array([[-l2 * np.sin(first), -l3 * np.sin(second)], [l2 * np.cos(first), l3 * np.cos(second)]])


@pytest.mark.parametrize(("q2", "q3"), [(0.4, -0.9), (1.3, 0.6), (2.0, -1.7)])
def test_equation_12_holds_for_the_absolute_angle_of_the_forearm(q2: float, q3: float) -> None:
    """Js^-1 Jp is the constant [[1, 0], [-1, 1]] of (16) with q3' = q2 + q3 in Jp; with q3 it is not."""
    right = planar(q2, q2 + q3)
    serial = right @ np.array([[1.0, 0.0], [1.0, 1.0]])
    assert np.allclose(np.linalg.solve(serial, right), [[1, 0], [-1, 1]], atol=1e-12)
    assert np.abs(np.linalg.solve(serial, planar(q2, q3)) - [[1, 0], [-1, 1]]).max() > 0.3


@pytest.mark.parametrize(("q2", "q3"), [(0.4, -0.9), (1.3, 0.6), (2.0, -1.7)])
def test_equations_14_and_15_lead_to_16_corrected(q2: float, q3: float) -> None:
    """One Cartesian stiffness of both chains; solved for ks it is [[k2, -k2], [-k2, k2 + k3]], not what (16) prints."""
    k2, k3 = 0.14e-6, 0.2e-6
    Jp = planar(q2, q2 + q3)
    Js = Jp @ np.array([[1.0, 0.0], [1.0, 1.0]])
    whole = np.linalg.inv(Js) @ Jp
    ks = whole @ np.diag([k2, k3]) @ whole.T
    assert np.allclose(ks, [[k2, -k2], [-k2, k2 + k3]], rtol=1e-9, atol=0)
    stiffness = np.linalg.inv(Jp @ np.diag([k2, k3]) @ Jp.T)
    assert np.allclose(np.linalg.inv(Js @ ks @ Js.T), stiffness, rtol=1e-8)
    printed_16 = np.array([[k2, -k3], [-k3, k3]])
    assert np.abs(np.linalg.inv(Js @ printed_16 @ Js.T) / stiffness - 1.0).max() > 0.1


def test_equations_2_and_6_are_least_at_the_fit(m900ib: Experiment) -> None:
    """The sum of squares of (6), the readings' errors in it, written out with plain predictions: no step lowers it."""
    experiment = m900ib.with_(fit=table5.JOINTS[1:])
    plan = read_plan(example("m900ib") / "table5.csv", experiment)
    simulation = simulate(experiment, plan, seed=3, linear=True)
    fit = identify(experiment, simulation.readings, options=FitOptions(linear=True, keep_all=True))
    model = experiment.model()
    index = model.index(table5.JOINTS[1:])

    def squares(x: Array) -> float:
        predicted = model.predict(plan.poses, x, linear=True).reshape(-1, 3)
        return float(((simulation.readings.value - predicted) ** 2).sum())

    least = squares(fit.x)
    assert least < squares(model.nominal)
    for i in index:
        for step in (1e-3, -1e-3):
            other = fit.x.copy()
            other[i] *= 1.0 + step
            assert squares(other) > least


def test_the_forearms_column_depends_on_its_elevation_alone(m900ib: Experiment) -> None:
    """In the model too: whatever link 2 does, actuator 3 moves the wrist centre as the elevation J3 says."""
    robot = m900ib.robot
    model = make_model(robot.facts, robot.effects, robot.parameters, Site(5, np.zeros(3)), [], robot.gravity)
    pendant = np.zeros((30, 6))
    pendant[:, 1] = np.linspace(-0.5, 1.5, 30)
    pendant[:, 2] = 0.3
    q = np.ascontiguousarray(robot.controller.to_joints(pendant).T)
    context = Context(robot.facts, Poses(q.T, q.T, np.zeros((30, 6))))
    motion = move(model.layout, context, nominal_actuators(model.layout, q), np.zeros((model.layout.bars, 30)))
    state = place_chain(motion, model.tip, ())
    forearm = np.array([np.cos(0.3) * 1.285 - np.sin(0.3) * 0.25, np.sin(0.3) * 1.285 + np.cos(0.3) * 0.25])
    assert np.allclose(state.tip.linear[2].T[:, [0, 2]], [-forearm[1], forearm[0]], atol=1e-12)
    assert q[2].max() - q[2].min() > 1.0, "the relative angle has moved far"


@dataclass(frozen=True)
class SerialPair(Spring):
    """Springs of a serial arm whose compliance of joints 2 and 3 is T diag(k2, k3) T'."""

    corrected: bool = True

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.k{k}", "rad/(N m)", typical=1e-7) for k in (2, 3))

    def virtual_joints(self, robot: RobotFacts) -> tuple[Actuator, ...]:
        return (Actuator("joint_2"), Actuator("joint_3"))

    def mixing(self, x: Array, context: Context) -> Array:
        """T, with the sign of the M-900iB's opposed axes."""
        return np.array([[1.0, 0.0], [1.0, 1.0]]) if self.corrected else np.eye(2)


def test_equation_16_makes_a_serial_arm_give_like_the_parallelogram(m900ib: Experiment) -> None:
    robot, k = m900ib.robot, np.array([1.4e-7, 2.0e-7])
    pendant = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 6))
    poses = Poses(pendant, robot.controller.to_joints(pendant), np.tile([100.0, 800, -4000, 50, 200, 30], (20, 1)))

    def predict(*effects: object) -> Array:
        parameters = [p for e in effects for p in e.parameters(robot.facts)]  # type: ignore[attr-defined]
        site = Site(6, np.array([0.15, 0.0, 0.2]))
        model = make_model(robot.facts, effects, parameters, site, [("m", site)], robot.gravity)  # type: ignore[arg-type]
        x = model.nominal
        x[[i for i, name in enumerate(model.names) if "parallelogram" not in name]] = k
        return model.predict(poses, x, linear=True)

    loop = next(e for e in robot.effects if e.effect_name() == "parallelogram")
    springs = [find_effect("joint_compliance")(joint) for joint in ("joint_2", "joint_3")]  # type: ignore[call-arg]
    closed = predict(loop, *springs)
    assert np.abs(predict(SerialPair()) - closed).max() < 1e-14
    assert np.abs(predict(SerialPair(corrected=False)) - closed).max() > 1e-4


# The balancer: q2 and (22)


def test_q2_names_two_angles(m900ib: Experiment) -> None:
    """The balancer's b is J2 = 90 deg - q2, q2 being link 2's elevation: by the pivots' distance."""
    robot = m900ib.robot
    triangle, q2 = SpringTriangle(0.235, 1.12), np.deg2rad([0.0, 35.0, 60.0, 120.0])
    pendant = np.zeros((4, 6))
    pendant[:, 1] = np.pi / 2 - q2
    q = robot.controller.to_joints(pendant)
    axis_3 = reference_point(m900ib.with_(constraints=replace(m900ib.constraints, of="link_3")), m900ib.model(), q)
    axis_2 = np.array([0.41, 0.0, 0.94])
    assert np.allclose(np.arctan2(axis_3[:, 2] - axis_2[2], axis_3[:, 0] - axis_2[0]), q2, atol=1e-9)
    distance = np.linalg.norm(axis_3 - axis_2 - [0, 0, 0.235], axis=1)
    assert np.allclose(triangle.length(np.pi / 2 - q2), distance, atol=1e-12)
    assert np.abs(triangle.length(q2) - distance).max() > 0.2


def printed(b: Array) -> Array:
    """Rows of (22) as printed, with sin b instead of its square."""
    L, s = TRIANGLE.lc * TRIANGLE.l2, TRIANGLE.length(b)
    return np.stack([np.ones_like(b), L * np.cos(b), L * (L * np.sin(b) / s**3 - np.cos(b) / s)], axis=1)


def test_equation_22_has_the_square_of_the_sine() -> None:
    """K2 + d M_c / d b by differences of (9) is what a row of (22) times [K2, Kc, s0 Kc] has to give."""
    b, K2, Kc, s0, h = np.linspace(-20.0, 130.0, 31), 7e6, 6e6, 0.46, 1e-5
    moment: Callable[[Array], Array] = lambda angle: -TRIANGLE.torque(angle, spring(Kc, s0)).value[:, 0]  # noqa: E731
    numeric = K2 + (moment(np.deg2rad(b) + h) - moment(np.deg2rad(b) - h)) / (2 * h)
    unknowns = np.array([K2, Kc, s0 * Kc])
    assert np.allclose(stiffness_rows(np.deg2rad(b), TRIANGLE.lc, TRIANGLE.l2) @ unknowns, numeric, rtol=1e-8)
    assert np.abs(printed(np.deg2rad(b)) @ unknowns - numeric).max() > 0.05 * np.abs(numeric - K2).max()


# Tables 1 to 4


@pytest.mark.parametrize(("criterion", "loss"), sorted(numbers.RANGES))
def test_table_2_has_its_columns_exchanged(criterion: str, loss: float) -> None:
    """The narrow ranges belong to the trace and the wide ones to the determinant, also where Table 2 heads them
    the other way round from Table 1."""
    other, printed = {"A": "D", "D": "A"}[criterion], numbers.RANGES[criterion, loss]
    ranges = (numbers.table_2(numbers.curve(c), loss) for c in (criterion, other))
    ours, wrong = (np.abs(np.subtract(r, printed)).max() for r in ranges)
    assert ours <= 4.0
    assert wrong > ours


def test_the_determinant_is_its_cube_root() -> None:
    """Three, four, five measurements: 1 : 0.796 : 0.630 in Table 1. The determinant itself would halve each time."""
    _, four, five = numbers.table_1().ratio["D"]
    assert np.allclose([four, five], [0.796, 0.630], atol=0.003)
    assert np.allclose([four**3, five**3], [0.5, 0.25], atol=1e-9)


def test_the_trace_does_not_need_it() -> None:
    """1 : 0.690 : 0.551 in Table 1."""
    assert np.allclose(numbers.table_1().ratio["A"], [1.0, 0.690, 0.551], rtol=0.01, atol=0)


def test_the_weighted_criterion_is_half_the_sum() -> None:
    """Table 1: trace 14.27, determinant 2.11, O3 8.19."""
    assert abs((14.27 + 2.11) / 2 - 8.19) < 0.005
    a, d, o3 = (numbers.curve(name) for name in ("A", "D", "O3"))
    assert np.allclose(o3, (a + d) / 2, rtol=1e-12)


def test_the_last_row_of_table_2_is_a_loss_of_100_percent() -> None:
    """O3: 16.3 is printed at 50 %; from a best value of 8.2 that is twice, and 50 % would be 12.3."""
    assert abs(16.3 / 8.19 - 2.0) < 0.02
    assert abs(8.19 * 1.5 - 12.3) < 0.05


def test_table_3_prints_2_for_a_compliance_that_is_not_seen() -> None:
    """k2(88): a vertical force has nearly no lever on an upright link 2. sd is 17 where 2.00 is printed."""
    sd = {middle: numbers.table_3(middle)[1] for middle in (60.0, 88.0)}
    assert abs(sd[88.0] - 17.0) < 0.2
    assert abs(sd[88.0] / numbers.K2_AT_88 - 8.5) < 0.1
    assert abs(sd[60.0] * np.cos(np.pi / 3) / (sd[88.0] * np.cos(np.deg2rad(88.0))) - 1.0) < 0.05, "as 1 / |cos q2|"


# Table 5: the twelve poses


@pytest.fixture(scope="module")
def paper(m900ib: Experiment) -> Plan:
    return read_plan(example("m900ib") / "table5.csv", m900ib)


def test_row_2_of_table_5_hardly_means_35() -> None:
    """Joint 4 is not seen with 35 nor with 45, and well with 135. A typo: no gain over it is claimed."""
    assert table5.joint_4_share(35.0) > 1.0
    assert table5.joint_4_share(45.0) > 1.0
    assert table5.joint_4_share(135.0) < 0.25


@pytest.mark.parametrize("pair", [(5, 6), (7, 8)])
def test_rows_of_table_5_are_the_same_twice(pair: tuple[int, int]) -> None:
    """The same flange pose with the wrist flipped, hence the same information: ten distinct poses."""
    poses = table5.table_5()
    assert table5.flange_difference(poses, *pair) < 1e-12
    one, other = table5.each_information(poses[[pair[0] - 1, pair[1] - 1]])
    assert np.allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(one).max())
    assert table5.twins(poses) == [(5, 6), (7, 8)], "and no others"


def test_rows_11_and_12_of_table_5_are_too_near_to_axis_1(m900ib: Experiment, paper: Plan) -> None:
    q = m900ib.robot.controller.to_joints(paper.pendant)
    distance = np.hypot(*reference_point(m900ib, m900ib.model(), q)[:, :2].T)
    assert np.allclose(distance[10:], 0.84, atol=0.005)
    assert np.all(distance[:10] >= 1.0)
    allowed = check_poses(m900ib, m900ib.model(), paper.pendant)["axis1_distance_min"]
    assert list(np.flatnonzero(~allowed)) == [10, 11]


def test_rows_1_and_2_of_table_5_are_high_enough_at_the_wrist_centre_only(m900ib: Experiment, paper: Plan) -> None:
    model, q = m900ib.model(), m900ib.robot.controller.to_joints(paper.pendant)

    def height(of: str) -> Array:
        return reference_point(m900ib.with_(constraints=replace(m900ib.constraints, of=of)), model, q)[:2, 2]

    assert np.all(height("wrist_centre") >= 0.5)
    assert np.all(height("flange") < 0.5)
