// Mouse, touch and keyboard input on the image: orbit, pan and zoom of the camera, dragging of objects, the pixel probe.

import { ARROWS, element, pointerPosition, throttled } from "./socket.js";

const ORBIT_SPEED = 0.006; // radians per pixel of the screen
const ORBIT_STEP = 0.09; // radians per key press
const DRAG_STEP = 8; // pixels of the image per key press

export class ImageInput {
  // `toggle` stops and starts the render, `changed` is called after moves of the camera.
  constructor(canvas, overlay, chooser, socket, toggle, changed) {
    Object.assign(this, { canvas, overlay, chooser, socket, toggle, changed });
    this.moved = false; // whether the camera is another than that of the scene file
    this.orbit = null;
    this.draggables = [];
    this.pointers = new Map();
    this.dragged = null; // {id, dx, dy}: the object, and the offset from the pointer to its centre
    this.pendingPick = null; // a press whose pick has not been answered
    this.cursor = null; // the pixel that the keyboard probes
    this.sendCamera = throttled(() => { this.socket.send(this.orbit.request()); this.settle(); });
    this.sendDrag = throttled((position) => this.socket.send({ type: "drag", ...position }));
    this.sendProbe = throttled((position) => this.socket.send({ type: "probe", ...position }));
    this.listen();
  }

  scene(orbit, draggables) {
    this.orbit = orbit;
    this.draggables = draggables;
    const chosen = this.chooser.value;
    this.chooser.replaceChildren(new Option("the camera", ""), ...draggables.map((object) => new Option(object.name, object.id, false, object.id === chosen)));
    this.centre = null;
  }

  // ---- positions

  // The position of a pointer in pixels of the image.
  position(event) {
    return pointerPosition(this.canvas, event);
  }

  // Handles of point and spot lights. They are buttons, so that they take the keyboard focus.
  showHandles(places) {
    const existing = new Map(Array.from(this.overlay.querySelectorAll(".handle"), (handle) => [handle.dataset.id, handle]));
    for (const { id, x, y } of places) {
      const handle = existing.get(id) ?? this.addHandle(id);
      existing.delete(id);
      handle.style.left = `${(100 * x) / this.canvas.width}%`;
      handle.style.top = `${(100 * y) / this.canvas.height}%`;
      handle.hidden = x < 0 || y < 0 || x > this.canvas.width || y > this.canvas.height;
    }
    for (const handle of existing.values()) handle.remove();
  }

  addHandle(id) {
    const name = this.draggables.find((object) => object.id === id)?.name ?? id;
    const handle = element("button", { type: "button", className: "handle", ariaLabel: `${name}: arrow keys move it` });
    handle.dataset.id = id;
    handle.addEventListener("focus", () => this.choose(id));
    handle.addEventListener("keydown", (event) => this.key(event));
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      this.dragged = { id, dx: 0, dy: 0 };
    });
    handle.addEventListener("pointermove", (event) => { if (this.dragged?.id === id) this.dragTo(this.position(event)); });
    for (const end of ["pointerup", "pointercancel"]) handle.addEventListener(end, () => { this.dragged = null; });
    this.overlay.append(handle);
    return handle;
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
      this.dragged = this.pendingPick = null;
      return;
    }
    this.pendingPick = { ...this.position(event), moves: [] };
    this.socket.send({ type: "pick", x: this.pendingPick.x, y: this.pendingPick.y });
  }

  // The answer to a press, or to the choice of an object in the list.
  picked(header) {
    if (this.pickedByName && header.id === this.pickedByName) {
      this.centre = { id: header.id, x: header.x, y: header.y };
      this.pickedByName = null;
      const waiting = this.nudges ?? [];
      this.nudges = null;
      for (const [dx, dy] of waiting) this.nudge(dx, dy);
      return;
    }
    const pick = this.pendingPick;
    this.pendingPick = null;
    if (!pick) return;
    if (header.id) {
      this.dragged = { id: header.id, dx: header.x - pick.x, dy: header.y - pick.y };
      this.chooser.value = header.id;
      this.centre = null;
      if (pick.moves.length) this.dragTo(pick.moves.at(-1).position);
      if (pick.released) this.dragged = null;
    } else {
      for (const { dx, dy } of pick.moves) this.turn(dx, dy);
    }
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return this.probeAt(this.position(event));
    const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
    this.pointers.set(event.pointerId, event);
    if (this.pointers.size === 2) return this.pinch(event, before);
    if (this.pendingPick) return void this.pendingPick.moves.push({ dx, dy, position: this.position(event) });
    if (this.dragged) return this.dragTo(this.position(event));
    if (event.shiftKey || event.buttons & 2) this.pan(dx, dy);
    else this.turn(dx, dy);
  }

  release(event) {
    this.dragged = null;
    if (this.pendingPick) this.pendingPick.released = true; // its answer has not arrived
    this.pointers.delete(event.pointerId);
    this.canvas.classList.remove("dragging");
  }

  // Two fingers: their midpoint pans, their distance zooms.
  pinch(event, before) {
    const other = [...this.pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
    const distance = (pointer) => Math.hypot(pointer.clientX - other.clientX, pointer.clientY - other.clientY);
    this.pan((event.clientX - before.clientX) / 2, (event.clientY - before.clientY) / 2);
    if (distance(event) > 0) this.zoom(distance(before) / distance(event));
  }

  // The wheel zooms once the image has the focus; before, it scrolls the page.
  wheel(event) {
    if (document.activeElement !== this.canvas) return;
    event.preventDefault();
    this.zoom(Math.exp(event.deltaY * 0.0012));
  }

  dragTo(position) {
    this.sendDrag({ id: this.dragged.id, x: position.x + this.dragged.dx, y: position.y + this.dragged.dy });
  }

  probeAt(position) {
    const [x, y] = [Math.floor(position.x), Math.floor(position.y)];
    if (x >= 0 && y >= 0 && x < this.canvas.width && y < this.canvas.height) this.sendProbe({ x, y });
  }

  // ---- the camera

  turn(dx, dy) {
    this.moveCamera(() => this.orbit.turn(dx * ORBIT_SPEED, dy * ORBIT_SPEED));
  }

  pan(dx, dy) {
    const box = this.canvas.getBoundingClientRect();
    this.moveCamera(() => this.orbit.pan(dx / box.height, -dy / box.height, this.canvas.width / this.canvas.height));
  }

  zoom(factor) {
    this.moveCamera(() => this.orbit.zoom(factor));
  }

  moveCamera(move) {
    if (!this.orbit) return;
    move();
    this.moved = true;
    this.sendCamera();
  }

  // Calls `changed` once after a series of moves: browsers limit how often an address changes.
  settle() {
    clearTimeout(this.settling);
    this.settling = setTimeout(this.changed, 300);
  }

  // ---- keys

  choose(id) {
    this.chooser.value = id;
    this.centre = null;
    this.cursor = null;
    this.showCursor();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (ARROWS[event.key]) this.arrow(...ARROWS[event.key], event.shiftKey);
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
      this.nudge(DRAG_STEP * x, DRAG_STEP * y);
    } else if (shifted) {
      this.moveCamera(() => this.orbit.pan(0.04 * x, -0.04 * y, this.canvas.width / this.canvas.height));
    } else {
      this.moveCamera(() => this.orbit.turn(ORBIT_STEP * x, ORBIT_STEP * y));
    }
  }

  // Moves the chosen object by pixels of the image. The worker is asked once for the position of its centre.
  nudge(dx, dy) {
    if (!this.centre) {
      this.nudges = [...(this.nudges ?? []), [dx, dy]];
      if (this.nudges.length > 1) return;
      this.pickedByName = this.chooser.value;
      this.socket.send({ type: "pick", id: this.pickedByName });
      return;
    }
    this.centre.x += dx;
    this.centre.y += dy;
    this.sendDrag(this.centre);
  }

  startProbe() {
    this.cursor = { x: Math.floor(this.canvas.width / 2), y: Math.floor(this.canvas.height / 2) };
    this.showCursor();
  }

  showCursor() {
    this.overlay.querySelector(".cross")?.remove();
    if (!this.cursor) return;
    const cross = element("div", { className: "cross" });
    cross.style.left = `${(100 * (this.cursor.x + 0.5)) / this.canvas.width}%`;
    cross.style.top = `${(100 * (this.cursor.y + 0.5)) / this.canvas.height}%`;
    this.overlay.append(cross);
    this.probeAt(this.cursor);
  }
}
