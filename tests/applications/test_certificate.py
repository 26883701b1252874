"""A certificate states what independent arithmetic and simulation find, and nothing of a fit that is wrong."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from remembered import diagnose
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.diagnoses import Diagnosis
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import (
    Experiment,
    Readings,
    example,
    load_experiment,
    make_plan,
    make_rows,
    read_readings,
    simulate,
)
from qsframework.fits import FitRecord, identify, read_fit, validate, write_fit
from qsframework.plugin import Array, Poses
from qsframework.report.certificate_page import arrivals, pair, write_certificate
from qsframework.report.words.certificate import conformity_words
from qsframework.report.words.validation import validation_verdict
from qsframework.uses.certificate import MetaSpec, certify, read_meta
from tests.identify.records import with_values

pytestmark = pytest.mark.usefixtures("diagnosed_once")

PLAIN = FitOptions()


def readings_of(experiment: Experiment, seed: int, count: int = 40) -> Readings:
    rng = np.random.default_rng(seed)
    controller = experiment.robot.controller
    pendant = 0.8 * rng.uniform(controller.lower, controller.upper, (3 * count, 6))
    every = Poses(pendant, controller.to_joints(pendant), np.zeros((3 * count, 6)))
    pendant = pendant[experiment.model().transmission_margin(every) > 0.0][:count]  # the parallelogram is not flat
    wrench = np.tile([0.0, 1500.0, -4000.0, 0, 0, 0], (count, 1))
    plan = make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["side"] * count)
    return simulate(experiment, plan, truth_of(experiment), seed=seed).readings


def truth_of(experiment: Experiment) -> Array:
    """An arm that gives a third more than the nominal one."""
    return 1.3 * experiment.model().nominal


def stored(experiment: Experiment, readings: Readings, folder: Path) -> FitRecord:
    return read_fit(write_fit(identify(experiment, readings, options=PLAIN), folder / "fit.json"))


@pytest.fixture(scope="module")
def fitted(m900ib: Experiment, tmp_path_factory: pytest.TempPathFactory) -> FitRecord:
    return stored(m900ib, readings_of(m900ib, 0), tmp_path_factory.mktemp("fit"))


def test_the_budget_is_the_spread_of_fits_to_other_readings(m900ib: Experiment, fitted: FitRecord) -> None:
    """The share of the parameters against 16 fits: how far their predictions of one campaign are from the truth."""
    other = readings_of(m900ib, 7)
    found = certify(m900ib, fitted, other, MetaSpec())
    model = m900ib.model()
    squares: list[float] = []
    base = readings_of(m900ib, 0)
    true = fit_truth(m900ib, base)
    for seed in range(16):
        fit = identify(m900ib, base.with_values(true + noise(seed)), options=PLAIN)
        wrong = fit.predict(other)[0] - fit_truth(m900ib, other)
        squares.append(float(np.square(wrong).sum(axis=1).mean()))
    (share,) = [s.standard for s in found.budget if s.source == "parameters"]
    assert share == pytest.approx(float(np.sqrt(np.mean(squares))), rel=0.25)
    assert [s.source for s in found.budget] == ["parameters", "held", "instrument", "model"]
    assert found.budget[2].standard == pytest.approx(np.sqrt(3.0) * 3e-5)
    assert found.corrected < 0.5 * found.budget[2].standard
    assert found.conformity is None
    assert not found.validation.seen
    assert set(found.kept) <= set(model.names)


def noise(seed: int) -> Array:
    return np.random.default_rng([seed, 9]).standard_normal((120, 3)) * 3e-5


def fit_truth(experiment: Experiment, readings: Readings) -> Array:
    return make_rows(readings).predict(experiment.model(), truth_of(experiment))


@pytest.fixture(scope="module")
def ur10() -> Diagnosis:
    """Of its real readings, which name encoders that err."""
    experiment = load_experiment(example("ur10") / "experiment.yaml")
    return diagnose(experiment, read_readings(experiment.data, experiment))


def test_accuracy_and_repeatability_are_those_of_iso_9283(ur10: Diagnosis, tmp_path: Path) -> None:
    """AP = |mean - predicted|, RP = mean + 3 s of the distances from the centre, by hand, of readings read thrice."""
    experiment = load_experiment(example("ur10") / "experiment.yaml")
    text = Path(experiment.data[0]).read_text(encoding="utf-8")
    table = [line for line in text.splitlines() if not line.startswith("#")]
    rng = np.random.default_rng(1)
    header = table[0].split(",")
    at = [header.index(f"{a}_mm") for a in "xyz"]
    lines = [table[0] + ",repeat"]
    for line in table[1:]:
        cells = line.split(",")
        for k in range(3 if len(lines) < 10 else 1):
            moved = [*cells, str(k + 1)]
            for i in at:
                moved[i] = f"{float(cells[i]) + 0.02 * rng.standard_normal():.6f}"
            lines.append(",".join(moved))
    path = tmp_path / "again.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    readings = read_readings(path, experiment)
    own = read_readings(experiment.data, experiment)
    fit = read_fit(write_fit(identify(experiment, own), tmp_path / "fit.json"))
    found = certify(experiment, fit, readings, MetaSpec(), diagnosis=ur10, anyway=True)
    assert [a.count for a in found.arrivals] == [3, 3, 3]
    first = found.arrivals[0]
    three = readings.value[:3]
    away = np.linalg.norm(three - three.mean(axis=0), axis=1)
    assert first.repeatability == pytest.approx(away.mean() + 3.0 * away.std(ddof=1))
    assert first.after < first.before
    told = dict(arrivals(found))
    assert told["poses and markers that were reached again"] == "3, 3 to 3 times each"
    assert "instrument" not in {s.source for s in found.budget}, "residuals say nothing of the instrument"


@pytest.mark.parametrize(
    ("tolerance", "rule", "holds", "words"),
    [
        (1e-3, "guarded", True, "The calibrated robot conforms"),
        (1e-3, "simple", True, "The calibrated robot conforms"),
        (1e-5, "guarded", False, "does NOT conform"),
        (1.05, "guarded", None, "can be neither stated nor denied"),
        (1.05, "simple", True, "conforms"),
    ],
)
def test_conformity_follows_the_stated_rule(
    m900ib: Experiment, fitted: FitRecord, tolerance: float, rule: str, holds: bool | None, words: str
) -> None:
    """A tolerance above 1 is so many times the error itself: within the guard band."""
    other = readings_of(m900ib, 7)
    plain = certify(m900ib, fitted, other, MetaSpec(tolerance=1.0)).conformity
    assert plain is not None
    assert plain.expanded == pytest.approx(2.0 * 3e-5)
    asked = tolerance * plain.error if tolerance > 1.0 else tolerance
    found = certify(m900ib, fitted, other, MetaSpec.model_validate({"tolerance": asked, "decision": rule})).conformity
    assert found is not None
    assert found.holds is holds
    assert words in conformity_words(found)


def test_a_fit_that_is_wrong_gets_no_certificate(m900ib: Experiment, fitted: FitRecord) -> None:
    other = readings_of(m900ib, 7)
    first = fitted.names[0]
    turned = with_values(fitted, {e.name: -e.value for e in fitted.estimates})
    with pytest.raises(InputError, match=r"not to be trusted: .*and no arm has it below 0"):
        certify(m900ib, turned, other, MetaSpec())
    with pytest.raises(InputError, match=re.escape(f"{first} is") + ".*among the estimates"):
        certify(m900ib, replace(fitted, model_values={**fitted.model_values, first: 1e-9}), other, MetaSpec())
    with pytest.raises(InputError, match="a variance would be below zero"):
        certify(m900ib, replace(fitted, covariance=-fitted.covariance), other, MetaSpec())
    stiff = with_values(fitted, {n: 3.0 * fitted.model_values[n] for n in fitted.names})
    with pytest.raises(InputError, match="is not below that of the values before"):
        certify(m900ib, stiff, other, MetaSpec())


def test_other_readings_that_refute_the_fit_are_no_ground_for_a_certificate(
    m900ib: Experiment, fitted: FitRecord
) -> None:
    """A joint of the arm has come loose since: better than nominal values would be, and far worse than said."""
    other = readings_of(m900ib, 7)
    loose = truth_of(m900ib)
    loose[m900ib.model().index(["joint_compliance[joint_5]"])] *= 1.5
    again = other.with_values(make_rows(other).predict(m900ib.model(), loose) + noise(3))
    found = validate(m900ib, again, fitted)
    assert found.whole.summary()[0] < found.whole.summary(True)[0]
    assert validation_verdict(found).word.startswith("Refuted: ")
    with pytest.raises(InputError, match=r"these readings are missed by .* held-out poses of the fit's own by 0\.05"):
        certify(m900ib, fitted, again, MetaSpec())
    assert "certified although these readings are missed" in " ".join(
        certify(m900ib, fitted, again, MetaSpec(), anyway=True).notes
    )
    assert not validate(m900ib, other, fitted).refuted


def test_readings_of_the_fit_are_halved(m900ib: Experiment, tmp_path: Path) -> None:
    plan = readings_of(m900ib, 0)
    from qsframework.experiment.measured import write_simulated

    write_simulated(tmp_path / "readings.csv", plan, m900ib)
    own = read_readings(tmp_path / "readings.csv", m900ib)
    fit = stored(m900ib, own, tmp_path)
    found = certify(m900ib, fit, own, MetaSpec(), halves=3)
    assert found.validation.halves == 3
    page = write_certificate(tmp_path / "c.html", found).read_text(encoding="utf-8")
    assert "3 random halves of the poses" in page
    (missing,) = re.findall(r"<b>Not stated:</b> (.*?)</li>", page)
    assert len(re.split("[,;]", missing)) > 10, "what nobody states is named in one line"
    assert "MN m/rad" in page


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("robot: {serial: 7}\n", "serial"),
        ("tolerance: 0.5\n", "does not say its unit"),
        ("decision: generous\n", "decision"),
        ("instrument: {uncertainty_kg: 1}\n", "ends in no unit of this kind"),
    ],
)
def test_a_wrong_meta_names_its_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "meta.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said) as error:
        read_meta(path)
    assert "line 1" in str(error.value) or ":1" in str(error.value)


def test_u_has_two_digits_and_the_value_as_many_decimals() -> None:
    assert pair(0.30149, 0.01234, "mm") == "0.301 ± 0.012 mm"
    assert pair(2.357, 0.4, "mm") == "2.36 ± 0.40 mm"
    assert pair(1234.5, 56.0, "N") == "1234 ± 56 N"
    assert pair(1.0, float("nan"), "mm") == "1 mm, U not quoted"


def test_the_command_writes_a_template_and_says_what_is_missing(tmp_path: Path) -> None:
    run, given = CliRunner(), str(example("hidden_effect") / "experiment.yaml")
    meta, fit, page = (str(tmp_path / name) for name in ("meta.yaml", "fit.json", "c.html"))
    assert run.invoke(app, ["certificate", "--template", meta], catch_exceptions=False).exit_code == 0
    assert read_meta(Path(meta)) == MetaSpec()
    assert run.invoke(app, ["identify", given, "--json", fit], catch_exceptions=False).exit_code == 0
    command = ["certificate", given, fit, "-o", page, "--meta", meta, "--halves", "2"]
    told = run.invoke(app, command)
    assert isinstance(told.exception, InputError)
    assert told.exception.problems[0].argument == ("anyway", "")
    told = run.invoke(app, [*command, "--anyway"], catch_exceptions=False)
    assert told.exit_code == 0, told.output
    assert "certified although the readings name what the fit does not have, joint_hardening[joint_3]" in told.output
    assert "left blank" in told.output
    assert "No tolerance stated" in told.output
    again = run.invoke(app, ["certificate", given])
    assert isinstance(again.exception, InputError)


def test_no_certificate_while_a_diagnosis_names_what_the_fit_does_not_have() -> None:
    """The documented way leads to one: the extended robot, which says what it was extended by."""
    experiment = load_experiment(example("hidden_effect") / "experiment.yaml")
    readings = read_readings(experiment.data, experiment)
    fit, found = identify(experiment, readings), diagnose(experiment, readings)
    with pytest.raises(InputError, match=r"the readings name what the fit does not have, joint_hardening\[joint_3\]"):
        certify(experiment, fit, readings, MetaSpec(), halves=1, diagnosis=found)
    with pytest.raises(InputError, match=r"the readings name what the fit does not have, joint_hardening\[joint_3\]"):
        certify(experiment, fit, readings, MetaSpec(), halves=1)
    told = certify(experiment, fit, readings, MetaSpec(), halves=1, diagnosis=found, anyway=True)
    assert any(note.startswith("certified although the readings name") for note in told.notes)
    assert told.fit.account.causes == ("joint_hardening[joint_3]",)
    (said,) = told.fit.account.scope()
    assert said.startswith("Measured: deflections under load, loaded minus unloaded, 180 readings at 60 visits.")
    assert "where the unloaded arm stands in its base frame was not measured" in said


def test_positions_in_an_estimated_frame_are_certified_in_that_frame(ur10: Diagnosis) -> None:
    experiment = load_experiment(example("ur10") / "experiment.yaml")
    readings = read_readings(experiment.data, experiment)
    fit = identify(experiment, readings)
    told = certify(experiment, fit, readings, MetaSpec(), halves=1, diagnosis=ur10, anyway=True)
    (said,) = told.fit.account.scope()
    assert "in the frame of the instrument, which was estimated from the same readings" in said
    assert "an error in the base frame is not known" in said
