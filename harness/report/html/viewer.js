// The image viewer: two pictures A and B of a scene, flipped, wiped, subtracted or all side by side, under one zoom, pan and
// exposure. The rule says which checkpoint of each contestant is shown. The state is kept in the address, after `#images?`.

const MODES = ["flip", "wipe", "grid"];
const VIEWS = ["radiance", "difference", "error", "signed", "luminance"];
const RULES = ["last", "time", "samples"];
const FRAGMENT = "#images?";
const SAVE_AFTER = 300;
const part = (name) => document.getElementById(`viewer-${name}`);

class Viewer {
  constructor(data) {
    this.data = data;
    this.canvas = part("canvas");
    this.context = this.canvas.getContext("2d");
    this.mode = "flip";
    this.view = "radiance";
    this.rule = "last";
    this.exposure = 0;
    this.wipe = 0.5;
    this.pointer = null;
    this.listen();
    this.restore();
  }

  // --- state

  async open(index, wished = {}) {
    this.group = this.data.groups[index];
    const group = this.group;
    if (!group.radiance) group.radiance = await Promise.all(group.pictures.map((picture) => decodePicture(picture.data)));
    if (group !== this.group) return;
    this.drawn = new Map();
    this.setRule(this.rule, wished.a, wished.b);
    this.fit();
    if (wished.zoom) [this.zoom, this.x, this.y] = [wished.zoom, wished.x, wished.y];
    this.redraw();
    this.canvas.dataset.ready = group.title;
  }

  // The pictures that the rule shows, as places in the group's list.
  get listed() {
    return this.group.rules[this.rule].pictures;
  }

  // Takes the pictures of a rule; A and B stay with their contestants where these have one.
  setRule(rule, a = this.nameOf(this.current), b = this.nameOf(this.other)) {
    this.rule = rule;
    const named = (name, otherwise) => {
      const found = this.listed.find((place) => this.nameOf(place) === name);
      return found === undefined ? otherwise : found;
    };
    const first = this.listed[this.group.has_reference && this.listed.length > 1 ? 1 : 0];
    this.current = named(a, first);
    this.other = named(b, this.listed.find((place) => place !== this.current) ?? first);
    this.drawn.clear();
    this.writeChoices();
  }

  nameOf(place) {
    return this.group.pictures[place]?.name;
  }

  // The state as it stands in the address, and back.
  save() {
    clearTimeout(this.saving);
    this.saving = setTimeout(() => {
      const state = new URLSearchParams({
        scene: this.group.title, rule: this.rule, a: this.nameOf(this.current), b: this.nameOf(this.other), mode: this.mode,
        show: this.view, ev: this.exposure, wipe: this.wipe.toFixed(3),
      });
      if (!this.fitted) state.set("at", [this.zoom, this.x, this.y].map((value) => value.toFixed(4)).join(" "));
      this.saved = FRAGMENT + state;
      history.replaceState(null, "", this.saved);
    }, SAVE_AFTER);
  }

  restore() {
    const asked = location.hash.startsWith(FRAGMENT);
    const state = new URLSearchParams(asked ? location.hash.slice(FRAGMENT.length) : "");
    const among = (list, key, otherwise) => (list.includes(state.get(key)) ? state.get(key) : otherwise);
    this.mode = among(MODES, "mode", this.mode);
    this.view = among(VIEWS, "show", this.view);
    this.rule = among(RULES, "rule", this.rule);
    const number = (text, low, high, otherwise) => (text !== null && text !== "" && Number.isFinite(Number(text))
      ? Math.min(Math.max(Number(text), low), high) : otherwise);
    this.exposure = number(state.get("ev"), -6, 6, this.exposure);
    this.wipe = number(state.get("wipe"), 0, 1, this.wipe);
    const [zoom, x, y] = (state.get("at") ?? "").split(" ").map(Number);
    const place = [zoom, x, y].every(Number.isFinite) && zoom >= 0.1 && zoom <= 64 ? { zoom, x, y } : {};
    const index = Math.max(this.data.groups.findIndex((group) => group.title === state.get("scene")), 0);
    part("group").value = String(index);
    if (asked) document.getElementById("images").scrollIntoView();
    return this.open(index, { a: state.get("a") ?? undefined, b: state.get("b") ?? undefined, ...place });
  }

  get reference() {
    return this.group.has_reference ? this.group.radiance[0] : null;
  }

  // The number key of a picture: the reference is 0, contestants count from 1.
  keyOf(place) {
    const index = this.listed.indexOf(place);
    return this.group.has_reference ? index : index + 1;
  }

  choose(place, side = "current") {
    if (place === undefined || !this.listed.includes(place)) return;
    this[side] = place;
    if (side === "other" && this.view === "difference") this.drawn.clear();
    this.changed();
  }

  swap() {
    [this.current, this.other] = [this.other, this.current];
    if (this.view === "difference") this.drawn.clear();
    this.changed();
  }

  changed() {
    this.redraw();
    this.save();
  }

  set(property, value) {
    this[property] = value;
    if (property === "exposure") this.drawn.clear();
    this.changed();
  }

  // A difference is one picture: it leaves the wipe, and the wipe leaves it.
  setView(view) {
    this.view = view;
    if (view === "difference" && this.mode === "wipe") this.mode = "flip";
    this.drawn.clear();
    this.changed();
  }

  // --- drawing

  bitmap(index) {
    if (!this.drawn.has(index)) {
      const { width, height, radiance, epsilon } = this.group;
      const canvas = new OffscreenCanvas(width, height);
      const [view, second] = this.view === "difference" ? ["signed", radiance[this.other]] : [this.view, this.reference];
      paintView(canvas, view, radiance[index], second, 2 ** this.exposure, epsilon, this.data.maps);
      this.drawn.set(index, canvas);
    }
    return this.drawn.get(index);
  }

  // Columns and rows of the pictures that are shown.
  cells() {
    const count = this.mode === "grid" ? this.listed.length : 1;
    const aspect = (this.canvas.parentElement.clientWidth / innerHeight) * (this.group.height / this.group.width);
    const columns = Math.min(count, Math.max(1, Math.round(Math.sqrt(count * aspect))));
    return [columns, Math.ceil(count / columns)];
  }

  // The areas of the canvas, in CSS pixels, and the picture in each. They are of one size.
  areas() {
    const [columns, rows] = this.cells();
    this.canvas.style.setProperty("--aspect", (columns * this.group.width) / (rows * this.group.height));
    const [width, height] = [this.canvas.clientWidth / columns, this.canvas.clientHeight / rows];
    const shown = this.mode === "grid" ? this.listed : [this.current];
    return shown.map((index, k) => ({ index, left: (k % columns) * width, top: Math.floor(k / columns) * height, width, height }));
  }

  redraw() {
    const ratio = devicePixelRatio || 1;
    const areas = this.areas(); // before the canvas is measured, which gets its proportions there
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    const context = this.context;
    context.imageSmoothingEnabled = false;
    context.scale(ratio, ratio);
    for (const area of areas) this.drawPicture(area);
    if (this.mode === "wipe") this.drawWipe(width, height);
    this.drawPixel(width, height);
    this.writeState();
  }

  drawPicture({ index, left, top, width, height }) {
    const context = this.context;
    context.save();
    context.beginPath();
    context.rect(left, top, width, height);
    context.clip();
    this.drawBitmap(index, left, top, width, height);
    const minus = this.view === "difference" ? ` minus ${this.nameOf(this.other)}` : "";
    const label = this.label(index) + minus;
    this.drawLabel(label, left, top, Math.min(this.widthOf(label), width));
    context.restore();
  }

  // A picture under zoom and pan in the area that begins at (left, top).
  drawBitmap(index, left, top, width, height) {
    const { zoom, x, y } = this;
    this.context.drawImage(this.bitmap(index), left + x * width, top + y * height, this.group.width * zoom, this.group.height * zoom);
  }

  widthOf(label) {
    this.context.font = "13px system-ui, sans-serif";
    return this.context.measureText(label).width + 12;
  }

  drawLabel(label, left, top, width) {
    this.context.fillStyle = "rgba(0, 0, 0, 0.6)";
    this.context.fillRect(left, top, width, 22);
    this.context.fillStyle = "#fff";
    this.context.fillText(label, left + 6, top + 15);
  }

  label(place) {
    const sides = [["A", this.current], ["B", this.other]].filter(([, other]) => other === place).map(([side]) => side);
    return `${sides.join(" ")} ${this.nameOf(place)}`.trim();
  }

  // The values under the pointer, beside it.
  drawPixel(width, height) {
    const at = this.pixelAt();
    if (!at) return;
    const context = this.context;
    const lines = this.pixelLines(at);
    context.font = "12px ui-monospace, monospace";
    const wide = Math.max(...lines.map((line) => context.measureText(line).width)) + 12;
    const tall = 16 * lines.length + 8;
    const left = this.pointer.x + 16 + wide > width ? Math.max(this.pointer.x - 16 - wide, 0) : this.pointer.x + 16;
    const top = this.pointer.y + 16 + tall > height ? Math.max(this.pointer.y - 16 - tall, 0) : this.pointer.y + 16;
    context.fillStyle = "rgba(0, 0, 0, 0.75)";
    context.fillRect(left, top, wide, tall);
    context.fillStyle = "#fff";
    lines.forEach((line, row) => context.fillText(line, left + 6, top + 16 * (row + 1)));
    const { zoom } = this;
    const { area } = at;
    context.strokeStyle = "#fff";
    if (zoom >= 6) context.strokeRect(area.left + this.x * area.width + at.x * zoom, area.top + this.y * area.height + at.y * zoom, zoom, zoom);
  }

  drawWipe(width, height) {
    const context = this.context;
    const edge = this.wipe * width;
    context.clearRect(edge, 0, width - edge, height);
    context.save();
    context.beginPath();
    context.rect(edge, 0, width - edge, height);
    context.clip();
    this.drawBitmap(this.other, 0, 0, width, height);
    context.restore();
    const label = this.label(this.other);
    const wide = this.widthOf(label);
    this.drawLabel(label, width - wide, 0, wide);
    context.fillRect(edge - 1, 0, 2, height);
  }

  // --- zoom and pan: picture pixel p lies at (x * area + p * zoom)

  fit() {
    const { width, height } = this.areas()[0];
    this.setZoom(Math.min(width / this.group.width, height / this.group.height));
    this.fitted = true;
  }

  setZoom(zoom) {
    const { width, height } = this.areas()[0];
    this.zoom = zoom;
    this.fitted = false;
    this.x = 0.5 - (this.group.width * zoom) / width / 2;
    this.y = 0.5 - (this.group.height * zoom) / height / 2;
    this.redraw();
  }

  // Zooms by a factor, keeping the point (px, py) of an area, both as shares of its size, where it is.
  zoomBy(factor, px = 0.5, py = 0.5) {
    const zoom = Math.min(Math.max(this.zoom * factor, 0.1), 64);
    const real = zoom / this.zoom;
    this.x = px - (px - this.x) * real;
    this.y = py - (py - this.y) * real;
    this.zoom = zoom;
    this.fitted = false;
    this.changed();
  }

  pan(dx, dy) {
    const { width, height } = this.areas()[0];
    this.x += dx / width;
    this.y += dy / height;
    this.fitted = false;
    this.changed();
  }

  // --- words

  writeChoices() {
    for (const side of ["a", "b"]) {
      part(side).replaceChildren(...this.listed.map((place) => {
        const picture = this.group.pictures[place];
        return new Option(`${this.keyOf(place)} ${picture.name} (${picture.caption})`, String(place));
      }));
    }
    const rules = part("rule");
    rules.replaceChildren(...RULES.map((rule) => new Option(this.group.rules[rule].words, rule)));
    this.writeMissing(this.group.rules[this.rule].missing);
  }

  writeMissing(missing) {
    const place = part("missing");
    place.hidden = !missing.length;
    place.querySelector("summary").textContent = `${missing.length} contestant${missing.length === 1 ? "" : "s"} not shown, and why`;
    place.querySelector("ul").replaceChildren(...missing.map(([name, reason]) => {
      const item = document.createElement("li");
      item.textContent = `${name}: ${reason}`;
      return item;
    }));
  }

  writeState() {
    for (const button of document.querySelectorAll("[data-mode]")) {
      button.setAttribute("aria-pressed", String(button.dataset.mode === this.mode));
    }
    part("a").value = String(this.current);
    part("b").value = String(this.other);
    part("rule").value = this.rule;
    part("view").value = this.view;
    part("exposure").value = this.exposure;
    part("ev").textContent = `${this.exposure > 0 ? "+" : ""}${this.exposure} EV`;
    const picture = this.group.pictures[this.current];
    this.canvas.setAttribute("aria-label", `${this.group.title}, ${picture.name}, ${picture.caption}, ${this.view}`);
    this.writeScale();
    this.writePixel();
  }

  writeScale() {
    const place = part("scale");
    const words = scaleWords(this.view, 2 ** this.exposure);
    place.replaceChildren();
    if (!words) return;
    if (!this.reference && !["luminance", "difference"].includes(this.view)) {
      place.textContent = "There is no reference to compare with.";
      return;
    }
    place.append(colourBar(this.data.maps[words[0]]), words[1]);
  }

  writePixel() {
    const status = part("status");
    const at = this.pixelAt();
    const shrunk = this.group.factor > 1 ? ` Shown at 1/${this.group.factor} of its resolution.` : "";
    if (!at) {
      const picture = this.group.pictures[this.current];
      status.textContent = `${picture.name}: ${picture.caption}. Zoom ${(100 * this.zoom).toFixed(0)} %.${shrunk}`;
      return;
    }
    status.textContent = this.pixelLines(at).join(" | ") + shrunk;
  }

  // Place, then radiance (red, green, blue) of the picture pointed at, of A and B, and of the reference, and the error.
  pixelLines(at) {
    const { radiance, pictures, width, epsilon } = this.group;
    const i = 3 * (at.y * width + at.x);
    const values = (data) => Array.from(data.slice(i, i + 3), (v) => v.toPrecision(3)).join(" ");
    const places = [...new Set([at.index, this.current, this.other])];
    const lines = [`(${at.x}, ${at.y}) red green blue`, ...places.map((place) => `${pictures[place].name}: ${values(radiance[place])}`)];
    if (this.reference) {
      if (!places.includes(0)) lines.push(`reference: ${values(this.reference)}`);
      const error = relativeSquaredError(radiance[at.index], this.reference, i, epsilon);
      lines.push(`relative squared error against the reference ${error.toPrecision(3)}`);
    }
    return lines;
  }

  // The picture's pixel under the pointer, or null.
  pixelAt() {
    if (!this.pointer) return null;
    for (const area of this.areas()) {
      const { index, left, top, width, height } = area;
      const px = this.pointer.x - left;
      const py = this.pointer.y - top;
      if (px < 0 || py < 0 || px >= width || py >= height) continue;
      const x = Math.floor((px - this.x * width) / this.zoom);
      const y = Math.floor((py - this.y * height) / this.zoom);
      if (x < 0 || y < 0 || x >= this.group.width || y >= this.group.height) return null;
      const shown = this.mode === "wipe" && this.pointer.x >= this.wipe * width ? this.other : index;
      return { x, y, index: shown, area };
    }
    return null;
  }

  // --- input

  listen() {
    const canvas = this.canvas;
    part("group").addEventListener("change", async (event) => {
      await this.open(Number(event.target.value), { a: this.nameOf(this.current), b: this.nameOf(this.other) });
      this.save();
    });
    part("rule").addEventListener("change", (event) => { this.setRule(event.target.value); this.changed(); });
    part("a").addEventListener("change", (event) => this.choose(Number(event.target.value)));
    part("b").addEventListener("change", (event) => this.choose(Number(event.target.value), "other"));
    part("swap").addEventListener("click", () => this.swap());
    addEventListener("hashchange", () => { if (location.hash.startsWith(FRAGMENT) && location.hash !== this.saved) this.restore(); });
    part("view").addEventListener("change", (event) => this.setView(event.target.value));
    part("exposure").addEventListener("input", (event) => this.set("exposure", Number(event.target.value)));
    for (const button of document.querySelectorAll("[data-mode]")) {
      button.addEventListener("click", () => this.setMode(button.dataset.mode));
    }
    const zooms = {
      in: () => this.zoomBy(1.5),
      out: () => this.zoomBy(1 / 1.5),
      fit: () => { this.fit(); this.save(); },
      one: () => { this.setZoom(1); this.save(); },
    };
    for (const button of document.querySelectorAll("[data-zoom]")) button.addEventListener("click", zooms[button.dataset.zoom]);
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerleave", () => { this.pointer = null; this.redraw(); });
    new ResizeObserver(() => { if (this.drawn) (this.fitted ? this.fit() : this.redraw()); }).observe(canvas);
  }

  setMode(mode) {
    this.mode = this.mode === mode ? "flip" : mode;
    if (mode === "wipe" && this.view === "difference") this.setView("radiance");
    this.fit();
    this.save();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const step = 40;
    const actions = {
      e: () => this.setView(this.view === "error" ? "radiance" : "error"),
      w: () => this.setMode("wipe"),
      g: () => this.setMode("grid"),
      d: () => this.setView(this.view === "difference" ? "radiance" : "difference"),
      f: () => { this.fit(); this.save(); },
      " ": () => this.swap(),
      "+": () => this.zoomBy(1.25),
      "=": () => this.zoomBy(1.25),
      "-": () => this.zoomBy(0.8),
      "[": () => this.set("exposure", Math.max(this.exposure - 0.5, -6)),
      "]": () => this.set("exposure", Math.min(this.exposure + 0.5, 6)),
      ArrowLeft: () => this.pan(step, 0),
      ArrowRight: () => this.pan(-step, 0),
      ArrowUp: () => this.pan(0, step),
      ArrowDown: () => this.pan(0, -step),
    };
    const digit = /^(?:Digit|Numpad)([0-9])$/.exec(event.code);
    if (digit) this.choose(this.listed.find((place) => this.keyOf(place) === Number(digit[1])), event.shiftKey ? "other" : "current");
    else if (actions[event.key]) actions[event.key]();
    else return;
    event.preventDefault();
  }

  // The wheel scrolls the page until the picture has been clicked.
  wheel(event) {
    if (document.activeElement !== this.canvas) return;
    event.preventDefault();
    const shares = this.areas().map((area) => [(event.offsetX - area.left) / area.width, (event.offsetY - area.top) / area.height]);
    const inside = shares.find(([x, y]) => x >= 0 && x < 1 && y >= 0 && y < 1);
    if (inside) this.zoomBy(Math.exp(-event.deltaY * 0.0015), ...inside);
  }

  press(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.wiping = this.mode === "wipe" && Math.abs(event.offsetX - this.wipe * this.canvas.clientWidth) < 16;
  }

  move(event) {
    this.pointer = { x: event.offsetX, y: event.offsetY };
    if (event.buttons & 1 && this.wiping) {
      this.set("wipe", Math.min(Math.max(event.offsetX / this.canvas.clientWidth, 0), 1));
    } else if (event.buttons & 1) {
      this.pan(event.movementX, event.movementY);
    } else {
      this.redraw();
    }
  }
}

const pictures = document.getElementById("pictures");
if (pictures) new Viewer(JSON.parse(pictures.textContent));
