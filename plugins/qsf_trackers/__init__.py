"""Readings from the files of others: trackers' point lists and controllers' joint logs."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
