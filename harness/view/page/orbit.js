// The camera: how it turns around its target, shifts and goes nearer. Vectors are arrays of three numbers.

const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, s) => a.map((x) => s * x);
const length = (a) => Math.hypot(...a);
const unit = (a) => scaled(a, 1 / length(a));

const STEEPEST = 1.55; // radians above or below; at the pole there is no right

// `axis` is unit (Rodrigues' formula).
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

  // Turns by angles in radians: `around` the up axis, `over` towards it.
  turn(around, over) {
    const pole = unit(this.up);
    let arm = rotated(add(this.eye, this.target, -1), pole, -around);
    const height = Math.asin(Math.min(Math.max(dot(unit(arm), pole), -1), 1));
    const wanted = Math.min(Math.max(height + over, -STEEPEST), STEEPEST);
    const right = unit(cross(scaled(arm, -1), pole));
    arm = rotated(arm, right, height - wanted);
    this.eye = add(this.target, arm);
  }

  // Shifts by shares of the window's height, so that what is at the target's distance follows the pointer.
  shift(right, up, aspect) {
    const axes = this.axes();
    const window = this.windowHeight(aspect);
    const way = add(scaled(axes.right, -right * window), axes.upwards, -up * window);
    this.eye = add(this.eye, way);
    this.target = add(this.target, way);
  }

  windowHeight(aspect) {
    if (this.height) return this.height;
    const [fov, axis] = this.fov;
    const extent = 2 * this.distance * Math.tan((fov * Math.PI) / 360);
    return axis === "x" ? extent / aspect : extent;
  }

  // Goes to `factor` times the distance, or shows as many times more.
  zoom(factor) {
    if (this.height) this.height *= factor;
    else this.eye = add(this.target, add(this.eye, this.target, -1), factor);
  }

  request() {
    return { do: "camera", eye: this.eye, target: this.target, up: this.up, height: this.height ?? null };
  }
}
