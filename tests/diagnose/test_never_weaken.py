"""Causes that the diagnosis must find, in files that another code wrote: one in absolute positions, two of no library.

They are a part of the net, with the tests of `test_hidden.py`, `test_learned.py` and `test_positions_and_mixed.py` that
hide an effect and require its place, its law, the extension and the gain: no bound here is loosened, no test skipped or
renamed away. What a result is called may change, what is required of it may not.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from qsframework.diagnoses import diagnose
from qsframework.experiment import load_experiment, read_readings
from qsframework.fits import identify
from qsframework.plugin import Array
from qsframework.report.extended import write_extended
from qsframework.report.words.diagnosis import diagnosis_words

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from fresh_poses import among, fresh_errors, place_right, variable_right
from independent import Campaign, Setting, noisy, write_campaign
from independent_arm import HEAVY, Hidden, Rest
from unknown import came_by

S = 20.0
"""Norm of what is hidden, in units of noise, after the fitted parameters have been fitted to it."""


def stiffening(size: float) -> Hidden:
    """The third gear gives less under much torque, by its cube: the library's hardening."""

    def law(still: Rest) -> Array:
        return -np.eye(6)[2] * size * 1e-16 * still.torque[:, [2]] ** 3

    return Hidden(gears=(law,))


def running_in(size: float) -> Hidden:
    """The third gear gives more from reading to reading, and no more in the end."""

    def law(still: Rest) -> Array:
        late = 1.0 - np.exp(-still.visits.order[:, None] / 0.3)
        return np.eye(6)[2] * size * 1e-8 * still.torque[:, [2]] * late

    return Hidden(gears=(law,))


def by_the_way_it_came(size: float) -> Hidden:
    """The second gear gives more, or less, by how far the joint turned to get there."""

    def law(still: Rest) -> Array:
        turned = came_by(HEAVY, still, 1)[:, None]
        return np.eye(6)[1] * size * 1e-8 * still.torque[:, [1]] * np.tanh(turned / 0.5)

    return Hidden(gears=(law,))


def written(made: Campaign, make: Callable[[float], Hidden], folder: Path) -> tuple[Hidden, Path]:
    """What is hidden, of size S, and the experiment.yaml of the readings."""
    hidden = make(made.sized(make, S, 0.01, 1000.0))
    return hidden, write_campaign(made, noisy(made, made.clean(hidden)), folder)


def test_a_gear_that_hardens_is_found_in_positions_in_an_unknown_frame(tmp_path: Path) -> None:
    """Unloaded and loaded positions of a tracker that stands anywhere; the geometry is fitted beside the springs."""
    made = Campaign(Setting(HEAVY, poses=24, seed=3, kind="positions"))
    hidden, path = written(made, stiffening, tmp_path / "campaign")
    experiment = load_experiment(path)
    readings = read_readings(experiment.data, experiment)
    assert readings.is_position.all()
    found = diagnose(experiment, readings, repeats=1)
    assert found.verdict == "explained", diagnosis_words(found)
    told = [(f.name, [r.name for r in f.alternatives]) for f in found.findings]
    assert told == [("joint_hardening[j3]", [])], "place and law, alone"
    assert found.rms.heldout_extended < 0.75 * found.rms.heldout_identified
    assert fresh_errors(made, hidden, found).share > 0.9
    write_extended(found, tmp_path / "extended")
    extended = load_experiment(tmp_path / "extended" / "experiment.yaml")
    fit = identify(extended, read_readings(extended.data, extended))
    (cubic,) = (e for e in fit.estimates if e.name.startswith("joint_hardening[j3]"))
    assert cubic.value < -5.0 * cubic.sd, "the extended robot has the law, and the readings its size"
    assert fit.rms_left_out < 0.75 * found.rms.heldout_identified


@pytest.mark.parametrize(
    ("make", "place", "variable", "name"),
    [
        (running_in, "j3", "torque x order", "learned[j3/order]"),
        (by_the_way_it_came, "j2", "approach", "learned[j2/came]"),
    ],
)
def test_a_cause_of_no_library_is_placed_learned_and_gains(
    make: Callable[[float], Hidden], place: str, variable: str, name: str, tmp_path: Path
) -> None:
    made = Campaign(Setting(HEAVY, poses=40, seed=2))
    hidden, path = written(made, make, tmp_path / "campaign")
    experiment = load_experiment(path)
    found = diagnose(experiment, read_readings(experiment.data, experiment), repeats=1)
    assert found.verdict in ("unexplained", "partly_explained"), "no name of the library is right"
    assert place_right(among(found), place), diagnosis_words(found)
    assert variable_right(among(found), place, variable), diagnosis_words(found)
    assert len(found.places) <= 4, "it is told where, not that it may be anywhere"
    assert found.learned is not None
    assert found.learned.name == name
    assert found.learned.heldout < 0.75 * found.rms.heldout_extended
    write_extended(found, tmp_path / "extended")
    extended = load_experiment(tmp_path / "extended" / "experiment.yaml")
    assert name in {e.name for e in extended.model().effects}
    fresh = fresh_errors(made, hidden, found)
    assert fresh.share > 0.85
    assert fresh.extended < 0.4 * fresh.springs
