"""What a fitted model leaves unexplained, and the variable that it depends on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from qsframework.diagnoses.residuals.noise_components import pure_dof, replicate_basis
from qsframework.estimation import LinearFit, orthonormal
from qsframework.estimation.projection import Flags
from qsframework.estimation.tails import f_sf
from qsframework.experiment import Experiment
from qsframework.experiment.observations import ReadingRows
from qsframework.plugin import Array, Indices

DEGREE = 3
"""Highest power of a variable in a trend."""
_NEW = 1e-6
"""Share of a trend's column that must remain beside the fit, else the fit absorbs it."""


@dataclass(frozen=True, kw_only=True)
class Trend:
    """Whether residuals depend on a variable: raw p-value, p-value adjusted for all variables (Holm), and in words.

    square, dof: of the residuals that the variable takes; free: degrees of freedom that they have; share: of their sum
    of squares
    """

    variable: str
    p_raw: float
    p_value: float
    square: float
    dof: int
    free: int
    share: float


@dataclass(frozen=True)
class LackOfFit:
    """square, dof: of the whitened residuals, whose noise may have any size; p_replicates: F test against pure error
    with free_replicates degrees of freedom, NaN without replicates; trends: one for each variable, the strongest first.
    """

    square: float
    dof: int
    p_replicates: float
    free_replicates: int
    trends: tuple[Trend, ...]


def lack_of_fit(
    white: Array,
    columns: Array,
    replicate: Indices,
    variables: Mapping[str, Array],
    shapes: Array | None = None,
    mask: Flags | None = None,
) -> LackOfFit:
    """Test whitened residuals (R, 3) of a fit with whitened columns (R, 3, p), freely estimated.

    replicate (R,): equal where pose, load and marker are; variables: (R,) numbers by name, or labels (text, whole
    numbers of a label are text too); shapes (R, 3, d): vector fields that a smooth function of a variable may
    multiply, by default the three axes of the base; mask (R, 3): what was measured, None: all
    """
    fit = LinearFit.onto(orthonormal(columns.reshape(white.size, -1)), white, mask)
    p_replicates, free = _replicates(fit, replicate, mask)
    shapes = np.broadcast_to(np.eye(3), (*white.shape, 3)) if shapes is None else shapes
    trends = _trends(fit, variables, shapes, mask)
    return LackOfFit(fit.chi2, fit.dof, p_replicates, free, trends)


def _replicates(fit: LinearFit, replicate: Indices, mask: Flags | None) -> tuple[float, int]:
    """p-value of the fit against pure error, and the degrees of freedom of the latter."""
    free = pure_dof(replicate, mask)
    if free <= 0 or fit.dof <= free:
        return np.nan, free
    pure = LinearFit.onto(replicate_basis(replicate, mask), fit.white, mask)
    lack, dof = fit.chi2 - pure.chi2, fit.dof - pure.dof
    return float(f_sf(max(lack, 0.0) / dof / (pure.chi2 / pure.dof), dof, pure.dof)), pure.dof


def _trends(fit: LinearFit, variables: Mapping[str, Array], shapes: Array, mask: Flags | None) -> tuple[Trend, ...]:
    """Residuals regressed on each variable, its columns taken beside the fit and beside the shapes themselves."""
    constant = shapes.reshape(len(fit.white), -1)
    around = replace(LinearFit.onto(orthonormal(np.hstack([fit.Q, constant])), fit.white, mask), stated=False)
    found: list[tuple[str, float, float, int]] = []
    for name, values in variables.items():
        Q = _trend_columns(values, shapes, around)
        if Q.shape[1] == 0 or around.dof <= Q.shape[1]:
            continue
        square = float(np.square(Q.T @ around.white).sum())
        found.append((name, float(around.p_values(square, Q.shape[1])), square, Q.shape[1]))
    found.sort(key=lambda t: t[1])
    out: list[Trend] = []
    adjusted = 0.0
    for i, (name, p, square, dof) in enumerate(found):
        adjusted = min(1.0, max(adjusted, p * (len(found) - i)))
        share = square / around.chi2 if around.chi2 > 0.0 else 0.0
        out.append(
            Trend(variable=name, p_raw=p, p_value=adjusted, square=square, dof=dof, free=around.dof, share=share)
        )
    return tuple(out)


def _trend_columns(values: Array, shapes: Array, around: LinearFit) -> Array:
    """Orthonormal columns (3R, k) of smooth functions of a variable times the shapes, beside the fit."""
    functions = smooth(values)
    flat = (functions[:, None, None, :] * shapes[..., None]).reshape(3 * len(values), -1)
    size = np.linalg.norm(flat, axis=0)
    U, new, _ = np.linalg.svd(around.given(flat[:, size > 0.0] / size[size > 0.0]), full_matrices=False)
    return U[:, new > _NEW]


def smooth(values: Array) -> Array:
    """Functions (R, k) of a variable: its Legendre polynomials without the constant, or one column per label."""
    different = np.unique(values)
    if values.dtype.kind in "USO":
        return (values[:, None] == different[None, 1:]).astype(float)
    if len(different) < 2:
        return np.zeros((len(values), 0))
    t: Array = 2.0 * (values - different[0]) / (different[-1] - different[0]) - 1.0
    columns = np.polynomial.legendre.legvander(t, min(DEGREE, len(different) - 1))
    return np.asarray(columns[:, 1:], dtype=np.float64)


def variables_of(experiment: Experiment, rows: ReadingRows) -> dict[str, Array]:
    """What residuals of rows may depend on, by name; only what varies."""
    poses, of = rows.readings.poses, rows.plus
    out = {joint: poses.q[of, k] for k, joint in enumerate(experiment.robot.facts.joints)}
    wrench = poses.wrench[of]
    out |= dict(zip(("fx", "fy", "fz", "mx", "my", "mz"), wrench.T, strict=True))
    out["load"] = np.linalg.norm(wrench[:, :3], axis=1)
    recorded = poses.loaded
    for name in ("time", "temperature", "approach"):
        values = getattr(recorded, name)
        if values is not None and np.isfinite(values[of]).all():
            out[name] = values[of]
    out["marker"] = np.array([experiment.markers[int(m)].name for m in rows.marker])
    return {name: values for name, values in out.items() if len(np.unique(values)) > 1}


def arm_axes(experiment: Experiment, rows: ReadingRows) -> Array:
    """Axes (R, 3, 3) that turn with the arm about the vertical of the base: outwards, sideways, up, as columns.

    In them a fault of the arm looks alike wherever the first joint has turned it.
    """
    place = experiment.model().positions(rows.readings.poses, linear=True)[rows.plus, rows.marker]
    up = np.array([0.0, 0.0, 1.0])
    g = experiment.robot.gravity
    if np.linalg.norm(g) > 0.0:
        up = -g / np.linalg.norm(g)
    out = place - (place @ up)[:, None] * up
    size = np.linalg.norm(out, axis=1, keepdims=True)
    sideways = np.cross(up, np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0]))
    out = np.where(size > 1e-6, out / np.maximum(size, 1e-300), np.cross(sideways, up) / np.linalg.norm(sideways))
    return np.stack([out, np.cross(up, out), np.broadcast_to(up, out.shape)], axis=2)
