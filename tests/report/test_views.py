"""How a fit, a plan, readings, a diagnosis and a validation show themselves in Python."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

import qsframework as qsf
from qsframework.diagnoses import Diagnosis
from qsframework.experiment import Experiment, Readings, example
from qsframework.fits import Fit
from qsframework.report.words.fit import fit_verdict
from tests.diagnose.cases import hardened


class Cells(HTMLParser):
    """The text of a fragment's table cells, and its tags."""

    def __init__(self, fragment: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.cells: list[str] = []
        self.feed(fragment)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1] in ("td", "th"):
            self.cells[-1] += data


@pytest.fixture(scope="module")
def fit(r2000ic: Experiment, real: Readings) -> Fit:
    return qsf.identify(r2000ic, real)


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return hardened()


@pytest.fixture(scope="module")
def results(r2000ic: Experiment, real: Readings, fit: Fit, found: Diagnosis) -> Mapping[str, object]:
    plan = qsf.read_plan(example("day") / "plan.csv", qsf.load_experiment(example("day") / "experiment.yaml"))
    validation = qsf.validate(r2000ic, real, fit)
    return {"Fit": fit, "Plan": plan, "Readings": real, "Diagnosis": found, "Validation": validation}


@pytest.mark.parametrize("kind", ["Fit", "Plan", "Readings", "Diagnosis", "Validation"])
def test_a_result_shows_itself(kind: str, results: Mapping[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    result = results[kind]
    said, one, page = str(result), repr(result), Cells(result._repr_html_())  # type: ignore[attr-defined]
    assert all(len(line) <= 100 for line in said.splitlines())
    assert len(said.splitlines()) > 5
    assert "\n" not in one
    assert one.startswith(f"<{kind}: ")
    assert {"p", "table", "td", "th"} <= set(page.tags) <= {"p", "b", "table", "thead", "tbody", "tr", "td", "th"}
    frame = result.to_frame()  # type: ignore[attr-defined]
    assert len(frame) > 0
    figure = result.plot()  # type: ignore[attr-defined]
    assert any(len(trace.y) for trace in figure.data if trace.y is not None)


def test_a_fit_says_what_its_command_says(fit: Fit) -> None:
    assert fit_verdict(fit).said in str(fit).replace("\n", " ")
    assert fit_verdict(fit).said in repr(fit)
    frame = fit.to_frame()
    assert list(frame["parameter"]) == list(fit.names)
    np.testing.assert_array_equal(frame["value"], [e.value for e in fit.estimates])


def test_the_frame_of_readings_is_si(real: Readings) -> None:
    frame = real.to_frame()
    assert len(frame) == len(real)
    np.testing.assert_array_equal(frame[["x_m", "y_m", "z_m"]], real.value)
    assert frame["fz_N"].min() < -500.0


def test_the_frame_of_a_diagnosis_holds_every_cause(found: Diagnosis) -> None:
    frame = found.to_frame()
    assert set(frame["cause"]) == {x.name for x in found.table}
    first = frame.dropna(subset="s").sort_values("s").iloc[-1]
    assert first["cause"] in str(found)


@pytest.fixture(scope="module")
def inputs(m900ib: Experiment) -> Mapping[str, object]:
    """What verbs take, and what else they give back."""
    plan = qsf.read_plan(example("m900ib") / "table5.csv", m900ib)
    made = qsf.simulate(m900ib, plan, seed=1)
    fit = qsf.identify(m900ib, made.readings, ["joint_compliance[joint_2]", "joint_compliance[joint_3]"])
    targets = qsf.read_targets(example("m900ib") / "targets.csv", m900ib)
    return {
        "Experiment": m900ib,
        "Robot": m900ib.robot,
        "Simulation": made,
        "Targets": targets,
        "Compensation": qsf.compensate(m900ib, fit, targets),
        "Stiffness": qsf.stiffness("fanuc_m900ib", [0.0, 0.3, -0.2, 0.5, 0.7, 0.0], [0.0, 0.0, -4000.0]),
    }


@pytest.mark.parametrize("kind", ["Experiment", "Robot", "Simulation", "Targets", "Compensation", "Stiffness"])
def test_an_input_shows_itself(kind: str, inputs: Mapping[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    value: Any = inputs[kind]
    assert repr(value).startswith(f"<{kind}: ")
    assert "\n" not in repr(value)
    assert len(repr(value)) < 400
    assert all(len(line) <= 100 for line in str(value).splitlines())
    assert "table" in Cells(value._repr_html_()).tags
    frame = value.to_frame()
    assert len(frame) > 0
    assert not {"x", "y", "z", "fx", "fy", "fz", "q1"} & set(frame.columns), "columns say their units"
    if kind in ("Experiment", "Robot", "Targets"):
        with pytest.raises(qsf.InputError, match="no plot shows this"):
            value.plot()
    else:
        assert len(value.plot().data) > 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("no_such_robot", [0.0] * 6, [0.0] * 6), "no_such_robot"),
        ((42, [0.0] * 6, [0.0] * 6), "robot: found 42 .*load_robot"),
        (("fanuc_m900ib", [0.0] * 5, [0.0] * 6), "pendant must be 6 numbers"),
        (("fanuc_m900ib", "0,0,0", [0.0] * 6), "pendant: found '0,0,0' .*an array of numbers"),
        (("fanuc_m900ib", [0.0] * 6, 4000.0), "wrench: found 4000.0 .*an array of numbers"),
    ],
)
def test_wrong_arguments_answer_in_words(arguments: tuple[Any, ...], words: str) -> None:
    with pytest.raises(qsf.InputError, match=words):
        qsf.stiffness(*arguments)


def test_names_are_no_markup(results: Mapping[str, object]) -> None:
    plan = results["Plan"]
    assert isinstance(plan, qsf.Plan)
    odd = replace(plan, pose=("<script>alert(1)</script>", *plan.pose[1:]))
    page = Cells(odd._repr_html_())
    assert "script" not in page.tags
    assert "<script>alert(1)</script>" in page.cells


def test_a_frame_without_pandas_says_what_to_install(fit: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(qsf.InputError, match="pip install pandas"):
        fit.to_frame()


def test_units_go_both_ways() -> None:
    assert qsf.units.to_si(180.0, "deg") == pytest.approx(math.pi)
    assert qsf.units.from_si(math.pi, "deg") == pytest.approx(180.0)
    assert qsf.units.from_si(qsf.units.to_si(21.5, "degC"), "degC") == pytest.approx(21.5)
    with pytest.raises(ValueError, match="unknown unit"):
        qsf.units.from_si(1.0, "furlongs_of_rope")


def test_every_name_of_the_front_door_is_there() -> None:
    for name in dir(qsf):
        assert getattr(qsf, name) is not None


def test_results_show_themselves_where_only_a_module_was_imported() -> None:
    code = (
        "from pathlib import Path; from qsframework.experiment import example, load_experiment, read_readings; "
        "e = load_experiment(example('r2000ic') / 'experiment.yaml'); print(repr(read_readings(e.data, e)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("<Readings: 43 readings")
