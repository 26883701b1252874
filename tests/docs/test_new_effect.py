"""docs/new-effect.md shows the stranger's package as it is, and the kinds as they are."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from qsframework import plugin
from qsframework.estimation import FitOptions
from qsframework.experiment import load_experiment
from qsframework.experiment.examples import example
from qsframework.experiment.simulate import displaced
from qsframework.fits import identify
from qsframework.plugin import Conditions, Effect, check_effect
from tests.identify.arm import random_poses


def blocks(root: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", (root / "docs" / "new-effect.md").read_text(), re.M | re.S)


@pytest.mark.parametrize(
    ("language", "name"),
    [("python", "qsf_bolted_base.py"), ("toml", "pyproject.toml"), ("yaml", "experiment.yaml")],
)
def test_the_page_shows_the_files_of_the_package(root: Path, language: str, name: str) -> None:
    block = blocks(root, language)[0]
    assert block == (root / "tests" / "third_party_package" / name).read_text()


def test_the_effect_is_as_short_as_promised(root: Path) -> None:
    """The class is no longer than the example of the blueprint: 12 lines."""
    block = blocks(root, "python")[0]
    assert len(block[block.index("@dataclass") :].splitlines()) <= 12


STEPS = ("SettlingGear", "WarmGear", "StickyGear")


@pytest.fixture(scope="module")
def steps(root: Path) -> dict[str, type[Effect]]:
    """The page's effects from a plain law to a warm, hysteretic one, as somebody would paste them."""
    page = ModuleType("new_effect_page")
    sys.modules[page.__name__] = page  # where a dataclass looks up its module
    exec(compile("\n".join(blocks(root, "python")[1:]), "new-effect.md", "exec"), page.__dict__)
    return {name: getattr(page, name) for name in STEPS}


@pytest.mark.parametrize("name", STEPS)
def test_every_step_keeps_the_protocol(steps: dict[str, type[Effect]], name: str) -> None:
    assert len(check_effect(steps[name]("joint_2"))) > 10  # type: ignore[call-arg]


def test_a_law_without_derivative_is_at_most_20_lines(root: Path) -> None:
    """Everything that a third party writes, imports and blank lines too."""
    law = blocks(root, "python")[1]
    assert len(law.splitlines()) <= 24
    assert len([line for line in law.splitlines() if line.strip()]) <= 20


@pytest.mark.parametrize("name", STEPS)
def test_every_step_is_found_in_readings_that_hide_it(steps: dict[str, type[Effect]], name: str) -> None:
    campaign = load_experiment(example("m900ib") / "experiment.yaml")
    effect = steps[name]("joint_2")  # type: ignore[call-arg]
    own = effect.parameters(campaign.robot.facts)
    campaign = campaign.with_(
        effects=(*campaign.effects, effect),
        parameters=(*campaign.parameters, *own),
        fit=("joint_compliance", effect.name),
    )
    model, rng = campaign.model(), np.random.default_rng(0)
    truth = model.nominal
    truth[model.index([p.name for p in own])] = [4.0 * p.typical for p in own]
    at = random_poses(campaign, 1, 60)
    warm = 293.15 + rng.uniform(-5, 20, 60)
    before, after = (Conditions(None, warm, rng.choice([-1.0, 1.0], 60)) for _ in range(2))
    at = replace(at, unloaded=before, loaded=after, wrench=at.wrench * rng.uniform(-1, 1, (60, 1)))
    readings = displaced(at, model.predict(at, truth, linear=True), 1e-6, [f"p{i}" for i in range(60)])
    fit = identify(campaign, readings, options=FitOptions(linear=True))
    for p, true in zip(own, truth[model.index([p.name for p in own])], strict=True):
        found = next(e for e in fit.estimates if e.name == p.name)
        assert abs(found.value - true) < max(4 * found.sd, 0.02 * abs(true)), p.name


def test_the_table_lists_every_kind_with_what_it_asks_for(root: Path) -> None:
    kinds = {kind.__name__: kind for kind in Effect.__subclasses__() if kind.__module__ == "qsframework.plugin.kinds"}
    page = (root / "docs" / "new-effect.md").read_text()
    rows = re.findall(r"^\| (\d) \| `(\w+)` \| [^|]* \| ([^|]*) \| ([^|]*) \|$", page, re.M)
    assert {name: int(stage) for stage, name, _, _ in rows} == {n: k.stage for n, k in kinds.items()}
    for _, name, write, give in rows:
        for method in kinds[name].__abstractmethods__:
            assert re.search(rf"`{method}\b", write), f"{name} needs {method}"
        for term in re.findall(r"`(\w+)`", give):
            assert hasattr(plugin, term)
