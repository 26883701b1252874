from .blocks import (
    Block as Block,
    Figure as Figure,
    Lines as Lines,
    Mark as Mark,
    ReportTable as ReportTable,
    SceneView as SceneView,
    Section as Section,
    Text as Text,
    Verdict as Verdict,
)
from .fit_section import (
    error_tables as error_tables,
    fit_section as fit_section,
    fit_sections as fit_sections,
    fit_table as fit_table,
    interval_tables as interval_tables,
    where_section as where_section,
)
from .page import write_report as write_report
from .plan_section import plan_section as plan_section, pose_table as pose_table, sd_table as sd_table
from .provenance import provenance_section as provenance_section
from .words.plan import certificate_text as certificate_text
from .words.sizes import shown as shown
