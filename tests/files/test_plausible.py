"""A number that no robot cell has is refused where it is read, whatever file or option it stands in."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from qsframework import units
from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.experiment import example, load_experiment, read_plan, read_readings
from qsframework.plausible import LOADS, RANGES, beyond, too_strong
from qsframework.uses.targets import read_targets

EXPERIMENT = """robot: {robot}
load: {{point_mm: [{point}]}}
loads:
  - {{name: w, force_N: [0, 0, -1500]}}
markers:
  m1: {{xyz_mm: [150, 250, 250]}}
noise: {{sigma_mm: {sigma}}}
"""
HEAD = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N"


@pytest.mark.parametrize("si", RANGES)
def test_the_table_is_in_si_and_bounds_both_signs(si: str) -> None:
    assert units.conversion(si)[:2] == (1.0, 0.0)
    known = RANGES[si]
    for sign in (1.0, -1.0):
        assert beyond(sign * known.most, si) is None
        assert beyond(sign * 1.001 * known.most, si) is known
        if known.least:
            assert beyond(sign * 0.999 * known.least, si) is known
    assert beyond(0.0, si) is None
    assert known.source


def test_forces_are_held_against_the_payload() -> None:
    weight = 100.0 * 9.81
    assert too_strong((0.0, 0.0, -LOADS * weight), 100.0, 9.81) is None
    assert too_strong((0.0, LOADS * weight, -weight), 100.0, 9.81) is not None
    assert too_strong((0.0, 0.0, 1e9), None, 9.81) is None, "nobody states a payload"


def wrong(*arguments: object) -> str:
    done = CliRunner().invoke(app, [str(a) for a in arguments])
    assert isinstance(done.exception, InputError), done.output
    return str(done.exception)


def test_files_of_an_experiment(tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    for robot, point, sigma, words in (
        ("fanuc_r2000ic", "150000, 0, 200", "0.03", "line 2: load.point_mm[0] is no length; found 150000"),
        ("fanuc_r2000ic", "150, 0, 200", "3e9", "line 7: noise.sigma_mm is no length"),
    ):
        file.write_text(EXPERIMENT.format(robot=robot, point=point, sigma=sigma))
        with pytest.raises(InputError) as error:
            load_experiment(file)
        assert words in str(error.value)
        assert "allowed: up to 100000 mm" in str(error.value)


def test_files_of_a_robot(tmp_path: Path, root: Path) -> None:
    import shutil

    source = root / "robots" / "fanuc_r2000ic"
    for name, old, new, words in (
        ("r2000ic.urdf.xacro", 'name="a2" value="1.075"', 'name="a2" value="1075"', "is no length of an arm"),
        ("robot.yaml", "limits_deg: [-185, 185]", "limits_deg: [-1000000, 1000000]", "is no angle"),
        ("robot.yaml", "payload_kg: 165", "payload_kg: 165000000", "is no mass"),
        ("robot.yaml", "effects:", "gravity_m/s^2: [0, 0, -981]\neffects:", "is no acceleration"),
    ):
        robot = tmp_path / "robot"
        shutil.rmtree(robot, ignore_errors=True)
        shutil.copytree(source, robot)
        text = (robot / name).read_text()
        assert old in text
        (robot / name).write_text(text.replace(old, new, 1))
        said = wrong("check", robot / "robot.yaml")
        assert words in said, said
        assert "robot/" + name + ", line" in said
    shutil.rmtree(robot)
    shutil.copytree(source, robot)
    nominal = robot / "nominal.yaml"
    key = next(line for line in nominal.read_text().splitlines() if "value_" in line)
    nominal.write_text(nominal.read_text().replace(key, f"{key.split(':')[0]}: 5e30", 1))
    assert "nominal.yaml, line" in wrong("check", robot / "robot.yaml")
    nominal.write_text(nominal.read_text().replace("5e30", "1e-25", 1))
    assert "is no compliance" in wrong("check", robot / "robot.yaml")


def test_tables(tmp_path: Path) -> None:
    experiment = load_experiment(example("r2000ic") / "experiment.yaml")
    plan = tmp_path / "plan.csv"
    plan.write_text(f"{HEAD}\na,10,20,-10,5,60,0,0,0,-1500\nb,10,20,-10,5,60,0,0,0,-4000000\n")
    with pytest.raises(InputError, match=r"line 3, column fz_N: .*allowed: up to 1e\+06 N"):
        read_plan(plan, experiment)
    plan.write_text(f"{HEAD}\na,10,20,-10,5,60,0,0,0,-1500\nb,10,20,-10,5,60,0,0,0,-400000\n")
    with pytest.raises(InputError, match=r"line 3, column fz_N: no test of an arm applies this force.*20 times"):
        read_plan(plan, experiment)
    targets = tmp_path / "targets.csv"
    targets.write_text(f"{HEAD.replace('pose', 'target')},my_Nm\na,10,20,-10,5,60,0,0,0,-1500,90000\n")
    with pytest.raises(
        InputError, match=r"line 2, column my_Nm: .*this moment.*90000 N m.*20 times the payload at 0.3 m"
    ):
        read_targets(targets, experiment)
    plan.write_text(f"{HEAD}\na,10,20,-10,5,60,0,0,0,-\N{DEVANAGARI DIGIT FIVE}\n", encoding="utf-8")
    with pytest.raises(InputError, match="line 2, column fz_N: cannot be used"):
        read_plan(plan, experiment)
    zero = tmp_path / "readings.csv"
    zero.write_text(f"{HEAD},marker,dx_mm,dy_mm,dz_mm\na,10,20,-10,5,60,0,0,0,-1500,tool,0,0,0\n")
    with pytest.raises(InputError, match="every displacement is zero"):
        read_readings(zero, experiment)


def test_options() -> None:
    stiffness = ("stiffness", "fanuc_r2000ic", "--pose", "0,0,0,0,60,0")
    ok = ("--load", "0,0,-1500", "--point", "0,0,100")
    for changed, words in (
        (("--load", "0,0,-400000", "--point", "0,0,100"), "20 times the payload"),
        (("--load", "0,0,-1500", "--point", "1e300,0,0"), "numbers of up to 100000"),
        (("--load", "0,0,-1500", "--point", "\N{ARABIC-INDIC DIGIT FIVE},0,0"), "numbers with commas between them"),
    ):
        assert words in wrong(*stiffness, *changed)
    assert CliRunner().invoke(app, [*stiffness, *ok]).exit_code == 0
    assert "up to 1e+06" in wrong("show", "fanuc_r2000ic", "--scale", "1e308", "--html", "x.html")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_an_output_that_cannot_be_printed_is_said_in_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "qsframework", "robots"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 1
    assert done.stderr == "error: the output cannot be printed: No space left on device\n"
