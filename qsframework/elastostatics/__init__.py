"""How the arm gives: kinematics of the elastic coordinates, springs, equilibrium, and the chain rule."""

from typing import TYPE_CHECKING

from qsframework.lazily import lazily

if TYPE_CHECKING:
    from qsframework.elastostatics.equilibrium import (
        Equilibrium,
        cartesian_compliance,
        cartesian_stiffness,
        equilibrium,
        full_displacement,
    )
    from qsframework.elastostatics.evaluation import spring_stiffness
    from qsframework.elastostatics.exact import exact_positions, exact_readings
    from qsframework.elastostatics.flips import flip_margin
    from qsframework.elastostatics.model import Model, make_model
    from qsframework.elastostatics.ranges import Beyond, beyond, range_notes
    from qsframework.elastostatics.state import Site, State
    from qsframework.elastostatics.torques import actuator_torques

__all__ = [
    "Beyond",
    "Equilibrium",
    "Model",
    "Site",
    "State",
    "actuator_torques",
    "beyond",
    "cartesian_compliance",
    "cartesian_stiffness",
    "equilibrium",
    "exact_positions",
    "exact_readings",
    "flip_margin",
    "full_displacement",
    "make_model",
    "range_notes",
    "spring_stiffness",
]
__getattr__ = lazily(
    __name__,
    {
        "equilibrium": "Equilibrium cartesian_compliance cartesian_stiffness equilibrium full_displacement",
        "evaluation": "spring_stiffness",
        "exact": "exact_positions exact_readings",
        "flips": "flip_margin",
        "model": "Model make_model",
        "ranges": "Beyond beyond range_notes",
        "state": "Site State",
        "torques": "actuator_torques",
    },
)
