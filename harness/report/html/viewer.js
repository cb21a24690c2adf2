// The image viewer: flip by number keys, wipe, side by side; one zoom, pan and exposure for all pictures of a scene.

class Viewer {
  constructor(data) {
    this.data = data;
    this.canvas = document.getElementById("viewer-canvas");
    this.context = this.canvas.getContext("2d");
    this.mode = "flip";
    this.view = "radiance";
    this.exposure = 0;
    this.wipe = 0.5;
    this.pointer = null;
    this.listen();
    this.open(0);
  }

  // --- state

  async open(index) {
    this.group = this.data.groups[index];
    const group = this.group;
    if (!group.radiance) group.radiance = await Promise.all(group.pictures.map((picture) => decodePicture(picture.data)));
    if (group !== this.group) return;
    this.drawn = new Map();
    this.current = Math.min(group.has_reference ? 1 : 0, group.pictures.length - 1);
    this.other = 0;
    this.writeChoices();
    this.fit();
    this.canvas.dataset.ready = group.title;
  }

  get reference() {
    return this.group.has_reference ? this.group.radiance[0] : null;
  }

  // The number key of a picture: the reference is 0, contestants count from 1.
  keyOf(index) {
    return this.group.has_reference ? index : index + 1;
  }

  choose(index) {
    if (index < 0 || index >= this.group.pictures.length) return;
    if (index !== this.current) this.other = this.current;
    this.current = index;
    this.redraw();
  }

  set(property, value) {
    this[property] = value;
    if (property === "exposure" || property === "view") this.drawn.clear();
    this.redraw();
  }

  // --- drawing

  bitmap(index) {
    if (!this.drawn.has(index)) {
      const { width, height, radiance, epsilon } = this.group;
      const canvas = new OffscreenCanvas(width, height);
      const context = canvas.getContext("2d");
      const image = context.createImageData(width, height);
      const gain = 2 ** this.exposure;
      for (let i = 0, o = 0; i < radiance[index].length; i += 3, o += 4) {
        const colour = viewPixel(this.view, radiance[index], this.reference, i, gain, epsilon, this.data.maps);
        image.data.set(colour, o);
        image.data[o + 3] = 255;
      }
      context.putImageData(image, 0, 0);
      this.drawn.set(index, canvas);
    }
    return this.drawn.get(index);
  }

  // The areas of the canvas, in CSS pixels: [picture, left, top, width, height] each.
  areas() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const count = this.group.pictures.length;
    if (this.mode !== "grid") return [[this.current, 0, 0, width, height]];
    const aspect = (width / height) * (this.group.height / this.group.width);
    const columns = Math.min(count, Math.max(1, Math.round(Math.sqrt(count * aspect))));
    const rows = Math.ceil(count / columns);
    return this.group.pictures.map((_, index) => [
      index, ((index % columns) * width) / columns, (Math.floor(index / columns) * height) / rows, width / columns, height / rows,
    ]);
  }

  redraw() {
    const ratio = devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    const context = this.context;
    context.imageSmoothingEnabled = false;
    context.scale(ratio, ratio);
    for (const [index, left, top, w, h] of this.areas()) this.drawPicture(index, left, top, w, h);
    if (this.mode === "wipe") this.drawWipe(width, height);
    this.writeState();
  }

  drawPicture(index, left, top, width, height) {
    const context = this.context;
    context.save();
    context.beginPath();
    context.rect(left, top, width, height);
    context.clip();
    const { zoom, x, y } = this;
    context.drawImage(this.bitmap(index), left + x * width, top + y * height, this.group.width * zoom, this.group.height * zoom);
    const label = `${this.keyOf(index)} ${this.group.pictures[index].name}`;
    context.font = "13px system-ui, sans-serif";
    context.fillStyle = "rgba(0, 0, 0, 0.6)";
    context.fillRect(left, top, Math.min(context.measureText(label).width + 12, width), 22);
    context.fillStyle = "#fff";
    context.fillText(label, left + 6, top + 15);
    context.restore();
  }

  drawWipe(width, height) {
    const context = this.context;
    const edge = this.wipe * width;
    context.fillStyle = "#000";
    context.fillRect(edge, 0, width - edge, height);
    context.save();
    context.beginPath();
    context.rect(edge, 0, width - edge, height);
    context.clip();
    context.drawImage(this.bitmap(this.other), this.x * width, this.y * height, this.group.width * this.zoom, this.group.height * this.zoom);
    context.restore();
    const label = `${this.keyOf(this.other)} ${this.group.pictures[this.other].name}`;
    context.font = "13px system-ui, sans-serif";
    const wide = context.measureText(label).width + 12;
    context.fillStyle = "rgba(0, 0, 0, 0.6)";
    context.fillRect(width - wide, 0, wide, 22);
    context.fillStyle = "#fff";
    context.fillText(label, width - wide + 6, 15);
    context.fillRect(edge - 1, 0, 2, height);
  }

  // --- zoom and pan: picture pixel p lies at (x * area + p * zoom)

  fit() {
    const [, , , width, height] = this.areas()[0];
    this.setZoom(Math.min(width / this.group.width, height / this.group.height));
  }

  setZoom(zoom) {
    const [, , , width, height] = this.areas()[0];
    this.zoom = zoom;
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
    this.redraw();
  }

  pan(dx, dy) {
    const [, , , width, height] = this.areas()[0];
    this.x += dx / width;
    this.y += dy / height;
    this.redraw();
  }

  // --- words

  writeChoices() {
    const list = document.getElementById("viewer-choices");
    list.replaceChildren(...this.group.pictures.map((picture, index) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(`${this.keyOf(index)} ${picture.name} `);
      const words = document.createElement("small");
      words.textContent = picture.caption;
      button.append(words);
      button.addEventListener("click", () => this.choose(index));
      return button;
    }));
  }

  writeState() {
    const press = (button, on) => button.setAttribute("aria-pressed", String(on));
    Array.from(document.getElementById("viewer-choices").children).forEach((button, i) => press(button, i === this.current));
    for (const button of document.querySelectorAll("[data-mode]")) press(button, button.dataset.mode === this.mode);
    document.getElementById("viewer-view").value = this.view;
    document.getElementById("viewer-exposure").value = this.exposure;
    document.getElementById("viewer-ev").textContent = `${this.exposure > 0 ? "+" : ""}${this.exposure} EV`;
    const picture = this.group.pictures[this.current];
    this.canvas.setAttribute("aria-label", `${this.group.title}, ${picture.name}, ${picture.caption}, ${this.view}`);
    this.writeScale();
    this.writePixel();
  }

  writeScale() {
    const place = document.getElementById("viewer-scale");
    const words = scaleWords(this.view, 2 ** this.exposure);
    place.replaceChildren();
    if (!words) return;
    if (!this.reference && this.view !== "luminance") {
      place.textContent = "There is no reference to compare with.";
      return;
    }
    const bar = document.createElement("i");
    bar.style.background = `linear-gradient(to right, ${this.data.maps[words[0]].map((c) => `rgb(${c})`).join(",")})`;
    place.append(bar, words[1]);
  }

  writePixel() {
    const status = document.getElementById("viewer-status");
    const at = this.pixelAt();
    const shrunk = this.group.factor > 1 ? ` Shown at 1/${this.group.factor} of its resolution.` : "";
    if (!at) {
      const picture = this.group.pictures[this.current];
      status.textContent = `${picture.name}: ${picture.caption}. Zoom ${(100 * this.zoom).toFixed(0)} %.${shrunk}`;
      return;
    }
    const i = 3 * (at.y * this.group.width + at.x);
    const values = (radiance) => Array.from(radiance.slice(i, i + 3), (v) => v.toPrecision(3)).join(" ");
    const own = this.group.radiance[at.index];
    let text = `(${at.x}, ${at.y}) ${this.group.pictures[at.index].name}: ${values(own)}`;
    if (this.reference) {
      const error = relativeSquaredError(own, this.reference, i, this.group.epsilon);
      text += ` | reference: ${values(this.reference)} | relative squared error ${error.toPrecision(3)}`;
    }
    status.textContent = text + shrunk;
  }

  // The picture's pixel under the pointer, or null.
  pixelAt() {
    if (!this.pointer) return null;
    for (const [index, left, top, width, height] of this.areas()) {
      const px = this.pointer.x - left;
      const py = this.pointer.y - top;
      if (px < 0 || py < 0 || px >= width || py >= height) continue;
      const x = Math.floor((px - this.x * width) / this.zoom);
      const y = Math.floor((py - this.y * height) / this.zoom);
      if (x < 0 || y < 0 || x >= this.group.width || y >= this.group.height) return null;
      const shown = this.mode === "wipe" && this.pointer.x >= this.wipe * width ? this.other : index;
      return { x, y, index: shown };
    }
    return null;
  }

  // --- input

  listen() {
    const canvas = this.canvas;
    document.getElementById("viewer-group").addEventListener("change", (event) => this.open(Number(event.target.value)));
    document.getElementById("viewer-view").addEventListener("change", (event) => this.set("view", event.target.value));
    document.getElementById("viewer-exposure").addEventListener("input", (event) => this.set("exposure", Number(event.target.value)));
    for (const button of document.querySelectorAll("[data-mode]")) {
      button.addEventListener("click", () => this.setMode(button.dataset.mode));
    }
    const zooms = { in: () => this.zoomBy(1.5), out: () => this.zoomBy(1 / 1.5), fit: () => this.fit(), one: () => this.setZoom(1) };
    for (const button of document.querySelectorAll("[data-zoom]")) button.addEventListener("click", zooms[button.dataset.zoom]);
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerleave", () => { this.pointer = null; this.writePixel(); });
    new ResizeObserver(() => { if (this.drawn) this.redraw(); }).observe(canvas);
  }

  setMode(mode) {
    this.mode = this.mode === mode ? "flip" : mode;
    if (mode === "wipe" && this.other === this.current) this.other = this.current === 0 ? 1 % this.group.pictures.length : 0;
    this.fit();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const step = 40;
    const actions = {
      e: () => this.set("view", this.view === "error" ? "radiance" : "error"),
      w: () => this.setMode("wipe"),
      g: () => this.setMode("grid"),
      f: () => this.fit(),
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
    if (/^[0-9]$/.test(event.key)) this.choose(this.group.pictures.findIndex((_, i) => this.keyOf(i) === Number(event.key)));
    else if (actions[event.key]) actions[event.key]();
    else return;
    event.preventDefault();
  }

  // The wheel scrolls the page until the picture has been clicked.
  wheel(event) {
    if (document.activeElement !== this.canvas) return;
    event.preventDefault();
    const area = this.areas().find(([, l, t, w, h]) => event.offsetX >= l && event.offsetX < l + w && event.offsetY >= t && event.offsetY < t + h);
    if (!area) return;
    const [, left, top, width, height] = area;
    this.zoomBy(Math.exp(-event.deltaY * 0.0015), (event.offsetX - left) / width, (event.offsetY - top) / height);
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
      this.writePixel();
    }
  }
}

const pictures = document.getElementById("pictures");
if (pictures) new Viewer(JSON.parse(pictures.textContent));
