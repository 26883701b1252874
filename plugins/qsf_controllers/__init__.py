"""Languages of controllers, and `qsf export`, which writes plans in them."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
