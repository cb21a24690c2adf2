// The histogram of a displayed image, by channel, and the shares of pixels at the ends of the scale.

const COLOURS = ["#ff5c5c", "#5fd35f", "#6ca6ff"];
const LABEL_HEIGHT = 14;

// `pixels` are RGBA bytes. Returns the shares of pixels that are black, and that have a channel at 255.
export function drawHistogram(canvas, pixels) {
  const counts = COLOURS.map(() => new Uint32Array(256));
  let [black, clipped] = [0, 0];
  for (let i = 0; i < pixels.length; i += 4) {
    const [r, g, b] = [pixels[i], pixels[i + 1], pixels[i + 2]];
    counts[0][r]++;
    counts[1][g]++;
    counts[2][b]++;
    if (r + g + b === 0) black++;
    if (r === 255 || g === 255 || b === 255) clipped++;
  }
  const context = canvas.getContext("2d");
  const height = canvas.height - LABEL_HEIGHT;
  context.clearRect(0, 0, canvas.width, canvas.height);
  // the ends are left out of the scale: a black background would flatten the rest
  const most = Math.max(1, ...counts.map((channel) => Math.max(...channel.subarray(1, 255))));
  context.globalCompositeOperation = "lighter";
  counts.forEach((channel, index) => {
    context.fillStyle = COLOURS[index];
    channel.forEach((count, value) => {
      const bar = Math.min(1, Math.sqrt(count / most)) * height;
      context.fillRect((value * canvas.width) / 256, height - bar, canvas.width / 256, bar);
    });
  });
  context.globalCompositeOperation = "source-over";
  const shares = { black: (4 * black) / pixels.length, clipped: (4 * clipped) / pixels.length };
  context.fillStyle = "#fff";
  context.font = "11px system-ui, sans-serif";
  context.fillText(`black ${percent(shares.black)}`, 4, canvas.height - 3);
  context.textAlign = "right";
  context.fillText(`clipped ${percent(shares.clipped)}`, canvas.width - 4, canvas.height - 3);
  context.textAlign = "left";
  canvas.setAttribute("aria-label", `Histogram: ${percent(shares.black)} of the pixels are black, ${percent(shares.clipped)} clipped`);
  return shares;
}

// A text in place of the histogram.
export function drawNote(canvas, text) {
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  context.fillStyle = "#fff";
  context.font = "11px system-ui, sans-serif";
  context.textAlign = "center";
  context.fillText(text, canvas.width / 2, canvas.height / 2);
  context.textAlign = "left";
  canvas.setAttribute("aria-label", text);
}

const percent = (share) => `${(100 * share).toFixed(1)} %`;
