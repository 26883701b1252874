"""The point of a joint's axis about which its bearing tilts: stated, estimated, or an uncertainty of every estimate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm import random_poses, settled
from test_joint import displacements

from qsf_plugins.offaxis_compliance import OffaxisCompliance
from qsframework.experiment import Experiment, on_robot
from qsframework.fits.identify import fit_readings
from qsframework.plugin import RobotFacts
from qsframework.report.fit_section import fit_table

UP = 0.58
TILTS = (OffaxisCompliance("joint_1", "x"), OffaxisCompliance("joint_1", "y"))
SIZES = (3e-8, 2e-8)
SPRINGS = tuple(tilt.name for tilt in TILTS)


def tilting(arm: Experiment, facts: RobotFacts, up: float = 0.0) -> Experiment:
    """The arm with a first bearing that tilts about x and y; up: m along the axis, where it is by `nominal.yaml`."""
    own = {p.name: p for tilt in TILTS for p in tilt.parameters(facts)}
    known = tuple(replace(own.pop(name), nominal=c, sd=0.01 * c) for name, c in zip(SPRINGS, SIZES, strict=True))
    known += tuple(replace(p, nominal=up) for p in own.values())
    robot = replace(arm.robot, facts=facts, effects=arm.robot.effects + TILTS, parameters=arm.robot.parameters + known)
    return on_robot(arm, robot).with_(fit=("joint_compliance", "offaxis_compliance"))


def stated(arm: Experiment) -> RobotFacts:
    return replace(arm.robot.facts, bearings=(UP, *arm.robot.facts.bearings[1:]))


def lifted(arm: Experiment) -> RobotFacts:
    """The same arm with the frame of its first joint at the bearing."""
    facts, up = arm.robot.facts, np.eye(4)
    up[:3, 3] = UP * facts.axes[0]
    placements, centres = facts.placements.copy(), facts.centres.copy()
    down = np.linalg.inv(up)
    placements[0], placements[1] = placements[0] @ up, down @ placements[1]
    centres[1] -= up[:3, 3]
    hung = ((b, b.parent == facts.links[1]) for b in facts.branches)
    branches = tuple(replace(b, placement=down @ b.placement) if on_it else b for b, on_it in hung)
    return replace(facts, placements=placements, centres=centres, branches=branches)


def test_a_stated_bearing_is_a_frame_there(m900ib: Experiment) -> None:
    """To rounding; where the robot states nothing, the length is a parameter that nobody fits unasked."""
    poses, loaded = random_poses(m900ib, 1, 12), np.arange(12) % 2 == 0
    there, moved = (tilting(m900ib, facts(m900ib)).model() for facts in (stated, lifted))
    np.testing.assert_allclose(settled(there, poses, loaded), settled(moved, poses, loaded), atol=1e-9)
    assert set(moved.names) - set(there.names) == {f"{name}.bearing" for name in SPRINGS}
    assert not any(name.endswith("bearing") for name in tilting(m900ib, lifted(m900ib)).with_(fit=None).fit_names())


def test_the_length_as_a_parameter_is_the_stated_one(m900ib: Experiment) -> None:
    """But for what the square of a turn of 2 mrad makes of it, and its derivative is that of differences."""
    facts, poses, loaded = m900ib.robot.facts, random_poses(m900ib, 1, 12), np.arange(12) % 2 == 0
    length = tilting(m900ib, facts, UP).model()
    there = tilting(m900ib, stated(m900ib)).model()
    np.testing.assert_allclose(settled(length, poses, loaded), settled(there, poses, loaded), atol=2e-6)
    names = [f"{name}.bearing" for name in SPRINGS]
    found = length.sensitivity(poses, names=names)
    for k, i in enumerate(length.index(names)):
        step = 1e-3 * np.eye(len(length.nominal))[i]
        up, down = (length.predict(poses, x=length.nominal + s * step) for s in (1.0, -1.0))
        np.testing.assert_allclose(found[..., k], (up - down) / 2e-3, rtol=1e-5, atol=1e-9)


def test_what_nobody_states_is_estimated_or_stands_beside_each_estimate(m900ib: Experiment) -> None:
    """Of an arm that tilts UP above the floor. With the tilt in `fit:` the length is found from what is known of it,
    and all is right; with the tilt held the other springs are off by sds of the noise, and the table says by what."""
    truth, floor = tilting(m900ib, stated(m900ib)), tilting(m900ib, m900ib.robot.facts)
    was = dict(zip(truth.model().names, truth.model().nominal, strict=True))
    worst: dict[str, list[float]] = {}
    for seed in range(2):
        readings = displacements(truth, truth.model().nominal, 24, seed)
        held = fit_readings(floor.with_(fit=("joint_compliance",)), readings)
        found, right = fit_readings(floor, readings), fit_readings(truth, readings)
        for what, fit in (("noise", held), ("quoted", held), ("found", found), ("right", right)):
            sds = fit.sd if what == "noise" else fit.sd_total
            off = [(e.value - was.get(e.name, UP)) / sd for e, sd in zip(fit.estimates, sds, strict=True)]
            worst.setdefault(what, []).append(float(np.abs(off).max()))
        assert found.chi2 < 1.3 * found.dof
        told = {e.name: e for e in found.estimates}[f"{SPRINGS[1]}.bearing"]
        assert told.prior_sd == pytest.approx(0.1 * m900ib.robot.facts.sizes.reach)
        assert told.counted_sd is not None
        assert f"most by {SPRINGS[0]}.bearing" in fit_table(held).caption
        assert "bearing" not in fit_table(right).caption
    assert min(worst["noise"]) > 6.0
    assert max(worst["quoted"]) < 3.0
    assert max(worst["found"] + worst["right"]) < 3.3, "of 36 normal numbers"
