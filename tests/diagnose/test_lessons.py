"""What is left teaches a law only where it weighs enough and the noise hardly looks like any."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from independent_arm import HEAVY

from qsframework.diagnoses.baseline import fits_beside
from qsframework.diagnoses.learn import law_trials
from qsframework.diagnoses.result import Leftover
from qsframework.hypotheses.catalogue.generic_laws import generic_blocks, motions
from tests.diagnose.clean_fit import clean_fit


@pytest.mark.parametrize(
    ("evidence", "tried", "p", "learned"),
    [(9.0, 400, 1.0 / 501.0, True), (8.0, 400, 1.0 / 501.0, False), (8.0, 200, 1e-6, True), (30.0, 400, 0.004, False)],
)
def test_a_law_must_outweigh_all_that_were_tried_and_no_draw_of_the_noise_may_look_like_one(
    evidence: float, tried: int, p: float, learned: bool, tmp_path: Path
) -> None:
    """Ten to one against nothing, which weighs as all laws together: log 4000 = 8.3, log 2000 = 7.6."""
    _, rows, fit = clean_fit(HEAVY, tmp_path, poses=8)
    blocks = list(generic_blocks(motions(fit.model, rows, fit.x, fit.frames)))
    fits = fits_beside(rows, rows.padded_noise.colour(fit.jacobian))
    values = fit.residuals.ravel() + 1e-5 * np.random.default_rng(1).standard_normal(fit.residuals.size)
    left = [Leftover(blocks[0].law, p, evidence)]
    found = law_trials(fit.model, [(float(k), b) for k, b in enumerate(blocks[:9])], left, tried, fits, values)
    assert [x.leftover for x in found][:1] == (left if learned else []), "what is said of comes first"
    nats = [x.evidence for x in found[1:]]
    assert nats == sorted(nats, reverse=True)
    assert len({x.cause.name for x in found}) == len(found), "about one axis of a place, or about all"
