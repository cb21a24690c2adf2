// What the canvas shows while a new image is prepared: the old one dimmed, and what the worker does.

const SHOWN_AFTER = 250; // milliseconds; a preparation that is shorter changes nothing on the screen
const COMPILING_AFTER = 2; // seconds; kernels from the cache are loaded within that time

export class Preparation {
  constructor(canvas, box) {
    Object.assign(this, { canvas, box, began: null, activity: "" });
    setInterval(() => this.show(), 250);
  }

  // A new image was asked for.
  begin() {
    this.began ??= performance.now();
    this.activity = "loading";
  }

  // `seconds` is about the time of a first compilation, undefined for engines that compile nothing.
  state(header, seconds) {
    this.activity = header.activity;
    this.firstCompile = seconds;
    if (header.state === "busy" && /loading|building/.test(header.activity)) this.began ??= performance.now();
    else if (header.state === "waiting") this.began ??= performance.now();
    else this.end();
  }

  // A frame of the new image has arrived, or there will be none.
  end() {
    this.began = null;
    this.show();
  }

  show() {
    const shown = this.began !== null && performance.now() - this.began > SHOWN_AFTER;
    this.box.hidden = !shown;
    this.canvas.classList.toggle("stale", shown);
    if (!shown) return;
    const seconds = (performance.now() - this.began) / 1000;
    const compiling = this.firstCompile && seconds > COMPILING_AFTER && this.activity.includes("compiling");
    const estimate = seconds < this.firstCompile ? `the first time takes about ${this.firstCompile} s` : "for the first time";
    const text = compiling ? `compiling, ${estimate}: ${Math.floor(seconds)} s so far` : `${this.activity || "waiting"} …`;
    if (this.box.textContent !== text) this.box.textContent = text;
  }
}
