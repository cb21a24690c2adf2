// The live plot: error over seconds on logarithmic axes, with the targets as lines, in SVG.

const SPACE = "http://www.w3.org/2000/svg";
const EDGE = { left: 58, right: 14, top: 16, bottom: 44 };
const MARKS = ["circle", "square", "triangle", "diamond"];

function element(name, attributes, text) {
  const made = document.createElementNS(SPACE, name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === "style") made.style.cssText = value; // the page's policy forbids the attribute
    else made.setAttribute(key, value);
  }
  if (text !== undefined) made.textContent = text;
  return made;
}

// Ticks between two powers of ten, as [logarithm, label]: whole powers, and on short axes 2 and 5 times them.
function ticks(low, high) {
  const made = [];
  for (let exponent = Math.floor(low); exponent <= Math.ceil(high); exponent++) {
    for (const digit of high - low < 2 ? [1, 2, 5] : [1]) {
      const plain = exponent >= -3 && exponent <= 3;
      const label = plain ? String(Number((digit * 10 ** exponent).toPrecision(1))) : `${digit}e${exponent}`;
      made.push([exponent + Math.log10(digit), label]);
    }
  }
  return made.filter(([place]) => place >= low && place <= high);
}

function markPath(kind, x, y, r) {
  if (kind === 1) return `M${x - r} ${y - r}h${2 * r}v${2 * r}h${-2 * r}z`;
  if (kind === 2) return `M${x} ${y - 1.2 * r}l${1.2 * r} ${2.2 * r}h${-2.4 * r}z`;
  if (kind === 3) return `M${x} ${y - 1.3 * r}l${1.3 * r} ${1.3 * r}l${-1.3 * r} ${1.3 * r}l${-1.3 * r} ${-1.3 * r}z`;
  return `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0z`;
}

// Contestants: [{name, points: [[seconds, error, spp]], crossings: [{target, seconds, state}]}]; no time is marked for targets
// that are undecided.
export function drawPlot(svg, contestants, targets, isUndecided) {
  const width = Math.max(svg.clientWidth, 240); // drawn at its display size, so that text keeps its size
  const height = Math.min(Math.max(0.45 * width, 260), 460);
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const points = contestants.flatMap((contestant) => contestant.points).filter(([seconds, error]) => seconds > 0 && error > 0);
  svg.replaceChildren();
  if (points.length === 0) return;
  const xs = points.map(([seconds]) => Math.log10(seconds));
  const ys = [...points.map(([, error]) => Math.log10(error)), ...targets.map(Math.log10)];
  const [x0, x1] = [Math.min(...xs) - 0.05, Math.max(Math.max(...xs), Math.min(...xs) + 0.5) + 0.05];
  const [y0, y1] = [Math.min(...ys) - 0.15, Math.max(...ys) + 0.15];
  const px = (x) => EDGE.left + ((x - x0) / (x1 - x0)) * (width - EDGE.left - EDGE.right);
  const py = (y) => EDGE.top + ((y1 - y) / (y1 - y0)) * (height - EDGE.top - EDGE.bottom);
  const right = width - EDGE.right;
  for (const [place, label] of ticks(x0, x1)) {
    const x = px(place);
    svg.append(element("line", { x1: x, x2: x, y1: EDGE.top, y2: height - EDGE.bottom, class: "grid" }));
    svg.append(element("text", { x, y: height - EDGE.bottom + 18, "text-anchor": "middle" }, label));
  }
  for (const [place, label] of ticks(y0, y1)) {
    const y = py(place);
    svg.append(element("line", { x1: EDGE.left, x2: right, y1: y, y2: y, class: "grid" }));
    svg.append(element("text", { x: EDGE.left - 8, y: y + 4, "text-anchor": "end" }, label));
  }
  svg.append(element("text", { x: (EDGE.left + right) / 2, y: height - 6, "text-anchor": "middle", class: "faint" }, "seconds of rendering"));
  svg.append(element("text", { x: 14, y: (height - EDGE.bottom) / 2, "text-anchor": "middle", class: "faint", transform: `rotate(-90 14 ${(height - EDGE.bottom) / 2})` }, "relative mean squared error"));
  for (const target of targets) {
    const y = py(Math.log10(target));
    svg.append(element("line", { x1: EDGE.left, x2: right, y1: y, y2: y, class: "target" }));
    svg.append(element("text", { x: right, y: y - 5, "text-anchor": "end" }, `target ${target}`));
  }
  contestants.forEach((contestant, index) => drawContestant(svg, contestant, index, px, py, isUndecided));
  svg.setAttribute("aria-label", description(contestants));
}

function drawContestant(svg, contestant, index, px, py, isUndecided) {
  const colour = `var(--contestant-${index + 1})`;
  const places = contestant.points.filter(([seconds, error]) => seconds > 0 && error > 0).map(([s, e]) => [px(Math.log10(s)), py(Math.log10(e))]);
  if (places.length === 0) return;
  const path = places.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
  svg.append(element("path", { d: path, fill: "none", style: `stroke: ${colour}`, "stroke-width": 2 }));
  for (const [x, y] of places) svg.append(element("path", { d: markPath(index, x, y, 3), style: `fill: ${colour}` }));
  for (const crossing of contestant.crossings.filter((c) => !isUndecided(c.target) && (c.state === "reached" || c.state === "at_first"))) {
    const [x, y] = [px(Math.log10(crossing.seconds)), py(Math.log10(crossing.target))];
    svg.append(element("path", { d: markPath(index, x, y, 8), fill: "none", style: `stroke: ${colour}`, "stroke-width": 2.5 }));
  }
}

// A description for screen readers.
function description(contestants) {
  const sentences = contestants.filter((contestant) => contestant.points.length).map((contestant) => {
    const [seconds, error] = contestant.points.at(-1);
    return `${contestant.name}: error ${error?.toPrecision(2)} after ${seconds.toPrecision(2)} seconds`;
  });
  return `Error over time. ${sentences.join("; ")}`;
}

export const markName = (index) => MARKS[index];
