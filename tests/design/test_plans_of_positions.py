"""Plans of positions: no load, the frame and the nests unknown; the promised sds are those of the fits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qsframework.errors import InputError
from qsframework.estimation import PLAIN
from qsframework.experiment import Experiment, Plan, load_experiment, simulate
from qsframework.fits import identify
from qsframework.fits.identify import fit_readings
from qsframework.information import predicted_uncertainties
from qsframework.plans import design
from qsframework.plans.candidates import generate_candidates
from qsframework.plans.certified import relaxed_design
from qsframework.plans.criteria import Determinant, Mean
from qsframework.plans.options import DesignOptions
from qsframework.plans.problem import make_problem

TEXT = """
robot: ur10
rigid: true
markers:
  m1: {xyz_mm: [60, 0, 40]}
  m2: {xyz_mm: [-40, 50, 40]}
  m3: {xyz_mm: [-40, -50, 80]}
noise: {position_sigma_mm: 0.03}
stations:
  east: {xyz_mm: [3000, 500, 300]}
fit: [geometry]
"""
DRAWS = 30


def written(folder: Path, text: str = TEXT) -> Experiment:
    (folder / "experiment.yaml").write_text(text)
    return load_experiment(folder / "experiment.yaml")


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> tuple[Experiment, Plan]:
    experiment = written(tmp_path_factory.mktemp("positions"))
    candidates = generate_candidates(experiment, 120, seed=0)
    return experiment, design(experiment, 18, "D", candidates)


def test_the_plan_is_certified_and_reads_positions_from_the_station(planned: tuple[Experiment, Plan]) -> None:
    _, plan = planned
    assert plan.certificate is not None
    assert plan.certificate.polished_from > 0.9
    assert set(plan.station) == {"east"}
    assert not plan.wrench.any()


def test_predicted_sds_are_those_of_fits_and_of_their_errors(planned: tuple[Experiment, Plan]) -> None:
    """Of arms as they are delivered: what is known of them counts in the plan as in the fit."""
    experiment, plan = planned
    predicted = {p.name: p.sd for p in predicted_uncertainties(experiment, plan)}
    drawn = [simulate(experiment, plan, truth="drawn", seed=s) for s in range(DRAWS)]
    fits = [fit_readings(experiment, one.readings, PLAIN) for one in drawn]
    names = [e.name for e in fits[0].estimates if e.name in predicted]
    assert len(names) == len(predicted) == 42
    sds = np.median([[e.sd for e in fit.estimates if e.name in names] for fit in fits], axis=0)
    assert sds == pytest.approx([predicted[n] for n in names], rel=4e-2), "a value far off loosens what was known"
    errors = [
        [e.value - one.truth_by_name()[e.name] for e in fit.estimates if e.name in names]
        for one, fit in zip(drawn, fits, strict=True)
    ]
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / [predicted[n] for n in names]
    one = 1.0 / np.sqrt(2.0 * DRAWS)
    assert np.abs(ratio - 1.0).max() < 4.0 * one
    assert abs(ratio.mean() - 1.0) < 3.0 * one / 2.0  # estimates of one fit scatter together


def test_a_second_station_helps_and_costs(tmp_path: Path) -> None:
    """A budget of plain poses: the second station is set up only where it is worth its cost."""
    both = TEXT.replace("fit:", "  west: {xyz_mm: [-3000, -500, 300], cost: 4}\nfit:")
    experiment = written(tmp_path, both)
    options = DesignOptions(criterion="D", budget=16.0)
    plan = design(experiment, 0, candidates=generate_candidates(experiment, 60, seed=0), options=options)
    assert sum(plan.repeats) + 4 * ("west" in plan.station) <= 16


def test_reflectors_on_other_links_and_on_the_floor_are_planned_and_fitted(tmp_path: Path) -> None:
    """What the plan predicts of their places is what a fit gives, though not every station sees each at every pose."""
    more = "  elbow: {xyz_mm: [0, 60, 60], link: link_3}\n  floor: {xyz_mm: [900, 200, 0], link: base_link}\n"
    effects = "effects: [{effect: marker_offset, markers: all}]\nfit: [geometry, marker_offset]"
    experiment = written(tmp_path, TEXT.replace("noise:", f"{more}noise:").replace("fit: [geometry]", effects))
    options = DesignOptions(criterion="D", polish=False)
    plan = design(experiment, 16, candidates=generate_candidates(experiment, 100, seed=0), options=options)
    promised = {p.name: p.sd for p in predicted_uncertainties(experiment, plan)}
    readings = simulate(experiment, plan, seed=1).readings
    assert 16 * 3 < len(readings) < 16 * 5
    fit = {e.name: e.sd for e in identify(experiment, readings).estimates}
    for name in (f"marker_offset[{marker}].{axis}" for marker in ("elbow", "floor") for axis in "xyz"):
        assert fit[name] == pytest.approx(promised[name], rel=2e-2)


TWO = """
robot: ur10
rigid: true
markers: {m1: {xyz_mm: [80, 0, 60]}, m2: {xyz_mm: [-60, 60, 90]}, m3: {xyz_mm: [0, -80, 40]}}
stations: {front: {xyz_mm: [3000, 500, 300]}, side: {xyz_mm: [300, -3200, 900], cost: 4}}
noise: {position_sigma_mm: 0.015, distance_sigma_um/m: 6}
effects: [{effect: marker_offset, markers: all}]
fit: [geometry, marker_offset]
"""


def test_a_station_that_is_not_worth_its_frame_is_certified_all_the_same(tmp_path: Path) -> None:
    """With both stations the best weights leave one next to nothing: rounds must not turn in a circle."""
    experiment = written(tmp_path, TWO)
    candidates = generate_candidates(experiment, 600, seed=0)
    problem = make_problem(experiment, candidates, 26.0, budget=True)
    wanted = np.eye(problem.reading.width)[:, problem.wanted.tolist()]
    rule = Mean(Determinant("D", "", wanted))
    relaxed, _ = relaxed_design(problem, rule, DesignOptions(criterion="D", budget=26.0), 0, lambda bound: None)
    assert relaxed.efficiency > 1.0 - 1e-5
    share = np.bincount(problem.station(relaxed.index), relaxed.weights, 2)
    assert share[1] < 1e-3


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("noise: {position_sigma_mm: 0.03}", "noise: estimate", ("needs", "noise")),
        ("xyz_mm: [3000, 500, 300]", "xyz_mm: [3000, 500]", ("xyz needs three numbers",)),
    ],
)
def test_what_a_plan_of_positions_lacks_is_said(tmp_path: Path, old: str, new: str, words: tuple[str, ...]) -> None:
    def tried() -> Plan:
        experiment = written(tmp_path, TEXT.replace(old, new))
        return design(experiment, 10, "D", generate_candidates(experiment, 30, seed=0))

    with pytest.raises(InputError) as error:
        tried()
    for word in words:
        assert word in str(error.value)
