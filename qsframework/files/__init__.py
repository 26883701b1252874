"""Files in and out: safe YAML that knows its lines, models with units in their keys, atomic writes."""

from qsframework.files.declared import FileModel, FileRecord, Lists, Named, Unit, as_file, fields, measured, null
from qsframework.files.documents import Document, read_text, read_yaml
from qsframework.files.folders import write_folder
from qsframework.files.models import json_schema, validate
from qsframework.files.output import sha256, write_bytes, write_text
from qsframework.files.yaml_text import yaml_text

__all__ = [
    "Document",
    "FileModel",
    "FileRecord",
    "Lists",
    "Named",
    "Unit",
    "as_file",
    "fields",
    "json_schema",
    "measured",
    "null",
    "read_text",
    "read_yaml",
    "sha256",
    "validate",
    "write_bytes",
    "write_folder",
    "write_text",
    "yaml_text",
]
