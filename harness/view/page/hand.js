// Mouse, fingers and keys on the image: they turn, shift and zoom the camera, drag things, or probe a pixel.

import { lastOfFrame } from "./link.js";

const TURN = 0.006; // radians a pixel of the screen
const STEP = 0.09; // radians a key
const NUDGE = 8; // pixels of the image a key

export class Hand {
  constructor(canvas, marks, chooser, link, toggle) {
    Object.assign(this, { canvas, marks, chooser, link, toggle });
    this.orbit = null;
    this.movables = [];
    this.pointers = new Map();
    this.held = null; // what is dragged: {id, dx, dy} from the pointer to its middle
    this.asked = null; // a press whose answer has not come
    this.cursor = null; // the probe of the keyboard
    this.sendCamera = lastOfFrame(() => this.link.send(this.orbit.request()));
    this.sendDrag = lastOfFrame((place) => this.link.send({ do: "drag", ...place }));
    this.sendProbe = lastOfFrame((place) => this.link.send({ do: "probe", ...place }));
    this.listen();
  }

  scene(orbit, movables) {
    this.orbit = orbit;
    this.movables = movables;
    const chosen = this.chooser.value;
    this.chooser.replaceChildren(new Option("the camera", ""), ...movables.map((thing) => new Option(thing.name, thing.id, false, thing.id === chosen)));
    this.place = null;
  }

  // ---- places

  // Where a pointer is, in pixels of the image.
  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return { x: ((event.clientX - box.left) / box.width) * this.canvas.width, y: ((event.clientY - box.top) / box.height) * this.canvas.height };
  }

  // Marks of point lights, which are buttons: they have the keyboard's focus, too.
  handles(places) {
    const known = new Map(Array.from(this.marks.querySelectorAll(".handle"), (mark) => [mark.dataset.id, mark]));
    for (const { id, x, y } of places) {
      const mark = known.get(id) ?? this.mark(id);
      known.delete(id);
      mark.style.left = `${(100 * x) / this.canvas.width}%`;
      mark.style.top = `${(100 * y) / this.canvas.height}%`;
      mark.hidden = x < 0 || y < 0 || x > this.canvas.width || y > this.canvas.height;
    }
    for (const mark of known.values()) mark.remove();
  }

  mark(id) {
    const mark = document.createElement("button");
    mark.type = "button";
    mark.className = "handle";
    mark.dataset.id = id;
    mark.setAttribute("aria-label", `${this.movables.find((thing) => thing.id === id)?.name ?? id}: arrow keys move it`);
    mark.addEventListener("focus", () => this.choose(id));
    mark.addEventListener("keydown", (event) => this.key(event));
    mark.addEventListener("pointerdown", (event) => {
      mark.setPointerCapture(event.pointerId);
      this.held = { id, dx: 0, dy: 0 };
    });
    mark.addEventListener("pointermove", (event) => { if (this.held?.id === id) this.dragTo(this.at(event)); });
    for (const end of ["pointerup", "pointercancel"]) mark.addEventListener(end, () => { this.held = null; });
    this.marks.append(mark);
    return mark;
  }

  // ---- pointers

  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => this.release(event));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.chooser.addEventListener("change", () => this.choose(this.chooser.value));
  }

  press(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    this.canvas.classList.add("dragging");
    this.pointers.set(event.pointerId, event);
    if (this.pointers.size > 1 || event.button === 2 || event.shiftKey) {
      this.held = this.asked = null;
      return;
    }
    this.asked = { ...this.at(event), moves: [] };
    this.link.send({ do: "grab", x: this.asked.x, y: this.asked.y });
  }

  // The answer to a press, or to the choice of a thing by its name.
  grabbed(header) {
    if (this.naming && header.id === this.naming) {
      this.place = { id: header.id, x: header.x, y: header.y };
      this.naming = null;
      const waiting = this.nudges ?? [];
      this.nudges = null;
      for (const [dx, dy] of waiting) this.nudge(dx, dy);
      return;
    }
    const asked = this.asked;
    this.asked = null;
    if (!asked) return;
    if (header.id) {
      this.held = { id: header.id, dx: header.x - asked.x, dy: header.y - asked.y };
      this.chooser.value = header.id;
      this.place = null;
      if (asked.moves.length) this.dragTo(asked.moves.at(-1).at);
      if (asked.released) this.held = null;
    } else {
      for (const { dx, dy } of asked.moves) this.turn(dx, dy);
    }
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return this.probeAt(this.at(event));
    const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
    this.pointers.set(event.pointerId, event);
    if (this.pointers.size === 2) return this.pinch(event, before);
    if (this.asked) return void this.asked.moves.push({ dx, dy, at: this.at(event) });
    if (this.held) return this.dragTo(this.at(event));
    if (event.shiftKey || event.buttons & 2) this.shift(dx, dy);
    else this.turn(dx, dy);
  }

  release(event) {
    this.held = null;
    if (this.asked) this.asked.released = true; // its answer is on the way
    this.pointers.delete(event.pointerId);
    this.canvas.classList.remove("dragging");
  }

  // Two fingers: their middle shifts, their distance zooms.
  pinch(event, before) {
    const other = [...this.pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
    const apart = (pointer) => Math.hypot(pointer.clientX - other.clientX, pointer.clientY - other.clientY);
    this.shift((event.clientX - before.clientX) / 2, (event.clientY - before.clientY) / 2);
    if (apart(event) > 0) this.zoom(apart(before) / apart(event));
  }

  // The wheel scrolls the page until the image has been clicked.
  wheel(event) {
    if (document.activeElement !== this.canvas) return;
    event.preventDefault();
    this.zoom(Math.exp(event.deltaY * 0.0012));
  }

  dragTo(place) {
    this.sendDrag({ id: this.held.id, x: place.x + this.held.dx, y: place.y + this.held.dy });
  }

  probeAt(place) {
    const [x, y] = [Math.floor(place.x), Math.floor(place.y)];
    if (x >= 0 && y >= 0 && x < this.canvas.width && y < this.canvas.height) this.sendProbe({ x, y });
  }

  // ---- the camera

  turn(dx, dy) {
    this.change(() => this.orbit.turn(dx * TURN, dy * TURN));
  }

  shift(dx, dy) {
    const box = this.canvas.getBoundingClientRect();
    this.change(() => this.orbit.shift(dx / box.height, -dy / box.height, this.canvas.width / this.canvas.height));
  }

  zoom(factor) {
    this.change(() => this.orbit.zoom(factor));
  }

  change(act) {
    if (!this.orbit) return;
    act();
    this.sendCamera();
  }

  // ---- keys

  choose(id) {
    this.chooser.value = id;
    this.place = null;
    this.cursor = null;
    this.showCursor();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (arrows[event.key]) this.arrow(...arrows[event.key], event.shiftKey);
    else if (event.key === "+" || event.key === "=") this.zoom(0.9);
    else if (event.key === "-") this.zoom(1 / 0.9);
    else if (event.key === "o") this.choose(this.chooser.options[(this.chooser.selectedIndex + 1) % this.chooser.options.length].value);
    else if (event.key === "p") this.startProbe();
    else if (event.key === "Escape") this.choose("");
    else if (event.key === " " && event.target === this.canvas) this.toggle();
    else return;
    event.preventDefault();
  }

  arrow(x, y, shifted) {
    if (this.cursor) {
      const step = shifted ? 10 : 1;
      this.cursor.x = Math.min(Math.max(this.cursor.x + step * x, 0), this.canvas.width - 1);
      this.cursor.y = Math.min(Math.max(this.cursor.y + step * y, 0), this.canvas.height - 1);
      this.showCursor();
    } else if (this.chooser.value) {
      this.nudge(NUDGE * x, NUDGE * y);
    } else if (shifted) {
      this.change(() => this.orbit.shift(0.04 * x, -0.04 * y, this.canvas.width / this.canvas.height));
    } else {
      this.change(() => this.orbit.turn(STEP * x, STEP * y));
    }
  }

  // Moves the chosen thing by pixels of the image; where it is, the worker knows.
  nudge(dx, dy) {
    if (!this.place) {
      this.nudges = [...(this.nudges ?? []), [dx, dy]];
      if (this.nudges.length > 1) return;
      this.naming = this.chooser.value;
      this.link.send({ do: "grab", id: this.naming });
      return;
    }
    this.place.x += dx;
    this.place.y += dy;
    this.sendDrag(this.place);
  }

  startProbe() {
    this.cursor = { x: Math.floor(this.canvas.width / 2), y: Math.floor(this.canvas.height / 2) };
    this.showCursor();
  }

  showCursor() {
    this.marks.querySelector(".cross")?.remove();
    if (!this.cursor) return;
    const cross = document.createElement("div");
    cross.className = "cross";
    cross.style.left = `${(100 * (this.cursor.x + 0.5)) / this.canvas.width}%`;
    cross.style.top = `${(100 * (this.cursor.y + 0.5)) / this.canvas.height}%`;
    this.marks.append(cross);
    this.probeAt(this.cursor);
  }
}
