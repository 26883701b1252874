// Plots are drawn when they are first to be seen, for a plot in a closed part of the page has no width.
const every = (what, do_) => document.querySelectorAll(what).forEach(do_);
const plain = text => new DOMParser().parseFromString(text, "text/html").documentElement.textContent;
const tied = new Set([...document.querySelectorAll("iframe[data-page]")].flatMap(f => JSON.parse(f.dataset.poses)));
const dark = matchMedia("(prefers-color-scheme: dark)"), PAPER = 684;
// A plot as the page stands: light or dark, of the width that a plot has on paper, never higher than a sheet.
function content(div, paper) {
  const {data, layout} = JSON.parse(document.getElementById(div.id + "-data").textContent);
  delete layout.title;  // the page has it above, where it breaks and is read aloud
  const width = paper ? (div.closest(".wide, .picture:only-child") ? PAPER : PAPER / 2 - 8) : div.clientWidth;
  if (width < 480) for (const axis in layout) if (/^[xy]axis/.test(axis)) layout[axis].nticks = 6;
  if (paper) Object.assign(layout, {width, height: Math.min(900, width < PAPER ? 0.85 * layout.height : layout.height)});
  const look = layout.template.layout;
  if (paper) look.font.size = look.xaxis.title.font.size = look.yaxis.title.font.size = 10;
  for (const note of layout.annotations || []) if (paper && note.font) note.font.size = 10;
  if (dark.matches && !paper) {
    look.font.color = "#e4e7ea";
    for (const axis of [look.xaxis, look.yaxis]) Object.assign(axis, {gridcolor: "#353c43", zerolinecolor: "#59626b"});
    for (const trace of data) for (const part of [trace.marker, trace.line]) if (part && part.color === "#000000") part.color = "#fff";
  }
  return [data, layout];
}
function draw(div) {
  if (!div.checkVisibility()) return;
  if (div.dataset.drawn) { Plotly.Plots.resize(div); return; }
  div.dataset.drawn = "yes";
  Plotly.newPlot(div, ...content(div), {displaylogo: false, responsive: true});
  const named = () => {
    div.querySelectorAll(".modebar-btn").forEach(button => button.tabIndex = -1);
    div.querySelectorAll("svg").forEach(svg => svg.setAttribute("aria-hidden", "true"));
    const first = div.querySelector("svg.main-svg"), title = div.closest(".picture").querySelector("h3");
    first.removeAttribute("aria-hidden");
    first.setAttribute("role", "img");
    first.setAttribute("aria-label", title ? title.textContent : "plot");
  };
  named();
  div.on("plotly_afterplot", named);
  div.on("plotly_click", at => {
    const pose = plain(String(at.points[0].customdata));
    if (tied.has(pose)) choose(pose);
  });
}
const drawAll = () => every(".plotly-graph-div", draw);
const redraw = paper => every(".plotly-graph-div[data-drawn]", div => {
  const [data, layout] = content(div, paper);
  div.style.height = layout.height + "px";
  Plotly.react(div, data, layout);
});
addEventListener("toggle", drawAll, true);
dark.addEventListener("change", () => redraw(false));
every("#unfold", button => button.onclick = () => every("details", part => part.open = true));
drawAll();

// A link to a folded part opens it.
function unfold() {
  const part = location.hash && document.getElementById(location.hash.slice(1));
  const folded = part && part.querySelector("details.evidence");
  if (folded) { folded.open = true; part.scrollIntoView(); }
}
addEventListener("hashchange", unfold);
unfold();

// Scenes stand packed in the page. Their canvas keeps what was drawn, so that it can be copied for the printer.
const KEEP = `<script>{
  const get = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return get.call(this, kind, {...options, preserveDrawingBuffer: true});
  };
}<\/script>`;
every("iframe[data-page]", async frame => {
  const bytes = Uint8Array.from(atob(frame.dataset.page), c => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const page = await new Response(stream).text();
  frame.addEventListener("load", () => tie(frame));
  frame.srcdoc = page.replace("<head>", "<head>" + KEEP);
});

// One pose is chosen in the whole page: in its scenes, its tables and its plots.
const posesOf = frame => JSON.parse(frame.dataset.poses);
const sliderOf = frame => frame.contentDocument && frame.contentDocument.getElementById("step");
function tie(frame) {
  const slider = sliderOf(frame), poses = posesOf(frame);
  if (!slider || !poses.length) return;
  slider.addEventListener("input", move => move.isTrusted && choose(poses[slider.value - 1], frame));
}
function choose(pose, from) {
  every("tr[data-pose]", row => row.classList.toggle("chosen", row.dataset.pose === pose));
  every("iframe[data-page]", frame => {
    const step = posesOf(frame).indexOf(pose) + 1, slider = sliderOf(frame);
    if (frame === from || !step || !slider) return;
    slider.value = step;
    slider.dispatchEvent(new Event("input"));
  });
  every(".plotly-graph-div[data-drawn]", div => {
    const at = div.data.map(trace => {
      if (!trace.customdata) return null;
      const points = [...trace.customdata].flatMap((p, i) => plain(String(p)) === pose ? [i] : []);
      return points.length ? points : null;
    });
    if (at.some(Boolean)) Plotly.restyle(div, {selectedpoints: at});
  });
  document.body.dataset.pose = pose;
}
every("tr[data-pose]", row => {
  if (!tied.has(row.dataset.pose)) return;
  row.classList.add("tied");
  row.title = "shows this pose in 3D";
  row.onclick = () => choose(row.dataset.pose);
});

// On paper plots are as wide as the paper, and scenes are pictures of what they show now.
addEventListener("beforeprint", () => {
  redraw(true);
  every("iframe[data-page]", frame => {
    const seen = frame.contentDocument && frame.contentDocument.querySelector("canvas");
    if (dark.matches && seen) frame.contentWindow.ground(false);
    const paper = frame.parentElement.querySelector("canvas");
    if (!seen || !seen.width) return;
    paper.width = seen.width;
    paper.height = seen.height;
    paper.getContext("2d").drawImage(seen, 0, 0);
  });
});
addEventListener("afterprint", () => redraw(false));
