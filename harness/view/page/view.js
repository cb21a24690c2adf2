// The page with one image: controls, the image while it is refined, and the state.

import { WorkerSocket, byId, count, download, duration, element, invalidEntry, showError, showState } from "./socket.js";
import { drawHistogram, drawNote } from "./histogram.js";
import { Orbit } from "./orbit.js";
import { SettingsForm } from "./settings_form.js";
import { ImageInput } from "./input.js";
import { Preparation } from "./preparation.js";
import { readAddress, writeAddress } from "./url_settings.js";

const canvas = byId("canvas");
const context = canvas.getContext("2d", { alpha: false });
const page = { state: "idle", settingsForm: null, opened: null, frames: 0, input: null, pixels: null };
const given = readAddress();
const preparation = new Preparation(canvas, byId("busy"));
window.raybench = page; // for tests and other scripts

const socket = new WorkerSocket("view", {
  menu, opened, scene, frame, state, probe, reference, picked: (header) => page.input.picked(header),
  error: (header) => { settled(); showError(header.text); },
  worker_lost: (header) => { page.opened = null; settled(); showError(header.text); },
  file: (header, bytes) => { page.saved = { name: header.name, size: bytes.byteLength, bytes }; download(header.name, bytes, "application/octet-stream"); },
  yaml: copyText,
  closed: settled,
});

// ---- messages of the worker

function menu(header) {
  const first = page.settingsForm === null;
  if (!first) return replaced(); // the page keeps its settings
  page.menu = header;
  const able = (name) => header.engines.some((engine) => engine.name === name && !engine.problem);
  const wanted = [given.settings.engine, document.body.dataset.engine].filter(Boolean);
  const engine = wanted.find(able) ?? header.preferred;
  page.settingsForm = new SettingsForm(byId("render-settings"), header, "Renderer", engine, given.settings);
  page.settingsForm.more.open = false;
  if (wanted.length && wanted[0] !== engine) page.settingsForm.announce(`${wanted[0]} is not available: ${engine} is used.`);
  byId("scenes").append(...header.scenes.map((name) => new Option(name)));
  byId("mapper").append(...header.tone_mappers.map((name) => new Option(name, name, false, name === "srgb")));
  byId("scene").value = document.body.dataset.scene;
  byId("target-spp").max = header.limits.spp;
  for (const side of ["width", "height"]) byId(side).max = header.limits.side;
  for (const [key, id] of Object.entries(FIELDS)) if (key in given.fields) byId(id).value = given.fields[key];
  if ("exposure" in given.fields || "mapper" in given.fields) tone();
  open(false);
}

// A new worker, after one that was lost, knows neither the reference nor how the image is displayed.
function replaced() {
  if (page.reference?.name) {
    page.reference = null;
    byId("show").value = "image";
    byId("reference-state").textContent = "None: the reference was lost with its worker process.";
  }
  tone();
}

const FIELDS = { scene: "scene", width: "width", height: "height", spp: "target-spp", seed: "seed", mapper: "mapper", exposure: "exposure" };

function remember() {
  if (page.settingsForm === null) return;
  const fields = Object.fromEntries(Object.entries(FIELDS).map(([key, id]) => [key, byId(id).value]));
  try {
    writeAddress(fields, page.settingsForm.value(), page.input.moved ? page.input.orbit : null);
  } catch {
    // an option that cannot be read: the address keeps its last settings
  }
}

// The new image has come, or an error in its place.
function settled() {
  page.expecting = false;
  preparation.end();
}

function opened(header) {
  page.expecting = false;
  page.opened = header;
  if (canvas.width !== header.width || canvas.height !== header.height) Object.assign(canvas, { width: header.width, height: header.height });
  byId("picture").style.setProperty("--aspect", header.width / header.height);
  document.title = `${header.name} – raybench view`;
  canvas.setAttribute("aria-label", `${header.name}, ${header.width} by ${header.height} pixels`);
}

function scene(header) {
  page.input.scene(header.camera ? new Orbit(header.camera) : null, header.draggables);
  if (given.camera && page.input.orbit) {
    const { height, ...pose } = given.camera;
    Object.assign(page.input.orbit, pose, page.input.orbit.height && height ? { height } : {});
    page.input.moveCamera(() => {});
  }
  given.camera = null;
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
  if (!page.expecting) preparation.end(); // frames of the old image may still arrive
  page.pixels = header.error === undefined ? bytes : null;
  showHistogram();
  byId("scale").hidden = header.error === undefined;
  if (header.error !== undefined) writeScale(header);
  page.frames += 1;
  page.frame = { ...header, time: performance.now() };
  page.input.showHandles(header.handles);
  socket.send({ type: "ack" });
}

function state(header) {
  page.state = header.state;
  page.status = header;
  showState(header);
  preparation.state(header, page.menu?.first_compile[page.settingsForm?.engine.value]);
  byId("restart").disabled = page.opened === null;
  byId("start").textContent = header.state === "stopped" && page.opened ? "Continue" : "Start";
  if (header.memory_bytes === undefined) return;
  const done = header.spp ?? 0;
  if (page.probe && done < page.probe.spp) { // the probed image was replaced
    page.probe = null;
    byId("probe").hidden = true;
  }
  byId("spp").textContent = header.spp === undefined ? "–" : `${done} of ${header.target_spp}`;
  byId("progress").value = header.target_spp ? done / header.target_spp : 0;
  byId("seconds").textContent = duration(header.render_seconds || null);
  byId("samples").textContent = count(header.samples_per_second);
  byId("rays").textContent = count(header.rays_per_second);
  byId("build").textContent = duration(header.build_seconds);
  byId("compile").textContent = duration(header.compile_seconds);
  byId("memory").textContent = count(header.memory_bytes, "B");
}

function probe(header) {
  page.probe = header;
  const text = (values) => values.map(shortNumber).join(" ");
  const total = header.mean.reduce((a, b) => a + b, 0);
  const error = header.error.reduce((a, b) => a + (b ?? NaN), 0);
  const relative = total > 0 && error === error ? `\nrelative       ${shortNumber((100 * error) / total)} %` : "";
  byId("probe").hidden = false;
  const low = header.y > canvas.height / 2;
  byId("probe").classList.toggle("top", low);
  byId("histogram").classList.toggle("bottom", low); // never over the probe
  byId("probe").textContent =
    `(${header.x}, ${header.y}), ${header.spp} samples\nmean           ${text(header.mean)}\n` +
    `var. of mean   ${text(header.variance)}\nstandard error ${text(header.error)}${relative}`;
}

// Three digits; small and large numbers with an exponent.
function shortNumber(value) {
  if (value === null) return "?";
  const plain = value === 0 || (Math.abs(value) >= 0.001 && Math.abs(value) < 1000);
  return plain ? value.toPrecision(3) : value.toExponential(2);
}

function reference(header) {
  page.reference = header;
  const dropped = `None: the reference was dropped, for ${header.why}.`;
  byId("reference-state").textContent = header.name ? `Reference: ${header.name}.` : dropped;
  if (!header.name) showError("The error map ended: the reference shows another view. Keep an image of this view.");
  if (header.name) byId("show").value = "error";
  else byId("show").value = "image";
  tone();
}

function writeScale(header) {
  byId("scale").replaceChildren(element("i"),
    `relative squared error, 1e-5 to 1, logarithmic; mean (relMSE, ε = ${header.epsilon}) ${header.error.toPrecision(3)}, ` +
    `the noise of the reference included`);
}

function showHistogram() {
  if (byId("histogram").hidden) return;
  if (byId("show").value === "error") drawNote(byId("histogram"), "error map: no histogram");
  else if (page.pixels) page.shares = drawHistogram(byId("histogram"), new Uint8ClampedArray(page.pixels));
}

function toggleHistogram() {
  const box = byId("histogram");
  box.hidden = !box.hidden;
  byId("toggle-histogram").setAttribute("aria-pressed", String(!box.hidden));
  showHistogram();
}

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else byId("viewport").requestFullscreen().catch((error) => showError(`full screen: ${error.message}`));
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
  const problem = invalidEntry(byId("form"));
  showError(problem && (page.opened ? `${problem} The image is still that of the last valid settings.` : problem));
  if (problem) return;
  byId("warnings").replaceChildren();
  if (!keepEdits) page.input.moved = false;
  try {
    const request = { type: "open", scene: byId("scene").value.trim(), settings: page.settingsForm.value(), keep_edits: keepEdits };
    request.width = number("width");
    request.height = number("height");
    request.spp = number("target-spp") ?? 256;
    request.seed = number("seed") ?? 1;
    preparation.begin();
    page.expecting = true;
    socket.send(request);
    remember();
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
  socket.send({ type: "tone", mapper: byId("mapper").value, exposure, show: byId("show").value });
  remember();
}

// The error map needs a reference: without one the page says how to get one.
function chooseView(name) {
  if (name === "error" && !page.reference?.name) {
    byId("show").value = "image";
    showError("The error map needs a reference: let an image get many samples and keep it, or name an EXR file, under Reference of the error map.");
    return;
  }
  showError(null);
  byId("show").value = name;
  tone();
}

function toggle() {
  if (["busy", "waiting"].includes(page.state)) socket.send({ type: "stop" });
  else start();
}

function shortcut(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select, textarea, dialog")) return;
  const exposure = byId("exposure");
  const step = (sign) => () => { exposure.value = Number(exposure.value) + sign * Number(exposure.step); tone(); };
  const act = {
    "?": () => byId("keys").showModal(), h: toggleHistogram, f: fullScreen, "[": step(-1), "]": step(1),
    e: () => chooseView(byId("show").value === "error" ? "image" : "error"),
  }[event.key];
  if (!act) return;
  act();
  event.preventDefault();
}

page.input = new ImageInput(canvas, byId("handles"), byId("moves"), socket, toggle, remember);
document.addEventListener("keydown", shortcut);
byId("start").addEventListener("click", start);
byId("restart").addEventListener("click", () => open(true));
byId("reset").addEventListener("click", () => open(false));
for (const kind of ["png", "exr"]) byId(`save-${kind}`).addEventListener("click", () => socket.send({ type: "save", kind }));
byId("copy-yaml").addEventListener("click", () => socket.send({ type: "yaml" }));
for (const id of ["mapper", "exposure"]) byId(id).addEventListener("input", tone);
byId("show").addEventListener("change", () => chooseView(byId("show").value));
byId("toggle-histogram").addEventListener("click", toggleHistogram);
byId("full-screen").addEventListener("click", fullScreen);
byId("show-keys").addEventListener("click", () => byId("keys").showModal());
byId("keep-reference").addEventListener("click", () => { showError(null); socket.send({ type: "reference" }); });
byId("reference-file").addEventListener("change", (event) => {
  showError(null);
  if (event.target.value.trim()) socket.send({ type: "reference", file: event.target.value.trim() });
});
byId("form").addEventListener("change", (event) => {
  if (!["moves", "reference-file"].includes(event.target.id)) open(event.target.id !== "scene");
});
byId("form").addEventListener("submit", (event) => { event.preventDefault(); open(true); });
addEventListener("hashchange", () => location.reload());
