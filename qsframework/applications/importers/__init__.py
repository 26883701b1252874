"""Readings from the files of others: trackers' point lists and controllers' joint logs."""

from qsframework.applications.importers.importing import Imported, ImportWish, import_readings

__all__ = ["ImportWish", "Imported", "import_readings"]
