// Plots: Plotly draws what is seen. Its code lies in the page, deflated, and is read when the first plot is drawn.

const NARROW = 700; // Below this many pixels the legend stands beneath the plot.
const SUBPLOT = 250; // Subplots stand side by side only while each has this many pixels.
const LONG_NAME = 18; // Names of this many letters or more are broken into two lines.
const PRINTED = 660; // Width in pixels of a plot on paper.
const CONFIG = {
  displaylogo: false,
  modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"], ["toImage"]],
};

let library = null;

function readLibrary() {
  library ??= inflate(base64Bytes(document.getElementById("plotly").textContent)).then((code) => {
    const script = document.createElement("script");
    script.textContent = new TextDecoder().decode(code);
    document.head.append(script);
    return window.Plotly;
  });
  return library;
}

const AXIS = /^[xy]axis\d*$/; // Keys of a layout that are axes.

function axisOf(layout, letter, index) {
  return layout[`${letter}axis${index ? index + 1 : ""}`];
}

function countSubplots(layout) {
  let count = 0;
  while (axisOf(layout, "x", count)) count++;
  return count;
}

// A name in two lines where it is long.
function wrapped(name) {
  const spaces = Array.from(name.matchAll(/ /g), (found) => found.index);
  if (name.length < LONG_NAME || !spaces.length) return name;
  const middle = spaces.reduce((a, b) => (Math.abs(b - name.length / 2) < Math.abs(a - name.length / 2) ? b : a));
  return `${name.slice(0, middle)}<br>${name.slice(middle + 1)}`;
}

// The layout of a plot for a width in pixels: columns of subplots, what axes show, place of the legend.
function layoutFor(described, width) {
  const layout = structuredClone(described.layout);
  const entries = described.data.filter((trace) => trace.showlegend).map((trace) => trace.name.length);
  entries.push(...layout.shapes.filter((shape) => shape.showlegend).map((shape) => shape.name.length));
  const right = described.legend === "right" && width >= NARROW;
  const legendWidth = Math.max(0, ...entries) * 6.2 + 60;
  const count = countSubplots(layout);
  const room = right ? width - legendWidth : width;
  const columns = Math.max(1, Math.min(described.columns, Math.floor(room / SUBPLOT)));
  const rows = Math.ceil(count / columns);
  const names = layout.yaxis.ticktext || [];
  const wraps = names.some((name) => name.length >= LONG_NAME) && width < NARROW;
  const scale = width === PRINTED ? 0.7 : 1; // Two plots a page.
  const rowHeight = Math.max(scale * described.height, wraps ? 30 * names.length + 60 : 130);
  for (let k = 0; k < count; k++) {
    const [x, y, below] = [axisOf(layout, "x", k), axisOf(layout, "y", k), axisOf(layout, "x", k + columns)];
    const inner = k % columns > 0;
    if (6.5 * y.title.text.length > rowHeight - 90) y.title.text = wrapped(y.title.text);
    if (y.ticktext && width < NARROW) y.ticktext = y.ticktext.map(wrapped);
    const texts = y.ticktext && !(inner && !described.texts) ? 6.5 * Math.max(...y.ticktext.flatMap((text) => text.split("<br>")).map((line) => line.length)) : 40;
    if (!x.tickvals) x.nticks = Math.max(3, Math.round((room / columns - texts) / 60));
    if (inner && !described.texts) y.showticklabels = false;
    const titleOf = (index) => axisOf(described.layout, "y", index).title.text;
    if (inner && titleOf(k) === titleOf(k - 1)) y.title.text = "";
    if (below && below.title.text === x.title.text) x.title.text = "";
  }
  const lines = right ? 0 : Math.min(8, Math.ceil(entries.length / Math.max(1, Math.floor(width / legendWidth))));
  layout.grid = { rows, columns, pattern: "independent", xgap: described.texts ? 0.22 : 0.08, ygap: Math.min(0.45, 75 / rowHeight) };
  layout.width = width;
  layout.height = Math.round(rowHeight * rows + 19 * lines + (right ? 0 : 20));
  layout.margin = { l: 12, r: 12, t: layout.title ? 58 : 34, b: 12 };
  layout.legend = right
    ? { x: 1.01, xanchor: "left", y: 1, yanchor: "top" }
    : { orientation: "h", x: 0, y: 0, xref: "container", yref: "container", yanchor: "bottom", maxheight: 170 };
  if (!described.data.some((trace) => trace.showlegend && trace.hoverinfo !== "skip")) Object.assign(layout.legend, { itemclick: false, itemdoubleclick: false });
  layout.dragmode = matchMedia("(pointer: coarse)").matches ? false : "zoom"; // A finger scrolls the page.
  return layout;
}

async function drawPlot(element, width = element.clientWidth) {
  const described = element.described ??= JSON.parse(element.nextElementSibling.textContent);
  const Plotly = await readLibrary();
  const config = { ...CONFIG, toImageButtonOptions: { format: "svg", filename: element.dataset.plot } };
  await Plotly.react(element, described.data, layoutFor(described, width), config);
  element.dataset.drawn = width;
}

function seenPlots() {
  return Array.from(document.querySelectorAll(".chart[data-plot]")).filter((element) => element.clientWidth > 0);
}

async function drawSeen() {
  for (const element of seenPlots()) {
    if (Number(element.dataset.drawn) === element.clientWidth) continue;
    try {
      await drawPlot(element);
    } catch (error) {
      console.error(error);
      element.textContent = `The plot cannot be drawn: ${error.message}.`;
    }
  }
}

// Zooms by a factor around the middle, or moves by shares of what is seen.
function moveAxes(element, factor, right, up) {
  const changes = {};
  for (const [name, axis] of Object.entries(element.layout)) {
    if (!AXIS.test(name) || !axis.range || axis.matches) continue;
    const [low, high] = axis.range;
    const middle = (low + high) / 2 + (name[0] === "x" ? right : up) * (high - low);
    const half = ((high - low) / 2) * factor;
    changes[`${name}.range`] = [middle - half, middle + half];
  }
  window.Plotly.relayout(element, changes);
}

function resetAxes(element) {
  const changes = {};
  for (const [name, axis] of Object.entries(element.described.layout)) {
    if (!AXIS.test(name)) continue;
    if (axis.range && !axis.autorange) changes[`${name}.range`] = axis.range;
    else changes[`${name}.autorange`] = axis.autorange || true;
  }
  window.Plotly.relayout(element, changes);
}

const PLOT_KEYS = {
  "+": (element) => moveAxes(element, 1 / 1.5, 0, 0),
  "-": (element) => moveAxes(element, 1.5, 0, 0),
  0: resetAxes,
  ArrowLeft: (element) => moveAxes(element, 1, -0.1, 0),
  ArrowRight: (element) => moveAxes(element, 1, 0.1, 0),
  ArrowUp: (element) => moveAxes(element, 1, 0, 0.1),
  ArrowDown: (element) => moveAxes(element, 1, 0, -0.1),
};

for (const element of document.querySelectorAll(".chart[data-plot]")) {
  element.addEventListener("keydown", (event) => {
    const act = PLOT_KEYS[event.key];
    if (!act || event.ctrlKey || event.metaKey || !element.dataset.drawn) return;
    event.preventDefault();
    act(element);
  });
}

let resizing = 0;
addEventListener("resize", () => {
  clearTimeout(resizing);
  resizing = setTimeout(drawSeen, 150);
});
document.addEventListener("change", (event) => {
  if (event.target.matches(".tabs > input")) drawSeen();
});
addEventListener("beforeprint", () => { for (const element of seenPlots()) drawPlot(element, PRINTED); });
addEventListener("afterprint", drawSeen);
drawSeen();
