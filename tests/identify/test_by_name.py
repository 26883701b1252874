"""An estimate is asked for by its name, or by its place where that is enough."""

from __future__ import annotations

import pytest

from qsframework import identify, load_experiment, read_readings
from qsframework.errors import InputError
from qsframework.fits import Fit


@pytest.fixture(scope="module")
def fit() -> Fit:
    experiment = load_experiment("examples/r2000ic/experiment.yaml")
    return identify(experiment, read_readings(experiment.data, experiment))


def test_by_place_and_by_name(fit: Fit) -> None:
    assert fit["joint_1"] is fit["joint_compliance[joint_1]"]
    assert fit["joint_1"].value == pytest.approx(1.161e-6, rel=1e-3)


def test_what_it_has_not_is_refused_with_what_it_has(fit: Fit) -> None:
    with pytest.raises(InputError, match=r"no estimate of 'joint_9'.*joint_compliance.joint_1"):
        fit["joint_9"]


def test_a_place_of_several_is_refused_with_their_names() -> None:
    experiment = load_experiment("examples/ur10/experiment.yaml")
    found = identify(experiment, read_readings(["examples/ur10/series_b.csv"], experiment))
    with pytest.raises(InputError, match=r"estimates of 'joint_2'.*joint_offset.joint_2"):
        found["joint_2"]
    assert found["joint_offset[joint_2]"].unit == "rad"
