// From radiance to display: each view writes red, green and blue (0-255) of one pixel.

const ERROR_DECADES = [-5, 0];
const LUMINANCE_STOPS = [-8, 4];

function srgb(x) {
  const clipped = Math.min(Math.max(x, 0), 1);
  return 255 * (clipped <= 0.0031308 ? 12.92 * clipped : 1.055 * clipped ** (1 / 2.4) - 0.055);
}

function luminance(radiance, i) {
  return 0.2126 * radiance[i] + 0.7152 * radiance[i + 1] + 0.0722 * radiance[i + 2];
}

// Mean over channels of (A-R)^2 / (R^2 + eps) at the pixel that starts at i.
function relativeSquaredError(a, r, i, epsilon) {
  let sum = 0;
  for (let c = i; c < i + 3; c++) sum += (a[c] - r[c]) ** 2 / (r[c] ** 2 + epsilon);
  return sum / 3;
}

function signedDifference(a, r, i) {
  const reference = luminance(r, i);
  return (luminance(a, i) - reference) / (Math.abs(reference) + 0.05);
}

function mapped(stops, share) {
  const place = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const low = Math.min(Math.floor(place), stops.length - 2);
  return stops[low].map((value, c) => value + (place - low) * (stops[low + 1][c] - value));
}

// The views; `other` is the reference's radiance. A non-finite pixel is drawn in pure magenta.
function viewPixel(view, radiance, other, i, gain, epsilon, maps) {
  if (!Number.isFinite(radiance[i] + radiance[i + 1] + radiance[i + 2])) return [255, 0, 255];
  if (view === "error" && other) {
    const decade = Math.log10(Math.max(gain * relativeSquaredError(radiance, other, i, epsilon), 1e-12));
    return mapped(maps.magma, (decade - ERROR_DECADES[0]) / (ERROR_DECADES[1] - ERROR_DECADES[0]));
  }
  if (view === "signed" && other) return mapped(maps.signed, 0.5 + 0.5 * gain * signedDifference(radiance, other, i));
  if (view === "luminance") {
    const stop = Math.log2(Math.max(gain * luminance(radiance, i), 1e-9));
    return mapped(maps.magma, (stop - LUMINANCE_STOPS[0]) / (LUMINANCE_STOPS[1] - LUMINANCE_STOPS[0]));
  }
  return [srgb(gain * radiance[i]), srgb(gain * radiance[i + 1]), srgb(gain * radiance[i + 2])];
}

// Draws a view of a picture, of the canvas's size.
function paintView(canvas, view, radiance, other, gain, epsilon, maps) {
  const context = canvas.getContext("2d");
  const image = context.createImageData(canvas.width, canvas.height);
  for (let i = 0, o = 0; i < radiance.length; i += 3, o += 4) {
    image.data.set(viewPixel(view, radiance, other, i, gain, epsilon, maps), o);
    image.data[o + 3] = 255;
  }
  context.putImageData(image, 0, 0);
}

// The bar beside a scale.
function colourBar(stops) {
  const bar = document.createElement("i");
  bar.style.background = `linear-gradient(to right, ${stops.map((colour) => `rgb(${colour})`).join(",")})`;
  return bar;
}

function scaleWords(view, gain) {
  const limit = (1 / gain).toPrecision(3);
  const ends = ERROR_DECADES.map((decade) => (10 ** decade / gain).toExponential(1));
  return {
    radiance: null,
    error: ["magma", `(A−R)² / (R² + ε) against the reference R, mean of channels, ${ends[0]} … ${ends[1]}, logarithmic`],
    signed: ["signed", `luminance (A−R) / (|R| + 0.05) against the reference R, −${limit} (blue, too dark) … +${limit} (red, too bright)`],
    difference: ["signed", `luminance (A−B) / (|B| + 0.05), −${limit} (blue: A is darker) … +${limit} (red: A is brighter)`],
    luminance: ["magma", `luminance 2^${LUMINANCE_STOPS[0]} … 2^${LUMINANCE_STOPS[1]}, over 2^exposure, logarithmic`],
  }[view];
}
