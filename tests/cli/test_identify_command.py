"""`qsf simulate`, `identify` and `validate`: files of all kinds, old spellings, and who made the readings."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from qsframework.errors import InputError
from qsframework.experiment import example, load_experiment, read_readings
from qsframework.files import sha256
from qsframework.fits import read_fit
from tests.cli.test_commands import M900IB, R2000IC, run

PLAN = str(example("m900ib") / "table5.csv")
UR10 = str(example("ur10") / "experiment.yaml")
JOINT_2 = ("--fit", "joint_compliance[joint_2]", "--fit", "joint_compliance[joint_3]")


@pytest.fixture
def simulated(tmp_path: Path) -> Path:
    path = tmp_path / "readings.csv"
    run("simulate", M900IB, PLAN, "-o", str(path), "--seed", "5")
    return path


def told(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text())


def test_simulated_readings_say_what_made_them(simulated: Path, tmp_path: Path) -> None:
    beside = told(simulated.with_suffix(".json"))
    assert beside == {"format": 1, "model": "equilibrium", "readings_sha256": sha256(simulated), "seed": 5}
    run("simulate", M900IB, PLAN, "-o", str(tmp_path / "l.csv"), "--linear", "--seed", "6")
    beside = told(tmp_path / "l.json")
    assert (beside["model"], beside["seed"]) == ("linear", 6)
    made = read_readings(tmp_path / "l.csv", load_experiment(M900IB)).made
    assert made is not None
    assert (made.model, made.seed) == ("linear", 6)


@pytest.mark.parametrize("linear", [False, True])
def test_readings_of_the_other_model_are_told_first(simulated: Path, linear: bool, tmp_path: Path) -> None:
    """One line below the verdict where the model of the fit did not make the readings; else none."""
    path = tmp_path / "other.csv"
    run("simulate", M900IB, PLAN, "-o", str(path), "--seed", "5", *(() if linear else ("--linear",)))
    more = ("--linear",) if linear else ()
    first = run("identify", M900IB, str(path), *more).split("\nparameter ")[0]
    made, fitted = ("full equilibrium", "linear model") if linear else ("linear model", "full equilibrium")
    assert made in first
    assert fitted in first
    own = run("identify", M900IB, str(simulated if not linear else path), *(() if linear else more))
    assert made not in (head := own.split("\nparameter ")[0]) or fitted not in head


def test_measured_readings_and_changed_ones_were_made_by_no_model(simulated: Path) -> None:
    """A hash keeps the .json from speaking of a table that somebody changed."""
    experiment = load_experiment(M900IB)
    assert read_readings(simulated, experiment).made is not None
    simulated.write_text(simulated.read_text() + "\n")
    assert read_readings(simulated, experiment).made is None
    simulated.with_suffix(".json").write_text("{")
    assert read_readings(simulated, experiment).made is None


STATES = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N,marker,state,x_mm,y_mm,z_mm\n"


@pytest.fixture
def states(tmp_path: Path) -> Path:
    """The poses and loads of a plan as a file of states, with an experiment that states both noises."""
    import numpy as np

    from qsframework.experiment import read_plan

    experiment = load_experiment(M900IB)
    plan = read_plan(PLAN, experiment)
    model, rng = experiment.model(), np.random.default_rng(4)
    lines = [STATES]
    for loaded in (False, True):
        place = 1e3 * (model.positions(plan.poses, model.nominal, loaded) + 2e-5 * rng.normal(size=(1, 1, 3)))
        place += 0.02 * rng.normal(size=place.shape)
        for i, name in enumerate(plan.pose):
            q = ",".join(repr(v) for v in np.rad2deg(plan.pendant[i]).tolist())
            force = ",".join(repr(v) if loaded else "" for v in plan.wrench[i, :3].tolist())
            for k, marker in enumerate(model.marker_names):
                xyz = ",".join(repr(v) for v in place[i, k].tolist())
                lines.append(f"{name},{q},{force},{marker},{('unloaded', 'loaded')[loaded]},{xyz}\n")
    (tmp_path / "states.csv").write_text("".join(lines))
    text = Path(M900IB).read_text().replace("sigma_mm: 0.03", "position_sigma_mm: 0.02, displacement_sigma_mm: 0.03")
    assert "position_sigma_mm" in text
    (tmp_path / "experiment.yaml").write_text(text)
    return tmp_path / "states.csv"


def test_states_are_read_as_asked(states: Path, tmp_path: Path) -> None:
    experiment, out = str(tmp_path / "experiment.yaml"), tmp_path / "f.json"
    ways = {}
    for way in ("differences", "positions"):
        run("identify", experiment, str(states), "--states", way, "--json", str(out))
        ways[way] = told(out)
    run("identify", experiment, str(states), "--json", str(out))
    assert told(out) == ways["differences"], "both states of each pose and springs alone: differences"
    run("identify", experiment, str(states), *JOINT_2, "--states", "positions", "--json", str(out))
    assert list(told(out)["frames"]) == [""]
    for way, fit in ways.items():
        assert bool(fit["frames"]) == (way == "positions")
        known = load_experiment(M900IB).model()
        for name, e in fit["estimates"].items():
            if name in known.names:
                truth = known.nominal[known.names.index(name)]
                assert abs(e["value"] - truth) < 5 * e["sd"], (way, name)
    with pytest.raises(InputError, match=r"unknown states 'difference'.*allowed: differences, positions"):
        run("identify", experiment, str(states), "--states", "difference")


def test_several_files_are_one_fit(states: Path, simulated: Path, tmp_path: Path) -> None:
    """Displacements and positions together, by arguments and from the experiment."""
    experiment, out = tmp_path / "experiment.yaml", tmp_path / "f.json"
    for file in (simulated, states):
        run("identify", str(experiment), str(file), "--states", "positions", "--json", str(out))
        alone = told(out)["estimates"]["joint_compliance[joint_3]"]["sd"]
    run("identify", str(experiment), str(simulated), str(states), "--states", "positions", "--json", str(out))
    both = told(out)
    assert both["estimates"]["joint_compliance[joint_3]"]["sd"] < alone
    assert [file["sha256"] for file in both["account"]["files"]] == [sha256(simulated), sha256(states)]
    experiment.write_text(experiment.read_text() + "\ndata: [readings.csv, states.csv]\nstates: positions\n")
    run("identify", str(experiment), "--json", str(out))
    assert told(out) == both


def test_what_does_not_go_together_is_refused(simulated: Path) -> None:
    with pytest.raises(InputError, match="--clean masks what --keep-all keeps; give one of them"):
        run("identify", M900IB, str(simulated), "--clean", "--keep-all")
    with pytest.raises(InputError, match=r"would overwrite an input"):
        run("identify", M900IB, str(simulated), "--json", str(simulated))


def test_a_fit_is_validated_on_another_file(simulated: Path, tmp_path: Path) -> None:
    fit, other, out, report = (tmp_path / n for n in ("fit.json", "other.csv", "v.json", "v.html"))
    run("identify", M900IB, str(simulated), "--json", str(fit))
    run("simulate", M900IB, PLAN, "-o", str(other), "--seed", "9")
    before = fit.read_text()
    output = run("validate", M900IB, str(fit), str(other), "--json", str(out), "--report", str(report))
    assert "at 36 held-out readings" in output
    found = told(out)
    assert (found["format"], found["robot"], found["seen"], found["halves"]) == (1, "fanuc_m900ib", False, 0)
    assert found["readings"] == len(read_readings(other, load_experiment(M900IB)))
    assert 0.02 < found["rms_per_axis_mm"] < 0.06, "the noise, 0.03 mm, and a little of the fit"
    assert found["error_mm"]["mean"] < found["error_mm"]["p95"] <= found["error_mm"]["max"]
    assert set(found["parts"]) == {"displacements"}
    page = report.read_text()
    assert "Validation" in page
    assert f"{found['error_mm']['mean']:.3f}" in page
    assert fit.read_text() == before
    assert "the readings of the fit" in run("validate", M900IB, str(fit), str(simulated))


def test_random_halves_judge_a_fit(tmp_path: Path) -> None:
    """Of the experiment's own readings; the same seed draws the same halves."""
    fit, out = tmp_path / "fit.json", tmp_path / "v.json"
    run("identify", R2000IC, *JOINT_2, "--json", str(fit))
    results = []
    for seed in ("1", "1", "2"):
        output = run("validate", R2000IC, str(fit), "--halves", "4", "--seed", seed, "--json", str(out))
        assert "the held-out halves, 4 random halves" in output
        results.append(told(out))
    assert results[0] == results[1]
    assert results[0]["spread_mm"] != results[2]["spread_mm"]
    assert len(results[0]["spread_mm"]) == results[0]["halves"] == 4
    assert results[0]["rms_per_axis_mm"] >= told(fit)["rms_per_axis_mm"]["identified"] * 0.9


def test_a_validation_that_cannot_be_is_refused(simulated: Path, tmp_path: Path) -> None:
    fit = tmp_path / "fit.json"
    run("identify", M900IB, str(simulated), "--json", str(fit))
    with pytest.raises(InputError, match=r"no readings; add `data: readings.csv` or give FILE"):
        run("validate", M900IB, str(fit))
    with pytest.raises(InputError, match="fanuc_m900ib"):
        run("validate", R2000IC, str(fit))
    with pytest.raises(InputError, match="would overwrite an input"):
        run("validate", M900IB, str(fit), str(simulated), "--json", str(fit))
    assert read_fit(fit).robot == "fanuc_m900ib"
    short = tmp_path / "short.csv"
    lines = simulated.read_text().splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("pose,"))
    short.write_text("\n".join([lines[head], *(x for x in lines if x.startswith(("row01,", "row02,")))]) + "\n")
    with pytest.raises(InputError, match="are too few for halves"):
        run("validate", M900IB, str(fit), str(short), "--halves", "2")


def test_a_check_reads_every_file(states: Path, simulated: Path, tmp_path: Path) -> None:
    experiment = tmp_path / "experiment.yaml"
    experiment.write_text(experiment.read_text() + "\ndata: [readings.csv, states.csv]\n")
    count = len(read_readings([simulated, states], load_experiment(experiment), "positions"))
    assert f"{count} readings at" in run("check", str(experiment))
    shutil.copy(example("r2000ic") / "readings.csv", simulated)
    with pytest.raises(InputError, match="another robot"):
        run("check", str(experiment))


def test_a_check_takes_readings_beside_the_experiment(simulated: Path) -> None:
    said = " ".join(run("check", M900IB, str(simulated)).split())
    assert "readings at" in said
    assert f"next: qsf identify {M900IB} {simulated}" in said
    with pytest.raises(InputError, match="checked with one experiment"):
        run("check", str(simulated))
