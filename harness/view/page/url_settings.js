// The settings of the page in the address: what follows `#`, as scene=cornell_box&shader=path_tracer&shader.max_depth=6.

const KINDS = ["shader", "sampler", "accelerator"];
const round = (values) => values.map((value) => Number(value.toPrecision(7)));

function plain(text) {
  try {
    return JSON.parse(text);
  } catch {
    return text;
  }
}

// {fields: {scene, width, ...} as texts, settings: {engine, shader: {name, ...}, ...}, camera: {eye, target, up, height} or null}
export function readAddress() {
  const given = new URLSearchParams(location.hash.slice(1));
  const settings = {};
  for (const key of ["engine", "precision"]) if (given.get(key)) settings[key] = given.get(key);
  if (given.get("threads")) settings.threads = Number(given.get("threads"));
  for (const kind of KINDS) {
    if (!given.get(kind)) continue;
    settings[kind] = { name: given.get(kind) };
    for (const [key, text] of given) if (key.startsWith(`${kind}.`)) settings[kind][key.slice(kind.length + 1)] = plain(text);
  }
  return { fields: Object.fromEntries(given), settings, camera: cameraOf(given.get("camera")) };
}

function cameraOf(text) {
  const numbers = (text ?? "").split(",").map(Number);
  if (numbers.length < 9 || !numbers.every(Number.isFinite)) return null;
  return { eye: numbers.slice(0, 3), target: numbers.slice(3, 6), up: numbers.slice(6, 9), height: numbers[9] ?? null };
}

// `fields` of which empty ones are left out, the `settings` of a request, and an orbit camera or null.
export function writeAddress(fields, settings, camera) {
  const written = new URLSearchParams();
  for (const [key, value] of Object.entries(fields)) if (value !== "" && value !== null) written.set(key, value);
  for (const key of ["engine", "threads", "precision"]) if (settings[key]) written.set(key, settings[key]);
  for (const kind of KINDS) {
    const { name, ...options } = settings[kind];
    written.set(kind, name);
    for (const [key, value] of Object.entries(options)) written.set(`${kind}.${key}`, typeof value === "string" ? value : JSON.stringify(value));
  }
  if (camera) {
    const height = camera.height ? [camera.height] : [];
    written.set("camera", round([...camera.eye, ...camera.target, ...camera.up, ...height]).join(","));
  }
  history.replaceState(null, "", `#${written}`);
}
