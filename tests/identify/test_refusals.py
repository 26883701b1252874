"""Every bad input that a user may bring is an error that says what to do; a fit that failed is never a result.

Poses all equal: test_states.py; absolute positions without a tracker frame: test_absolute.py.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer

from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.estimation import FitOptions, Independent, Observations, solve
from qsframework.experiment import (
    Experiment,
    Readings,
    load_experiment,
    make_plan,
    read_readings,
    simulate,
    write_readings,
)
from qsframework.fits import identify
from qsframework.plugin import Parameter, Poses


def readings_of(experiment: Experiment, count: int = 6) -> Readings:
    controller = experiment.robot.controller
    draws = np.random.default_rng(2).uniform(controller.lower, controller.upper, (count, 6)) * 0.6
    pendant = draws
    wrench = np.tile([0.0, 1500.0, -3000.0, 0.0, 0.0, 0.0], (count, 1))
    plan = make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["pull"] * count)
    return simulate(experiment, plan, seed=0).readings


@pytest.fixture(scope="module")
def lines(m900ib: Experiment, tmp_path_factory: pytest.TempPathFactory) -> list[list[str]]:
    file = tmp_path_factory.mktemp("good") / "r.csv"
    write_readings(file, readings_of(m900ib), m900ib)
    return [line.split(",") for line in file.read_text().splitlines() if not line.startswith("#")]


def rewritten(lines: list[list[str]], folder: Path, column: str, value: str, row: int | None = None) -> Path:
    """The file with one column's value changed, in one row or in all; added where it is missing."""
    head = lines[0] if column in lines[0] else [*lines[0], column]
    out = [",".join(head)]
    for i, line in enumerate(lines[1:]):
        cells = [*line, *[""] * (len(head) - len(line))]
        if row is None or i == row:
            cells[head.index(column)] = value
        out.append(",".join(cells))
    file = folder / "r.csv"
    file.write_text("\n".join(out) + "\n")
    return file


def test_fewer_readings_than_parameters(m900ib: Experiment) -> None:
    few = readings_of(m900ib)
    few = replace(few, use=np.arange(len(few.use)) < 1)
    for options in (FitOptions(), FitOptions(linear=True)):
        with pytest.raises(InputError, match="1 reading gives 3 numbers: too few for"):
            identify(m900ib, few, options=options)


def test_no_load(m900ib: Experiment, lines: list[list[str]], tmp_path: Path) -> None:
    zero = lines
    for column in ("fx_N", "fy_N", "fz_N"):
        file = rewritten(zero, tmp_path, column, "0")
        zero = [line.split(",") for line in file.read_text().splitlines()]
    with pytest.raises(InputError, match="every force is zero; a displacement under no load carries no information"):
        read_readings(tmp_path / "r.csv", m900ib)


def test_a_load_row_of_zero(m900ib: Experiment, lines: list[list[str]], tmp_path: Path) -> None:
    zero = lines
    for column in ("fx_N", "fy_N", "fz_N"):
        head = zero[0]
        pose = zero[1][head.index("pose")]
        zero = [zero[0]] + [
            [
                "0" if name == column and line[head.index("pose")] == pose else cell
                for name, cell in zip(head, line, strict=True)
            ]
            for line in zero[1:]
        ]
    file = tmp_path / "r.csv"
    file.write_text("\n".join(",".join(line) for line in zero) + "\n")
    with pytest.raises(InputError, match="no force and no moment") as caught:
        read_readings(file, m900ib)
    problem = caught.value.problems[0]
    assert problem.line == 2
    assert "use = 0" in str(problem.hint)
    masked = rewritten(zero, tmp_path, "use", "1")
    content = masked.read_text().splitlines()
    count = sum(line[zero[0].index("pose")] == zero[1][zero[0].index("pose")] for line in zero[1:])
    at = content[0].split(",").index("use")
    for i in range(1, count + 1):
        cells = content[i].split(",")
        cells[at] = "0"
        content[i] = ",".join(cells)
    masked.write_text("\n".join(content) + "\n")
    assert len(read_readings(masked, m900ib).use) == len(lines) - 1


@pytest.mark.parametrize("value", ["0", "-0.02"])
def test_sigma_zero(m900ib: Experiment, lines: list[list[str]], tmp_path: Path, value: str) -> None:
    with pytest.raises(InputError, match="must be positive") as caught:
        read_readings(rewritten(lines, tmp_path, "sigma_mm", value, row=3), m900ib)
    assert caught.value.problems[0].line == 5
    with pytest.raises(InputError, match="the noise of every reading must be a positive number"):
        Independent(np.array([1.0, 0.0]))


def test_sigma_missing_in_some_rows(m900ib: Experiment, lines: list[list[str]], tmp_path: Path) -> None:
    unknown = m900ib.with_(noise=replace(m900ib.noise, sigma=None))
    file = rewritten(lines, tmp_path, "sigma_mm", "", row=3)
    with pytest.raises(InputError, match=r"1 readings have no sigma_mm and the experiment states no noise") as caught:
        read_readings(file, unknown)
    assert caught.value.problems[0].line == 5
    assert "Give all of them or none" in str(caught.value)
    assert read_readings(file, m900ib).stated, "the experiment's noise fills the gap"


def test_a_marker_that_is_nowhere_defined(m900ib: Experiment, lines: list[list[str]], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the experiment has no such marker") as caught:
        read_readings(rewritten(lines, tmp_path, "marker", "nose", row=0), m900ib)
    problem = caught.value.problems[0]
    assert problem.line == 2
    assert m900ib.markers[0].name in str(problem.allowed)


def test_a_fit_that_did_not_converge_is_no_result() -> None:
    """A model whose derivative has the wrong sign: no step lowers the error."""
    false = Observations(
        measured=np.ones(3),
        predict=lambda x: np.full(3, 5.0) + x[0],
        jacobian=lambda x: np.full((3, 1), -1.0),
        parameters=(Parameter("a", "1", typical=1.0),),
        noise=Independent(np.ones(3)),
        block=np.arange(3),
        row=np.arange(3),
    )
    with pytest.raises(
        NotConverged, match=r"stuck after \d+ steps.*start nearer|did not settle in \d+ steps.*fix this parameter"
    ):
        solve(false)


def test_the_advice_names_options_that_exist(m900ib: Experiment) -> None:
    """One pose, too few readings: what the errors advise can be typed."""
    from qsframework.cli.app import app

    one = readings_of(m900ib)
    q, pendant = (np.repeat(v[:1], len(one.poses), axis=0) for v in (one.poses.q, one.poses.pendant))
    q = q + 1e-5 * np.random.default_rng(0).standard_normal(q.shape)
    alone = one.with_poses(replace(one.poses, q=q, pendant=pendant))
    said: list[str] = []
    for given in (alone, replace(one, use=(one.plus == 0) & (one.marker == 0))):
        with pytest.raises((InputError, NotIdentifiable)) as caught:
            identify(m900ib, given)
        said.append(str(caught.value))
    assert "are of one pose: 6 parameters would rest on a single geometry" in said[0]
    assert "or hold the others fixed" in said[0]
    assert "1 reading gives 3 numbers: too few for" in said[1]
    assert "measure more poses, or fit fewer" in said[1]
    command = typer.main.get_group(app).commands["identify"]
    known = {option for parameter in command.params for option in parameter.opts}
    named = set(re.findall(r"--[a-z-]+", " ".join(said)))
    assert {"--fit", "--fixed", "--free", "--method"} <= known
    assert named <= known, named - known


def test_a_row_pasted_twice_is_refused_with_what_to_do(
    m900ib: Experiment, lines: list[list[str]], tmp_path: Path
) -> None:
    file = tmp_path / "r.csv"
    file.write_text("\n".join(",".join(line) for line in [*lines, lines[3]]) + "\n")
    with pytest.raises(InputError, match=r"stands here twice; first in line 4. Delete the row .* column repeat"):
        read_readings(file, m900ib)
    again = [*lines[3]]
    again[lines[0].index("repeat")] = "2"
    file.write_text("\n".join(",".join(line) for line in [*lines, again]) + "\n")
    assert len(read_readings(file, m900ib).use) == len(lines)


def test_a_missing_key_is_shown_as_it_should_look(tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    text = "robot: fanuc_m900ib\nload: {point_mm: [150, 0, 200]}\n"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        load_experiment(file)
    said = str(caught.value)
    for key, shown in (("markers", "{m1: {xyz_mm: [150, 0, 200]}}"), ("noise", "{sigma_mm: 0.03}")):
        assert f"key '{key}' is missing. Add for example `{key}: {shown}`" in said
        text += f"{key}: {shown}\n"
    file.write_text(text)
    assert load_experiment(file).noise.sigma == pytest.approx(3e-5)
