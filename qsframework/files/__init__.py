"""Files in and out: safe YAML that knows its lines, models with units in their keys, atomic writes."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
