"""What is done to the robot: campaigns, plans, readings, simulation, and readings as observations."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
