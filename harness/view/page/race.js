// The page with a race: lanes, their pictures and error maps, and one plot of error over time.

import { Link, byId, count, duration, showProblem, themeButton } from "./link.js";
import { PartForm } from "./part.js";
import { drawPlot, markName } from "./plot.js";

const FEWEST = 2;
const MOST = 4;
const DEFAULTS = [["embree", {}], ["numba", {}], ["embree", { sampler: { name: "random" } }], ["numpy", {}]];
const page = { parts: [], lanes: [], targets: [], state: "idle", references: [] };
window.raybench = page;

const link = new Link("race", {
  menu, lanes, reference, lane, state, saved,
  problem: (header) => showProblem(header.text),
  lost: (header) => showProblem(header.text),
  note: (header) => { const item = document.createElement("li"); item.textContent = header.text; byId("notes").append(item); },
  progress,
  closed: () => state({ state: "stopped", doing: "no connection" }),
});

// ---- what the worker tells

function menu(header) {
  if (page.menu) return;
  page.menu = header;
  byId("scenes").append(...header.scenes.map((name) => new Option(name)));
  byId("scene").value = document.body.dataset.scene || "cornell_box";
  const able = header.engines.filter((engine) => !engine.lacks).map((engine) => engine.name);
  byId("reference-engine").append(...able.map((name) => new Option(name, name, false, name === (document.body.dataset.engine || header.preferred))));
  addLane();
  addLane();
  byId("start").disabled = false;
}

function lanes(header) {
  page.targets = header.targets;
  page.size = { width: header.width, height: header.height };
  page.references = [];
  page.lanes = header.names.map((name, index) => laneBox(name, index));
  byId("lanes").replaceChildren(...page.lanes.map((made) => made.box));
  byId("plot").replaceChildren();
  byId("settings").open = false;
}

function laneBox(name, index) {
  const box = document.createElement("article");
  box.className = "lane";
  box.style.setProperty("--colour", `var(--lane-${index + 1})`);
  const heading = document.createElement("h3");
  heading.textContent = `${index + 1} ${name} (${markName(index)})`;
  const images = document.createElement("div");
  images.className = "images";
  const [image, imageBox] = picture("image", name);
  const [error, errorBox] = picture("error", name);
  images.append(imageBox, errorBox);
  const told = document.createElement("ul");
  box.append(heading, images, told);
  return { box, name, image, error, told, points: [], crossings: [] };
}

function picture(what, name) {
  const figure = document.createElement("figure");
  const canvas = document.createElement("canvas");
  Object.assign(canvas, page.size);
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", what === "image" ? `Image of ${name}` : `Error map of ${name}`);
  const caption = document.createElement("figcaption");
  caption.textContent = what;
  figure.append(canvas, caption);
  return [canvas, figure];
}

function radianceOf(bytes) {
  const halves = new Uint16Array(bytes);
  return Float32Array.from(halves, (bits) => HALF_VALUES[bits]);
}

function reference(header, bytes) {
  const radiance = radianceOf(bytes);
  page.maps = header.maps;
  page.epsilon = header.epsilon;
  for (const index of header.lanes) page.references[index] = radiance;
  writeScale();
}

function lane(header, bytes) {
  const lane = page.lanes[header.lane];
  Object.assign(lane, header, { frames: (lane.frames ?? 0) + 1 });
  const radiance = radianceOf(bytes);
  paint(lane.image, "radiance", radiance, null);
  paint(lane.error, "error", radiance, page.references[header.lane]);
  lane.told.replaceChildren(...laneWords(lane));
  page.lanes.forEach((other) => other.box.classList.toggle("running", other === lane && !lane.done));
  drawPlot(byId("plot"), page.lanes, page.targets);
}

function paint(canvas, view, radiance, other) {
  const context = canvas.getContext("2d");
  const image = context.createImageData(canvas.width, canvas.height);
  for (let i = 0, o = 0; i < radiance.length; i += 3, o += 4) {
    const [red, green, blue] = viewPixel(view, radiance, other, i, 1, page.epsilon, page.maps);
    image.data[o] = red;
    image.data[o + 1] = green;
    image.data[o + 2] = blue;
    image.data[o + 3] = 255;
  }
  context.putImageData(image, 0, 0);
}

function laneWords(lane) {
  const last = lane.points.at(-1);
  const words = [
    `${duration(lane.seconds)} of rendering, ${lane.spp} samples a pixel`,
    last ? `error ${last[1] === null ? "unknown" : last[1].toPrecision(3)} at ${last[2]} samples` : "no checkpoint yet",
    `build ${duration(lane.phases.build)}, compile ${duration(lane.phases.compile)}, ${count(lane.rays)} rays`,
  ];
  const items = words.map((text) => { const item = document.createElement("li"); item.textContent = text; return item; });
  for (const crossing of lane.crossings) {
    const item = document.createElement("li");
    const reached = crossing.state === "reached" || crossing.state === "at_first";
    item.className = reached ? "reached" : "";
    const time = `${crossing.state === "at_first" ? "at most " : ""}${duration(crossing.seconds)}`;
    item.textContent = reached ? `✓ target ${crossing.target} in ${time}` : `target ${crossing.target}: ${lane.done ? "not reached" : "open"}`;
    items.push(item);
  }
  return items;
}

function writeScale() {
  const [map, words] = scaleWords("error", 1);
  const bar = document.createElement("i");
  bar.style.background = `linear-gradient(to right, ${page.maps[map].map((c) => `rgb(${c})`).join(",")})`;
  byId("scale").replaceChildren(bar, `Error maps: ${words.replace("ε", `${page.epsilon}`)}`);
}

function progress(header) {
  const bar = byId("progress");
  bar.hidden = header.done >= header.wanted;
  bar.value = header.done / header.wanted;
  byId("doing").textContent = `${header.text}, ${header.done} of ${header.wanted} images`;
}

function state(header) {
  page.state = header.state;
  if (byId("state").textContent !== header.state) byId("state").textContent = header.state;
  byId("doing").textContent = header.doing;
  const resting = !["busy", "waiting"].includes(header.state);
  byId("stop").disabled = resting;
  byId("start").disabled = !resting;
  byId("save").disabled = !resting || !page.lanes.some((lane) => lane.points.length);
  if (resting) byId("progress").hidden = true;
  if (resting) page.lanes.forEach((lane) => lane.box.classList.remove("running"));
}

function saved(header) {
  page.saved = header;
  const link = document.createElement("a");
  link.href = `reports/${header.name}/report.html`;
  link.target = "_blank";
  link.rel = "noopener";
  link.textContent = "open its report";
  byId("saved").replaceChildren(`Saved in ${header.folder}: `, link, `, or raybench report ${header.folder}.`);
}

// ---- what the page asks for

function addLane() {
  if (page.parts.length >= MOST) return;
  const place = document.createElement("div");
  byId("parts").append(place);
  const [engine, given] = DEFAULTS[page.parts.length];
  const known = page.menu.engines.some((one) => one.name === engine && !one.lacks);
  const first = page.parts.length === 0 && document.body.dataset.engine;
  const form = new PartForm(place, page.menu, `Lane ${page.parts.length + 1}`, first || (known ? engine : page.menu.preferred));
  Object.assign(form.given, given);
  form.offer();
  page.parts.push(form);
  writeButtons();
}

function removeLane() {
  if (page.parts.length <= FEWEST) return;
  page.parts.pop().place.remove();
  writeButtons();
}

function writeButtons() {
  byId("add").disabled = page.parts.length >= MOST;
  byId("remove").disabled = page.parts.length <= FEWEST;
}

function start() {
  showProblem(null);
  byId("saved").replaceChildren();
  byId("notes").replaceChildren();
  const value = (id) => Number(byId(id).value);
  try {
    const targets = byId("targets").value.split(/[\s,;]+/).filter(Boolean).map(Number);
    if (!targets.length || !targets.every((target) => target > 0)) throw new Error("targets: errors above zero are wanted, such as 0.1 0.01");
    link.send({
      do: "race", scene: byId("scene").value.trim(), lanes: page.parts.map((part) => part.value()), targets,
      width: value("width"), height: value("height"), reference_spp: value("reference-spp"),
      reference_engine: byId("reference-engine").value,
      max_seconds: value("max-seconds"), slice_seconds: value("slice"),
    });
  } catch (error) {
    showProblem(error.message);
  }
}

themeButton();
new ResizeObserver(() => { if (page.lanes.length) drawPlot(byId("plot"), page.lanes, page.targets); }).observe(byId("lanes"));
byId("add").addEventListener("click", addLane);
byId("remove").addEventListener("click", removeLane);
byId("start").addEventListener("click", start);
byId("stop").addEventListener("click", () => link.send({ do: "stop" }));
byId("save").addEventListener("click", () => { showProblem(null); link.send({ do: "save", name: byId("name").value.trim() }); });
byId("form").addEventListener("submit", (event) => event.preventDefault());
addEventListener("pagehide", () => { link.leaving = true; link.socket.close(); });
