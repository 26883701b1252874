// The page of a scene. meshcat's viewer draws; its control panel, with inputs for every object, is taken off the page.
const {THREE} = MeshCat, at = id => document.getElementById(id);
const viewer = new MeshCat.Viewer(at("view"));
viewer.gui.domElement.remove();
const set = (path, property, value) => viewer.set_property(path, property, value);
const dark = matchMedia("(prefers-color-scheme: dark)");
function ground(night) {
  set(["Background"], "top_color", night ? [0.18, 0.2, 0.23] : [0.93, 0.95, 0.97]);
  set(["Background"], "bottom_color", night ? [0.32, 0.35, 0.39] : [0.8, 0.83, 0.87]);
  viewer.render();
}
ground(dark.matches);
dark.addEventListener("change", () => ground(dark.matches));

// What the scene is made of: solids, colours and whole parts of the tree stand in the page once, and are used again.
const floats = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
const MAKE = {
  BoxGeometry: size => new THREE.BoxGeometry(...size),
  SphereGeometry: ([radius]) => new THREE.SphereGeometry(radius, 24, 16),
  CylinderGeometry: ([top, bottom]) => new THREE.CylinderGeometry(top, bottom, 1, 32),
  BufferGeometry: ([points, faces]) => {
    const solid = new THREE.BufferGeometry();
    solid.setAttribute("position", new THREE.BufferAttribute(floats(points), 3));
    solid.setIndex(new THREE.BufferAttribute(new Uint32Array(floats(faces).buffer), 1));
    solid.computeVertexNormals();
    return solid;
  },
};
const solids = scene.solids.map(([kind, ...size]) => MAKE[kind](size));
const paint = (colour, opacity) => new THREE.MeshPhongMaterial({
  color: colour, opacity, transparent: opacity < 1, depthWrite: opacity >= 0.3, side: THREE.DoubleSide, reflectivity: 0.5,
  polygonOffset: opacity < 1, polygonOffsetFactor: 1, polygonOffsetUnits: 4,  // what lies in a solid's face stays behind it
});
const paints = scene.colours.map(([colour, opacity]) => paint(colour, opacity));
function build(id) {
  const [solid, colour, length, ...parts] = scene.nodes[id], group = new THREE.Group();
  if (solid >= 0) {
    const mesh = new THREE.Mesh(solids[solid], paints[colour]);
    if (length) mesh.scale.y = length;
    group.add(mesh);
  }
  for (let k = 0; k < parts.length; k += 3) {
    const child = build(parts[k + 2]);
    child.name = parts[k];
    stand(child, scene.matrices[parts[k + 1]]);
    group.add(child);
  }
  return group;
}
// Three rows of four numbers; an ellipsoid's axes are stretched, and three.js takes the stretch apart by itself.
const matrix = m => new THREE.Matrix4().set(...m, 0, 0, 0, 1);
function stand(object, m) { if (m) matrix(m).decompose(object.position, object.quaternion, object.scale); }
const root = build(scene.root);
viewer.scene_tree.find(["scene"]).object.add(root);
const find = path => path.split("/").reduce((o, name) => o && o.children.find(c => c.name === name), root);

// Words and glows face the reader, and nothing hides them. Words keep their size on the screen.
function facing(canvas, opacity = 1) {
  const map = new THREE.CanvasTexture(canvas);
  return new THREE.Sprite(new THREE.SpriteMaterial({map, opacity, depthTest: false, depthWrite: false}));
}
function words(text, ink, ground) {
  const canvas = document.createElement("canvas"), pen = canvas.getContext("2d"), font = "600 36px system-ui, sans-serif";
  pen.font = font;
  canvas.width = Math.max(48, Math.ceil(pen.measureText(text).width) + 24);
  canvas.height = 48;
  pen.fillStyle = ground;
  pen.beginPath();
  pen.roundRect(1, 1, canvas.width - 2, 46, 22);
  pen.fill();
  pen.font = font;
  pen.fillStyle = ink;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.fillText(text, canvas.width / 2, 25);
  const sprite = facing(canvas);
  sprite.material.sizeAttenuation = false;
  sprite.userData.pixels = [canvas.width * 20 / 48, 20];
  sprite.renderOrder = 3;
  return sprite;
}
const said = [], numbers = [], glows = [];
for (const [path, text, point, ink, step] of scene.texts) {
  const sprite = words(text, step ? "#fff" : ink, step ? ink : "#ffffffe8");
  sprite.position.set(...point);
  sprite.userData.step = step;
  (step ? numbers : said).push(sprite);
  find(path).add(sprite);
}
for (const [path, point, radius, colour, strength, pulse] of scene.glows) {
  const canvas = document.createElement("canvas"), pen = canvas.getContext("2d");
  canvas.width = canvas.height = 64;
  const ring = pen.createRadialGradient(32, 32, 0, 32, 32, 32);
  for (const [where, alpha] of [[0, "ff"], [0.35, "c0"], [0.7, "50"], [1, "00"]]) ring.addColorStop(where, colour + alpha);
  pen.fillStyle = ring;
  pen.fillRect(0, 0, 64, 64);
  const sprite = facing(canvas, strength);
  sprite.position.set(...point);
  sprite.scale.setScalar(2 * radius);
  sprite.renderOrder = 2;
  sprite.userData = {strength, pulse};
  glows.push(sprite);
  find(path).add(sprite);
}

// Where one looks from: directions in the robot's base frame, z up. meshcat's world has y up.
const FROM = {corner: [1.1, -0.95, 0.65], front: [1, 0, 0.12], side: [0, -1, 0.12], top: [0.001, 0, 1]};
const camera = () => viewer.camera, wide = 40;
const up = v => new THREE.Vector3(v.x, v.z, -v.y);
let moved = false;
function corners() {
  const points = [];
  root.updateWorldMatrix(true, true);
  (function visit(o) {
    if (!o.visible) return;
    if (o.isMesh) {
      o.geometry.boundingBox || o.geometry.computeBoundingBox();
      const {min, max} = o.geometry.boundingBox;
      for (const x of [min.x, max.x]) for (const y of [min.y, max.y]) for (const z of [min.z, max.z])
        points.push(new THREE.Vector3(x, y, z).applyMatrix4(o.matrixWorld));
    }
    o.children.forEach(visit);
  })(steps.length && chosen() ? find(steps[chosen() - 1].path) || root : root);
  return points.length ? points : [-0.5, 0.5].map(x => new THREE.Vector3(x, 1, x).multiplyScalar(scene.size));
}
function frame() {
  const width = innerWidth, height = innerHeight, eye = camera(), points = corners();
  const left = at("facts").open && width > 640 ? at("facts").offsetWidth + 10 : 0, low = at("bar").offsetHeight + 10;
  const top = at("told").open ? 0 : at("told").offsetHeight + 10, word = said.length ? 90 : 0;  // words stand out at the sides
  const middle = new THREE.Box3().setFromPoints(points).getCenter(new THREE.Vector3());
  const towards = up(new THREE.Vector3(...FROM[at("from").value])).normalize();
  const right = new THREE.Vector3(0, 1, 0).cross(towards).normalize(), high = towards.clone().cross(right);
  const tall = Math.tan(wide * Math.PI / 360), share = 0.9;
  const across = tall * share * (width - left - word) / height, upwards = tall * share * (height - low - top) / height;
  let far = 0.1;
  for (let round = 0; round < 5; round += 1) {  // what is near looks larger: the middle of the picture is not the box's
    far = 0.1;
    const from = points.map(p => p.clone().sub(middle)).map(d => [d.dot(right), d.dot(high), d.dot(towards)]);
    for (const [x, y, near] of from) far = Math.max(far, near + Math.abs(x) / across, near + Math.abs(y) / upwards);
    for (const [k, axis] of [right, high].entries()) {
      const seen = from.map(d => d[k] / (far - d[2]));
      middle.addScaledVector(axis, 0.5 * far * (Math.min(...seen) + Math.max(...seen)));
    }
  }
  eye.fov = wide;
  eye.far = 20 * far;
  eye.aspect = width / height;
  eye.setViewOffset(width, height, -left / 2, (low - top) / 2, width, height);
  eye.position.copy(middle).addScaledVector(towards, far);
  viewer.controls.target.copy(middle);
  viewer.controls.update();
  partWords();
  viewer.set_dirty();
}
// Of the words that are seen the lowest stand below their points, the highest above, others to the right. The panel says
// which number is chosen, and no number stands under a panel.
function partWords() {
  const seen = o => !o || (o.visible && seen(o.parent));
  camera().updateMatrixWorld();
  const place = s => s.getWorldPosition(new THREE.Vector3()).project(camera());
  const order = said.filter(seen).map(s => [place(s).y, s]).sort((a, b) => b[0] - a[0]).map(pair => pair[1]);
  order.forEach((s, k) => {
    if (k === 0) s.center.set(0.5, -0.35);
    else if (k === order.length - 1) s.center.set(0.5, 1.35);
    else s.center.set(-0.15, 0.5);
  });
  const panels = ["facts", "told", "bar"].map(id => at(id).getBoundingClientRect()), room = 12;
  for (const number of numbers) {
    const {x, y} = place(number), [left, top] = [(x + 1) / 2 * innerWidth, (1 - y) / 2 * innerHeight];
    const under = p => left > p.left - room && left < p.right + room && top > p.top - room && top < p.bottom + room;
    number.visible = number.userData.step !== chosen() && !panels.some(under);
  }
}
function fitWords() {
  const unit = 2 * Math.tan(wide * Math.PI / 360) / innerHeight;
  for (const sprite of [...said, ...numbers]) sprite.scale.set(...sprite.userData.pixels.map(p => p * unit), 1);
}
viewer.controls.addEventListener("start", () => { moved = true; });
viewer.controls.addEventListener("change", () => partWords());
addEventListener("resize", () => { fitWords(); viewer.set_3d_pane_size(); if (!moved) frame(); });
at("from").onchange = () => { moved = false; frame(); };
at("facts").ontoggle = () => { if (!moved) frame(); };

// Steps and layers.
const {steps} = scene, slider = at("step"), boxes = {};
const chosen = () => Number(slider.value), on = name => !boxes[name] || boxes[name].checked;
const visible = (path, value) => { const o = find(path); if (o) o.visible = value; };
function cells(parent, rows, share) {
  parent.replaceChildren();
  const table = parent.appendChild(document.createElement("table"));
  for (const [name, value, part] of rows) {
    const row = table.insertRow();
    row.insertCell().textContent = name;
    row.insertCell().textContent = value;
    if (share) {
      const bar = table.insertRow().insertCell();
      bar.colSpan = 2;
      const line = bar.appendChild(document.createElement("div"));
      line.className = "share";
      line.style.width = 100 * Math.min(1, Math.max(0, part)) + "%";
    }
  }
}
function show() {
  const now = chosen(), one = steps[now - 1];
  steps.forEach((step, i) => {
    visible(step.path, now === 0 || now === i + 1);
    if (step.ghost) visible(step.ghost, on("ghosts") && now !== i + 1);
  });
  at("label").textContent = !one ? "all" : (steps.length > 1 ? now + " of " + steps.length + ": " : "") + one.label;
  slider.setAttribute("aria-valuetext", at("label").textContent);
  cells(at("angles"), one ? one.angles : []);
  cells(at("shares"), one ? one.shares : [], true);
  at("play").hidden = !one || !one.plays;
  if (playing) rest(), play();
  if (moved) partWords();
  else frame();
  viewer.set_dirty();
}
function choose(step) {
  slider.value = step;
  show();
  if (parent === window && steps[step - 1]) history.replaceState(null, "", "#pose=" + encodeURIComponent(steps[step - 1].name));
}
// #pose=NAME, or #5 for the fifth.
function asked() {
  let options = location.hash.slice(1);
  try { options = decodeURIComponent(options); } catch (broken) { /* taken as it stands */ }
  const name = options.replace(/^pose=/, "");
  return steps.findIndex(s => s.name === name) + 1 || (steps[Number(name) - 1] ? Number(name) : 0);
}
for (const [name, {paths, shown}] of Object.entries(scene.layers)) {
  const label = document.createElement("label"), box = document.createElement("input");
  box.type = "checkbox";
  box.checked = shown;
  boxes[name] = box;
  const apply = () => { if (name !== "ghosts") paths.forEach(path => visible(path, box.checked)); };
  box.onchange = () => { apply(); show(); };
  apply();
  label.append(box, " " + name);
  at("layers").append(label);
}
at("show").hidden = !Object.keys(boxes).length;
at("bar").hidden = !Object.keys(boxes).length && !steps.length;
if (steps.length) {
  at("order").hidden = steps.length < 2;
  slider.min = scene.all ? 0 : 1;
  slider.max = steps.length;
  slider.value = asked() || scene.first;
  slider.oninput = () => choose(chosen());
  at("facts").hidden = false;
  at("facts").open = innerWidth > 640;
  addEventListener("hashchange", () => { if (asked()) choose(asked()); });
}

// Play: the arm sags from where it stands to where its load bends it, and springs back.
const same = (from, to, pairs = []) => {
  for (const child of to.children) {
    const twin = child.name && from.children.find(c => c.name === child.name);
    if (!twin) continue;
    pairs.push([twin, child]);
    same(twin, child, pairs);
  }
  return pairs;
};
let playing = 0, sagging = [], hidden = [], repainted = [], load = 1;
const pale = paint(0x8090a0, 0.18);
function play() {
  const one = steps[chosen() - 1], keep = o => [o, o.position.clone(), o.quaternion.clone()];
  if (!one || !one.plays) return;
  const robot = find(one.plays[0]), bent = find(one.plays[1]);
  const bare = o => o.children.filter(c => c.isMesh);
  for (const [twin, child] of same(robot, bent)) {
    sagging.push([...keep(child), twin.position.clone(), twin.quaternion.clone()]);
    bare(child).forEach((mesh, k) => {
      const own = bare(twin)[k];
      repainted.push([mesh, mesh.material], [own, own.material]);
      mesh.material = own.material;
      own.material = pale;
    });
  }
  for (const [path, from, to] of scene.moves) {
    const o = find(path);
    if (!o || !path.startsWith(one.path + "/")) continue;
    const start = keep(o), [a, b] = [new THREE.Object3D(), new THREE.Object3D()];
    stand(a, from);
    stand(b, to);
    sagging.push([o, b.position, b.quaternion, a.position, a.quaternion, start]);
  }
  bent.children.filter(c => c.name.endsWith("_way")).forEach(way => { if (way.visible) hidden.push(way); way.visible = false; });
  playing = performance.now();
  at("play").setAttribute("aria-pressed", "true");
  at("play").textContent = "Stop";
}
function rest() {
  for (const [o, place, turn, , , start] of sagging) {
    o.position.copy(start ? start[1] : place);
    o.quaternion.copy(start ? start[2] : turn);
  }
  repainted.reverse().forEach(([mesh, own]) => { mesh.material = own; });
  hidden.forEach(way => { way.visible = true; });
  sagging = []; hidden = []; repainted = [];
  playing = 0;
  bend(1);
  at("play").setAttribute("aria-pressed", "false");
  at("play").textContent = "Play the load" + scene.factor;
}
function bend(share) {
  load = share;
  for (const [o, place, turn, from, start] of sagging) {
    o.position.lerpVectors(from, place, share);
    o.quaternion.slerpQuaternions(start, turn, share);
  }
  for (const glow of glows) if (!glow.userData.pulse) glow.material.opacity = glow.userData.strength * Math.min(1, Math.abs(share));
  viewer.set_dirty();
}
// Seconds: the load comes on, acts, and is let go: the arm swings about where it stood.
function loaded(t) {
  t %= 5.2;
  if (t < 1.4) return (t / 1.4) ** 2 * (3 - 2 * t / 1.4);
  if (t < 2.6) return 1;
  return t < 4.6 ? Math.exp(-2.6 * (t - 2.6)) * Math.cos(11 * (t - 2.6)) : 0;
}
(function beat(now) {
  requestAnimationFrame(beat);
  if (playing) bend(loaded((now - playing) / 1000));
  for (const glow of glows) if (glow.userData.pulse && glow.parent.visible) {
    const share = matchMedia("(prefers-reduced-motion: reduce)").matches ? 1 : 0.75 + 0.25 * Math.sin(now / 350);
    glow.material.opacity = glow.userData.strength * share;
    viewer.set_dirty();
  }
})(0);
at("play").onclick = () => playing ? rest() : play();
rest();

// Keys, and a click on a number.
addEventListener("keydown", key => {
  if (/^(INPUT|SELECT|BUTTON|SUMMARY)$/.test(key.target.tagName) || key.ctrlKey || key.metaKey || key.altKey) return;
  const views = Object.keys(FROM), now = chosen();
  if (["ArrowRight", "PageDown"].includes(key.key) && now < steps.length) choose(now + 1);
  else if (["ArrowLeft", "PageUp"].includes(key.key) && now > Number(slider.min)) choose(now - 1);
  else if (key.key === " " && !at("play").hidden) at("play").click();
  else if (views[key.key - 1]) { at("from").value = views[key.key - 1]; at("from").onchange(); }
  else return;
  key.preventDefault();
});
const ray = new THREE.Raycaster();
let pressed = null;
at("view").addEventListener("pointerdown", e => { pressed = [e.clientX, e.clientY]; });
at("view").addEventListener("pointerup", e => {
  if (!pressed || Math.hypot(e.clientX - pressed[0], e.clientY - pressed[1]) > 4) return;
  ray.setFromCamera({x: 2 * e.clientX / innerWidth - 1, y: 1 - 2 * e.clientY / innerHeight}, camera());
  const [hit] = ray.intersectObjects(numbers.filter(n => n.visible && n.parent.visible));
  if (hit) choose(hit.object.userData.step);
});
fitWords();
show();

if (scene.watch) {
  let known = null;
  setInterval(async () => {
    try {
      const now = await (await fetch(scene.watch)).text();
      if (known !== null && now !== known) location.reload();
      known = now;
    } catch (gone) { document.title = "qsf show has stopped"; }
  }, 1500);
}
