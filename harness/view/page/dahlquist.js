// The page with Dahlquist's program: its animation, its switches, and spheres that are dragged.

import { ARROWS, WorkerSocket, byId, count, duration, element, invalidEntry, pointerPosition, showError, showState, throttled } from "./socket.js";

const SWITCHES = ["reflections", "environment", "interlaced", "redraw"];
const KEYBOARD = 20; // the finger number of the keyboard
const STEP = 8;
const canvas = byId("canvas");
const context = canvas.getContext("2d", { alpha: false });
const page = { frames: 0, state: "idle", touchedSpheres: [] };
window.raybench = page;
let held = null; // the position of the keyboard's finger

const socket = new WorkerSocket("dahlquist", {
  menu, frame, state,
  touched: (header) => page.touchedSpheres.push(header.sphere),
  error: (header) => showError(header.text),
  worker_lost: (header) => showError(header.text),
});

function menu(header) {
  if (page.menu) return;
  page.menu = header;
  byId("engine").append(...header.engines.map((name) => new Option(name, name, false, name === document.body.dataset.engine)));
  Object.assign(byId("threads"), { max: header.cores, value: header.cores });
  for (const [name, seconds, rays] of header.original) {
    const row = byId("figures").insertRow();
    row.append(element("th", { scope: "row" }, `the original, ${name}`));
    for (const text of [duration(seconds), count(rays), (1 / seconds).toFixed(1)]) row.insertCell().textContent = text;
  }
  if (matchMedia("(prefers-reduced-motion: reduce)").matches) byId("activity").textContent = "Start animates it";
  else begin();
}

function frame(header, bytes) {
  const pixels = new Uint8ClampedArray(bytes);
  for (let i = 3; i < pixels.length; i += 4) pixels[i] = 255; // the original stores a flag in alpha
  if (canvas.width !== header.width || canvas.height !== header.height) resize(header.width, header.height);
  context.putImageData(new ImageData(pixels, header.width, header.height), 0, 0);
  page.frames += 1;
  socket.send({ type: "ack" });
}

function resize(width, height) {
  Object.assign(canvas, { width, height });
  canvas.parentElement.style.setProperty("--aspect", width / height);
}

function state(header) {
  page.state = header.state;
  page.status = header;
  showState(header);
  if (!header.frame_seconds) return;
  const background = header.redraw ? "redrawn" : "kept";
  const halves = header.calls_per_frame === 2 ? ", two interlaced calls" : "";
  byId("own-name").textContent = `here, ${header.size}, ${header.threads} threads, background ${background}${halves}`;
  byId("own-frame").textContent = duration(header.frame_seconds);
  byId("own-rays").textContent = count(header.rays_per_second);
  byId("own-frames").textContent = header.frames_per_second ? header.frames_per_second.toFixed(1) : "–";
}

function begin() {
  const problem = invalidEntry(byId("form"));
  showError(problem);
  if (problem) return;
  const value = (id) => Number(byId(id).value);
  socket.send({ type: "dahlquist", width: value("width"), height: value("height"), engine: byId("engine").value, threads: value("threads") });
  switches();
}

function switches() {
  const speed = Number(byId("speed").value);
  byId("speed-value").textContent = speed;
  const chosen = Object.fromEntries(SWITCHES.map((name) => [name, byId(name).checked]));
  socket.send({ type: "switches", ...chosen, speed });
}

const fingers = new Map(); // pointer id -> finger number
const sendMoves = new Map();

canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  const finger = [...Array(10).keys()].find((free) => ![...fingers.values()].includes(free)) ?? 9;
  fingers.set(event.pointerId, finger);
  sendMoves.set(event.pointerId, throttled((point) => { if (fingers.has(event.pointerId)) socket.send({ type: "move", finger, ...point }); }));
  socket.send({ type: "touch", finger, ...pointerPosition(canvas, event) });
});
canvas.addEventListener("pointermove", (event) => sendMoves.get(event.pointerId)?.(pointerPosition(canvas, event)));
for (const end of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(end, (event) => {
    if (fingers.has(event.pointerId)) socket.send({ type: "release", finger: fingers.get(event.pointerId) });
    fingers.delete(event.pointerId);
    sendMoves.delete(event.pointerId);
  });
}

// Keys 1 to 5 hold a sphere, and arrow keys move it like a finger.
canvas.addEventListener("keydown", (event) => {
  if (/^[1-5]$/.test(event.key)) socket.send({ type: "hold", finger: KEYBOARD, sphere: Number(event.key) - 1 });
  else if (ARROWS[event.key] && held) {
    held = { x: held.x + STEP * ARROWS[event.key][0], y: held.y + STEP * ARROWS[event.key][1] };
    socket.send({ type: "move", finger: KEYBOARD, ...held });
  } else if (event.key === "Escape") { held = null; socket.send({ type: "release", finger: KEYBOARD }); }
  else return;
  event.preventDefault();
});
socket.handlers.held = (header) => { held = { x: header.x, y: header.y }; page.held = header; };

byId("start").addEventListener("click", () => (page.status?.size ? socket.send({ type: "resume" }) : begin()));
for (const name of [...SWITCHES, "speed"]) byId(name).addEventListener("input", switches);
for (const name of ["width", "height", "engine", "threads"]) byId(name).addEventListener("change", begin);
byId("form").addEventListener("submit", (event) => event.preventDefault());
