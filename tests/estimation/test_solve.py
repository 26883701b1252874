"""The solver on its own: against closed forms, scipy, brute force, and problems it has to refuse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.estimation import FitOptions, Independent, Observations, Solution, propagated, settle, solve
from qsframework.plugin import Array, Parameter


def line(m: int = 30, seed: int = 0, lower: float = -np.inf) -> tuple[Observations, Array]:
    """y = A x + noise with three parameters of very different size."""
    rng = np.random.default_rng(seed)
    size = np.array([1e-7, 1.0, 1e5])
    A = rng.normal(size=(m, 3)) / size
    truth = size * [1.0, -0.05, 2.0]
    sigma = rng.uniform(0.5, 2.0, m) * 0.1
    parameters = tuple(
        Parameter(n, "", nominal=v, typical=v, sd=0.5 * v, lower=lower) for n, v in zip("abc", size, strict=True)
    )
    return _observations(lambda x: A @ x, lambda x: A, parameters, A @ truth + sigma * rng.normal(size=m), sigma), A


def _observations(
    predict: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    parameters: tuple[Parameter, ...],
    measured: Array,
    sigma: Array,
) -> Observations:
    index = np.arange(len(measured))
    return Observations(
        measured=measured,
        predict=predict,
        jacobian=jacobian,
        parameters=parameters,
        noise=Independent(sigma),
        block=index,
        row=index,
    )


def decay(seed: int = 0) -> Observations:
    """y = a exp(-b t): bent in b."""
    t = np.linspace(0.0, 4.0, 40)
    sigma = np.full(40, 0.01)
    y = 2.0 * np.exp(-1.3 * t) + sigma * np.random.default_rng(seed).normal(size=40)
    parameters = (
        Parameter("a", "", nominal=1.0, typical=1.0, lower=0.0),
        Parameter("b", "", nominal=0.4, typical=1.0, lower=0.0),
    )
    return _observations(
        lambda x: x[0] * np.exp(-x[1] * t),
        lambda x: np.stack([np.exp(-x[1] * t), -x[0] * t * np.exp(-x[1] * t)], axis=1),
        parameters,
        y,
        sigma,
    )


def test_a_line_is_solved_in_closed_form() -> None:
    o, A = line()
    W = A / o.noise.whiten(np.ones(30))[:, None] ** -1
    found = solve(o)
    cov = np.linalg.inv((W * [1e-7, 1, 1e5]).T @ (W * [1e-7, 1, 1e5])) * np.outer([1e-7, 1, 1e5], [1e-7, 1, 1e5])
    assert np.allclose(found.x, cov @ W.T @ o.noise.whiten(o.measured), rtol=1e-10)
    assert np.allclose(found.covariance, cov, rtol=1e-9)
    assert np.allclose(found.jacobian, W)
    assert found.cost == pytest.approx(0.5 * (found.residuals**2).sum())


def test_a_bound_is_met_exactly_and_named() -> None:
    """And left alone where bounds are not kept, which is the default."""
    o, A = line(lower=0.0)
    free = solve(o)
    assert free.x[1] < 0.0
    assert free.at_bound == ()
    found = solve(o, FitOptions(bounds=True))
    assert found.at_bound == ("b",)
    assert found.x[1] == 0.0
    W = o.noise.whiten(A[:, [0, 2]] * [1e-7, 1e5])
    assert np.allclose(found.x[[0, 2]], np.linalg.lstsq(W, o.noise.whiten(o.measured))[0] * [1e-7, 1e5], rtol=1e-9)
    assert not found.covariance[1].any()
    assert found.free == 2


def known(o: Observations) -> Observations:
    """The same where each parameter is known to half its nominal value before the readings."""
    return replace(o, prior_sd=0.5 * o.start)


def test_priors_are_readings() -> None:
    """Rows below those of the readings, residuals and cost included."""
    o, A = line()
    size = np.array([1e-7, 1.0, 1e5])
    W = np.vstack([o.noise.whiten(A * size), 2.0 * np.eye(3)])
    y = np.concatenate([o.noise.whiten(o.measured), 2.0 * np.ones(3)])
    found = solve(known(o))
    assert np.allclose(found.x, np.linalg.lstsq(W, y)[0] * size, rtol=1e-9)
    assert np.allclose(found.covariance, np.linalg.inv(W.T @ W) * np.outer(size, size), rtol=1e-9)
    left = y - W @ (found.x / size)
    assert np.allclose(np.concatenate([found.residuals, found.priors]), left, atol=1e-9)
    assert found.cost == pytest.approx(0.5 * float(left @ left), rel=1e-12)
    assert not len(solve(o).priors), "nothing is known of any"


def test_priors_tell_what_readings_cannot() -> None:
    o, A = line()
    blind = A.copy()
    blind[:, 2] = 0.0
    unseen = replace(o, jacobian=lambda x: blind, predict=lambda x: blind @ x)
    with pytest.raises(NotIdentifiable, match="c: no reading depends on it"):
        solve(unseen)
    found = solve(known(unseen))
    assert found.x[2] == pytest.approx(1e5)
    assert np.sqrt(found.covariance[2, 2]) == pytest.approx(0.5e5)


def test_fixed_and_tied() -> None:
    o, A = line()
    found = solve(o, FitOptions(fixed=("c",)))
    W = o.noise.whiten(A)
    left = o.noise.whiten(o.measured) - W[:, 2] * 1e5
    assert found.x[2] == 1e5
    assert np.allclose(found.x[:2], np.linalg.lstsq(W[:, :2] * [1e-7, 1], left)[0] * [1e-7, 1])
    found = solve(o, FitOptions(tied=(("a", "c"),)))
    assert found.x[2] / found.x[0] == pytest.approx(1e12)
    both = np.stack([W[:, 0] * 1e-7 + W[:, 2] * 1e5, W[:, 1]], axis=1)
    assert np.allclose(found.x[:2] / [1e-7, 1], np.linalg.lstsq(both, o.noise.whiten(o.measured))[0])
    for wrong, words in (
        (FitOptions(fixed=("d",)), "no parameter 'd'"),
        (FitOptions(fixed=("a", "b", "c")), "nothing is left"),
    ):
        with pytest.raises(InputError, match=words):
            solve(o, wrong)
    with pytest.raises(InputError, match="tied and fixed, or tied twice: a"):
        FitOptions(fixed=("a",), tied=(("a", "b"),))


def scipys(o: Observations, loss: str, start: Array) -> Array:
    kind = {"loss": loss, "f_scale": 1.345} if loss != "linear" else {}
    return least_squares(
        lambda x: o.noise.whiten(o.predict(x) - o.measured),
        start,
        lambda x: o.noise.whiten(o.jacobian(x)),
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
        **kind,
    ).x


@pytest.mark.parametrize("loss", ["linear", "huber", "soft_l1"])
def test_a_bent_model_with_gross_readings_agrees_with_scipy(loss: str) -> None:
    o = decay()
    gross = o.measured.copy()
    gross[[5, 20]] += [0.4, -0.3]
    o = replace(o, measured=gross)
    found = solve(o, FitOptions(loss=loss))
    assert np.allclose(found.x, scipys(o, loss, np.array([2.0, 1.3])), rtol=1e-6)


def test_robust_losses_resist() -> None:
    clean, gross = decay(1), decay(1)
    bad = gross.measured.copy()
    bad[3] += 1.0
    gross = replace(gross, measured=bad)
    sound = solve(clean).x
    off = {loss: abs(solve(gross, FitOptions(loss=loss)).x[1] - sound[1]) for loss in ("linear", "huber", "soft_l1")}
    assert off["huber"] < off["linear"] / 20
    assert off["soft_l1"] < off["linear"] / 20
    assert solve(gross, FitOptions(loss="huber")).weights[3] < 0.02


def test_other_starts_find_the_deeper_minimum() -> None:
    """y = sin(b t): from b = 1 the nearest minimum is a wrong frequency."""
    t = np.linspace(0.0, 6.0, 60)
    p = (Parameter("b", "", nominal=1.0, typical=1.0, sd=2.0, lower=0.0),)
    o = _observations(
        lambda x: np.sin(x[0] * t), lambda x: (t * np.cos(x[0] * t))[:, None], p, np.sin(2.7 * t), np.full(60, 0.1)
    )
    alone = _try(o, starts=0)
    assert alone is None or abs(alone.x[0] - 2.7) > 0.1
    found = solve(o, FitOptions(starts=12))
    assert found.x[0] == pytest.approx(2.7)
    assert np.array_equal(found.x, solve(o, FitOptions(starts=12)).x)


def test_a_linear_model_is_told_by_one_step_of_all_parameters() -> None:
    """Whether other starts are worth it costs two sets of sensitivities, not one for each parameter."""
    o, A = line()
    asked = list[Array]()

    def jacobian(x: Array) -> Array:
        asked.append(x)
        return A

    solve(replace(o, jacobian=jacobian), FitOptions(starts=0))
    plain = len(asked)
    solve(replace(o, jacobian=jacobian), FitOptions(starts=12))
    assert len(asked) - plain == plain + 2
    assert np.all(asked[plain + 1] != asked[plain]), "all parameters move"


def _try(o: Observations, starts: int) -> Solution | None:
    try:
        return solve(o, FitOptions(starts=starts))
    except NotConverged:
        return None


def test_what_does_not_converge_is_no_result() -> None:
    o = decay()
    with pytest.raises(NotConverged, match="no finite prediction"):
        solve(replace(o, predict=lambda x: np.full(40, np.nan)))
    with pytest.raises(NotConverged, match=r"no step lowers|did not settle"):
        solve(replace(o, jacobian=lambda x: -o.jacobian(x)))


def test_only_a_combination_is_told() -> None:
    o, A = line()
    tied = A.copy()
    tied[:, 2] = tied[:, 0] * 1e-12
    with pytest.raises(NotIdentifiable, match="a, c: only a combination of these is identifiable"):
        solve(replace(o, jacobian=lambda x: tied, predict=lambda x: tied @ x))


def test_bad_words() -> None:
    with pytest.raises(InputError, match="Did you mean 'huber'"):
        solve(decay(), FitOptions(loss="hubre"))
    with pytest.raises(InputError, match="outside its bounds"):
        solve(decay(), FitOptions(bounds=True), np.array([-1.0, 1.0]))
    with pytest.raises(InputError, match="positive"):
        Independent(np.array([1.0, 0.0]))


def test_residuals_and_cost_are_those_of_the_answer() -> None:
    """What stands in the solution is the model at x, not a linear guess of it."""
    o = decay(3)
    found = solve(o)
    r = o.noise.whiten(o.measured - o.predict(found.x))
    assert found.residuals == pytest.approx(r, abs=1e-6 * float(np.abs(r).max()))
    assert found.cost == pytest.approx(0.5 * float(r @ r), rel=1e-6)


def test_what_is_known_of_one_parameter_is_a_row_of_its_own() -> None:
    """About any value, the nominal one by default; other sds take its place by name, of the others nothing is known."""
    o, A = line()
    size = np.array([1e-7, 1.0, 1e5])
    sds = np.array([np.inf, 1.0 / 3.0, np.inf])
    W = np.vstack([o.noise.whiten(A * size), [[0.0, 3.0, 0.0]]])
    for prior, value in ((None, 1.0), (size * [9.0, -0.4, 9.0], -0.4)):
        found = solve(replace(o, prior=prior, prior_sd=sds))
        y = np.append(o.noise.whiten(o.measured), 3.0 * value)
        assert np.allclose(found.x, np.linalg.lstsq(W, y)[0] * size, rtol=1e-9)
        assert np.allclose(found.covariance, np.linalg.inv(W.T @ W) * np.outer(size, size), rtol=1e-9)
        assert found.priors == pytest.approx([3.0 * (value - found.x[1])], rel=1e-9)
    assert np.array_equal(o.knowing({"b": 1.0 / 3.0}).known[0], 1.0 / sds)
    weaker = replace(o, prior_sd=sds).knowing({"b": 0.5, "c": 0.5e5, "a": 0.5e-7})
    assert np.allclose(solve(weaker).x, solve(known(o)).x, rtol=1e-12)


def test_the_share_of_each_reading_in_its_own_prediction() -> None:
    """hat hat' = W (W' W)^-1 W' where nothing else counts; with priors its trace is less than the parameters."""
    o, A = line()
    W = o.noise.whiten(A * [1e-7, 1.0, 1e5])
    plain, held = solve(o).hat, solve(known(o)).hat
    assert plain @ plain.T == pytest.approx(W @ np.linalg.solve(W.T @ W, W.T), abs=1e-9)
    both = np.linalg.inv(W.T @ W + 4.0 * np.eye(3))
    assert held @ held.T == pytest.approx(W @ both @ W.T, abs=1e-9)
    assert np.square(held).sum() < 3.0


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("size", [0.1, 1.0, 10.0])
def test_errors_common_to_all_readings_move_the_estimates_as_refits_say(stated: bool, size: float) -> None:
    """Whatever stands for a noise that is estimated: by how much the fit to readings that err so is another."""
    o, _ = line()
    assert isinstance(o.noise, Independent)
    sigma = o.noise.colour(np.ones(30))
    o = replace(known(o), noise=Independent(sigma if stated else size * sigma), stated=stated)
    solution, error = settle(o), 1e-3 * np.sin(np.arange(30.0))
    unit = solution.unit or 1.0
    same = replace(o, noise=Independent(o.noise.colour(np.full(30, unit))), stated=True)
    there = solve(replace(same, measured=o.measured + error)).x - solve(same).x
    moved = propagated(solution, o.noise.whiten(error)[:, None])[:, 0]
    assert np.allclose(moved / o.start, there / o.start, rtol=1e-5, atol=1e-10)


def test_what_no_reading_depends_on_is_named() -> None:
    o, _ = line()
    with pytest.raises(NotIdentifiable) as caught:
        solve(
            replace(o, predict=lambda x: np.zeros(len(o.measured)), jacobian=lambda x: np.zeros((len(o.measured), 3)))
        )
    assert caught.value.unseen == ("a", "b", "c")
