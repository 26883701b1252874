"""How the arm gives: kinematics of the elastic coordinates, springs, equilibrium, and the chain rule."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
