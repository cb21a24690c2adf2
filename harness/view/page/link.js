// The socket to this tab's worker: JSON text there; back come a JSON header and bytes (harness/view/messages.py).

const decoder = new TextDecoder();

export class Link {
  // `hear` has a function for each `is` of a message: (header, bytes) => void.
  constructor(desk, hear) {
    this.hear = hear;
    const base = new URL(".", location.href);
    this.socket = new WebSocket(new URL(`desk/${desk}`, base.href.replace(/^http/, "ws")));
    this.socket.binaryType = "arraybuffer";
    this.socket.addEventListener("message", (event) => this.receive(event.data));
    this.socket.addEventListener("close", () => this.closed());
  }

  receive(data) {
    const length = new DataView(data).getUint32(0, true);
    const header = JSON.parse(decoder.decode(new Uint8Array(data, 4, length)));
    this.hear[header.is]?.(header, data.slice(4 + length));
  }

  send(request) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(request));
  }

  closed() {
    if (!this.leaving) showProblem("The server has gone, or has closed this page. Start raybench view again, or load the page again.");
    this.hear.closed?.();
  }
}

export const byId = (id) => document.getElementById(id);

export function showProblem(text) {
  const place = byId("problem");
  place.hidden = !text;
  place.textContent = text ?? "";
}

// Calls `act` with the last value given, once a frame of the screen at most.
export function lastOfFrame(act) {
  let waiting = null;
  return (value) => {
    if (waiting === null) requestAnimationFrame(() => { const last = waiting; waiting = null; act(last.value); });
    waiting = { value };
  };
}

// Numbers as people read them.
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

// A file for the folder of downloads.
export function download(name, bytes, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([bytes], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

export function themeButton() {
  const root = document.documentElement;
  byId("theme").addEventListener("click", () => {
    const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = dark ? "light" : "dark";
  });
}
