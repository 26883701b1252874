"""`check_effect` passes what is right and catches what is wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from qsframework.errors import PluginError
from qsframework.plugin import (
    Array,
    At,
    Branch,
    Context,
    Effect,
    InputError,
    LawTerm,
    ParallelSpring,
    Parameter,
    RobotFacts,
    Sensor,
    SensorTerm,
    Spring,
    SpringLaw,
    TorqueTerm,
    VirtualJoint,
    build_effects,
    check_effect,
    find,
    place,
    registry,
)
from qsframework.plugin.check import sample_robot
from qsframework.plugin.terms import Reading

ROD = Branch(
    joint="rod_joint",
    link="rod",
    parent="link_1",
    placement=np.array([[1, 0, 0, 0.31], [0, 1, 0, 0.1], [0, 0, 1, 0.4], [0, 0, 0, 1.0]]),
    axis=np.array([0.0, -1.0, 0.0]),
    mass=80.0,
    centre=np.array([0.0, 0.0, 0.3]),
)
ROBOT = replace(sample_robot(), branches=(ROD,))
SETTINGS = {
    "learned": {"at": "joint_3", "by": "torque", "scale_Nm": 900.0, "lowest_Nm": -500.0, "highest_Nm": 900.0},
    "learned_bearing": {"at": "joint_4", "by": "attitude", "scale_Nm": 900.0},
    "learned_shift": {"at": "base_link", "by": "torque", "scale_N": 900.0, "lowest_N": -500.0, "highest_N": 900.0},
    "learned_offset": {"at": "m1", "by": "loaded*order", "first": 0.0, "last": 1.0},
    "learned_load": {"at": "tool", "by": "force", "scale_N": 900.0, "lowest_N": 100.0, "highest_N": 900.0},
    "learned_load_point": {"at": "tool", "by": "attitude"},
    "counterweight": {"link": "link_2", "x_m": 0.1, "y_m": 0.0, "z_m": -0.5},
    "compensator_friction": {
        "joint": "joint_2",
        "lc_m": 0.235,
        "l2_m": 1.12,
        "spring_stiffness_N/m": 1e5,
        "free_length_m": 0.7,
    },
    "point_spring": {f"{end}_{axis}_m": 0.1 for end in ("first", "second") for axis in "xyz"}
    | {"first": "link_1", "second": "link_2"},
    "parallelogram": {"driver": "joint_2", "driven": "joint_3", "lever_m": 0.75},
    "four_bar": {"driver": "joint_2", "driven": "joint_3", "lever_m": 0.75, "bar_m": 1.2, "rocker_mm": 600},
    "closed_chain": {
        "driver": "joint_2",
        "driven": "joint_3",
        "links": [
            {"name": "lever", "axis": [0, -1, 0], "to_mm": [700, 0, 100]},
            {"name": "bar", "axis": [0, 1, 0], "to_m": [0.8, 0.0, 1.1]},
        ],
    },
    "base_lift": {"direction": "ry"},
    "cylinder": {"joint": "rod_joint", "driver": "joint_2", "x_m": 0.1, "y_m": 0.0, "z_m": 0.9},
    "bar_compliance": {"driven": "joint_3"},
    "coupling": {"joint": "joint_5", "follows": {"joint_2": 1, "joint_3": -1}, "offset_deg": 5},
    "gravity_compensator": {"joint": "joint_2", "lc_m": 0.235, "l2_m": 1.12, "zero_deg": 20},
    "compensator_stiffness": {"joint": "joint_2", "lc_mm": 235, "l2_m": 1.12},
    "gas_balancer": {
        "joint": "joint_2",
        "lc_mm": 235,
        "l2_m": 1.12,
        "length_mm": 885,
        "pressure_bar": 90,
        "volume_l": 12,
        "piston_area_cm^2": 60,
        "rod_area_cm^2": 12,
        "exponent": 1.2,
    },
}


def instances(name: str) -> tuple[Effect, ...]:
    """Every place that the effect names, or one with settings where it needs them."""
    places = find(name).places(ROBOT, ("m1", "m2"))
    return places or build_effects({"effect": name, **SETTINGS[name]}, ROBOT, ("m1", "m2"))


@pytest.mark.parametrize("name", registry())
@pytest.mark.parametrize("seed", range(3))
def test_every_built_in_effect_keeps_the_protocol(name: str, seed: int) -> None:
    for effect in instances(name):
        assert len(check_effect(effect, ROBOT, seed)) > 3
        assert effect.check, "says what to look at on the real robot"
        assert effect.source, "says where its law is published"


@dataclass(frozen=True)
class Sticky(SpringLaw):
    """A law for the tests."""

    slope: float = 1.0
    offset: float = 0.0

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "rad", typical=1e-6),)

    def springs(self, robot: RobotFacts) -> tuple[At, ...]:
        return (("gear", "joint_2"),)

    def extra(self, torque: Array, x: Array, context: Context) -> LawTerm:
        value = x[0] * np.tanh(torque / 1e4)
        slope = x[0] / np.cosh(torque / 1e4) ** 2 / 1e4
        return LawTerm(value + self.offset, self.slope * slope, np.tanh(torque / 1e4)[..., None])


def test_a_right_law_passes() -> None:
    check_effect(Sticky())


def test_a_wrong_derivative_is_caught() -> None:
    with pytest.raises(Exception, match="law by torque derivative: differs from finite differences by 1"):
        check_effect(Sticky(slope=0.9))


def test_an_effect_that_does_not_vanish_is_caught() -> None:
    with pytest.raises(Exception, match="does not vanish at its null value"):
        check_effect(Sticky(offset=1e-6))


class Broken(Sticky):
    def extra(self, torque: Array, x: Array, context: Context) -> LawTerm:
        term = super().extra(torque, x, context)
        return replace(term, dx=term.dx[..., 0])


def test_a_wrong_shape_and_a_missing_sentence_are_caught() -> None:
    with pytest.raises(Exception, match=r"shape \(5, 1\), must be \(5, 1, 1\)"):
        check_effect(dataclass(frozen=True)(type("Shapeless", (Broken,), {"__doc__": "A law."}))())


class Impure(Sticky):
    """Changes its input."""

    def extra(self, torque: Array, x: Array, context: Context) -> LawTerm:
        torque *= 1.0 + 1e-9
        return super().extra(torque, x, context)


def test_an_impure_effect_is_caught() -> None:
    with pytest.raises(Exception, match="is pure"):
        check_effect(dataclass(frozen=True)(Impure)())


@dataclass(frozen=True)
class Unknown(Spring):
    """A spring with a unit that nobody knows, under a wrong name, in a wrong shape."""

    joint: str = place("joint_1")

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter("spring", "rad/(glorp)"),)

    def virtual_joints(self, robot: RobotFacts) -> tuple[VirtualJoint, ...]:
        return (VirtualJoint("link_1", "x", "rotation"),) * 2


def test_units_and_names_are_checked() -> None:
    with pytest.raises(Exception, match=r"pint does not know 'rad/\(glorp\)'.*\n.*must be unknown\[joint_1\]"):
        check_effect(Unknown())


@dataclass(frozen=True)
class Faceless(ParallelSpring):
    """Neither torque, stiffness nor ends."""


@dataclass(frozen=True)
class Blind(Sensor):
    """Gives NaN."""

    def read(self, reading: Reading, x: Array, context: Context) -> SensorTerm:
        shape = reading.position.shape
        return SensorTerm(np.full(shape, np.nan), np.zeros((*shape, 3)), np.zeros((*shape, 0)))


@dataclass(frozen=True)
class Moody(ParallelSpring):
    """A torque where the joint is at the first angles it was asked at, and none elsewhere."""

    asked: ClassVar[list[Array]] = []

    def joints(self, robot: RobotFacts) -> tuple[str, ...]:
        return (robot.joints[0],)

    def torque(self, q: Array, x: Array, context: Context) -> TorqueTerm | None:
        self.asked.append(q)
        flat = np.zeros((len(q), 1))
        return TorqueTerm(flat, flat[..., None], np.zeros((len(q), 1, 0))) if np.array_equal(q, self.asked[0]) else None


def test_an_effect_that_gives_a_torque_at_some_angles_only_is_caught() -> None:
    with pytest.raises(PluginError, match="torque is None at some angles or parameters and not at others"):
        check_effect(Moody())


def test_faceless_and_blind_effects_are_caught() -> None:
    with pytest.raises(Exception, match="neither torque, stiffness nor ends"):
        check_effect(Faceless())
    with pytest.raises(Exception, match="gives NaN"):
        check_effect(Blind())


def test_parameters_are_checked_when_made() -> None:
    with pytest.raises(Exception, match="outside its bounds"):
        Parameter("a", "m", nominal=-1.0, lower=0.0)
    with pytest.raises(Exception, match="typical must be a positive"):
        Parameter("a", "m", typical=0.0)
    with pytest.raises(Exception, match="sd must be positive"):
        Parameter("a", "m", sd=0.0)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"effect": "gravity_compensater"}, "Did you mean 'gravity_compensator'?"),
        ({"joint": "joint_1"}, "needs the key 'effect'"),
        ({"effect": "gravity_compensator", "joint": "joint_2"}, "needs lc_mm, lc_m"),
        ({"effect": "gravity_compensator", "joint": "joint_2", "lc": 1, "l2_m": 1}, "the unit is missing"),
        ({"effect": "gravity_compensator", "joint": "joint_2", "lc_N": 1, "l2_m": 1}, "does not end in a unit of m"),
        ({"effect": "gravity_compensator", "joint": "joint_2", "lc_m": "long", "l2_m": 1}, "must be a finite number"),
        ({"effect": "gravity_compensator", "joint": "joint_2", "lc_m": 0, "l2_m": 1}, "lc and l2 must be above 0"),
        ({"effect": "compensator_stiffness", "joint": "joint_2", "lc_m": 1, "l2_m": 1}, "and differ"),
        ({"effect": "joint_compliance", "joints": "some"}, "must be 'all' or a list"),
        ({"effect": "joint_compliance", "joint": 3}, "must be a name"),
        ({"effect": "joint_compliance", "joint": "joint_9"}, "no joint 'joint_9'"),
        ({"effect": "joint_compliance", "joint": "joint_1", "colour": "red"}, "unknown key"),
        ({"effect": "controller_coupling", "joint": "joint_1"}, "one before it"),
        ({"effect": "parallelogram", "driver": "joint_1", "driven": "joint_3", "lever_m": 1}, "needs parallel axes"),
    ],
)
def test_spec_entries_say_what_is_wrong(entry: dict[str, object], words: str) -> None:
    with pytest.raises(InputError) as caught:
        build_effects(entry, ROBOT)
    assert words in str(caught.value)


def test_plural_places_make_one_instance_each() -> None:
    assert len(build_effects({"effect": "joint_compliance", "joints": "all"}, ROBOT)) == 6
    names = [
        e.name
        for e in build_effects(
            {"effect": "offaxis_compliance", "joints": ["joint_2", "joint_3"], "axes": ["x", "z"]}, ROBOT
        )
    ]
    assert names == [f"offaxis_compliance[joint_{k}/{a}]" for k in (2, 3) for a in "xz"]
