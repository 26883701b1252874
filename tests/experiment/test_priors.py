"""What is known of a model's parameters before any reading: what each effect declares, and which of it counts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import predicted
import pytest
from scipy.stats import chi2

from qsframework.elastostatics import Model
from qsframework.errors import PluginError
from qsframework.estimation import Independent, Observations, solve
from qsframework.experiment import Experiment, Readings
from qsframework.experiment.prior import ADDED, DELIVERED, FOUND, LAW, READINGS, STATED, priors_of
from qsframework.plugin import Effect, Parameter, build_effects
from qsframework.plugin.registry import registry

PLACEMENT = dict.fromkeys(("x", "y", "z", "rx", "ry", "rz"), 5e-4)
PIVOTS = {"lc": 0.0271, "l2": 0.0271, "zero": 0.02}
DECLARED: dict[str, dict[str, float]] = {
    "closed_chain": {"lever": 1e-4, "bar": 1e-4},
    "encoder_eccentricity": {"sin": 5e-5, "cos": 5e-5},
    "four_bar": {"bar": 1e-4, "lever": 1e-4, "rocker": 1e-4, "link": 1e-4},
    "gas_balancer": {**PIVOTS, "pressure": 0.05 * 90e5, "volume": 0.05 * 12e-3, "exponent": 0.1},
    "gear_ratio": {"": 5e-4},
    "gravity_compensator": PIVOTS,
    "gravity_sag": {f"link_{k}_{axis}": 8.9153e-5 for k in range(2, 7) for axis in "xyz"},
    "joint_offset": {"": 1e-3},
    "joint_placement": PLACEMENT,
    "offaxis_compliance": {"bearing": 0.336506},
    "parallelogram": {"": 1e-4},
}
"""sds, SI, of an arm as delivered, by effect and the last part of a parameter's name; of all others none is declared.
Of an M-900iB, or where it has no place for an effect with the settings of benchmarks/predicted.py."""
LINKS = [
    {"name": "lever", "axis": [0.0, 1.0, 0.0], "to_m": [0.0, 0.0, 0.5]},
    {"name": "bar", "axis": [0.0, 1.0, 0.0], "to_m": [0.6, 0.0, 0.5]},
]
LOOPS = (
    {"effect": "four_bar", "lever_mm": 750, "bar_m": 1.2, "rocker_m": 0.6, "lever_zero_deg": 80, "branch": 1},
    {"effect": "closed_chain", "links": LINKS},
)
ARM = "fanuc_m900ib"


@pytest.fixture(scope="module")
def arm() -> Experiment:
    return predicted.campaign(ARM)


def shipped(arm: Experiment) -> Iterator[tuple[Experiment, Effect]]:
    """Every effect of the library that has parameters, on an arm that has a place for it."""
    yield from ((arm, e) for e in arm.robot.effects)
    yield from ((arm, effects[0]) for effects in predicted.effects_for(arm))
    plain = predicted.campaign("fanuc_r2000ic")
    for entry in LOOPS:
        (loop,) = build_effects(entry | {"driver": "joint_2", "driven": "joint_3"}, plain.robot.facts)
        yield plain, loop
    more = {"effect": "bar_compliance", "driven": "joint_3", "loop": "four_bar"}
    yield plain, build_effects(more, plain.robot.facts)[0]


def test_what_is_declared_of_every_effect_as_arms_are_delivered(arm: Experiment) -> None:
    """The table of priors: whoever changes one changes it here, and says by what it is known."""
    kinds = set[str]()
    for experiment, effect in shipped(arm):
        kind = effect.effect_name()
        declared = DECLARED.get(kind, {})
        kinds.add(kind)
        for p in effect.parameters(experiment.robot.facts):
            part = p.name.removeprefix(effect.name).removeprefix(".")
            assert p.nominal_sd == (pytest.approx(declared[part], rel=1e-3) if part in declared else None), p.name
    missing = {*registry()} - kinds
    assert missing == {"coupling", "cylinder"}, "these have no parameters"


def of(model: Model, name: str) -> tuple[float, float, str]:
    """Value, sd and where it is from."""
    priors, i = priors_of(model, cast(Readings, SimpleNamespace(hashes=("these",)))), model.names.index(name)
    return float(priors.value[i]), float(priors.sd[i]), priors.source[i]


def made(arm: Experiment, name: str, **changes: object) -> Model:
    """The arm with the zero of a joint and a law, one parameter of it changed."""
    facts = arm.robot.facts
    entries = {"effect": "joint_offset", "joint": "joint_2"}, {"effect": "link_mass", "link": "link_3"}
    law = {"effect": "learned", **predicted.WITH_SETTINGS["learned"], "prior_urad": 200.0}
    markers = tuple(m.name for m in arm.markers)
    offsets = {"effect": "marker_offset", "markers": "all"}
    effects = tuple(e for entry in (*entries, law, offsets) for e in build_effects(entry, facts, markers))
    own = tuple(p for e in effects for p in e.parameters(facts))

    def changed(parameters: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
        return tuple(replace(p, **changes) if p.name == name else p for p in parameters)

    robot = replace(arm.robot, parameters=changed(arm.robot.parameters))
    return arm.with_(robot=robot, effects=effects, parameters=changed(own)).model()


ZERO, SPRING, MASS = "joint_offset[joint_2]", "joint_compliance[joint_2]", "link_mass[link_3].mass"


def test_which_of_what_is_known_counts(arm: Experiment) -> None:
    """A stated sd before a declared one; of what these readings gave, the value before them and what is declared; what
    a diagnosis added, and laws, about their null."""
    assert of(made(arm, ZERO, nominal=2e-3), ZERO) == (2e-3, 1e-3, DELIVERED)
    assert of(made(arm, ZERO, nominal=2e-3, sd=3e-4), ZERO) == (2e-3, 3e-4, STATED)
    fitted = {"nominal": 2e-3, "sd": 1e-5}
    assert of(made(arm, ZERO, **fitted, earlier=((1e-4, ("these",)),)), ZERO) == (1e-4, 1e-3, DELIVERED)
    assert of(made(arm, ZERO, **fitted, earlier=((1e-4, ("others",)),)), ZERO) == (2e-3, 1e-5, STATED)
    (mass,) = (p for p in made(arm, MASS).parameters if p.name == MASS)
    assert of(made(arm, MASS), MASS) == (0.0, np.inf, READINGS)
    added = made(arm, MASS, nominal=50.0, sd=0.1, earlier=((None, ("these",)),))
    assert of(added, MASS) == (0.0, ADDED * mass.typical, FOUND)
    laws = [n for n in added.names if n.startswith("learned[")]
    assert laws
    for name in laws:
        assert of(added, name) == (0.0, pytest.approx(2e-4, rel=1e-12), LAW)


def test_nothing_is_known_of_springs_and_markers_whatever_is_stated(arm: Experiment) -> None:
    """What a campaign is there to tell; where a balancer is fixed is no spring."""
    for name in (SPRING, *(f"gravity_compensator[joint_2].{n}" for n in ("stiffness", "free_length"))):
        value, sd, source = of(made(arm, name, sd=1e-9), name)
        assert (sd, source) == (np.inf, READINGS)
        assert value > 0.0
    marker = f"marker_offset[{arm.markers[0].name}].x"
    assert of(made(arm, marker), marker) == (0.0, np.inf, READINGS)
    assert of(made(arm, marker, nominal_sd=1e-3), marker)[1] == np.inf
    pivot = "gravity_compensator[joint_2].lc"
    assert of(made(arm, pivot), pivot)[1:] == (pytest.approx(0.0271), DELIVERED)


@pytest.mark.parametrize(("grown", "agrees"), [(1.0, True), (1.15, False)])
def test_readings_and_priors_together_leave_chi_square_of_as_many_as_nothing_was_known_of(
    grown: float, agrees: bool
) -> None:
    """2 cost ~ chi2(n - flat), by its mean over campaigns; sds that are 15 % too small show."""
    rng, n, campaigns = np.random.default_rng(0), 30, 400
    A, sd = rng.normal(size=(n, 5)), np.array([np.inf, np.inf, 0.05, 0.2, 3.0])
    A[:, 4] = A[:, 3]  # of these two only the sum is told
    total, flat = 0.0, 2
    for _ in range(campaigns):
        x = np.where(np.isfinite(sd), grown * np.where(np.isfinite(sd), sd, 0.0) * rng.normal(size=5), 1.0)
        y = A @ x + grown * 0.1 * rng.normal(size=n)
        o = Observations(
            measured=y,
            predict=lambda v: A @ v,
            jacobian=lambda v: A,
            parameters=tuple(Parameter(name, "") for name in "abcde"),
            noise=Independent(np.full(n, 0.1)),
            block=np.arange(n),
            row=np.arange(n),
            prior_sd=sd,
        )
        found = solve(o)
        assert 2.0 * found.cost == pytest.approx(np.square(found.residuals).sum() + np.square(found.priors).sum())
        total += 2.0 * found.cost
    p = chi2.sf(total, campaigns * (n - flat))
    assert bool(1e-3 < p < 0.999) is agrees


@pytest.mark.parametrize("sd", [0.0, -1e-3, np.nan, np.inf])
def test_a_declared_sd_is_positive(sd: float) -> None:
    with pytest.raises(PluginError, match=r"a: nominal_sd must be positive or None, found"):
        Parameter("a", "m", nominal_sd=sd)
