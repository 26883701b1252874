"""What a campaign states of its noise, and what fits, plans and simulations make of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsf_trackers.importing import import_readings
from qsf_trackers.words import import_words
from qsframework.diagnoses.audit_entries import Audited, noise_entry
from qsframework.errors import InputError
from qsframework.estimation import LinearFit, orthonormal
from qsframework.estimation.axis_noise import LEVEL, axis_noise
from qsframework.experiment import Experiment, make_rows, read_readings, simulate
from qsframework.experiment.noise import NoiseModel, split_covariances
from qsframework.experiment.observations import ReadingRows
from qsframework.experiment.simulate import planned_readings
from qsframework.fits import identify
from qsframework.information import predicted_sd
from qsframework.information.sensitivities import plan_columns
from qsframework.plans.candidates import generate_candidates
from qsframework.plans.options import DesignOptions
from qsframework.plans.problem import joint_sd, make_problem
from qsframework.plugin import Array
from tests.calibration.small_arm import LOADS, small_arm, small_plan

STATION = "stations: {front: {xyz_mm: [4000, 500, 300]}}"
BEAM = "range_sigma_mm: 0.01, angle_sigma_urad: 15"
GAUGED = "[{name: weight, fz_N: -2000, gauge: {marker: m1, along: [0, 0, 1]}}, {name: pull, fy_N: 900}]"


def covariance(rows: ReadingRows) -> Array:
    """Of all coordinates (m, m)."""
    return rows.noise.colour(rows.noise.colour(np.eye(len(rows.at))).T)


def test_a_covariance_is_an_equal_error_and_two_vectors() -> None:
    root = np.random.default_rng(0).normal(size=(5, 3, 3))
    C = root @ root.transpose(0, 2, 1)
    sigma, vectors = split_covariances(C)
    beyond = np.einsum("nvi,nvj->nij", vectors, vectors)
    alike = np.square(sigma) - np.einsum("nii->ni", beyond)
    assert np.allclose(alike, np.linalg.eigvalsh(C)[:, :1])
    assert np.allclose(beyond + alike[:, :1, None] * np.eye(3), C)


def test_a_tracker_errs_along_its_beam_and_across(tmp_path: Path) -> None:
    """Of a displacement, twice: loaded and unloaded; with the nest's part and that of the visit."""
    arm = small_arm(tmp_path, f"{{{BEAM}, repeatability_mm: 0.02, nest_sigma_mm: 0.03}}", STATION)
    plan = small_plan(arm, 2)
    rows = make_rows(planned_readings(arm, plan))
    seen = arm.rigid_places(plan.q)[0] - [4.0, 0.5, 0.3]
    far = np.linalg.norm(seen[0])
    along = np.outer(seen[0], seen[0]) / far**2
    own = 2.0 * (1e-5**2 * along + (15e-6 * far) ** 2 * (np.eye(3) - along)) + 3e-5**2 * np.eye(3)
    C = covariance(rows)
    assert np.allclose(C[:3, :3], own + 2e-5**2 * np.eye(3), rtol=1e-9, atol=1e-18)
    assert np.allclose(C[:3, 3:6], 2e-5**2 * np.eye(3), atol=1e-18), "markers of a visit share what the arm does"
    assert np.allclose(C[:9, 9:], 0.0)


@pytest.mark.parametrize(
    "noise", [BEAM, f"{BEAM}, repeatability_mm: 0.03", "displacement_sigma_mm: 0.03, repeatability_mm: 0.04"]
)
def test_a_design_counts_readings_as_a_fit_does(tmp_path: Path, noise: str) -> None:
    """The information of candidates is that of the readings of a plan of the same poses."""
    arm = small_arm(tmp_path, f"{{{noise}, gauge_sigma_mm: 0.02}}", STATION, GAUGED)
    problem = make_problem(arm, generate_candidates(arm, 6, seed=1), 4.0)
    chosen = np.arange(0, 12, 3)
    rows = problem.made(chosen, linear=False)[:, 0]
    assert np.allclose(problem.rows.take(chosen)[:, 0], rows)
    from qsframework.experiment.plan import make_plan

    names = [problem.loads[int(g)].name for g in problem.load(chosen)]
    plan = make_plan(problem.batch(chosen), names, station=["front"] * len(chosen))
    columns = plan_columns(arm, plan, problem.names)
    flat = rows.reshape(-1, rows.shape[-1])
    assert np.allclose(flat.T @ flat, columns.T @ columns, rtol=1e-6)


def test_estimated_sizes_weigh_readings_and_are_estimated_again(tmp_path: Path) -> None:
    """As an extension writes them: a simulation has them, a fit finds its own."""
    arm = small_arm(tmp_path, "{sigma_mm: 0.03, source: estimated}")
    made = simulate(arm, small_plan(arm, 30), seed=1).readings
    assert not made.stated
    half = replace(made, value=made.value)
    fit = identify(arm, half)
    assert fit.sigma_source == "estimated"
    assert fit.p_value is None
    assert fit.sigma == pytest.approx(3e-5, rel=0.15)
    assert 2.0 < fit.coverage < 2.05
    assert NoiseModel(3e-5, repeatability=1e-5, source="estimated").entry() == {
        "sigma_mm": pytest.approx(0.03),
        "repeatability_mm": pytest.approx(0.01),
        "source": "estimated",
    }


def test_an_extension_counts_what_visits_share_once() -> None:
    """The sd that an audit found holds it; where each kind has its own, it is scaled as they are."""
    audited = Audited(sigma=6e-5, factor=2.0)
    assert noise_entry(NoiseModel(3e-5, repeatability=2e-5), audited) == {
        "sigma_mm": pytest.approx(0.06),
        "source": "estimated",
    }
    apart = noise_entry(NoiseModel(None, position=3e-5, repeatability=2e-5), audited)
    assert apart["repeatability_mm"] == pytest.approx(0.04)


def test_what_is_stated_is_compared_with_what_is_found(tmp_path: Path) -> None:
    arm = small_arm(tmp_path, "{sigma_mm: 0.03, repeatability_mm: 0.01}")
    truth = small_arm(tmp_path / "truth", "{sigma_mm: 0.03, repeatability_mm: 0.09}")
    readings = simulate(truth, small_plan(truth, 12), seed=2).readings
    from qsframework.estimation import FitOptions

    fit = identify(arm, replace(readings, repeatability=1e-5), options=FitOptions(shared="pose"))
    assert fit.shared_sd == 1e-5
    assert any("by the residuals and 0.0100 mm as stated" in note for note in fit.notes)


@pytest.mark.parametrize(
    ("noise", "loads", "words"),
    [
        ("{displacement_sigma_mm: 0.03}", GAUGED, "gauge_sigma_mm"),
        (f"{{{BEAM}}}", "", "where the tracker stands"),
        ("{range_sigma_mm: 0.01}", "", "belong together"),
        (f"{{{BEAM}, distance_sigma_um/m: 5}}", "", "not both"),
        ("{sigma_mm: 0}", "", "must be positive"),
        ("{sigma_mm: 0.03, source: guessed}", "", "source"),
    ],
)
def test_a_noise_that_is_not_enough_is_named(tmp_path: Path, noise: str, loads: str, words: str) -> None:
    def planned() -> Array:
        arm = small_arm(tmp_path, noise, loads=loads or LOADS)
        return predicted_sd(arm, small_plan(arm, 3))

    with pytest.raises(InputError, match=words):
        planned()


def test_directions_are_seen_and_seldom_where_there_are_none() -> None:
    """Errors of .5 : .8 : 1.45 along axes of any turn, beside twenty columns; and of one size."""
    rng = np.random.default_rng(3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    same, mask, far = np.tile(np.eye(3), (60, 1, 1)), np.ones((60, 3), dtype=bool), np.full(60, np.nan)
    sizes, false = list[Array](), 0
    for _ in range(100):
        Q = orthonormal(rng.normal(size=(180, 20)))
        e = rng.normal(size=(60, 3))
        found = axis_noise(LinearFit.onto(Q, ((e * [0.5, 0.8, 1.45]) @ turn.T).ravel()), [same], mask, far)
        clean = axis_noise(LinearFit.onto(Q, e.ravel()), [same], mask, far)
        assert found is not None
        assert clean is not None
        assert found.p_value < LEVEL
        sizes.append(found.sizes)
        false += clean.p_value < LEVEL
    assert np.mean(sizes, axis=0) == pytest.approx(np.array([0.5, 0.8, 1.45]), rel=0.13)
    assert false <= 3


def test_a_growth_with_the_distance_is_seen() -> None:
    rng = np.random.default_rng(4)
    same, mask, far = np.tile(np.eye(3), (200, 1, 1)), np.ones((200, 3), dtype=bool), rng.uniform(1.0, 8.0, 200)
    e = rng.normal(size=(200, 3)) * far[:, None]
    found = axis_noise(LinearFit.onto(orthonormal(rng.normal(size=(600, 20))), e.ravel()), [same], mask, far)
    assert found is not None
    assert found.growth == pytest.approx(1.0, abs=0.15)
    assert found.p_value < 1e-6


HEAD = "pose,q1_deg,q2_deg,q3_deg,fx_N,fy_N,fz_N,marker,dx_mm,dy_mm,dz_mm"


def table(folder: Path, arm: Experiment, extra: str, cells: list[str], last: str = "1", name: str = "p{}") -> int:
    """Rows that four reads of one marker at one place become."""
    row = ",10,20,30,0,0,-900,m1,1.{0}1,2.{0}3,3.{0}2"
    other = "z,40,20,30,0,0,-900,m1,1.5,2.5,3.5"
    lines = [name.format(k) + row.format(k) + f",{cell}" for k, cell in enumerate(cells)]
    (folder / "t.csv").write_text("\n".join([f"{HEAD},{extra}", *lines, f"{other},{last}"]) + "\n")
    return len(read_readings(folder / "t.csv", arm))


def test_reads_one_after_the_other_are_of_one_visit_unless_the_file_says_otherwise(tmp_path: Path) -> None:
    arm = small_arm(tmp_path)
    assert table(tmp_path, arm, "use", ["1"] * 4) == 2
    assert table(tmp_path, arm, "use", ["1"] * 4, name="p") == 2, "under one name as well"
    assert table(tmp_path, arm, "repeat", ["1", "2", "3", "4"], name="p") == 5
    assert table(tmp_path, arm, "visit", ["1", "2", "3", "4"], name="p") == 5
    assert table(tmp_path, arm, "time_s", ["0", "2", "4", "6"], "90") == 2, "it took 84 s to move on"
    assert table(tmp_path, arm, "time_s", ["0", "10", "110", "210"], "240") == 4, "30 s were enough to move on"
    (said,) = read_readings(tmp_path / "t.csv", arm).about_reads
    assert said.startswith("1 rows are further reads")
    assert import_words(import_readings(arm, [tmp_path / "t.csv"]))[-1] == said


def test_copies_are_no_reads(tmp_path: Path) -> None:
    arm = small_arm(tmp_path)
    same = ",10,20,30,0,0,-900,m1,1.1,2.3,3.2"
    (tmp_path / "t.csv").write_text("\n".join([HEAD, f"p{same}", f"p{same}"]) + "\n")
    with pytest.raises(InputError, match="stands here twice"):
        read_readings(tmp_path / "t.csv", arm)


def test_options_of_a_design_with_a_beam_run(tmp_path: Path) -> None:
    """The whole verb, with a tracker that errs along its beam: its promise is that of the readings of the plan."""
    from qsframework.plans import design

    arm = small_arm(tmp_path, f"{{{BEAM}, repeatability_mm: 0.01}}", STATION)
    plan = design(arm, 6, candidates=generate_candidates(arm, 60, seed=0), options=DesignOptions(criterion="A"))
    sd = predicted_sd(arm, plan)
    fit = identify(arm, simulate(arm, plan, seed=1).readings)
    assert fit.sd == pytest.approx(sd, rel=0.02)


def test_points_touched_at_single_poses_promise_as_much_as_fits_know(tmp_path: Path) -> None:
    """Each point is touched in two states: three numbers of it are estimated, and not the six of a frame."""
    arm = small_arm(tmp_path)
    plan = small_plan(arm, 4)
    turned = np.rad2deg(plan.poses.pendant)
    rows = ["pose,q1_deg,q2_deg,q3_deg,fx_N,fy_N,fz_N,marker,state,x_mm,y_mm,z_mm,point"]
    for i, (q, wrench) in enumerate(zip(turned, plan.wrench, strict=True)):
        for state, load in (("unloaded", [""] * 3), ("loaded", [f"{v}" for v in wrench[:3]])):
            cells = [f"p{i}", *(f"{a}" for a in q), *load, "m1", state, "0", "0", "0", f"at_{i}"]
            rows.append(",".join(cells))
    (tmp_path / "touched.csv").write_text("\n".join(rows) + "\n")
    readings = read_readings(tmp_path / "touched.csv", arm, "positions")
    seen = make_rows(readings)
    exact = np.array(readings.value)
    exact[seen.keep] = seen.predict(arm.model(), arm.model().nominal, seen.start(arm.model(), arm.model().nominal))
    fit = identify(arm, readings.with_values(exact))
    assert joint_sd(arm, [readings]) == pytest.approx(fit.sd[[fit.names.index(n) for n in arm.fit_names()]], rel=0.02)
    nowhere = seen.nearest(seen.positions(arm.model(), arm.model().nominal, True), np.zeros(len(seen.keep), dtype=bool))
    assert np.isfinite([frame.origin for frame in nowhere]).all(), "a point of which no row counts"
