"""The public API for effects, readers and languages: everything that a third party's plugin imports comes from here."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
