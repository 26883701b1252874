"""YAML out: text that `read_yaml` reads back as the same numbers and words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from qsframework.files.documents import DECIMAL

_ENDLESS = 1_000_000


class _Dumper(yaml.SafeDumper):
    """No anchors, which the reader refuses; text that looks like a decimal number is quoted."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, data: str) -> yaml.Node:
    return dumper.represent_scalar("tag:yaml.org,2002:str", data, style='"' if DECIMAL.fullmatch(data) else None)


_Dumper.add_representer(str, _text)


def yaml_text(data: Mapping[str, Any], comment: str = "") -> str:
    """A mapping of plain values as YAML, under a comment of any text."""
    told = "".join(f"# {' '.join(line.split())}\n" for line in comment.splitlines() if line.strip())
    body = yaml.dump(dict(data), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=_ENDLESS)
    return told + body
