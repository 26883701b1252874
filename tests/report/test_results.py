"""`qsf.report` writes the report that a result's command writes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

import qsframework as qsf
from qsframework.cli.app import app
from qsframework.experiment import Experiment, Readings, example
from tests.diagnose.cases import diagnosed


def headings(path: Path) -> list[str]:
    return re.findall(r"<h2[^>]*>(.*?)</h2>", path.read_text())


def test_a_fits_report_is_that_of_the_command(r2000ic: Experiment, real: Readings, tmp_path: Path) -> None:
    own = qsf.report(
        qsf.identify(r2000ic, real), tmp_path / "own.html", r2000ic, real, files=[r2000ic.path, *r2000ic.data]
    )
    told = CliRunner().invoke(app, ["identify", str(r2000ic.path), "--report", str(tmp_path / "told.html")])
    assert told.exit_code == 0, told.output
    assert headings(own) == headings(tmp_path / "told.html")
    assert len(headings(own)) >= 4


def test_reports_of_a_plan_a_validation_and_a_diagnosis(r2000ic: Experiment, real: Readings, tmp_path: Path) -> None:
    day = qsf.load_experiment(example("day") / "experiment.yaml")
    plan = qsf.read_plan(example("day") / "plan.csv", day)
    assert "Predicted uncertainties" in headings(qsf.report(plan, tmp_path / "plan.html", day))
    found = qsf.validate(r2000ic, real, qsf.identify(r2000ic, real))
    assert "Validation: " in qsf.report(found, tmp_path / "v.html", r2000ic).read_text()
    assert "Causes" in headings(qsf.report(diagnosed("r2000ic"), tmp_path / "d.html"))


def test_what_is_missing_is_said(r2000ic: Experiment, real: Readings, tmp_path: Path) -> None:
    fit = qsf.identify(r2000ic, real)
    with pytest.raises(qsf.InputError, match="this report needs the experiment"):
        qsf.report(fit, tmp_path / "x.html")
    with pytest.raises(qsf.InputError, match="this report needs the readings"):
        qsf.report(fit, tmp_path / "x.html", r2000ic)
    assert not list(tmp_path.iterdir())


def test_the_verbs_with_names_of_packages_stay_verbs() -> None:
    import qsframework.diagnoses.power
    import qsframework.report.page

    assert callable(qsf.report)
    assert callable(qsf.forecast)
    assert qsf.forecast is qsframework.forecast
