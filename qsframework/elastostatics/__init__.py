"""How the arm gives: kinematics of the elastic coordinates, springs, and the chain rule."""

from qsframework.elastostatics.model import Model, make_model
from qsframework.elastostatics.state import Site, State

__all__ = ["Model", "Site", "State", "make_model"]
