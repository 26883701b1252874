"""What is shown of a fit is declared in one place: a column or an error that is added there is in every printer."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

import qsframework as qsf
from qsframework.cli.identify import FitFiles, run_identify
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Readings, example
from qsframework.fits import Fit, columns
from qsframework.fits.columns import ErrorRow, FitColumn

COLUMN = FitColumn(key="signal", head="S/N", value=lambda _, e: e.value / e.sd, brief=True)
ERROR = ErrorRow(key="twice", head="residuals, doubled", errors=lambda fit, kind: 2.0 * fit.residuals[fit.kind == kind])


@pytest.fixture(scope="module")
def fit(r2000ic: Experiment, real: Readings) -> Fit:
    return qsf.identify(r2000ic, real)


@pytest.fixture
def more(monkeypatch: pytest.MonkeyPatch) -> None:
    """One column and one error more, declared where the others are."""
    columns.COLUMNS.insert(2, COLUMN)
    columns.ERRORS.append(ERROR)
    monkeypatch.setenv("COLUMNS", "100")


@pytest.fixture(autouse=True)
def restored() -> object:
    """The lists as they were."""
    own = list(columns.COLUMNS), list(columns.ERRORS)
    yield
    columns.COLUMNS[:], columns.ERRORS[:] = own


@pytest.mark.usefixtures("more")
def test_every_printer_shows_what_is_declared_once(
    fit: Fit,
    r2000ic: Experiment,
    real: Readings,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first, twice = fit.estimates[0], 2.0 * fit.errors["displacement"]["identified"]
    said = "S/N", f"{first.value / first.sd:+.2f}", "residuals, doubled", f"{1e3 * twice:.4f}"

    run_identify(FitFiles(experiment=example("r2000ic") / "experiment.yaml"), None, FitOptions(), clean=False)
    terminal = capsys.readouterr().out
    page = qsf.report(fit, tmp_path / "fit.html", r2000ic, real).read_text()
    source: list[str] = []
    monkeypatch.setattr(sys.modules["qsframework.report.printed"], "printed", lambda p, _: source.append(p) or b"%PDF-")
    qsf.report(fit, tmp_path / "fit.pdf", r2000ic, real)
    for text in (terminal, page, source[0], str(fit), fit._repr_html_()):
        assert [word for word in said if word not in text] == []

    stored = json.loads(qsf.write_fit(fit, tmp_path / "fit.json").read_text())
    assert stored["estimates"][first.name]["signal"] == pytest.approx(first.value / first.sd)
    assert stored["errors_mm"]["displacement"]["twice"] == pytest.approx(1e3 * twice)
    assert qsf.read_fit(tmp_path / "fit.json").values.tolist() == fit.values.tolist(), "what is more is passed over"
    frame = fit.to_frame()
    assert frame["signal"][0] == pytest.approx(first.value / first.sd)
    assert frame.attrs["errors_mm"]["displacement"]["twice"] == pytest.approx(1e3 * twice)
