// An orbit camera: it orbits around its target, pans and zooms. Vectors are arrays of three numbers.

const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, s) => a.map((x) => s * x);
const length = (a) => Math.hypot(...a);
const unit = (a) => scaled(a, 1 / length(a));

const MAX_ELEVATION = 1.55; // radians; at the pole the right vector is undefined

// `axis` is a unit vector (Rodrigues' formula).
function rotated(v, axis, angle) {
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  return add(add(scaled(v, cos), cross(axis, v), sin), axis, dot(axis, v) * (1 - cos));
}

export class Orbit {
  constructor(camera) {
    Object.assign(this, camera);
  }

  axes() {
    const forward = unit(add(this.target, this.eye, -1));
    const right = unit(cross(forward, this.up));
    return { forward, right, upwards: cross(right, forward) };
  }

  get distance() {
    return length(add(this.target, this.eye, -1));
  }

  // Orbits by angles in radians: `around` the up axis, `over` towards it.
  turn(around, over) {
    const pole = unit(this.up);
    let offset = rotated(add(this.eye, this.target, -1), pole, this.mirror ? around : -around);
    const elevation = Math.asin(Math.min(Math.max(dot(unit(offset), pole), -1), 1));
    const limited = Math.min(Math.max(elevation + over, -MAX_ELEVATION), MAX_ELEVATION);
    const right = unit(cross(scaled(offset, -1), pole));
    offset = rotated(offset, right, elevation - limited);
    this.eye = add(this.target, offset);
  }

  // Pans by fractions of the window height: what is as far away as the target follows the pointer.
  pan(right, up, aspect) {
    const axes = this.axes();
    const window = this.windowHeight(aspect);
    const rightwards = this.mirror ? -right : right;
    const motion = add(scaled(axes.right, -rightwards * window), axes.upwards, -up * window);
    this.eye = add(this.eye, motion);
    this.target = add(this.target, motion);
  }

  windowHeight(aspect) {
    if (this.height) return this.height;
    const [fov, axis] = this.fov;
    const extent = 2 * this.distance * Math.tan((fov * Math.PI) / 360);
    return axis === "x" ? extent / aspect : extent;
  }

  // Multiplies the distance to the target, or the window of an orthographic camera, by `factor`.
  zoom(factor) {
    if (this.height) this.height *= factor;
    else this.eye = add(this.target, add(this.eye, this.target, -1), factor);
  }

  request() {
    return { type: "camera", eye: this.eye, target: this.target, up: this.up, height: this.height ?? null };
  }
}
