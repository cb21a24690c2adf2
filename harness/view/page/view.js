// The page with one image: controls, the image while it is refined, and the state.

import { WorkerSocket, byId, count, download, duration, showError, themeButton } from "./socket.js";
import { Orbit } from "./orbit.js";
import { SettingsForm } from "./settings_form.js";
import { ImageInput } from "./input.js";

const canvas = byId("canvas");
const context = canvas.getContext("2d", { alpha: false });
const page = { state: "idle", settingsForm: null, opened: null, frames: 0, input: null };
window.raybench = page; // for tests and other scripts

const socket = new WorkerSocket("view", {
  menu, opened, scene, frame, state, probe, picked: (header) => page.input.picked(header),
  error: (header) => showError(header.text),
  worker_lost: (header) => { page.opened = null; showError(header.text); },
  warning: (header) => { const item = document.createElement("li"); item.textContent = header.text; byId("warnings").append(item); },
  file: (header, bytes) => { page.saved = { name: header.name, size: bytes.byteLength, bytes }; download(header.name, bytes, "application/octet-stream"); },
  yaml: copyText,
  closed: () => state({ state: "stopped", activity: "no connection" }),
});

// ---- messages of the worker

function menu(header) {
  const first = page.settingsForm === null;
  if (!first) return; // a new worker after a lost one: the page keeps its settings
  page.menu = header;
  page.settingsForm = new SettingsForm(byId("render-settings"), header, "Renderer", document.body.dataset.engine || header.preferred);
  byId("scenes").append(...header.scenes.map((name) => new Option(name)));
  byId("mapper").append(...header.tone_mappers.map((name) => new Option(name, name, false, name === "srgb")));
  byId("scene").value = document.body.dataset.scene;
  byId("target-spp").max = header.limits.spp;
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
  page.input.scene(header.camera ? new Orbit(header.camera) : null, header.draggables);
}

let preview = null;

function frame(header, bytes) {
  const image = new ImageData(new Uint8ClampedArray(bytes), header.width, header.height);
  if (header.width === canvas.width && header.height === canvas.height) {
    context.putImageData(image, 0, 0);
  } else {
    preview ??= document.createElement("canvas");
    preview.width = header.width;
    preview.height = header.height;
    preview.getContext("2d").putImageData(image, 0, 0);
    context.imageSmoothingQuality = "high";
    context.drawImage(preview, 0, 0, canvas.width, canvas.height);
  }
  page.frames += 1;
  page.frame = { ...header, time: performance.now() };
  page.input.showHandles(header.handles);
  socket.send({ type: "ack" });
}

function state(header) {
  page.state = header.state;
  page.status = header;
  if (byId("state").textContent !== header.state) byId("state").textContent = header.state;
  byId("activity").textContent = header.activity;
  const resting = !["busy", "waiting"].includes(header.state);
  byId("stop").disabled = resting;
  byId("start").disabled = !resting;
  byId("restart").disabled = page.opened === null;
  byId("start").textContent = header.state === "stopped" && page.opened ? "Continue" : "Start";
  if (header.memory_bytes === undefined) return;
  const done = header.spp ?? 0;
  if (page.probe && done < page.probe.spp) { // the probed image was replaced
    page.probe = null;
    byId("probe").textContent = UNPROBED;
  }
  byId("spp").textContent = header.spp === undefined ? "–" : `${done} of ${header.target_spp}`;
  byId("progress").value = header.target_spp ? done / header.target_spp : 0;
  byId("seconds").textContent = duration(header.render_seconds);
  byId("samples").textContent = count(header.samples_per_second);
  byId("rays").textContent = count(header.rays_per_second);
  byId("build").textContent = duration(header.build_seconds);
  byId("compile").textContent = duration(header.compile_seconds);
  byId("memory").textContent = count(header.memory_bytes, "B");
}

const UNPROBED = byId("probe").textContent;

function probe(header) {
  page.probe = header;
  const text = (values) => values.map((value) => (value === null ? "?" : Number(value).toPrecision(3))).join(" ");
  const total = header.mean.reduce((a, b) => a + b, 0);
  const error = header.error.reduce((a, b) => a + (b ?? NaN), 0);
  const relative = total > 0 && error === error ? ` (${((100 * error) / total).toPrecision(2)} %)` : "";
  byId("probe").textContent =
    `(${header.x}, ${header.y}) after ${header.spp} samples: ${text(header.mean)} | variance of the mean ${text(header.variance)}` +
    ` | standard error ${text(header.error)}${relative}`;
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

// ---- requests of the page

function number(id) {
  return byId(id).value === "" ? null : Number(byId(id).value);
}

function open(keepEdits) {
  if (page.settingsForm === null) return;
  showError(null);
  byId("warnings").replaceChildren();
  try {
    const request = { type: "open", scene: byId("scene").value.trim(), settings: page.settingsForm.value(), keep_edits: keepEdits };
    request.width = number("width");
    request.height = number("height");
    request.spp = number("target-spp") ?? 256;
    request.seed = number("seed") ?? 1;
    socket.send(request);
  } catch (error) {
    showError(error.message);
  }
}

function start() {
  showError(null);
  if (page.state === "stopped" && page.opened) socket.send({ type: "resume" });
  else open(true);
}

function tone() {
  const exposure = Number(byId("exposure").value);
  byId("exposure-value").textContent = `${exposure > 0 ? "+" : ""}${exposure} EV`;
  socket.send({ type: "tone", mapper: byId("mapper").value, exposure });
}

function toggle() {
  if (["busy", "waiting"].includes(page.state)) socket.send({ type: "stop" });
  else start();
}

page.input = new ImageInput(canvas, byId("handles"), byId("moves"), socket, toggle);
themeButton();
byId("start").addEventListener("click", start);
byId("stop").addEventListener("click", () => socket.send({ type: "stop" }));
byId("restart").addEventListener("click", () => open(true));
byId("reset").addEventListener("click", () => open(false));
for (const kind of ["png", "exr"]) byId(`save-${kind}`).addEventListener("click", () => socket.send({ type: "save", kind }));
byId("copy-yaml").addEventListener("click", () => socket.send({ type: "yaml" }));
for (const id of ["mapper", "exposure"]) byId(id).addEventListener("input", tone);
byId("form").addEventListener("change", (event) => {
  if (!["mapper", "exposure", "moves"].includes(event.target.id)) open(event.target.id !== "scene");
});
byId("form").addEventListener("submit", (event) => { event.preventDefault(); open(true); });
addEventListener("pagehide", () => { socket.close(); });
