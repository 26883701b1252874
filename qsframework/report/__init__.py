"""Reports: one HTML file each, readable without a network."""

from typing import TYPE_CHECKING

from qsframework.lazily import lazily

if TYPE_CHECKING:
    from qsframework.report.blocks import Block, Figure, Lines, Mark, Section, Table, Text, Verdict, View
    from qsframework.report.fit_section import error_tables, fit_section, fit_sections, fit_table, interval_tables
    from qsframework.report.page import write_report
    from qsframework.report.plan_section import plan_section, pose_table, sd_table
    from qsframework.report.provenance import PROVENANCE, provenance_section
    from qsframework.report.words.plan import certificate_text
    from qsframework.report.words.sizes import shown

__all__ = [
    "PROVENANCE",
    "Block",
    "Figure",
    "Lines",
    "Mark",
    "Section",
    "Table",
    "Text",
    "Verdict",
    "View",
    "certificate_text",
    "error_tables",
    "fit_section",
    "fit_sections",
    "fit_table",
    "interval_tables",
    "plan_section",
    "pose_table",
    "provenance_section",
    "sd_table",
    "shown",
    "write_report",
]
__getattr__ = lazily(
    __name__,
    {
        "blocks": "Block Figure Lines Mark Section Table Text Verdict View",
        "fit_section": "error_tables fit_section fit_sections fit_table interval_tables",
        "page": "write_report",
        "plan_section": "plan_section pose_table sd_table",
        "provenance": "PROVENANCE provenance_section",
        "words.plan": "certificate_text",
        "words.sizes": "shown",
    },
)
