"""What every fit shares: observations and their noise, one solver, projections and statistics. Knows no robot."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
