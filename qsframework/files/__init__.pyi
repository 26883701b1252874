from .declared import (
    FileModel as FileModel,
    Lists as Lists,
    Named as Named,
    Unit as Unit,
    as_file as as_file,
    fields as fields,
    measured as measured,
    null as null,
)
from .documents import Document as Document, read_text as read_text, read_yaml as read_yaml
from .folders import write_folder as write_folder
from .models import validate as validate
from .output import sha256 as sha256, write_bytes as write_bytes, write_text as write_text
from .plain import FileRecord as FileRecord
from .yaml_text import yaml_text as yaml_text
