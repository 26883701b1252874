"""The page in a browser: no complaint, no request, the robot fills the view, and everything on the page works."""

from __future__ import annotations

import io
import json
import threading
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import Browser
from headless import browser

from qsframework.experiment import Experiment, Plan, make_plan
from qsframework.plugin import Poses
from qsframework.robot import load_robot, robot_names
from qsframework.viz import Scene, SceneSite, robot_row, robot_shapes, serve, show_scene
from qsframework.viz.robot_shapes import deflected_look
from qsframework.viz.subject import one_pose, robot_alone

EVIL = "</script><script>document.title = 'taken'</script>"


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One browser for all pages."""
    with Browser(tmp_path_factory.mktemp("chromium"), "about:blank", own="file://") as driven:
        driven.size(800, 600)
        yield driven


@pytest.fixture
def chromium(driven: Browser) -> Iterator[Browser]:
    driven.forget()
    yield driven
    driven.go("about:blank", "true")  # nothing goes on to be drawn


def answer(page: Path, script: str, chromium: Browser, at: str = "") -> Any:
    """What a script on the page puts into `found`; fails if the console has anything to say."""
    told = f"<script>const found = [];\n{script}\ndocument.title = JSON.stringify(found);</script></body>"
    probe = page.with_name("probe.html")
    probe.write_text(page.read_text().replace("</body>", told))
    chromium.go(probe.as_uri() + at, READY)
    found = json.loads(chromium.run("document.title"))
    assert chromium.errors == chromium.foreign == chromium.logged == []
    return found


READY = "document.readyState === 'complete' && typeof find === 'function'"
PIXELS = """
const read = () => {
  viewer.set_3d_pane_size();
  viewer.render();
  const gl = viewer.renderer.getContext(), [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const out = new Uint8Array(4 * w * h);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, out);
  return [out, w, h];
};
const covered = () => {
  root.visible = true;
  const [full, w, h] = read();
  root.visible = false;
  const [empty] = read();
  let count = 0, left = w, right = 0, low = h, high = 0;
  for (let i = 0; i < full.length; i += 4) {
    if (Math.abs(full[i] - empty[i]) + Math.abs(full[i + 1] - empty[i + 1]) + Math.abs(full[i + 2] - empty[i + 2]) < 60)
      continue;
    const x = i / 4 % w, y = Math.floor(i / 4 / w);
    count += 1;
    left = Math.min(left, x); right = Math.max(right, x); low = Math.min(low, y); high = Math.max(high, y);
  }
  return [count / w / h, left / w, right / w, low / h, high / h];
};
"""


@browser
def test_every_robot_fills_the_first_view_and_is_whole_in_it(chromium: Browser, tmp_path: Path) -> None:
    names = sorted(robot_names())
    page = tmp_path / "row.html"
    page.write_text(robot_row([load_robot(name) for name in names]).html())
    found = answer(page, PIXELS + "steps.forEach((_, i) => { choose(i + 1); found.push(covered()); });", chromium)
    for name, (share, left, right, low, high) in zip(names, found, strict=True):
        assert share > 0.03, name  # a thin arm such as the UR10 covers little of its frame
        assert max(right - left, high - low) > 0.5, name
        assert min(left, low) > 0.0, name
        assert max(right, high) < 1.0, name


WORDS = """(() => {
  const seen = o => !o || (o.visible && seen(o.parent)), box = new THREE.Vector3();
  const words = said.filter(seen).map(s => {
    s.getWorldPosition(box).project(camera());
    const [w, h] = s.userData.pixels, x = (box.x + 1) / 2 * innerWidth, y = (1 - box.y) / 2 * innerHeight;
    return [x - s.center.x * w, y - (1 - s.center.y) * h, w, h];
  });
  const panels = ["facts", "told", "bar"].map(id => at(id).getBoundingClientRect())
    .map(r => [r.x, r.y, r.width, r.height]);
  const tip = new THREE.Box3().setFromObject(find("poses/0/load"));
  const ends = [tip.min, tip.max].map(v => v.project(camera()));
  return {words, panels, ends: ends.map(v => [v.x, v.y])};
})()"""
GHOST = f"""{{ {PIXELS} (() => {{
  const ghost = find("poses/0/deflected"), [full, w, h] = read();
  ghost.visible = false;
  const [bare] = read();
  ghost.visible = true;
  let apart = 0;
  for (let i = 0; i < full.length; i += 4)
    if (Math.abs(full[i] - bare[i]) + Math.abs(full[i + 1] - bare[i + 1]) + Math.abs(full[i + 2] - bare[i + 2]) > 70)
      apart += 1;
  return apart;
}})() }}"""


@browser
def test_words_arrows_and_the_deflected_arm_are_seen_on_every_robot(chromium: Browser, tmp_path: Path) -> None:
    """No word under a panel, out of the view or over another; the deflected arm differs from all that is behind it,
    on a light and on a dark ground."""
    for name in sorted(robot_names()):
        experiment = robot_alone(load_robot(name), np.array([0.2, 0.0, 0.1]))
        arm = experiment.robot.controller
        pose = np.clip(np.resize(np.deg2rad([10.0, 20.0, -10.0, 20.0, 60.0, 10.0]), arm.axes), arm.lower, arm.upper)
        page = tmp_path / "page.html"
        page.write_text(show_scene(experiment, one_pose(experiment, pose, None)).html())
        chromium.go(f"{page.as_uri()}?{name}", READY)
        for scheme in ("dark", "light"):
            chromium.media(scheme=scheme)
            chromium.until(f"dark.matches === {json.dumps(scheme == 'dark')}")
            found = chromium.run(WORDS)
            assert len(found["words"]) == 2, name
            assert not [w for w in found["words"] if w[0] < 0 or w[1] < 0 or w[0] + w[2] > 800 or w[1] + w[3] > 600], (
                name
            )
            boxes = [*found["words"], *found["panels"]]
            assert not [(a, b) for a in found["words"] for b in boxes if a is not b and overlap(a, b)], name
            assert np.abs(found["ends"]).max() < 1.0, name
            assert chromium.run(GHOST) > 300, (name, scheme)
    assert chromium.errors == []
    assert chromium.foreign == []


def overlap(a: list[float], b: list[float]) -> bool:
    """Whether two boxes (left, top, width, height) lie over each other by more than a pixel."""
    return all(min(a[k] + a[k + 2], b[k] + b[k + 2]) - max(a[k], b[k]) > 1.0 for k in range(2))


def test_the_parts_of_every_robot_differ_in_colour() -> None:
    """Solids, bars, balancers and the deflected arm, also where it lies over a solid."""
    for name in sorted(robot_names()):
        robot = load_robot(name)
        own = {tuple(s.rgba[:3]) for s in (*robot.shapes, *robot.branch_shapes)}
        deflected = np.array(deflected_look(robot)[0][:3])
        parts = [np.array(c) for c in (*own, robot_shapes._BAR[:3], robot_shapes._SPRING[:3])]
        apart = [float(np.linalg.norm(a - b)) for a, b in combinations([*parts, deflected], 2)]
        assert min(apart) > 0.2, name
        assert min(0.45 * float(np.linalg.norm(deflected - solid)) for solid in parts) > 0.2, name


@pytest.fixture(scope="module")
def plan(m900ib: Experiment) -> Plan:
    pendant = np.deg2rad([[0.0, 20, -10, 0, 40, 0], [40.0, 35, 5, 30, -50, 60], [-90.0, -20, -40, 10, 80, 0]])
    wrench = np.tile([0.0, 0, -4000, 0, 0, 0], (3, 1))
    return make_plan(Poses(pendant, m900ib.robot.controller.to_joints(pendant), wrench), ["weight"] * 3)


@pytest.fixture(scope="module")
def page(m900ib: Experiment, plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("plan") / "page.html"
    file.write_text(show_scene(m900ib, plan).html())
    return file


USED = """
const seen = path => find(path).visible, now = () => at("label").textContent;
const state = () => [0, 1, 2].map(i => [seen("poses/" + i), seen("ghosts/" + i)]);
const key = name => document.body.dispatchEvent(new KeyboardEvent("keydown", {key: name, bubbles: true}));
found.push(state(), now());
key("ArrowLeft"); found.push(now(), location.hash);
boxes.ghosts.click(); found.push(state());
boxes.deflected.click(); found.push(seen("poses/1/deflected"), seen("poses/1/robot")); boxes.deflected.click();
found.push(at("angles").innerText.split(/\\s+/).slice(0, 6), at("shares").innerText, at("play").textContent);
const tip = find("poses/1/deflected/tip"), own = tip.position.toArray(), link = find("poses/1/deflected/link_6");
const colour = () => link.children.find(c => c.name).children.find(c => c.isMesh).material.opacity;
const start = find("poses/1/robot/link_6").position;
key(" "); bend(0); found.push(tip.position.toArray(), own, link.position.distanceTo(start));
bend(1); found.push(tip.position.toArray(), colour()); key(" "); found.push(tip.position.toArray(), colour());
key("4"); found.push(at("from").value);
const stops = [...document.querySelectorAll("a[href], button, input, select, summary, [tabindex]")];
found.push(stops.filter(e => e.tabIndex >= 0).length, document.querySelectorAll("input").length);
found.push([...document.querySelectorAll("#facts, #bar, button, summary")].map(e => getComputedStyle(e).color));
"""


@browser
def test_what_is_on_the_page_works(page: Path, m900ib: Experiment, plan: Plan, chromium: Browser) -> None:
    """From a link to the third pose on: keys, layers, the readings of the pose, play, and what Tab stops at."""
    found = answer(page, USED, chromium, "#pose=p03")
    first, label, second, link, ghosts, bent, robot, angles, shares, play, *more = found
    assert first == [[False, False], [False, False], [True, False]]  # ghosts are off at first
    assert label.startswith("3 of 3: p03 (weight), the load point moves")
    assert second.startswith("2 of 3: p02 (weight)")
    assert link == "#pose=p02"
    assert ghosts == [[False, True], [True, False], [False, True]]
    assert (bent, robot) == (False, True)
    assert angles == ["J1", "40", "deg", "J2", "35", "deg"]
    assert "joint_2" in shares
    assert play == "Play the load, x 100"
    bare, own, apart, loaded, solid, after, pale, view, stops, boxes, inks = more
    from qsframework.elastostatics import equilibrium

    tips = [equilibrium(m900ib.model(), plan.poses, loaded=state).tip[1] for state in (False, True)]
    assert np.allclose(np.subtract(own, bare), 100.0 * (tips[1] - tips[0]), atol=3e-5)  # without load: nothing gives
    assert apart < 1e-9
    assert np.allclose(loaded, own)
    assert np.allclose(after, own)
    assert (solid, pale) == (1, 0.45)  # the arm that swings is the robot itself
    assert view == "top"
    assert stops <= 20
    assert boxes == 11
    assert set(inks) <= {"rgb(34, 34, 34)", "rgb(0, 0, 0)"}


@browser
def test_numbers_of_the_other_poses_stand_under_no_panel(page: Path, chromium: Browser) -> None:
    script = """for (const step of [1, 2, 3]) for (const view of Object.keys(FROM)) {
      at("from").value = view; at("from").onchange(); choose(step);
      for (const n of numbers.filter(n => n.visible)) {
        const p = n.getWorldPosition(new THREE.Vector3()).project(camera());
        const [x, y] = [(p.x + 1) / 2 * innerWidth, (1 - p.y) / 2 * innerHeight];
        const under = ["facts", "told", "bar"].map(id => at(id).getBoundingClientRect())
          .filter(r => x > r.left && x < r.right && y > r.top && y < r.bottom);
        found.push([n.userData.step === step, under.length]);
      }
    }"""
    found = answer(page, script, chromium)
    assert len(found) > 8
    assert not [pair for pair in found if pair != [False, 0]]


def test_a_scene_is_small_beside_its_viewer(m900ib: Experiment) -> None:
    """Twelve poses, ghosts, deflections and all: at most 150 kB more than meshcat's own script, and no request."""
    pendant = np.deg2rad(np.random.default_rng(0).uniform(-20.0, 20.0, (12, 6)))
    wrench = np.tile([0.0, 500.0, -4000, 0, 0, 0], (12, 1))
    plan = make_plan(Poses(pendant, m900ib.robot.controller.to_joints(pendant), wrench), ["weight"] * 12)
    text = show_scene(m900ib, plan).html()
    viewer = Path(find_spec("meshcat").origin).parent / "viewer" / "dist" / "main.min.js"
    assert 50_000 < len(text.encode()) - viewer.stat().st_size < 150_000
    own = text.replace(viewer.read_text(encoding="utf-8").replace("</script", "<\\/script"), "")
    assert len(own) < 150_000  # the viewer's code is meshcat's, and stands there once
    assert not [word for word in ("http", "src=", "href=") if word in own]


@browser
def test_what_users_wrote_is_text(chromium: Browser, tmp_path: Path) -> None:
    scene = Scene(title=EVIL, notes=[EVIL])
    scene.step("a", EVIL)
    scene.layer(EVIL, "a")
    (tmp_path / "evil.html").write_text(scene.html())
    assert EVIL not in scene.html()
    chromium.go((tmp_path / "evil.html").as_uri(), READY)
    title = chromium.run("document.title")
    assert "taken" in title  # the title is the text itself,
    assert title != "taken"  # which has not run


@browser
def test_the_served_page_is_drawn_without_complaint(m900ib: Experiment, chromium: Browser) -> None:
    scene = show_scene(m900ib, one_pose(m900ib, None, None))
    with serve(SceneSite(scene.html, []), 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_address[1]}/"
        chromium.go(address, READY)
        picture = chromium.picture([0, 0, 800, 600])
        server.shutdown()
    assert chromium.logged == []
    from PIL import Image

    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)
    assert int((pixels[..., 0] - pixels[..., 2] > 80).sum()) > 15_000  # the arm is yellow
