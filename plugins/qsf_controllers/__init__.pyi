from .export import export as export
from .options import ExportOptions as ExportOptions
