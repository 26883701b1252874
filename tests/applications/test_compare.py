"""`qsf compare`: every number of the comparison, computed another way; and tasks that cannot be used."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.elastostatics import equilibrium
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import load_experiment, read_readings, simulate
from qsframework.fits import identify, read_fit, write_fit
from qsframework.plans import DesignOptions, design
from qsframework.plugin import Poses
from qsframework.report.compare_section import heat_maps, path_figure, sd_tables
from qsframework.robot import load_robot
from qsframework.robot.collision import lowest_point, make_collider
from qsframework.robot.kinematics import joint_frames
from qsframework.uses.compare import Compared, Comparison, _free, campaign_of, compare, tip_model
from qsframework.uses.inverse import reach, tool_of
from qsframework.uses.robot_from_fit import with_fit
from qsframework.uses.stiffness import stiffness_at
from qsframework.uses.task import Task, load_task
from tests.identify.records import estimate, with_values

NAMES = ("fanuc_m900ib", "fanuc_r2000ic")


@pytest.fixture(scope="module")
def task(root: Path) -> Task:
    """The example with a coarser map and fewer candidates."""
    found = load_task(root / "examples" / "compare" / "task.yaml")
    campaign = found.campaign.model_copy(update={"candidates": 60})
    return replace(found, map_x=found.map_x[::3], map_z=found.map_z[::3], campaign=campaign)


@pytest.fixture(scope="module")
def result(task: Task) -> Comparison:
    return compare([load_robot(name) for name in NAMES], task)


def test_a_robot_is_taken_by_name_by_path_and_as_it_is(result: Comparison, task: Task, root: Path) -> None:
    """A path may be relative to the task's file; what is no robot is refused in words."""
    named = compare([NAMES[0], load_robot(NAMES[1])], task)
    assert named.as_json() == result.as_json()
    assert [r.robot.name for r in named.robots] == list(NAMES)
    beside = replace(task, path=root / "robots" / "task.yaml")
    with pytest.raises(InputError, match="compare needs two or more different robots, found fanuc_m900ib, fanuc_m900i"):
        compare([NAMES[0], Path(NAMES[0]) / "robot.yaml"], beside)
    with pytest.raises(InputError, match=r"unknown robot 'fanuc_m900'.*Did you mean 'fanuc_m900ib'"):
        compare(["fanuc_m900", NAMES[1]], task)


def test_a_comparison_shows_itself(result: Comparison, task: Task, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, a text of the terminal's width, tables in HTML, a row of the frame for each robot and point, a plot."""
    monkeypatch.setenv("COLUMNS", "100")
    assert repr(result).startswith("<Comparison: ")
    assert "\n" not in repr(result)
    assert len(repr(result)) < 400
    text, page = str(result), result._repr_html_()
    assert max(map(len, text.splitlines())) <= 100
    for name in NAMES:
        assert name in text
        assert name in page
    assert page.count("<table>") == 1 + len(sd_tables(result))
    frame = result.to_frame()
    assert list(frame.columns) == ["robot", "point", "deflection_m", "after_m"]
    assert len(frame) == len(NAMES) * len(task.points)
    np.testing.assert_array_equal(frame["deflection_m"], np.concatenate([r.task for r in result.robots]))
    np.testing.assert_array_equal(frame["after_m"], np.concatenate([r.after for r in result.robots]))
    drawn = [np.asarray(trace.y, float) for trace in result.plot().data]
    for r in result.robots:
        assert any(len(y) == len(r.task) and np.allclose(y, 1e3 * r.task, equal_nan=True) for y in drawn)


def test_the_tool_stands_where_it_is_asked(result: Comparison, task: Task) -> None:
    """Position and direction by the kinematics; the flange is `tool` behind the load point, on the last axis."""
    for r in result.robots:
        tool, robot = tool_of(r.robot, task.tool), r.robot
        placed = joint_frames(robot.facts, robot.controller.to_joints(r.pendant))
        place = placed.point(tool.site.link, tool.site.xyz).T
        assert np.abs(place - task.points).max() < 1e-6
        assert np.abs(placed.matrix(tool.site.link) @ tool.axis - task.directions).max() < 1e-6
        flange = placed.point(robot.flange.link, robot.flange.placement[:3, 3]).T
        assert np.allclose(place - flange, task.tool * task.directions, atol=1e-6)
        wrist = placed.positions[robot.facts.n - 1].T
        assert np.all(np.einsum("nc,nc->n", flange - wrist, task.directions) > -1e-9), "it points away from the wrist"
        assert not robot.controller.outside(r.pendant).any()


def test_out_of_reach_is_out_of_reach(task: Task) -> None:
    """Points farther than the stretched arm, and points reached before; none of the first, all of the second."""
    robot = load_robot("fanuc_r2000ic")
    tool = tool_of(robot, 0.2)
    model = tip_model(robot, tool)
    q = np.deg2rad([[0, 10, -10, 0, -70, 0], [40, 20, -20, 30, -60, 0], [-60, 0, 0, -40, 50, 0]])
    placed = joint_frames(robot.facts, robot.controller.to_joints(q))
    near = placed.point(tool.site.link, tool.site.xyz).T
    looks = placed.matrix(tool.site.link) @ tool.axis
    far = 8.0 * near / np.linalg.norm(near, axis=1, keepdims=True)
    found = reach(robot, model, tool, np.vstack([near, far]), np.vstack([looks, looks]))
    assert found.good.tolist() == [True] * 3 + [False] * 3


def test_the_map_is_that_of_qsf_stiffness(result: Comparison, task: Task) -> None:
    """Cells against `stiffness_at`, at the same angles found again."""
    for r in result.robots:
        tool = tool_of(r.robot, task.tool)
        model = tip_model(r.robot, tool)
        z, x = (a.ravel() for a in np.meshgrid(task.map_z, task.map_x, indexing="ij"))
        points = np.stack([x, np.full(len(x), task.map_y), z], axis=1)
        found = reach(r.robot, model, tool, points, np.tile(task.map_direction, (len(x), 1)), 0, _free(r.robot, task))
        pendant, reached = found.pendant, found.good
        assert np.array_equal(reached, r.reached)
        assert 0 < reached.sum() < len(x)
        flange = np.asarray(np.linalg.solve(r.robot.flange.placement, np.append(tool.site.xyz, 1.0)), dtype=float)
        wrench = np.append(task.map_force, np.zeros(3))
        for i in np.flatnonzero(reached)[:: max(1, reached.sum() // 4)]:
            one = stiffness_at(r.robot, pendant[i], wrench, flange[:3])
            assert r.deflection[i] == pytest.approx(np.linalg.norm(one.full), rel=1e-6)
            gives = max(np.linalg.eigvalsh(one.compliance[:3, :3] @ one.compliance[:3, :3].T))
            assert r.softest[i] == pytest.approx(1.0 / np.sqrt(gives), rel=1e-6)
    assert result.shared.sum() == np.logical_and(*(r.reached for r in result.robots)).sum() > 0


def test_the_error_after_compensation_is_found_in_simulation(result: Comparison, task: Task) -> None:
    """Sixty campaigns of the robot's plan: the deflection that each fit predicts along the path, against the true.

    Readings and fits of the linear model, which is quick; the deflections are those of the equilibrium.
    """
    r: Compared = result.robots[1]
    tool = tool_of(r.robot, task.tool)
    experiment, model = campaign_of(r.robot, task, tool), tip_model(r.robot, tool)
    work = Poses(r.pendant, r.robot.controller.to_joints(r.pendant), task.wrenches)
    options = DesignOptions(criterion="I", efficiency=0.99, polish=False)
    plan = design(
        experiment, task.campaign.poses, candidates=task.campaign.candidates, options=options, test_poses=work
    )
    true = equilibrium(model, work).tip - equilibrium(model, work, loaded=False).tip
    assert np.allclose(np.linalg.norm(true, axis=1), r.task, rtol=1e-9)
    squared = []
    for seed in range(60):
        readings = simulate(experiment, plan, seed=seed, linear=True).readings
        fit = identify(experiment, readings, options=FitOptions(linear=True))
        x = model.nominal
        x[model.index(fit.names)] = [e.value for e in fit.estimates]
        said = equilibrium(model, work, x).tip - equilibrium(model, work, x, loaded=False).tip
        squared.append(np.sum((said - true) ** 2, axis=1))
    ratio = np.sqrt(np.mean(squared, axis=0)) / r.after
    assert np.all(np.abs(ratio - 1.0) < 0.25), ratio


def test_a_robot_that_does_not_reach(task: Task) -> None:
    """The UR10 stands beside a heavy one: its own numbers are empty, and said so; its shared cells are few."""
    small = replace(task, map_x=np.array([0.5, 0.7, 2.0]), map_z=np.array([0.3, 0.5]))
    heavy, light = compare([load_robot("fanuc_r2000ic"), load_robot("ur10")], small).robots
    assert np.isfinite(heavy.task).all()
    assert np.isnan(light.task).all()
    assert np.isnan(light.after).all()
    assert light.campaign.endswith("best for the parameters: no point of the path is reached")
    assert np.isfinite(light.sds).all()
    assert any("does not reach point 1, 2, 3, 4, 5" in note for note in light.notes)


def test_loads_that_tell_nothing_are_said(task: Task) -> None:
    """Loads on the last axis tell nothing of joint 6: there is no plan, and the table says why."""
    bare = replace(task, campaign=task.campaign.model_copy(update={"lever": 0.0}))
    first = compare([load_robot(name) for name in NAMES], bare).robots[0]
    assert "joint_compliance[joint_6]: no reading depends on it" in first.campaign
    assert np.isnan(first.after).all()
    assert np.isfinite(first.task).all()


def test_the_figures_hold_the_numbers(result: Comparison, task: Task) -> None:
    figure = heat_maps(result, [r.deflection * 1e3 for r in result.robots], "mm", "Deflection", soft_is_high=True)
    maps = [t for t in figure.data if t["type"] == "heatmap"]
    assert len(maps) == 2
    for trace, r in zip(maps, result.robots, strict=True):
        assert trace["coloraxis"] == "coloraxis", "one scale for all"
        shown = np.array([[np.nan if v is None else v for v in row] for row in trace["z"]])
        expected = r.deflection.reshape(len(task.map_z), len(task.map_x)) * 1e3
        assert np.allclose(shown, np.log10(expected), equal_nan=True)
        assert np.allclose(np.array(trace["customdata"], dtype=float), expected, equal_nan=True)
    bar = figure.layout["coloraxis"]["colorbar"]
    assert np.allclose([float(t) for t in bar["ticktext"]], 10.0 ** np.array(bar["tickvals"]))
    assert len(bar["ticktext"]) > 1
    lines = path_figure(result).data
    assert np.allclose(lines[0]["y"], result.robots[0].task * 1e3)
    assert np.allclose(lines[3]["y"], result.robots[1].after * 1e3)


TEXT = """title: t
tool_mm: 250
approach: [0, 0, -1]
path:
  - {xyz_mm: [1700, 0, 800], fz_N: 600}
map: {x_mm: [600, 2600], z_mm: [0, 2400], steps: 3, fz_N: -1000}
campaign: {poses: 8, sigma_mm: 0.03, candidates: 60, loads: [{name: w, fz_N: -1000, fy_N: 500}]}
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("tool_mm", "tool", "line 2: key 'tool' does not say its unit"),
        ("tool_mm", "tool_kg", "line 2: key 'tool_kg' ends in no unit of this kind"),
        ("[0, 0, -1]", "[0, 0, 0]", "line 3: .*approach needs three numbers"),
        ("[1700, 0, 800]", "[1700, 0]", "line 5: .*xyz needs three numbers"),
        (", fz_N: 600}", "}", "line 5: path, point 1: no force acts there"),
        ("steps: 3, fz_N: -1000", "steps: 3", "line 6: .*the map needs a force"),
        ("[600, 2600]", "[2600, 600]", r"line 6: .*x of the map needs \[from, to\]"),
        ("poses: 8", "poses: 0", "line 7: .*poses"),
        ("name: w, fz_N: -1000, fy_N: 500", "name: w", "line 7: load 'w' is zero"),
        ("title: t", "tittle: t", "line 1: .*tittle"),
    ],
)
def test_wrong_tasks(tmp_path: Path, old: str, new: str, words: str) -> None:
    file = tmp_path / "task.yaml"
    file.write_text(TEXT)
    load_task(file)
    assert old in TEXT
    file.write_text(TEXT.replace(old, new))
    with pytest.raises(InputError, match=words) as caught:
        load_task(file)
    assert "task.yaml" in str(caught.value)


def test_the_command(tmp_path: Path) -> None:
    file, told, page = (tmp_path / name for name in ("task.yaml", "c.json", "c.html"))
    file.write_text(TEXT.replace("steps: 3, fz_N: -1000", "steps: 3, fz_N: -2000"))
    arguments = ["compare", *NAMES, "--task", str(file), "--json", str(told), "--report", str(page)]
    run = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert run.exit_code == 0
    content = json.loads(told.read_text())
    assert set(content["robots"]) == set(NAMES)
    assert len(content["robots"]["fanuc_m900ib"]["deflection_mm"]) == 9
    text = page.read_text()
    for words in (
        "One colour scale".lower(),
        "Along the path",
        "Identifiability",
        "Look for where",
        "8 poses under w",
    ):
        assert words in text, words
    assert "its payload, 165 kg, is less than the 2000 N of the task" in " ".join(run.output.split())
    assert "payload, 700 kg" not in run.output
    for names, words in (
        (["fanuc_m900ib"], "two or more different robots"),
        (["fanuc_m900ib"] * 2, "two or more different robots"),
        (["fanuc_m900ib", "fanuc_r2000"], "Did you mean 'fanuc_r2000ic'"),
    ):
        wrong = CliRunner().invoke(app, ["compare", *names, "--task", str(file)])
        assert isinstance(wrong.exception, InputError)
        assert words in str(wrong.exception)


def test_cells_where_the_arm_touches_itself_or_the_floor_are_not_reached(task: Task) -> None:
    """Every pose that counts is free by the collider's slow matrix and the lowest points; a floor takes cells."""
    robot = load_robot("fanuc_r2000ic")
    low = replace(task, map_z=np.linspace(-0.4, 0.8, 5), map_x=np.linspace(0.7, 2.2, 5), floor=0.3)
    tool, model = tool_of(robot, low.tool), tip_model(robot, tool_of(robot, low.tool))
    z, x = (a.ravel() for a in np.meshgrid(low.map_z, low.map_x, indexing="ij"))
    points, looks = np.stack([x, np.zeros(len(x)), z], axis=1), np.tile(low.map_direction, (len(x), 1))
    found = reach(robot, model, tool, points, looks, 0, _free(robot, low))
    placed = joint_frames(robot.facts, robot.controller.to_joints(found.pendant[found.good]))
    assert not make_collider(robot).matrix(placed).any()
    assert min(float(lowest_point(s, placed).min()) for s in robot.shapes if s.link > 0) >= 0.3
    anywhere = reach(robot, model, tool, points, looks)
    assert found.good.sum() < anywhere.good.sum()
    assert (found.blocked & ~found.good).sum() > 0
    assert not (found.blocked & ~anywhere.good).any()
    two = compare([robot, load_robot("fanuc_m900ib")], low).robots[0]
    assert two.touching == found.blocked.sum()
    assert any(f"{two.touching} cells of the map excluded for collision with the arm itself" in n for n in two.notes)


ALONE = "that the fit explains its readings was not checked: its experiment is not beside it. Put both into one folder"


def fit_of(root: Path, folder: Path) -> Path:
    """A fit of the real readings of the R-2000iC, as a file."""
    experiment = load_experiment(root / "examples" / "r2000ic" / "experiment.yaml")
    assert experiment.data is not None
    return write_fit(identify(experiment, read_readings(experiment.data, experiment)), folder / "fit.json")


def test_identified_values_stand_in_for_the_nominal(root: Path, task: Task, tmp_path: Path) -> None:
    fit = read_fit(fit_of(root, tmp_path))
    robot, others = with_fit(load_robot("fanuc_r2000ic"), fit)
    assert others == (ALONE,)
    values = {p.name: p.nominal for p in robot.parameters}
    assert [values[n] for n in fit.names] == pytest.approx(fit.values.tolist())
    small = replace(task, map_x=np.array([1.5, 1.8]), map_z=np.array([0.8, 1.0]))
    measured = compare([robot, load_robot("fanuc_m900ib")], small).robots[0]
    plain = compare([load_robot("fanuc_r2000ic"), load_robot("fanuc_m900ib")], small).robots[0]
    tool = tool_of(robot, small.tool)
    flange = np.asarray(np.linalg.solve(robot.flange.placement, np.append(tool.site.xyz, 1.0)), dtype=float)
    one = stiffness_at(robot, measured.pendant[0], small.wrenches[0], flange[:3])
    assert measured.task[0] == pytest.approx(np.linalg.norm(one.full), rel=1e-6)
    assert abs(measured.task[0] / plain.task[0] - 1.0) > 0.01
    assert any("with identified values of" in note for note in measured.notes)


def test_wrong_fits(root: Path, tmp_path: Path) -> None:
    fit, robot = read_fit(fit_of(root, tmp_path)), load_robot("fanuc_r2000ic")
    with pytest.raises(InputError, match=r"fit\.json: the fit is of another robot; found fanuc_r2000ic"):
        with_fit(load_robot("ur10"), fit)
    with pytest.raises(InputError, match="estimates no parameter of fanuc_r2000ic"):
        with_fit(robot, replace(fit, estimates=(estimate("frame[s].x", 0.0, 1.0),)))
    bad = with_values(fit, {fit.names[2]: -1e-7})
    with pytest.raises(InputError, match=r"joint_compliance\[joint_3\] is beyond its bounds.*within bounds"):
        with_fit(robot, bad)
    C, more = np.pad(fit.covariance, (0, 1)), (*fit.estimates, estimate("frame[s].x", 0.0, 1.0))
    extra = replace(fit, estimates=more, covariance=C, total_covariance=None, held=())
    left = "estimates that are no effects of its robot.yaml are omitted: frame[s].x"
    assert with_fit(robot, extra)[1] == (ALONE, left)


def test_the_command_takes_fits(root: Path, tmp_path: Path) -> None:
    (tmp_path / "task.yaml").write_text(TEXT)
    fit, told = fit_of(root, tmp_path), tmp_path / "c.json"
    arguments = ["compare", *NAMES, "--task", str(tmp_path / "task.yaml"), "--json", str(told)]
    run = CliRunner().invoke(app, [*arguments, "--fit", f"fanuc_r2000ic={fit}"], catch_exceptions=False)
    assert run.exit_code == 0
    assert "with identified values of" in run.output
    for r in json.loads(told.read_text())["robots"].values():
        known = [v for v in r["task_deflection_mm"] if v is not None]
        assert r["task_mean_mm"] == pytest.approx(np.mean(known))
        assert r["task_worst_mm"] == pytest.approx(max(known))
        after = [v for v in r["task_after_compensation_mm"] if v is not None]
        assert r["after_compensation_worst_mm"] == pytest.approx(max(after))
        assert all(s["sd"] > 0 for s in r["sds"].values())
    for wrong, words in ((str(fit), "--fit: not understood"), (f"ur10={fit}", "this robot is not compared")):
        failed = CliRunner().invoke(app, [*arguments, "--fit", wrong])
        assert isinstance(failed.exception, InputError)
        assert words in str(failed.exception)
