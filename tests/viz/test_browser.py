"""The page in a browser: no complaint, no request, and the robot is to be seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from headless import NO_HOST, SMALL, browser, console, open_page

from qsframework.experiment import Experiment, make_plan
from qsframework.plugin import Array, Poses
from qsframework.robot import load_robot, robot_names
from qsframework.viz import Scene, Site, serve, show_scene
from qsframework.viz.subject import one_pose, robot_alone

EVIL = "</script><script>document.title = 'taken'</script>"


def browse(page: Path | str, folder: Path, *more: str) -> str:
    """Open a page in headless Chromium; what it logged, or with --dump-dom what the page became."""
    run = open_page(page, folder, SMALL, *more, timeout=180)
    return run.stdout if "--dump-dom" in more else run.stderr


def look(page: Path, folder: Path) -> Array:
    """Pixels (600, 800, 3) of a page; fails if the console has an error or the page asks for anything elsewhere."""
    picture = page.with_suffix(".png")
    said = console(browse(page, folder, f"--screenshot={picture}", NO_HOST))
    assert not said, said
    from PIL import Image

    return np.asarray(Image.open(picture).convert("RGB")).astype(float)


def seen(scene: Scene, empty: Scene, folder: Path) -> tuple[int, Array]:
    """How many pixels differ from the empty scene, seen from the same place with the same notes; and the pixels."""
    empty.size, empty.notes, empty.layers, empty.steps = scene.size, scene.notes, scene.layers, scene.steps
    empty.first, empty.ghosts = scene.first, scene.ghosts
    pixels = []
    for name, one in (("scene", scene), ("empty", empty)):
        (folder / f"{name}.html").write_text(one.html())
        pixels.append(look(folder / f"{name}.html", folder))
    return int((np.abs(pixels[0] - pixels[1]).max(axis=2) > 40).sum()), pixels[0]


@browser
def test_the_robot_is_to_be_seen(m900ib: Experiment, tmp_path: Path) -> None:
    changed, pixels = seen(show_scene(m900ib, one_pose(m900ib, None, None)), Scene(title="empty"), tmp_path)
    assert changed > 15_000
    assert int((pixels[..., 0] - pixels[..., 2] > 80).sum()) > 3000  # the arm is yellow


@browser
def test_the_empty_scene_is_empty(tmp_path: Path) -> None:
    changed, _ = seen(Scene(title="one"), Scene(title="two"), tmp_path)
    assert changed < 200


@browser
@pytest.mark.parametrize("name", sorted(set(robot_names()) - {"fanuc_m900ib"}))
def test_every_robot_is_to_be_seen(name: str, tmp_path: Path) -> None:
    experiment = robot_alone(load_robot(name), np.zeros(3))
    changed, _ = seen(show_scene(experiment, one_pose(experiment, None, None)), Scene(title="empty"), tmp_path)
    assert changed > 2500  # a small arm such as the UR10 covers some 4000


@browser
def test_the_slider_shows_one_pose_and_the_ghosts_of_the_others(m900ib: Experiment, tmp_path: Path) -> None:
    """What the viewer's own tree says is visible, after the slider has moved."""
    pendant = np.deg2rad([[0.0, 20, -10, 0, 40, 0], [40.0, 35, 5, 30, -50, 60], [-90.0, -20, -40, 10, 80, 0]])
    wrench = np.tile([0.0, 0, -4000, 0, 0, 0], (3, 1))
    plan = make_plan(Poses(pendant, m900ib.robot.controller.to_joints(pendant), wrench), ["weight"] * 3)
    script = """<script>
    const visible = path => viewer.scene_tree.find(path.split("/")).object.visible;
    const state = () => [0, 1, 2].map(i => [visible("meshcat/poses/" + i), visible("meshcat/ghosts/" + i)]);
    const found = [state()];
    slider.value = 2; slider.oninput(); found.push(state(), document.getElementById("label").textContent);
    boxes.ghosts.click(); found.push(state());
    boxes.deflected.click(); found.push(visible("meshcat/poses/1/deflected"), visible("meshcat/poses/1/robot"));
    document.title = JSON.stringify(found);
    </script>"""
    page = tmp_path / "page.html"
    page.write_text(show_scene(m900ib, plan).html().replace("</body>", script + "</body>"))
    title = browse(page, tmp_path, "--dump-dom").split("<title>")[1].split("</title>")[0]
    import json

    first, second, label, without, deflected, robot = json.loads(title)
    assert first == [[True, False], [False, True], [False, True]]
    assert second == [[False, True], [True, False], [False, True]]
    assert label.startswith("2 of 3: p02 (weight), the load point moves")
    assert without == [[False, False], [True, False], [False, False]]
    assert (deflected, robot) == (False, True)
    opened = browse(page.as_uri() + "#3", tmp_path, "--dump-dom").split("<title>")[1].split("</title>")[0]
    assert json.loads(opened)[0] == [[False, True], [False, True], [True, False]]


@browser
def test_what_users_wrote_is_text(tmp_path: Path) -> None:
    scene = Scene(title=EVIL, notes=[EVIL])
    scene.step("a", EVIL)
    scene.layer(EVIL, "a")
    (tmp_path / "evil.html").write_text(scene.html())
    assert EVIL not in scene.html()
    title = browse(tmp_path / "evil.html", tmp_path, "--dump-dom").split("<title>")[1].split("</title>")[0]
    assert "taken" in title  # the title is the text itself,
    assert title != "taken"  # which has not run


def test_the_page_loads_nothing(m900ib: Experiment) -> None:
    page = show_scene(m900ib, one_pose(m900ib, None, None)).html()
    own = page.split("<script>")[0] + page.rpartition("<script>")[2]  # the viewer's code in between is meshcat's
    assert "http" not in own
    assert "src=" not in own
    assert "href=" not in own
    assert "const steps" in own
    assert "watch = null" in own


@browser
def test_the_served_page_is_drawn_without_complaint(m900ib: Experiment, tmp_path: Path) -> None:
    import threading

    scene = show_scene(m900ib, one_pose(m900ib, None, None))
    with serve(Site(scene.html, []), 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_address[1]}/"
        log = browse(address, tmp_path, f"--screenshot={tmp_path / 'served.png'}")
        server.shutdown()
    said = console(log)
    assert not said, said
    from PIL import Image

    pixels = np.asarray(Image.open(tmp_path / "served.png").convert("RGB")).astype(int)
    assert int((pixels[..., 0] - pixels[..., 2] > 80).sum()) > 3000
