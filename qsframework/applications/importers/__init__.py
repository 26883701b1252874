"""Readings from the files of others: trackers' point lists and controllers' joint logs."""

from qsframework.applications.importers.importing import Imported, import_readings
from qsframework.applications.options import ImportOptions

__all__ = ["ImportOptions", "Imported", "import_readings"]
