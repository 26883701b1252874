"""Readings from the files of others: trackers' point lists and controllers' joint logs."""

from qsframework.applications.importers.importing import Imported, ImportOptions, import_readings

__all__ = ["ImportOptions", "Imported", "import_readings"]
