"""The public API for effects: everything that a third party's plugin imports comes from here."""

from qsframework.errors import InputError, Problem
from qsframework.plugin.build import build_effects
from qsframework.plugin.check import check_effect
from qsframework.plugin.facts import Array, Branch, Conditions, Context, Indices, Poses, RobotFacts
from qsframework.plugin.kinds import (
    At,
    Effect,
    Geometry,
    Load,
    Loop,
    ParallelSpring,
    Sensor,
    Spring,
    SpringLaw,
)
from qsframework.plugin.parameter import Parameter
from qsframework.plugin.registry import find, registry
from qsframework.plugin.settings import place, setting
from qsframework.plugin.shapes import KNOTS, by_torque, circular, smooth
from qsframework.plugin.terms import (
    Actuator,
    Bar,
    Coordinate,
    GeometryTerm,
    LawTerm,
    Loads,
    LoadTerm,
    LoopTerm,
    Point,
    Range,
    Reading,
    SensorTerm,
    StiffnessTerm,
    TensionTerm,
    TorqueTerm,
    VirtualJoint,
)

__all__ = [
    "KNOTS",
    "Actuator",
    "Array",
    "At",
    "Bar",
    "Branch",
    "Conditions",
    "Context",
    "Coordinate",
    "Effect",
    "Geometry",
    "GeometryTerm",
    "Indices",
    "InputError",
    "LawTerm",
    "Load",
    "LoadTerm",
    "Loads",
    "Loop",
    "LoopTerm",
    "ParallelSpring",
    "Parameter",
    "Point",
    "Poses",
    "Problem",
    "Range",
    "Reading",
    "RobotFacts",
    "Sensor",
    "SensorTerm",
    "Spring",
    "SpringLaw",
    "StiffnessTerm",
    "TensionTerm",
    "TorqueTerm",
    "VirtualJoint",
    "build_effects",
    "by_torque",
    "check_effect",
    "circular",
    "find",
    "place",
    "registry",
    "setting",
    "smooth",
]
