"""The page around a scene: meshcat's viewer with the scene packed in, a slider, boxes for layers. It loads nothing."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def render(
    title: str,
    commands: Sequence[Mapping[str, Any]],
    steps: Sequence[tuple[str, str]],
    ghosts: Mapping[str, str],
    first: int,
    layers: Mapping[str, Sequence[str]],
    notes: Sequence[str],
    size: float,
    watch: str | None = None,
) -> str:
    """The page as HTML.

    steps: path and label of each step of the slider; ghosts: path of a step -> path of what stands for it while another
    step is chosen; layers: name -> paths that its box shows or hides;
    size: of the scene, m;
    watch: an address of the same server that answers with a number, a new one when the page is out of date
    """
    import meshcat
    import umsgpack

    viewer = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
    packed = [base64.b64encode(umsgpack.packb(command)).decode() for command in commands]
    full = [
        ["/meshcat/" + path, label, "/meshcat/" + ghosts[path] if path in ghosts else None] for path, label in steps
    ]
    return _PAGE.format(
        title=html.escape(title),
        script=viewer.read_text(encoding="utf-8").replace("</script", "<\\/script"),
        commands=json.dumps(packed),
        first=first,
        steps=_inside(full),
        layers=_inside({name: ["/meshcat/" + path for path in paths] for name, paths in layers.items()}),
        notes="".join(f"<p>{html.escape(note)}</p>" for note in notes),
        size=_inside(size),
        watch=_inside(watch),
    )


def _inside(value: Any) -> str:
    """JSON that may stand inside a script."""
    return json.dumps(value).replace("<", "\\u003c")


_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>
body {{ margin: 0; overflow: hidden; font: 14px sans-serif; }}
#view {{ width: 100vw; height: 100vh; }}
#bar, #told {{ position: fixed; left: 12px; background: #fffd; padding: 6px 10px; border-radius: 4px; }}
#bar {{ bottom: 12px; }} #bar label {{ margin-right: 10px; }}
#told {{ top: 12px; max-width: 34em; font-size: 12px; }} #told p {{ margin: 2px 0; }}
#told:empty {{ display: none; }}
</style></head><body>
<div id="view"></div>
<div id="told">{notes}</div>
<div id="bar" hidden>
<div id="order" hidden><label>Pose <input id="step" type="range" min="0" value="0"></label>
<span id="label"></span></div>
<div id="layers"></div></div>
<script>{script}</script>
<script>
const viewer = new MeshCat.Viewer(document.getElementById("view"));
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
for (const command of {commands}) viewer.handle_command_bytearray(bytes(command));
const set = (path, property, value) =>
  viewer.handle_command({{type: "set_property", path: path, property: property, value: value}});
set("/Background", "top_color", [0.93, 0.95, 0.97]);
set("/Background", "bottom_color", [0.8, 0.83, 0.87]);
const size = {size};
set("/Cameras/default/rotated/<object>", "position", [1.1 * size, 0.65 * size, 0.95 * size]);
viewer.controls.target.set(0, 0.3 * size, 0);
viewer.controls.update();
const steps = {steps}, layers = {layers}, watch = {watch};
const slider = document.getElementById("step"), boxes = {{}};
const ghosts = () => !boxes.ghosts || boxes.ghosts.checked;
function show() {{
  const chosen = Number(slider.value);
  steps.forEach(([path, label, ghost], i) => {{
    set(path, "visible", chosen === 0 || chosen === i + 1);
    if (ghost) set(ghost, "visible", ghosts() && chosen !== i + 1);
  }});
  const order = chosen === 0 ? "all" : chosen + " of " + steps.length + ": " + steps[chosen - 1][1];
  document.getElementById("label").textContent = order;
}}
for (const [name, paths] of Object.entries(layers)) {{
  const label = document.createElement("label"), box = document.createElement("input");
  box.type = "checkbox";
  box.checked = true;
  boxes[name] = box;
  box.onchange = () => {{ if (name !== "ghosts") paths.forEach(p => set(p, "visible", box.checked)); show(); }};
  label.append(box, " " + name);
  document.getElementById("layers").append(label);
}}
document.getElementById("bar").hidden = steps.length < 2 && !Object.keys(layers).length;
if (steps.length) {{
  document.getElementById("order").hidden = steps.length < 2;
  slider.min = steps.some(s => s[2]) ? 1 : 0;
  slider.max = steps.length;
  slider.value = Number(location.hash.slice(1)) || {first};
  slider.oninput = show;
  show();
}}
if (watch) {{
  let known = null;
  setInterval(async () => {{
    try {{
      const now = await (await fetch(watch)).text();
      if (known !== null && now !== known) location.reload();
      known = now;
    }} catch (gone) {{ document.title = "qsf show has stopped"; }}
  }}, 1500);
}}
</script></body></html>
"""
