"""3D scenes as one self-contained HTML file: meshcat's viewer with the scene packed into the page."""

from __future__ import annotations

import base64
import html
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from qsframework.plugin import Array

Colour = tuple[float, float, float, float]


@dataclass
class Scene:
    """Objects to draw, in metres, z up. Built up, then written once with `html`."""

    title: str
    commands: list[dict[str, Any]] = field(default_factory=list)
    steps: list[tuple[str, str]] = field(default_factory=list)
    """Paths that a slider shows one at a time, with the label of each."""
    first: int = 0
    """The step that is shown at first, counted from 1; 0 shows all."""

    def box(self, path: str, size: tuple[float, ...], placement: Array, colour: Colour) -> None:
        """A box of size x, y, z about its placement (4, 4)."""
        from meshcat.geometry import Box

        self._add(path, Box(list(size)), placement, colour)

    def sphere(self, path: str, radius: float, placement: Array, colour: Colour) -> None:
        """A sphere about its placement."""
        from meshcat.geometry import Sphere

        self._add(path, Sphere(radius), placement, colour)

    def cylinder(self, path: str, radius: float, length: float, placement: Array, colour: Colour) -> None:
        """A cylinder along the z axis of its placement."""
        from meshcat.geometry import Cylinder

        turned = np.eye(4)  # meshcat's cylinder lies along y
        turned[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
        self._add(path, Cylinder(length, radius), placement @ turned, colour)

    def rod(self, path: str, start: Array, end: Array, radius: float, colour: Colour) -> None:
        """A cylinder between two points (3,)."""
        vector = end - start
        length = float(np.linalg.norm(vector))
        if length == 0.0:
            return
        z = vector / length
        x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
        x /= np.linalg.norm(x)
        placement = np.eye(4)
        placement[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
        placement[:3, 3] = 0.5 * (start + end)
        self.cylinder(path, radius, length, placement, colour)

    def arrow(self, path: str, start: Array, vector: Array, radius: float, colour: Colour) -> None:
        """A rod with a ball at its tip, which marks the head."""
        self.rod(f"{path}/shaft", start, start + vector, radius, colour)
        head = np.eye(4)
        head[:3, 3] = start + vector
        self.sphere(f"{path}/head", 2.2 * radius, head, colour)

    def step(self, path: str, label: str) -> None:
        """Make a path one of the slider's steps."""
        self.steps.append((path, label))

    def _add(self, path: str, geometry: Any, placement: Array, colour: Colour) -> None:
        from meshcat.commands import SetObject, SetTransform
        from meshcat.geometry import MeshPhongMaterial
        from meshcat.path import Path as ScenePath

        red, green, blue = (int(255 * c) for c in colour[:3])
        material = MeshPhongMaterial(
            color=(red << 16) + (green << 8) + blue, opacity=colour[3], transparent=colour[3] < 1
        )
        where = ScenePath(("meshcat", *path.split("/")))
        self.commands.append(SetObject(geometry, material, where).lower())
        self.commands.append(SetTransform(np.asarray(placement, dtype=float), where).lower())

    def html(self) -> str:
        """The page: no request leaves it."""
        import meshcat
        import umsgpack

        viewer = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
        packed = [base64.b64encode(umsgpack.packb(command)).decode() for command in self.commands]
        return _PAGE.format(
            title=html.escape(self.title),
            script=viewer.read_text(encoding="utf-8").replace("</script", "<\\/script"),
            commands=json.dumps(packed),
            first=self.first,
            steps=json.dumps([["/meshcat/" + path, label] for path, label in self.steps]).replace("<", "\\u003c"),
        )


_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>
body {{ margin: 0; overflow: hidden; font: 14px sans-serif; }}
#view {{ width: 100vw; height: 100vh; }}
#bar {{ position: fixed; left: 12px; bottom: 12px; background: #fffd; padding: 6px 10px; border-radius: 4px; }}
</style></head><body>
<div id="view"></div>
<div id="bar" hidden><label>Pose <input id="step" type="range" min="0" value="0"></label> <span id="label"></span></div>
<script>{script}</script>
<script>
const viewer = new MeshCat.Viewer(document.getElementById("view"));
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
for (const command of {commands}) viewer.handle_command_bytearray(bytes(command));
const set = (path, property, value) =>
  viewer.handle_command({{type: "set_property", path: path, property: property, value: value}});
set("/Background", "top_color", [0.93, 0.95, 0.97]);
set("/Background", "bottom_color", [0.8, 0.83, 0.87]);
set("/Cameras/default/rotated/<object>", "position", [3.9, 1.9, 3.4]);
const steps = {steps};
const slider = document.getElementById("step");
function show() {{
  const chosen = Number(slider.value);
  steps.forEach(([path, label], i) => set(path, "visible", chosen === 0 || chosen === i + 1));
  document.getElementById("label").textContent = chosen === 0 ? "all" : steps[chosen - 1][1];
}}
if (steps.length) {{
  document.getElementById("bar").hidden = false;
  slider.max = steps.length;
  slider.value = {first};
  slider.oninput = show;
  show();
}}
</script></body></html>
"""
