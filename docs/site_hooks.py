"""What the site has beyond its pages: equations as MathML, which browsers draw by themselves, and a plan in 3D."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[1]
SCENE = "scene.html"
_MATH = re.compile(r"^```math\n(.*?)\n```$", re.M | re.S)
_TAG = re.compile(r"\s*\\tag\{(.*?)\}")


def on_config(config: Any) -> Any:
    """The version in the footer, and the link to the repository that this clone came from."""
    config.copyright = f"qsframework {version('qsframework')}"
    asked = ["git", "-C", str(ROOT), "config", "--get", "remote.origin.url"]
    origin = subprocess.run(asked, capture_output=True, text=True).stdout.strip()
    config.repo_url = origin if origin.startswith("https://") else ""
    return config


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Every `math` block as MathML, its number beside it."""
    return _MATH.sub(lambda found: equation(found[1]), markdown)


def equation(latex: str) -> str:
    """One equation and its number."""
    tag = _TAG.search(latex)
    number = f'<span class="number">({tag[1].replace(", ", "), (")})</span>' if tag else ""
    return f'<div class="equation">{convert(_TAG.sub("", latex), display="block")}{number}</div>'


def on_files(files: Any, config: Any) -> Any:
    """The scene of the home page: the plan of the measuring day's example on its robot."""
    day, made = ROOT / "examples" / "day", ROOT / "build" / SCENE
    made.parent.mkdir(exist_ok=True)
    qsf = str(Path(sys.executable).with_name("qsf"))
    show = [qsf, "show", str(day / "experiment.yaml"), str(day / "plan.csv"), "--html", str(made)]
    subprocess.run(show, check=True, capture_output=True)
    files.append(File.generated(config, SCENE, abs_src_path=str(made)))
    return files
