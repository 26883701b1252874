"""The tables of docs/paper.md: numbers against what the paper prints, page and files against what the script writes."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import make_paper
import numpy as np
import paper_numbers as paper
import paper_table5 as table5
import paper_wrist as wrist
import pytest
from paper_steps import loss_range

from qsframework.plans import CRITERIA, design, generate_candidates
from qsframework.plans.candidates import reference_point


@pytest.fixture(scope="module")
def text(root: Path) -> str:
    return (root / "docs" / "paper.md").read_text()


@pytest.fixture(scope="module")
def designed() -> make_paper.Designed:
    return make_paper.read_designed()


# Tables 1 and 2


@pytest.mark.parametrize("name", ["A", "D"])
def test_table_1_ratios_within_1_percent(name: str) -> None:
    assert np.allclose(paper.table_1().ratio[name], paper.RATIO[name], rtol=0.01, atol=0)


@pytest.mark.parametrize("name", paper.CRITERIA_NAMES)
def test_every_cell_of_table_1_within_1_percent(name: str) -> None:
    """The first three set the units of O1 and O2; the value per configuration is the value times the count."""
    value = np.array(paper.table_1().value[name])
    assert np.allclose(value, paper.TABLE_1[name], rtol=0.01, atol=0)
    each = [float(v) for v in paper.PER_CONFIGURATION[name]]
    assert np.allclose(value * paper.COUNTS, each, rtol=0.01, atol=0)


@pytest.mark.parametrize("name", paper.CRITERIA_NAMES)
def test_every_value_of_table_2_is_its_share_above_the_best(name: str) -> None:
    angle, best = (float(v) for v in paper.TABLE_2_BEST[name])
    assert abs(paper.best_middle(paper.paper_curve(name)) - angle) <= 2.0
    least = paper.paper_curve(name).min()
    assert np.isclose(least, best, rtol=0.005)
    for loss, printed in zip(make_paper.LOSSES, paper.TABLE_2_VALUE[name], strict=True):
        share = 1.0 if (name, loss) == ("O3", 0.5) else loss  # the error in print
        assert np.isclose((1.0 + share) * least, float(printed), rtol=0.01)


@pytest.mark.parametrize(("loss", "share"), [(0.1, 0.1), (0.2, 0.2), (0.5, 1.0)])
def test_the_ranges_of_o3_in_table_2_within_4_deg(loss: float, share: float) -> None:
    computed = paper.table_2(paper.paper_curve("O3"), share)
    assert np.abs(np.subtract(computed, paper.O3_RANGES[loss])).max() <= 4.0


@pytest.mark.parametrize("name", ["A", "D"])
def test_table_1_best_middle_angle_within_2_deg(name: str) -> None:
    """47.1 and 50 deg printed, 46.5 and 48.2 found."""
    assert abs(paper.best_middle(paper.curve(name)) - paper.BEST_MIDDLE[name]) <= 2.0


@pytest.mark.parametrize("name", ["A", "D"])
def test_the_best_four_and_five_repeat_the_best_three(name: str) -> None:
    three, four, five = paper.table_1().angles[name]
    for more in (four, five):
        assert all(min(abs(a - b) for b in three) <= 2.5 for a in more)
        assert len({min(three, key=lambda b: abs(a - b)) for a in more}) == 3


@pytest.mark.parametrize("name", ["A", "D"])
def test_the_search_for_angles_misses_nothing(name: str) -> None:
    """Against all designs of three and of four angles on a grid of 2.5 deg, repeats allowed."""
    grid = np.arange(0.0, 120.1, 2.5)
    rows = paper.stiffness_rows(np.deg2rad(grid), *paper.FITTED)
    each = rows[:, :, None] * rows[:, None, :]
    for count, found in zip((3, 4), paper.table_1().angles[name], strict=False):
        index = np.array(list(itertools.combinations_with_replacement(range(len(grid)), count)))
        values = CRITERIA[name].value(each[index].sum(axis=1))
        assert paper.step_two_value(name, found) <= values.min() * (1.0 + 1e-12)
        assert paper.step_two_value(name, found) >= values.min() * 0.99


def test_d_depends_on_the_ratio_of_the_lengths_alone_and_a_hardly() -> None:
    def best(name: str, factor: float) -> float:
        sides = (paper.FITTED[0] * factor, paper.FITTED[1] * factor)
        middles = np.arange(30.0, 60.0, 0.5)
        return float(middles[np.argmin([paper.step_two_value(name, (0.0, m, 120.0), sides=sides) for m in middles])])

    assert best("D", 0.5) == best("D", 1.0) == best("D", 2.0)
    assert [round(abs(best("A", f) - best("A", 1.0)), 1) for f in (0.5, 2.0)] == [1.0, 2.5]


@pytest.mark.parametrize(("name", "loss"), sorted(paper.RANGES))
def test_table_2_ends_within_4_deg(name: str, loss: float) -> None:
    computed = paper.table_2(paper.curve(name), loss)
    assert np.abs(np.subtract(computed, paper.RANGES[name, loss])).max() <= 4.0


def test_o3_in_the_papers_units_moves_by_less_than_1_deg() -> None:
    """With trace and determinant scaled to the printed 14.27 and 2.11 first."""
    a, d = (paper.BEST_VALUE[c] * paper.curve(c) / paper.curve(c).min() for c in ("A", "D"))
    theirs, ours = (a + d) / 2, paper.curve("O3")
    assert abs(theirs.min() - paper.BEST_VALUE["O3"]) < 0.01
    assert abs(paper.best_middle(theirs) - paper.best_middle(ours)) < 1.0
    for loss in make_paper.LOSSES:
        assert np.abs(np.subtract(paper.table_2(theirs, loss), paper.table_2(ours, loss))).max() < 1.0


# Tables 3 and 4


@pytest.mark.parametrize("middle", [20.0, 35.0, 60.0, 88.0])
def test_table_3_by_a_computation_of_its_own(middle: float) -> None:
    """The six poses' displacements by differences of the end's position; within 0.01."""
    force, h, rows = 1.0, 1e-6, []
    for q2, q3 in itertools.product(np.deg2rad([0.0, middle, 120.0]), np.deg2rad([-30.0, 30.0])):
        end = lambda a, b: 1.12 * np.exp(1j * a) + 1.285 * np.exp(1j * b)  # noqa: E731
        slopes = (end(q2 + h, q3) - end(q2 - h, q3)) / (2 * h), (end(q2, q3 + h) - end(q2, q3 - h)) / (2 * h)
        row = np.zeros(5, dtype=complex)
        row[[0.0, middle, 120.0].index(round(float(np.rad2deg(q2)), 6))] = slopes[0] * slopes[0].imag * force
        row[3 + int(q3 > 0)] = slopes[1] * slopes[1].imag * force
        rows += [row.real, row.imag]
    _, R = np.linalg.qr(np.array(rows))
    sd = np.linalg.norm(np.linalg.inv(R), axis=1)
    assert np.abs(paper.table_3(middle) - sd).max() < 0.01 * (1.0 if middle < 80 else 2.0)


@pytest.mark.parametrize("row", range(5))
def test_every_cell_of_table_3_but_one_within_a_hundredth(row: int) -> None:
    middle, printed = paper.TABLE_3[row]
    off = np.abs(paper.table_3(middle)[list(paper.COLUMN_ORDER)] - printed)
    if middle == 88.0:
        assert off[2] > 10.0, "the error in print"
        off[2] = 0.0
    assert off.max() < 0.01


@pytest.mark.parametrize("column", range(5))
def test_every_cell_of_table_4(column: int) -> None:
    """Ends within 0.7 deg, values within 0.01."""
    angle, value = paper.table_4_best(column)
    assert abs(angle - paper.TABLE_4_BEST[column][0]) <= 0.6
    assert abs(value - paper.TABLE_4_BEST[column][1]) < 0.006
    for loss, cells in paper.TABLE_4.items():
        ends, printed = cells[column]
        assert np.abs(np.subtract(paper.table_4(loss, column), ends)).max() <= 0.7
        assert abs((1.0 + loss) * value - printed) < 0.01


def test_the_last_column_of_table_4_is_that_of_table_2() -> None:
    assert paper.TABLE_4_LAST[0.1] == paper.O3_RANGES[0.1]
    assert [paper.TABLE_4_LAST[loss] for loss in (0.2, 0.5)] == [paper.RANGES["A", loss] for loss in (0.2, 0.5)]


# Figure 6 and section 5.3


def test_figure_6_stands_where_the_model_has_the_wrist() -> None:
    poses = table5.table_5()
    q2, q3 = np.deg2rad(90.0 - poses[:, 1]), np.deg2rad(poses[:, 2])
    limits = wrist.row_limits(poses)
    x, z = wrist.wrist_centre(q2, q3)
    assert np.allclose(x, [r.distance for r in limits], atol=1e-9)
    assert np.allclose(z, [r.height for r in limits], atol=1e-9)
    assert np.allclose(np.abs(np.cos(q2 - q3)), np.abs(np.cos(np.deg2rad([r.flat for r in limits]))), atol=1e-9)


def test_the_papers_ranges_of_q2_and_q3_keep_the_height_and_not_the_distance() -> None:
    """112 deg and more come nearer than 1 m with the forearm at 30 deg; with -30 deg none does."""
    q2, q3 = (a.ravel() for a in np.meshgrid(np.deg2rad(np.arange(0, 121)), np.deg2rad(np.arange(-30, 31))))
    assert wrist.wrist_centre(q2, q3)[1].min() > wrist.Z_MIN
    ends = np.deg2rad(np.array([110.0, 112.0, 120.0]))
    near = wrist.wrist_centre(ends, np.deg2rad(30.0 * np.ones(3)))[0] < wrist.AXIS_1_MIN
    assert near.tolist() == [False, True, True]
    assert wrist.wrist_centre(ends, np.deg2rad(-30.0 * np.ones(3)))[0].min() > wrist.AXIS_1_MIN


def test_the_rules_for_the_wrist_name_good_angles_not_their_combination() -> None:
    paper_, rule, free = table5.table_5(), wrist.by_the_rule(), wrist.free()
    for poses in (rule.pendant_deg, free.pendant_deg):
        assert np.array_equal(poses[:, :3], paper_[:, :3])
    assert {tuple(np.abs(w)) for w in rule.pendant_deg[:, 3:]} <= {(a, 30.0, b) for a in (45, 135) for b in (45, 135)}
    d = table5.criterion("D", paper_), rule.d, free.d
    assert d[1] / d[0] == pytest.approx(0.51, abs=0.02)
    assert d[2] / d[1] == pytest.approx(0.75, abs=0.02)
    assert table5.criterion("D", free.pendant_deg) == pytest.approx(free.d, rel=1e-9)


def test_no_single_wrist_of_the_rule_makes_its_plan_better() -> None:
    rule = wrist.by_the_rule()
    for row, choice in itertools.product((0, 4, 11), itertools.product(*wrist.RULE)):
        other = rule.pendant_deg.copy()
        other[row, 3:] = choice
        assert table5.criterion("D", other) >= rule.d * (1.0 - 1e-9)


# 35 deg


@pytest.mark.parametrize(("name", "alike", "weighted"), [("A", 46.5, 36.0), ("D", 48.0, 38.5)])
def test_weights_of_step_one_move_the_best_middle_angle(name: str, alike: float, weighted: float) -> None:
    assert abs(paper.best_middle(paper.curve(name)) - alike) <= 0.3
    curve = paper.curve(name, paper.step_one)
    assert abs(paper.best_middle(curve) - weighted) <= 0.3
    assert paper.loss_at(curve, 35.0) < 0.01


def test_48_deg_loses_a_fifth() -> None:
    assert abs(paper.loss_at(paper.curve("A", paper.step_one), 48.0) - 0.21) < 0.01


def test_on_the_robot_35_deg_is_not_the_best() -> None:
    assert abs(paper.on_the_robot("A").times - 1.8) < 0.05
    assert abs(paper.on_the_robot("D").times - 1.08) < 0.01


# Table 5


def test_the_plan_keeps_the_papers_limits_and_the_papers_does_not(designed: make_paper.Designed) -> None:
    assert table5.broken(designed.plan) == {}
    assert table5.broken(table5.table_5()) == {"transmission angle": [7, 8], "axis1_distance_min": [11, 12]}


@pytest.mark.parametrize("name", ["A", "D", "O3"])
def test_the_plan_beats_table_5(name: str, designed: make_paper.Designed) -> None:
    assert table5.criterion(name, designed.plan) < 0.5 * table5.criterion(name, table5.table_5())


def test_the_plan_knows_every_joint_better(designed: make_paper.Designed) -> None:
    assert np.all(table5.sd_share(designed.plan) < table5.sd_share(table5.table_5()))


def test_the_pages_plan_is_as_good_as_one_designed_now(designed: make_paper.Designed) -> None:
    """Solvers may find other poses, not worse ones: D within 5 %."""
    new = design(table5.vertical(), make_paper.POSES, "D", candidates=make_paper.CANDIDATES, seed=make_paper.SEED)
    now = table5.criterion("D", np.rad2deg(new.repeated().pendant))
    assert abs(table5.criterion("D", designed.plan) / now - 1.0) < 0.05, "run: python docs/paper/make_paper.py"


# Section 5.1


def test_joint_1_is_not_seen_under_the_weight() -> None:
    assert table5.unseen_under_weight() == "joint_compliance[joint_1]: no reading depends on it"


def test_for_joint_1_alone_the_arm_is_stretched_across_the_force(designed: make_paper.Designed) -> None:
    new = design(table5.side_pull(False), 1, "D", candidates=make_paper.CANDIDATES, seed=make_paper.SEED)
    for poses in (designed.side, np.rad2deg(new.pendant)):
        assert table5.reach(poses)[0] > 0.98 * table5.largest_reach()
        assert table5.lever(poses)[0] > 0.98 * table5.largest_reach()


def test_with_the_others_unknown_the_wrist_lies_along_the_force(designed: make_paper.Designed) -> None:
    random = np.rad2deg(generate_candidates(table5.vertical(), 500, 0).pendant)
    usual = np.median(np.abs(table5.wrist_torques(random)), axis=0)
    assert abs(np.median(table5.wrist_angle(random, table5.SIDE_PULL[:3])) - 60.0) < 3.0
    for poses in (designed.side_among_unknown, table5.climb(table5.told_of_joint_1, seed=1)):
        assert table5.wrist_angle(poses, table5.SIDE_PULL[:3])[0] < 15.0
        assert table5.reach(poses)[0] > 0.9 * table5.largest_reach()
        assert np.all(np.abs(table5.wrist_torques(poses)[0, [0, 2]]) < 0.5 * usual[[0, 2]])


def test_the_wrists_torques_are_what_the_energy_says() -> None:
    """tau = d (F . p) / d q by differences of the load point's position; pendant joints 4 to 6 are the URDF's."""
    pose, h = np.array([[20.0, 40.0, -30.0, 50.0, 60.0, 70.0]]), 1e-3

    def along_force(joint: int, step: float) -> float:
        moved = pose.copy()
        moved[0, joint] += step
        experiment = table5.vertical()
        at_load = experiment.with_(constraints=replace(experiment.constraints, of="load_point"))
        q = experiment.robot.controller.to_joints(np.deg2rad(moved))
        return float(reference_point(at_load, experiment.model(), q)[0] @ table5.SIDE_PULL[:3])

    numeric = [(along_force(k, h) - along_force(k, -h)) / np.deg2rad(2 * h) for k in (3, 4, 5)]
    assert np.allclose(table5.wrist_torques(pose)[0], numeric, atol=1e-4)


def test_the_largest_reach_is_that_of_a_stretched_arm() -> None:
    """By plane geometry: link 2 at e, forearm 15 deg below it, the load point as far out as the flange turns it."""
    e = np.deg2rad(np.arange(-20.0, 20.0, 0.01))
    forearm = e - np.deg2rad(15.0)
    wrist = 0.41 + 1.12 * np.cos(e) + 1.285 * np.cos(forearm) - 0.25 * np.sin(forearm)
    assert abs(table5.largest_reach() - (wrist.max() + np.hypot(0.3 + 0.15, 0.2))) < 1e-3


# The page


def test_the_page_and_its_tables_are_what_the_script_writes(
    root: Path, text: str, designed: make_paper.Designed
) -> None:
    written, tables = make_paper.written(designed)
    shown = text.split(make_paper.START)[1].split(make_paper.STOP)[0]
    assert written == shown, "run: python docs/paper/make_paper.py --keep"
    records = root / "docs" / "records"
    assert {path.name: path.read_text() for path in records.glob("paper-*.csv")} == tables


def test_the_pictures_are_what_the_script_draws(root: Path) -> None:
    for name, drawn in make_paper.pictures().items():
        assert (root / "docs" / "images" / name).read_text() == drawn, (
            f"{name}: run python docs/paper/make_paper.py --keep"
        )
        ElementTree.fromstring(drawn)


def test_every_picture_of_the_page_is_drawn(text: str) -> None:
    assert sorted(re.findall(r"images/(paper-\w+\.svg)", text)) == sorted(make_paper.pictures())


def test_a_curve_is_drawn_where_it_belongs() -> None:
    """The trace's lowest point in the picture, back in degrees, is its best middle angle."""
    drawn = ElementTree.fromstring(make_paper.pictures()["paper-A.svg"])
    points = next(e for e in drawn.iter() if e.tag.endswith("polyline")).attrib["points"].split()
    x, _ = max((tuple(map(float, p.split(","))) for p in points), key=lambda p: p[1])
    left, width = make_paper.plots.LEFT, make_paper.plots.WIDTH - make_paper.plots.LEFT - make_paper.plots.RIGHT
    assert abs((x - left) / width * 120.0 - paper.best_middle(paper.curve("A"))) < 1.5


def test_a_range_stops_where_a_list_stops() -> None:
    assert loss_range(np.array([1.0, 2.0]), np.array([1.0, 1.1]), 0.5) == (1.0, 2.0)
