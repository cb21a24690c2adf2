// Pictures come as deflated half floats in base64: all high bytes, then all low bytes.

const HALF_VALUES = (() => {
  const values = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const sign = bits & 0x8000 ? -1 : 1;
    const exponent = (bits >> 10) & 31;
    const fraction = bits & 1023;
    if (exponent === 31) values[bits] = fraction ? NaN : sign * Infinity;
    else if (exponent === 0) values[bits] = sign * fraction * 2 ** -24;
    else values[bits] = sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
  }
  return values;
})();

function base64Bytes(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Radiance of a picture: a Float32Array of height * width * 3.
async function decodePicture(data) {
  const planes = await inflate(base64Bytes(data));
  const count = planes.length / 2;
  const radiance = new Float32Array(count);
  for (let i = 0; i < count; i++) radiance[i] = HALF_VALUES[(planes[i] << 8) | planes[count + i]];
  return radiance;
}
