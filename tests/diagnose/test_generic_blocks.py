"""What a generic block says of the readings is what the model says with the law's effect in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from independent_arm import COILED, LOOP, SEVEN, Arm

from qsframework.diagnoses.learn import effects_of
from qsframework.experiment import Experiment, ReadingRows
from qsframework.hypotheses.catalogue.causes import Cause
from qsframework.hypotheses.catalogue.generic_laws import Block, generic_blocks, motions, single_axes
from qsframework.hypotheses.columns import make_case
from qsframework.hypotheses.exact_refit import SettledFit
from qsframework.plugin import build_effects
from qsframework.plugin.entry import effect_entry
from tests.diagnose.clean_fit import clean_fit

_SAME = 1e-9
"""Share of a column: both are of the arm where it settles."""


def blocks(arm: Arm, kind: str, folder: Path) -> tuple[Experiment, ReadingRows, SettledFit, list[Block]]:
    experiment, rows, fit = clean_fit(arm, folder, poses=8, kind=kind, recorded=True)
    return experiment, rows, fit, list(generic_blocks(motions(fit.model, rows, fit.x, fit.frames)))


@pytest.mark.parametrize(("arm", "kind"), [(COILED, "displacements"), (LOOP, "displacements"), (SEVEN, "positions")])
def test_every_block_is_what_its_effect_does(arm: Arm, kind: str, tmp_path: Path) -> None:
    experiment, rows, fit, found = blocks(arm, kind, tmp_path)
    parts = {b.law.part for b in found}
    assert parts == {"drive", "bearing", "link", "shift", "marker", "readings", "load", "point"}
    assert {f for b in found for f in b.law.by if f not in b.law.angles} >= {"torque", "others", "moment", "attitude"}
    assert {b.law.part for b in found if "came" in b.law.by} == {"drive", "bearing", "link", "shift"}
    assert {b.law.place for b in found if b.law.part == "shift"} == set(fit.model.facts.links)
    assert {b.law.by[-1] for b in found if b.law.part == "marker"} >= {"attitude", "order", fit.model.facts.joints[-1]}
    some = found[:: 5 if kind == "displacements" else 9]
    tried = [*some, *(b for block in some for b in single_axes(block, fit.model.facts))]
    for effect in (b.effect for b in tried):
        (read,) = build_effects(effect_entry(effect), fit.model.facts, fit.model.marker_names)
        assert read.name == effect.name, "a file that it is written to reads it back"
    off: dict[str, float] = {}
    for block in tried:
        effects = effects_of(fit.model, block.effect)
        cause = Cause(block.law.name, effects, effects[-1].parameters(fit.model.facts), False)
        case = make_case(experiment, rows, fit.names, [cause], fit.by_name(), fit.residuals, fit.frames)
        own, columns = case.metres(0) / np.array(cause.sizes), block.columns
        assert own.shape == columns.shape, block.law.name
        if "others" in block.law.by and block.law.axis:  # the same functions, those of its own axis first
            own, columns = own @ own.T, columns @ columns.T
        off[block.law.name] = float(np.abs(own - columns).max()) / max(float(np.abs(own).max()), 1e-300)
    assert len(tried) > 40
    assert {b.law.part for b in tried if b.law.axis} == {"link", "bearing", "shift"}
    assert {n: v for n, v in off.items() if v > _SAME} == {}
