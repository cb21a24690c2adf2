// The page with a race: contestants, their images and error maps, and a plot of error over time.

import { WorkerSocket, byId, count, duration, element, invalidEntry, listItem, showError, showState } from "./socket.js";
import { SettingsForm } from "./settings_form.js";
import { drawPlot, markName } from "./plot.js";

const MIN_CONTESTANTS = 2;
const MAX_CONTESTANTS = 4;
const DEFAULTS = [["embree", {}], ["numba", {}], ["embree", { sampler: { name: "random" } }], ["numpy", {}]];
const page = { settingsForms: [], contestants: [], targets: [], state: "idle", references: [] };
page.show = () => {
  page.contestants.filter((one) => one.points.length).forEach((one) => one.list.replaceChildren(...resultItems(one)));
  drawPlot(byId("plot"), page.contestants, page.targets, isUndecided);
};
page.showState = state;
window.raybench = page;

const socket = new WorkerSocket("race", {
  menu, contestants, reference, contestant, state, saved,
  error: (header) => fail(header.text),
  worker_lost: (header) => fail(header.text),
  progress,
});

// ---- messages of the worker

function menu(header) {
  if (page.menu) return;
  page.menu = header;
  byId("scenes").append(...header.scenes.map((name) => new Option(name)));
  byId("scene").value = document.body.dataset.scene || "cornell_box";
  const able = header.engines.filter((engine) => !engine.problem).map((engine) => engine.name);
  byId("reference-engine").append(...able.map((name) => new Option(name, name, false, name === (document.body.dataset.engine || header.preferred))));
  addContestant();
  addContestant();
  byId("start").disabled = false;
}

function contestants(header) {
  page.targets = header.targets;
  page.size = { width: header.width, height: header.height };
  page.references = [];
  page.contestants = header.names.map((name, index) => contestantBox(name, index));
  byId("contestants").replaceChildren(...page.contestants.map((made) => made.box));
  byId("plot").replaceChildren();
  byId("over-time").hidden = false;
  byId("settings").open = false;
}

function contestantBox(name, index) {
  const [image, error] = [canvas(`Image of ${name}`), canvas(`Error map of ${name}`)];
  const list = element("ul");
  const box = element(
    "article", { className: "contestant" },
    element("h3", {}, `${index + 1} ${name} (${markName(index)})`),
    element("div", { className: "images" }, captioned(image, "image"), captioned(error, "error")),
    list,
  );
  box.style.setProperty("--colour", `var(--contestant-${index + 1})`);
  return { box, name, image, error, list, points: [], crossings: [] };
}

const canvas = (ariaLabel) => element("canvas", { ...page.size, role: "img", ariaLabel });
const captioned = (picture, caption) => element("figure", {}, picture, element("figcaption", {}, caption));

function radianceOf(bytes) {
  const halves = new Uint16Array(bytes);
  return Float32Array.from(halves, (bits) => HALF_VALUES[bits]);
}

function reference(header, bytes) {
  const radiance = radianceOf(bytes);
  page.maps = header.maps;
  page.epsilon = header.epsilon;
  for (const index of header.contestants) page.references[index] = radiance;
  writeScale();
}

function contestant(header, bytes) {
  const contestant = page.contestants[header.contestant];
  Object.assign(contestant, header, { frames: (contestant.frames ?? 0) + 1 });
  const radiance = radianceOf(bytes);
  const paint = (canvas, view, other) => paintView(canvas, view, radiance, other, 1, page.epsilon, page.maps);
  paint(contestant.image, "radiance", null);
  paint(contestant.error, "error", page.references[header.contestant]);
  page.show();
}

const isReached = (crossing) => crossing.state === "reached" || crossing.state === "at_first";

// Whether the reference's noise leaves in doubt when a contestant reached the target: then there is no winner.
function isUndecided(target) {
  return page.contestants.flatMap((contestant) => contestant.crossings)
    .some((crossing) => crossing.target === target && isReached(crossing) && !crossing.reliable);
}

function resultItems(contestant) {
  const last = contestant.points.at(-1);
  const texts = [
    `${duration(contestant.seconds)} of rendering, ${contestant.spp} samples per pixel`,
    last ? `error ${last[1] === null ? "unknown" : last[1].toPrecision(3)} at ${last[2]} samples` : "no checkpoint yet",
    `build ${duration(contestant.phases.build)}, compile ${duration(contestant.phases.compile)}, ${count(contestant.rays)} rays`,
  ];
  return [...texts.map(listItem), ...contestant.crossings.map((crossing) => crossingItem(crossing, contestant.done))];
}

function crossingItem(crossing, done) {
  const target = `target ${crossing.target}`;
  if (!isReached(crossing)) return listItem(`${target}: ${done ? "not reached" : "not reached yet"}`);
  const undecided = isUndecided(crossing.target);
  const time = `${crossing.state === "at_first" ? "at most " : ""}${duration(crossing.seconds)}`;
  const item = listItem(undecided ? `? ${target}: undecided, the reference is too noisy: give it more samples` : `✓ ${target} in ${time}`);
  item.className = undecided ? "undecided" : "reached";
  return item;
}

function writeScale() {
  const [map, label] = scaleWords("error", 1);
  byId("scale").replaceChildren(colourBar(page.maps[map]), `Error maps: ${label.replace("ε", `${page.epsilon}`)}`);
}

function progress(header) {
  const bar = byId("progress");
  bar.hidden = header.done >= header.total;
  bar.value = header.done / header.total;
  byId("activity").textContent = `${header.text}, ${header.done} of ${header.total} images`;
}

function state(header) {
  page.state = header.state;
  const resting = showState(header);
  byId("save").disabled = !resting || !page.contestants.some((contestant) => contestant.points.length);
  if (resting) byId("progress").hidden = true;
  page.contestants.forEach((contestant, index) => contestant.box.classList.toggle("running", index === header.racing));
}

function saved(header) {
  page.saved = header;
  const link = element("a", { href: `reports/${header.name}/report.html`, target: "_blank", rel: "noopener" }, "open its report");
  byId("saved").replaceChildren(`Saved in ${header.folder}: `, link, `, or raybench report ${header.folder}.`);
}

// ---- requests of the page

function addContestant() {
  if (page.settingsForms.length >= MAX_CONTESTANTS) return;
  const place = element("div");
  byId("settings-forms").append(place);
  const [engine, given] = DEFAULTS[page.settingsForms.length];
  const known = page.menu.engines.some((one) => one.name === engine && !one.problem);
  const first = page.settingsForms.length === 0 && document.body.dataset.engine;
  const chosen = first || (known ? engine : page.menu.preferred);
  const form = new SettingsForm(place, page.menu, `Contestant ${page.settingsForms.length + 1}`, chosen, given);
  page.settingsForms.push(form);
  writeButtons();
}

function removeContestant() {
  if (page.settingsForms.length <= MIN_CONTESTANTS) return;
  page.settingsForms.pop().place.remove();
  writeButtons();
}

function writeButtons() {
  byId("add").disabled = page.settingsForms.length >= MAX_CONTESTANTS;
  byId("remove").disabled = page.settingsForms.length <= MIN_CONTESTANTS;
}

// Shows an error, which may be below the window.
function fail(text) {
  showError(text);
  byId("error").scrollIntoView({ block: "nearest" });
}

function start() {
  const problem = invalidEntry(byId("form"));
  if (problem) return fail(problem);
  showError(null);
  byId("saved").replaceChildren();
  byId("warnings").replaceChildren();
  const value = (id) => Number(byId(id).value);
  try {
    const targets = byId("targets").value.split(/[\s,;]+/).filter(Boolean).map(Number);
    if (!targets.length || !targets.every((target) => target > 0)) throw new Error("targets: must be errors above zero, such as 0.1 0.01");
    socket.send({
      type: "race", scene: byId("scene").value.trim(), contestants: page.settingsForms.map((form) => form.value()), targets,
      width: value("width"), height: value("height"), reference_spp: value("reference-spp"),
      reference_engine: byId("reference-engine").value,
      max_seconds: value("max-seconds"), slice_seconds: value("slice"),
    });
  } catch (error) {
    fail(error.message);
  }
}

function save() {
  if (!byId("name").validity.valid) return fail("Results folder: a name of letters, digits, dots, hyphens and underscores, which begins with a letter or digit.");
  showError(null);
  socket.send({ type: "save", name: byId("name").value });
}

new ResizeObserver(() => { if (page.contestants.length) page.show(); }).observe(byId("contestants"));
byId("add").addEventListener("click", addContestant);
byId("remove").addEventListener("click", removeContestant);
byId("start").addEventListener("click", start);
byId("save").addEventListener("click", save);
byId("form").addEventListener("submit", (event) => event.preventDefault());
