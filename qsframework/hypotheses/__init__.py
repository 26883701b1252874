"""What else could be true of readings: a catalogue, what its entries do to the readings, and the search among them."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
