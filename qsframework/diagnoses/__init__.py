"""What the model gets wrong, which cause explains it, and what the extended model gains."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
