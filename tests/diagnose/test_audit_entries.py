"""The extended experiment has the noise and the readings as the audit left them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.diagnose import DiagnoseFiles, run_diagnose
from qsframework.diagnoses import DiagnoseOptions, Diagnosis, diagnose
from qsframework.diagnoses.audit_entries import Audited, audited_of, audited_readings
from qsframework.errors import InputError
from qsframework.experiment import (
    Experiment,
    load_experiment,
    make_plan,
    make_rows,
    read_readings,
    simulate,
    write_readings,
)
from qsframework.experiment.noise import NoiseModel
from qsframework.fits import identify
from qsframework.report.extended import extension_of, write_extended
from tests.diagnose.cases import SIGMA, campaign, candidates, day_of_positions, diagnosed, hardened, measured, quiet
from tests.identify.arm import with_sigma

POSITION = 2e-5


@pytest.fixture(scope="module")
def real() -> Diagnosis:
    return diagnosed("r2000ic")


def test_identify_on_the_extended_folder_agrees_with_the_diagnosis(real: Diagnosis, tmp_path: Path) -> None:
    """The noise is the audited one, and the row that the audit took out stays out: errors held out are the same."""
    assert len(real.outliers)
    pulls = real.readings.poses.take(np.flatnonzero(real.readings.states.loaded))
    with pytest.raises(InputError, match="a displacement needs its noise"):
        simulate(real.experiment, make_plan(pulls, ["load"] * len(pulls)))
    write_extended(real, tmp_path / "out")
    again = load_experiment(tmp_path / "out" / "experiment.yaml")
    assert again.noise.sigma == pytest.approx(real.rms.noise, rel=1e-12)
    assert again.data == (tmp_path / "out" / "readings.csv",)
    readings = read_readings(again.data, again)
    assert np.array_equal(readings.line[~readings.use], real.readings.line[real.outliers])
    assert np.array_equal(readings.value, real.readings.value)
    assert np.array_equal(readings.line, real.readings.line), "every line is where it was"
    fit = identify(again, readings)
    assert fit.rms_left_out == pytest.approx(real.rms.heldout_extended, rel=0.02)
    assert {e.name for e in fit.estimates} - {*real.extended.names} == {"offaxis_compliance[joint_4/z].bearing"}
    for name in real.extended.names:
        assert abs(fit.x[fit.model.index([name])[0]] - real.extended.value(name)) < real.extended.sd(name), name
    told = (tmp_path / "out" / "experiment.yaml").read_text(encoding="utf-8")
    before = told[: told.index("\nnoise:\n")].splitlines()[-1]
    assert before.startswith("# The noise is not stated; it was estimated from")
    assert "masked (use 0) as outliers" in told
    result = simulate(again, make_plan(pulls, ["load"] * len(pulls)), seed=3)
    left = result.readings.value - make_rows(result.readings).predict(again.model(), again.model().nominal)
    assert np.sqrt(np.mean(left**2)) == pytest.approx(real.rms.noise, rel=0.15)


def test_what_is_said_to_come_next_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    readings = tmp_path / "readings.csv"
    write_readings(readings, hardened().readings, campaign())
    files = DiagnoseFiles(experiment=campaign().path, data=(readings,), extend=tmp_path / "out")
    run_diagnose(files, DiagnoseOptions(count=1))
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith("next: ")]
    assert told == [f"next: qsf identify {tmp_path / 'out' / 'experiment.yaml'}"]
    again = load_experiment(tmp_path / "out" / "experiment.yaml")
    assert identify(again, read_readings(again.data, again)).sigma > 0.0


def test_the_noise_of_states_is_that_of_one_position(m900ib: Experiment, tmp_path: Path) -> None:
    """Half of the true noise is stated: the audit finds it in the displacements, the files say it of positions."""
    readings = tmp_path / "states.csv"
    model = m900ib.model()
    write_readings(readings, day_of_positions(model, model.nominal, candidates()[:16], 3, None, POSITION), m900ib)
    (tmp_path / "e.yaml").write_text(re.sub("sigma_mm: [0-9.]+", "sigma_mm: 0.01", m900ib.path.read_text()))
    quiet = load_experiment(tmp_path / "e.yaml")
    found = diagnose(quiet, read_readings(readings, quiet), repeats=1)
    assert found.rms.noise == pytest.approx(np.sqrt(2.0) * POSITION, rel=0.1)
    assert audited_of(found).sigma == pytest.approx(POSITION, rel=0.1)
    assert audited_of(found).of_position
    assert "the noise of one position" in extension_of(found).about_noise


def test_a_noise_that_is_stated_and_right_stays(tmp_path: Path) -> None:
    found = quiet(0)
    assert audited_of(found) == Audited(masked=tuple(int(r) for r in found.readings.line[found.outliers]))
    write_extended(found, tmp_path / "out")
    assert load_experiment(tmp_path / "out" / "experiment.yaml").noise.sigma == SIGMA


@pytest.mark.parametrize("stated", [SIGMA / 3.0, None])
def test_sigmas_of_rows_become_the_true_ones(stated: float | None, tmp_path: Path) -> None:
    """Rows that state a third of their noise, in an experiment that states as much, or that has it estimated."""
    readings = measured(seed=2, count=24)
    path = tmp_path / "readings.csv"
    write_readings(path, with_sigma(readings, SIGMA / 3.0), campaign())
    experiment = campaign().with_(noise=NoiseModel(stated))
    found = diagnose(experiment, read_readings(path, experiment), repeats=1)
    assert found.audit.unit_source != "stated"
    assert audited_of(found).factor == pytest.approx(3.0, rel=0.15)
    write_extended(found, tmp_path / "out")
    again = load_experiment(tmp_path / "out" / "experiment.yaml")
    assert again.data == (tmp_path / "out" / "readings.csv",)
    sigma = read_readings(again.data, again).sigma
    assert np.allclose(sigma, audited_of(found).factor * SIGMA / 3.0, rtol=1e-9)
    assert again.noise.sigma == pytest.approx(float(sigma[0, 0]), rel=1e-9)


TABLE = """# robot: somebody's

pose,q1_deg,marker,sigma_um,dx_mm, use
# none
a,1.5,"m,1",30,0.1,
b,2,m2,,nan,no
c,2,m2,x,0.3,0

d,2,m2,40,0.4,1
"""


def test_lines_stay_where_they_are(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text(TABLE, encoding="utf-8")
    assert audited_readings(path, Audited(1e-5)) is None
    text = audited_readings(path, Audited(1e-5, masked=(5,), factor=2.0))
    assert text is not None
    assert text.splitlines() == [
        "# robot: somebody's",
        "",
        "pose,q1_deg,marker,sigma_um,dx_mm, use",
        "# none",
        'a,1.5,"m,1",60,0.1,0',
        "b,2,m2,,nan,no",
        "c,2,m2,x,0.3,0",
        "",
        "d,2,m2,80,0.4,1",
    ]
    path.write_text("pose,x_mm\na,1\nb,2\n", encoding="utf-8")
    assert audited_readings(path, Audited(1e-5, factor=2.0)) is None
    assert audited_readings(path, Audited(masked=(3,))) == "pose,x_mm,use\na,1,1\nb,2,0\n"
