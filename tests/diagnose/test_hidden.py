"""Effects are hidden in simulated readings by the exact model; the diagnosis sees the files only and must find them."""

from __future__ import annotations

from pathlib import Path

import diagnosis as benchmark
import hidden
import numpy as np
import pytest
import second_generator as second
from fresh_poses import named_words
from threadpoolctl import threadpool_limits

from qsframework.diagnoses.diagnose import diagnose
from qsframework.diagnoses.result import Diagnosis
from qsframework.experiment import load_experiment, read_readings
from qsframework.plugin import registry
from qsframework.report.result_json import diagnosis_json

Case = hidden.Case


def _diagnose(case: hidden.Case, folder: Path) -> tuple[hidden.Truth, Diagnosis]:
    with threadpool_limits(1):
        truth = hidden.hide(case)
        experiment = load_experiment(hidden.write_case(truth, folder))
        return truth, diagnose(experiment, read_readings(experiment.data, experiment), repeats=1)


def test_a_hidden_effect_is_named_placed_sized_and_gains(tmp_path: Path) -> None:
    """Others of the generator's kinds are hidden by the library itself, and named, in tests/proof/test_pinned.py."""
    place, s = "offaxis_compliance[joint_3/x]", 12.0
    case = Case("one", "one", 3, hidden.Setting(poses=30), effects=((place.partition("[")[0], s),), at=(place,))
    truth, d = _diagnose(case, tmp_path)
    assert truth.s[0] == pytest.approx(s, rel=0.005)
    assert d.verdict == "explained"
    assert [f.name for f in d.findings] == [place]
    found = {v.name: v for v in d.findings[0].values}
    assert place in found
    for name, value in found.items():
        assert abs(value.value - truth.values[name]) <= 3.0 * value.sd
        assert value.sd < 0.5 * max(abs(v) for v in truth.values.values())
    assert d.rms.heldout_extended < d.rms.heldout_identified


def test_nothing_is_named_where_nothing_is_hidden(tmp_path: Path) -> None:
    for seed, robot in ((1, "fanuc_m900ib"), (2, "fanuc_r2000ic")):
        _, d = _diagnose(Case("null", "null", seed, hidden.Setting(robot, poses=24)), tmp_path / robot)
        assert (d.verdict, d.findings, d.leftovers) == ("none", (), ())


def test_noise_that_the_file_understates_is_named_and_nothing_else(tmp_path: Path) -> None:
    _, d = _diagnose(Case("stress", "stress", 6, stress="sigma_too_small"), tmp_path)
    assert (d.verdict, d.findings, d.leftovers) == ("none", (), ())
    assert [p["id"] for p in diagnosis_json(d)["data_problems"]] == ["noise_level"]
    assert d.audit.unit == pytest.approx(1.5, rel=0.1)


@pytest.mark.parametrize("kind", ["hose_torque", "cross_coupling"])
def test_an_effect_outside_the_library_is_not_explained(kind: str, tmp_path: Path) -> None:
    _, d = _diagnose(
        Case("unknown", "unknown", 4, hidden.Setting(poses=30, recorded=True), unknown=(kind, 14.0)), tmp_path
    )
    assert d.verdict in ("unexplained", "partly_explained")


def test_the_files_say_nothing_of_what_is_hidden(tmp_path: Path) -> None:
    truth = hidden.hide(Case("one", "one", 3, effects=(("joint_hardening", 20.0),)))
    text = hidden.write_case(truth, tmp_path).read_text() + (tmp_path / "readings.csv").read_text()
    assert "hardening" not in text


def test_sensors_and_equilibrium_agree_with_the_model_where_both_are_exact() -> None:
    """Without gravity's and the load's second order the generator's readings are those of the linear model."""
    h = hidden.Hider(hidden.Setting(), 0)
    instance = h.instances["tracker_frame"]
    model, x = h.with_(h.values(instance, np.array([0.0, 0.0, 1.0])), [instance])
    small = h.poses.take(slice(0, 5))
    plain, turned = hidden.exact(h.base, small, h.x), hidden.exact(model, small, x)
    angle = x[model.index(["tracker_frame.rz"])[0]]
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    np.testing.assert_allclose(turned, plain @ R.T, atol=1e-12)
    assert np.abs(plain - h.base.predict(small, h.x, linear=True)).max() < 0.01 * np.abs(plain).max()
    assert np.abs(plain - h.base.predict(small, h.x, linear=True)).max() > 1e-6  # it is not the linear model


def test_the_size_of_an_effect_is_what_a_chi_square_would_see() -> None:
    """s^2 is the chi-square left by the best fit to noise-free readings."""
    truth = hidden.hide(Case("one", "one", 3, effects=(("offaxis_compliance", 8.0),)))
    h = truth.hider
    names = h.experiment.fit_names()
    A = h.base.sensitivity(h.poses, h.x, names).reshape(-1, len(names)) / hidden.SIGMA
    y = (truth.clean - hidden.exact(h.base, h.poses, h.x)).ravel() / hidden.SIGMA
    U = np.linalg.qr(A)[0]
    left = y - U @ (U.T @ y)
    assert np.linalg.norm(left) == pytest.approx(8.0, rel=0.02)


def test_a_stopped_run_goes_on_and_ends_alike(tmp_path: Path) -> None:
    cases = [c for c in benchmark.first_cases(3, ["conventions"], 0) if "metres" in c.id]
    assert len(cases) == 2
    whole = benchmark.run_all(cases, tmp_path / "whole.jsonl", 1)
    assert [r["outcome"] for r in whole] == ["refused", "refused"]
    lines = (tmp_path / "whole.jsonl").read_text().splitlines()
    (tmp_path / "cut.jsonl").write_text(lines[0] + "\n" + lines[1][:50])
    assert benchmark.run_all(cases, tmp_path / "cut.jsonl", 1) == whole


def _result(truth: str, causes: list[tuple[str, list[str]]], angles: dict[str, float]) -> dict[str, object]:
    told = [{"id": name, "alternatives": alternatives} for name, alternatives in causes]
    return {"truth": {"effects": [truth]}, "causes": told, "angles": [angles], "verdict": "explained"}


def test_how_answers_are_counted() -> None:
    right = _result("a", [("a", ["c"])], {"a": 0.0, "c": 50.0})
    alias = _result("a", [("b", ["a"])], {"a": 0.0, "b": 5.0})
    lax = _result("a", [("b", ["a", "c"])], {"a": 0.0, "b": 5.0, "c": 50.0})
    wrong = _result("a", [("c", [])], {"c": 50.0})
    assert [benchmark.named(r) for r in (right, alias, lax, wrong)] == [True, True, False, False]
    assert [benchmark.covered(r) for r in (right, alias, lax, wrong)] == [True, True, True, False]
    low, high = benchmark.wilson(5, 100)
    assert (low, high) == pytest.approx((0.02154, 0.11175), abs=1e-4)


def test_how_answers_of_the_second_generator_are_counted() -> None:
    def result(name: str, *alternatives: str, verdict: str = "explained") -> dict[str, object]:
        return {
            "truth": ["gear[j2]"],
            "verdict": verdict,
            "findings": [{"name": name, "alternatives": list(alternatives)}],
        }

    right, part, rival = result("gear[j2]"), result("gear[j2].sin"), result("gear[j3]", "gear[j2]")
    wrong, careful = result("gear[j22]"), result("gear[j3]", verdict="partly_explained")
    assert [second.named(r) for r in (right, part, rival, wrong, careful)] == [True, True, True, False, False]
    assert [second.wrong(r) for r in (right, part, rival, wrong, careful)] == [False, False, False, True, False]
    unknown = {"truth": [], "verdict": "explained", "findings": [{"name": "gear[j2]", "alternatives": []}]}
    assert second.wrong(unknown)
    spoken = {"place": "j2", "variable": "own torque", "said": [[["j2"], ["torque"]]]}
    assert not second.wrong(unknown | spoken), "a law of the library of the right place and variable is not wrong"
    assert second.wrong(unknown | spoken | {"place": "j3"})
    assert second.wrong(unknown | spoken | {"variable": "order"})
    assert second.interval(5, 100) == pytest.approx((0.01643, 0.11284), abs=1e-5)
    assert second.interval(0, 20) == pytest.approx((0.0, 0.16843), abs=1e-5)
    assert second.interval(20, 20) == pytest.approx((0.83157, 1.0), abs=1e-5)


def test_every_cause_of_the_library_speaks_of_a_place() -> None:
    """A drift of all readings is of the readings, though its name says no place; warmth alone is nowhere."""
    facts = hidden.experiment_of("fanuc_m900ib", 2).robot.facts
    said = {e.name: named_words(e.name, facts) for k in registry().values() for e in k.places(facts, ("m1", "m2"))}
    assert {name for name, (places, _) in said.items() if not places} == {"thermal_expansion"}
    assert said["reading_drift"] == ({"readings"}, {"order"})
    assert "base" in said["base_compliance[rx]"][0]
    assert "joint_3" in said["gear_flank[joint_3]"][0]


def test_cases_of_the_second_generator_come_again_alike() -> None:
    """The same case has the same seed whatever else is run, so that a checkpoint stays good."""
    few, many = (second.make_cases(n, second.GROUPS, 0) for n in (1, 12))
    assert {c.group for c in few} == set(second.GROUPS)
    assert len({c.id for c in many}) == len(many)
    seeds = {c.id: c.seed for c in many}
    assert all(seeds[c.id] == c.seed for c in few)
    assert not second.make_cases(1, ["nulls"], 0)
    assert len(second.make_cases(1, second.ASKED, 0)) >= 12
    assert 20 < len(second.make_cases(1, second.GROUPS, 0, quick=True)) < 80
