// The page with one image: controls, the image as it is refined, and what the state line says.

import { Link, byId, count, download, duration, showProblem, themeButton } from "./link.js";
import { Orbit } from "./orbit.js";
import { PartForm } from "./part.js";
import { Hand } from "./hand.js";

const canvas = byId("canvas");
const context = canvas.getContext("2d", { alpha: false });
const page = { state: "idle", part: null, opened: null, frames: 0, hand: null };
window.raybench = page; // for whoever looks at the page from outside, tests among them

const link = new Link("view", {
  menu, opened, scene, frame, state, probe, grabbed: (header) => page.hand.grabbed(header),
  problem: (header) => showProblem(header.text),
  lost: (header) => { page.opened = null; showProblem(header.text); },
  note: (header) => { const item = document.createElement("li"); item.textContent = header.text; byId("notes").append(item); },
  file: (header, bytes) => { page.saved = { name: header.name, size: bytes.byteLength, bytes }; download(header.name, bytes, "application/octet-stream"); },
  yaml: copyText,
  closed: () => state({ state: "stopped", doing: "no connection" }),
});

// ---- what the worker tells

function menu(header) {
  const first = page.part === null;
  if (!first) return; // a worker after one that was lost: the page keeps what was chosen
  page.menu = header;
  page.part = new PartForm(byId("part"), header, "Renderer", document.body.dataset.engine || header.preferred);
  byId("scenes").append(...header.scenes.map((name) => new Option(name)));
  byId("mapper").append(...header.tone_mappers.map((name) => new Option(name, name, false, name === "srgb")));
  byId("scene").value = document.body.dataset.scene;
  byId("wanted").max = header.limits.spp;
  for (const side of ["width", "height"]) byId(side).max = header.limits.side;
  open(false);
}

function opened(header) {
  page.opened = header;
  canvas.width = header.width;
  canvas.height = header.height;
  byId("picture").style.setProperty("--aspect", header.width / header.height);
  document.title = `${header.name} – raybench view`;
  canvas.setAttribute("aria-label", `${header.name}, ${header.width} by ${header.height} pixels`);
}

function scene(header) {
  page.hand.scene(header.camera ? new Orbit(header.camera) : null, header.movables);
}

let small = null;

function frame(header, bytes) {
  const image = new ImageData(new Uint8ClampedArray(bytes), header.width, header.height);
  if (header.width === canvas.width && header.height === canvas.height) {
    context.putImageData(image, 0, 0);
  } else {
    small ??= document.createElement("canvas");
    small.width = header.width;
    small.height = header.height;
    small.getContext("2d").putImageData(image, 0, 0);
    context.imageSmoothingQuality = "high";
    context.drawImage(small, 0, 0, canvas.width, canvas.height);
  }
  page.frames += 1;
  page.frame = { ...header, time: performance.now() };
  page.hand.handles(header.handles);
  link.send({ do: "ack" });
}

const WORDS = { idle: "idle", busy: "busy", finished: "finished", stopped: "stopped", waiting: "waiting" };

function state(header) {
  page.state = header.state;
  page.told = header;
  if (byId("state").textContent !== WORDS[header.state]) byId("state").textContent = WORDS[header.state];
  byId("doing").textContent = header.doing;
  const resting = !["busy", "waiting"].includes(header.state);
  byId("stop").disabled = resting;
  byId("start").disabled = !resting;
  byId("restart").disabled = page.opened === null;
  byId("start").textContent = header.state === "stopped" && page.opened ? "Go on" : "Start";
  if (header.memory_bytes === undefined) return;
  const done = header.spp ?? 0;
  if (page.probe && done < page.probe.spp) { // of an image that is no more
    page.probe = null;
    byId("probe").textContent = UNPROBED;
  }
  byId("spp").textContent = header.spp === undefined ? "–" : `${done} of ${header.wanted}`;
  byId("progress").value = header.wanted ? done / header.wanted : 0;
  byId("seconds").textContent = duration(header.seconds);
  byId("samples").textContent = count(header.samples_per_second);
  byId("rays").textContent = count(header.rays_per_second);
  byId("build").textContent = duration(header.build_seconds);
  byId("compile").textContent = duration(header.compile_seconds);
  byId("memory").textContent = count(header.memory_bytes, "B");
}

const UNPROBED = byId("probe").textContent;

function probe(header) {
  page.probe = header;
  const words = (values) => values.map((value) => (value === null ? "?" : Number(value).toPrecision(3))).join(" ");
  const share = header.mean.reduce((a, b) => a + b, 0);
  const error = header.error.reduce((a, b) => a + (b ?? NaN), 0);
  const relative = share > 0 && error === error ? ` (${((100 * error) / share).toPrecision(2)} %)` : "";
  byId("probe").textContent =
    `(${header.x}, ${header.y}) after ${header.spp} samples: ${words(header.mean)} | variance of the mean ${words(header.variance)}` +
    ` | standard error ${words(header.error)}${relative}`;
}

async function copyText(header) {
  page.yaml = header.text;
  try {
    await navigator.clipboard.writeText(header.text);
    byId("copy-yaml").textContent = "Copied";
  } catch {
    download("scene.yaml", header.text, "text/yaml"); // no permission for the clipboard
    byId("copy-yaml").textContent = "Saved as a file";
  }
  setTimeout(() => { byId("copy-yaml").textContent = "Copy scene as YAML"; }, 2000);
}

// ---- what the page asks for

function number(id) {
  return byId(id).value === "" ? null : Number(byId(id).value);
}

function open(keep) {
  if (page.part === null) return;
  showProblem(null);
  byId("notes").replaceChildren();
  try {
    const request = { do: "open", scene: byId("scene").value.trim(), part: page.part.value(), keep };
    request.width = number("width");
    request.height = number("height");
    request.spp = number("wanted") ?? 256;
    request.seed = number("seed") ?? 1;
    link.send(request);
  } catch (error) {
    showProblem(error.message);
  }
}

function start() {
  showProblem(null);
  if (page.state === "stopped" && page.opened) link.send({ do: "resume" });
  else open(true);
}

function tone() {
  const exposure = Number(byId("exposure").value);
  byId("exposure-told").textContent = `${exposure > 0 ? "+" : ""}${exposure} EV`;
  link.send({ do: "tone", mapper: byId("mapper").value, exposure });
}

function toggle() {
  if (["busy", "waiting"].includes(page.state)) link.send({ do: "stop" });
  else start();
}

page.hand = new Hand(canvas, byId("handles"), byId("moves"), link, toggle);
themeButton();
byId("start").addEventListener("click", start);
byId("stop").addEventListener("click", () => link.send({ do: "stop" }));
byId("restart").addEventListener("click", () => open(true));
byId("reset").addEventListener("click", () => open(false));
for (const kind of ["png", "exr"]) byId(`save-${kind}`).addEventListener("click", () => link.send({ do: "save", kind }));
byId("copy-yaml").addEventListener("click", () => link.send({ do: "yaml" }));
for (const id of ["mapper", "exposure"]) byId(id).addEventListener("input", tone);
byId("form").addEventListener("change", (event) => {
  if (!["mapper", "exposure", "moves"].includes(event.target.id)) open(event.target.id !== "scene");
});
byId("form").addEventListener("submit", (event) => { event.preventDefault(); open(true); });
addEventListener("pagehide", () => { link.leaving = true; link.socket.close(); });
