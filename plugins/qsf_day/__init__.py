"""The measuring day: what comes next, whether a reading is as expected, and what the readings tell so far."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
