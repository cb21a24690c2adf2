// The socket to the worker of this tab: sends JSON, receives messages of a JSON header and bytes (harness/view/messages.py).

const decoder = new TextDecoder();

export class WorkerSocket {
  // `handlers` has a function (header, bytes) => void for each `type` of a message, `state` among them.
  constructor(page, handlers) {
    this.handlers = { warning: (header) => byId("warnings")?.append(listItem(header.text)), ...handlers };
    const base = new URL(".", location.href);
    this.connection = new WebSocket(new URL(`socket/${page}`, base.href.replace(/^http/, "ws")));
    this.connection.binaryType = "arraybuffer";
    this.connection.addEventListener("message", (event) => this.receive(event.data));
    this.connection.addEventListener("close", () => this.closed());
    byId("stop").addEventListener("click", () => this.send({ type: "stop" }));
    addEventListener("pagehide", () => this.close());
  }

  receive(data) {
    const length = new DataView(data).getUint32(0, true);
    const header = JSON.parse(decoder.decode(new Uint8Array(data, 4, length)));
    this.handlers[header.type]?.(header, data.slice(4 + length));
  }

  send(request) {
    if (this.connection.readyState === WebSocket.OPEN) this.connection.send(JSON.stringify(request));
    else if (this.connection.readyState === WebSocket.CLOSED) this.closed();
  }

  close() {
    this.closing = true;
    this.connection.close();
  }

  closed() {
    if (!this.closing) showError("The connection to the server is closed. Reload the page; if the server has ended, start raybench view again and open the address that it prints.");
    this.handlers.closed?.();
    this.handlers.state({ state: "stopped", activity: "no connection" });
  }
}

export const byId = (id) => document.getElementById(id);

export function showError(text) {
  const box = byId("error");
  box.hidden = !text;
  box.textContent = text ?? "";
}

// Shows what the worker does. Returns whether it rests: then a start is possible, and no stop.
export function showState(header) {
  if (byId("state").textContent !== header.state) byId("state").textContent = header.state; // screen readers say what is written
  byId("activity").textContent = header.activity;
  const resting = !["busy", "waiting"].includes(header.state);
  byId("stop").disabled = resting;
  byId("start").disabled = !resting;
  return resting;
}

// What is wrong with the first control whose value cannot be used; null where all can be.
export function invalidEntry(form) {
  const found = Array.from(form.elements).find((control) => control.willValidate && !control.validity.valid);
  for (let around = found?.closest("details"); around; around = around.parentElement.closest("details")) around.open = true;
  return found ? `${found.labels[0]?.firstChild.textContent.trim() ?? found.name}: ${found.validationMessage}` : null;
}

// Calls `act` with the latest value, at most once per animation frame.
export function throttled(act) {
  let waiting = null;
  return (value) => {
    if (waiting === null) requestAnimationFrame(() => { const last = waiting; waiting = null; act(last.value); });
    waiting = { value };
  };
}

// A number with an SI prefix.
export function count(value, unit = "") {
  if (value === null || value === undefined) return "–";
  for (const [size, letter] of [[1e9, " G"], [1e6, " M"], [1e3, " k"]]) {
    if (value >= size) return `${(value / size).toPrecision(3)}${letter}${unit}`;
  }
  return `${Number(value.toPrecision(3))} ${unit}`.trim();
}

export function duration(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  if (seconds < 1) return `${(1000 * seconds).toFixed(seconds < 0.1 ? 1 : 0)} ms`;
  return seconds < 120 ? `${seconds.toFixed(seconds < 10 ? 2 : 1)} s` : `${(seconds / 60).toFixed(1)} min`;
}

// Offers bytes as a download.
export function download(name, bytes, type) {
  const link = element("a", { href: URL.createObjectURL(new Blob([bytes], { type })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

// A new element with these properties and children.
export function element(tag, properties = {}, ...children) {
  const { role, ariaLabel, ...rest } = properties; // as attributes: Firefox before 119 does not reflect these
  const made = Object.assign(document.createElement(tag), rest);
  if (role) made.setAttribute("role", role);
  if (ariaLabel) made.setAttribute("aria-label", ariaLabel);
  made.append(...children);
  return made;
}

export const listItem = (text) => element("li", {}, text);

// The step of an arrow key.
export const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

// The position of a pointer in pixels of a canvas.
export function pointerPosition(canvas, event) {
  const box = canvas.getBoundingClientRect();
  return { x: ((event.clientX - box.left) / box.width) * canvas.width, y: ((event.clientY - box.top) / box.height) * canvas.height };
}
