"""Reports: one HTML file each, readable without a network."""

from qsframework.report.blocks import Block, Figure, Lines, Section, Table, Text, View
from qsframework.report.fit_section import error_tables, fit_section, fit_table, interval_tables, shown
from qsframework.report.page import write_report
from qsframework.report.plan_section import certificate_text, plan_section, pose_table, sd_table
from qsframework.report.provenance import PROVENANCE, provenance_section

__all__ = [
    "PROVENANCE",
    "Block",
    "Figure",
    "Lines",
    "Section",
    "Table",
    "Text",
    "View",
    "certificate_text",
    "error_tables",
    "fit_section",
    "fit_table",
    "interval_tables",
    "plan_section",
    "pose_table",
    "provenance_section",
    "sd_table",
    "shown",
    "write_report",
]
