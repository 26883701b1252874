"""What a plan says of the tip: after the frame and the tool that suit best, by differences and by least squares."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.elastostatics import equilibrium
from qsframework.estimation import scales
from qsframework.experiment import Experiment, Plan, load_experiment
from qsframework.experiment.prior import priors_of
from qsframework.information.absorbed import FRAME, TOOL, absorbed, tip_motions
from qsframework.information.sensitivities import plan_columns
from qsframework.plans import design, generate_candidates
from qsframework.plans.options import DesignOptions
from qsframework.plans.tip import unstated
from qsframework.plugin import Array, Poses

TEXT = """
robot: ur10
load: {point_mm: [80, 0, 60]}
markers: {m1: {xyz_mm: [80, 0, 60]}, m2: {xyz_mm: [-60, 60, 90]}, m3: {xyz_mm: [0, -80, 40]}}
noise: {position_sigma_mm: 0.03, displacement_sigma_mm: 0.03}
effects: [{effect: marker_offset, markers: all}]
loads: [{name: weight, fz_N: -98}, {name: side, fz_N: -20, fx_N: 80}]
positions: {}
fit: [joint_compliance, geometry, marker_offset]
"""
POSES = 16


def written(folder: Path, text: str = TEXT) -> Experiment:
    (folder / "experiment.yaml").write_text(text)
    return load_experiment(folder / "experiment.yaml")


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return written(tmp_path_factory.mktemp("mixed"))


@pytest.fixture(scope="module")
def candidates(mixed: Experiment) -> Array:
    return generate_candidates(mixed, 60, seed=0).pendant


@pytest.fixture(scope="module")
def plan(mixed: Experiment, candidates: Array) -> Plan:
    return design(mixed, POSES, candidates=candidates, options=DesignOptions(polish=False, starts=3))


def tips(experiment: Experiment, x: Array, pendant: Array, wrench: Array) -> Array:
    """Where the load point stands (N, 3) under a wrench."""
    q = experiment.robot.controller.to_joints(pendant)
    found = equilibrium(experiment.model(), Poses(pendant, q, np.tile(wrench, (len(q), 1))), x, loaded=True)
    return found.tip


def test_the_predicted_tip_is_that_of_differences_less_the_best_frame_and_tool(
    mixed: Experiment, candidates: Array, plan: Plan
) -> None:
    """The root mean square over all candidates under every load, by central differences of the equilibrium; what is
    known before stands as rows under those of the plan, and frame and tool are fitted to each difference."""
    model, names = mixed.model(), mixed.fit_names()
    index = model.index(names)
    sd = priors_of(model).sd[index]
    size = scales([model.parameters[i] for i in index])
    rows = np.concatenate([plan_columns(mixed, plan, names) / size, np.diag(1.0 / sd)[np.isfinite(sd)]])
    covariance = np.linalg.inv((rows * size).T @ (rows * size)) * np.outer(size, size)
    root = np.linalg.cholesky(covariance)
    q = mixed.robot.controller.to_joints(candidates)
    square, base = 0.0, 0.0
    cases = [case.wrench for case in mixed.cases]
    work = np.resize(np.repeat(np.stack(cases), len(q), axis=0), (len(q), 6))
    assert np.ptp(work, axis=0).max() == 0.0, "the first load is the one over which frame and tool suit"
    motions = {}
    for k, column in enumerate(np.eye(len(names))):
        step = np.zeros(len(model.parameters))
        step[index] = 1e-2 * size * column
        for w, wrench in enumerate(cases):
            far = tips(mixed, model.nominal + step, candidates, wrench) - tips(
                mixed, model.nominal - step, candidates, wrench
            )
            motions[w, k] = far / (2e-2 * size[k])
    for w, wrench in enumerate(cases):
        found = equilibrium(model, Poses(candidates, q, np.tile(wrench, (len(q), 1))), model.nominal, loaded=True)
        if w == 0:
            moved = tip_motions(found.tip, found.tip_rotation)[:, :3].reshape(-1, 9)
            first = np.stack([motions[0, k].ravel() for k in range(len(names))], axis=1)
            suited = np.linalg.lstsq(moved, first, rcond=None)[0]
        here = tip_motions(found.tip, found.tip_rotation)[:, :3].reshape(-1, 9)
        slope = np.stack([motions[w, k].ravel() for k in range(len(names))], axis=1)
        square += np.square((slope - here @ suited) @ root).sum() / len(q) / len(cases)
        base += np.square(slope @ root).sum() / len(q) / len(cases)
    assert plan.certificate is not None
    assert plan.certificate.value == pytest.approx(square, rel=2e-3)
    assert plan.certificate.value_in_base == pytest.approx(base, rel=2e-3)
    assert 1e3 * np.sqrt(base) > 1.0
    assert plan.certificate.value_before is not None
    assert np.sqrt(square) < 0.05 * np.sqrt(plan.certificate.value_before)


def test_poses_go_where_they_help_the_tip(mixed: Experiment, candidates: Array, plan: Plan) -> None:
    """Without what is known before, most poses would chase the turn of the base, which only the loads show."""
    freely = design(mixed, POSES, candidates=candidates, options=DesignOptions(polish=False, starts=3, free=True))
    assert plan.of_positions.sum() > POSES / 2 > freely.of_positions.sum()
    assert freely.certificate is not None
    assert freely.certificate.value_in_base is None
    assert freely.certificate.value > plan.certificate.value  # type: ignore[union-attr]


def test_frame_and_tool_take_up_their_own_motions_and_leave_nothing_along_them() -> None:
    rng = np.random.default_rng(0)
    rotation = np.linalg.qr(rng.standard_normal((20, 3, 3)))[0]
    moved = tip_motions(rng.standard_normal((20, 3)), rotation)[:, :3]
    assert np.allclose(absorbed(moved, moved, FRAME + TOOL).left(moved, moved), 0.0, atol=1e-12)
    slope = rng.standard_normal((20, 3, 4))
    left = absorbed(slope, moved, FRAME).left(slope, moved)
    assert np.allclose(np.einsum("njc,njp->cp", moved[:, :, :6], left), 0.0, atol=1e-12)
    assert not np.allclose(np.einsum("njc,njp->cp", moved[:, :, 6:], left), 0.0, atol=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "columns"),
    [
        ("", "", FRAME + TOOL),
        (", marker_offset]", "]", FRAME),
        ("positions: {}\n", "", ()),
    ],
)
def test_what_nobody_states(tmp_path: Path, old: str, new: str, columns: tuple[int, ...]) -> None:
    experiment = written(tmp_path, TEXT.replace(old, new) if old else TEXT)
    assert unstated(experiment, experiment.fit_names()) == columns


def test_a_plan_of_what_is_known_better_says_so(mixed: Experiment, candidates: Array) -> None:
    """Zeros of a fine encoder, mastered to 2 urad: no reading of 0.03 mm improves on that."""
    zeros = tuple(f"joint_offset[joint_{k}]" for k in (2, 3))
    own = tuple(replace(p, sd=2e-6) if p.name in zeros else p for p in mixed.parameters)
    fine = mixed.with_(fit=zeros, parameters=own)
    certificate = design(fine, 4, "D", candidates=candidates).certificate
    assert certificate is not None
    assert "identify none of the parameters better than they are known" in " ".join(certificate.notes)
    usual = design(mixed.with_(fit=zeros), 4, "D", candidates=candidates).certificate
    assert usual is not None
    assert "better than they are known" not in " ".join(usual.notes)
