"""The page around a scene: meshcat's viewer with the scene packed in, and what one does with it. It loads nothing."""

from __future__ import annotations

import html
import json
import re
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qsframework.viz.packed import packed

if TYPE_CHECKING:
    from qsframework.viz.scene import Scene

_HERE = "qsframework.viz"


def render(scene: Scene, watch: str | None = None) -> str:
    """The page as HTML.

    watch: an address of the same server that answers with a number, a new one when the page is out of date
    """
    steps = [{"path": path, "label": label, **_facts(scene, path)} for path, label in scene.steps]
    layers = {name: {"paths": paths, "shown": name not in scene.off} for name, paths in scene.layers.items()}
    content = {
        **packed(scene.placed, scene.drawn, [path for path, *_ in (*scene.texts, *scene.glows)]),
        "texts": [[*text] for text in scene.texts],
        "glows": [[*glow] for glow in scene.glows],
        "moves": [[path, *(_rows(p) for p in ends)] for path, *ends in scene.moves],
        "factor": scene.factor,
        "steps": steps,
        "layers": layers,
        "first": scene.first,
        "all": not scene.ghosts and scene.first == 0,
        "size": scene.size,
        "watch": watch,
    }
    parts = {
        "title": html.escape(scene.title),
        "unfolded": "" if scene.steps else " open",
        "notes": "".join(f"<p>{html.escape(note)}</p>" for note in scene.notes),
        "meshcat": _meshcat(),
        "scene": json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"),
        "script": files(_HERE).joinpath("page.js").read_text(encoding="utf-8"),
    }
    page = files(_HERE).joinpath("page.html").read_text(encoding="utf-8")
    return re.sub(r"\{(\w+)\}", lambda m: parts.get(m[1], m[0]), page)


def _meshcat() -> str:
    """The viewer's own script, from the package, of which nothing else is loaded."""
    found = find_spec("meshcat")
    assert found is not None
    assert found.origin is not None
    script = Path(found.origin).parent / "viewer" / "dist" / "main.min.js"
    return script.read_text(encoding="utf-8").replace("</script", "<\\/script")


def _facts(scene: Scene, path: str) -> dict[str, Any]:
    facts = scene.facts.get(path)
    return {
        "ghost": scene.ghosts.get(path),
        "name": facts.name if facts else "",
        "angles": [list(a) for a in facts.angles] if facts else [],
        "shares": [[name, f"{100.0 * share:.0f} %", share] for name, share in facts.shares] if facts else [],
        "plays": list(facts.plays) if facts and facts.plays else None,
    }


def _rows(placement: Any) -> list[float]:
    """The first three rows of a placement (4, 4)."""
    return [round(float(v), 5) for v in placement[:3].ravel()]
