// A camera that orbits about a point, as the views of the scene do.

class Orbit {
  // told: centre, radius, fov (radians), span (width for parallel rays, or null), and the zoom at which the box is reached.
  constructor(told) {
    this.told = told;
    this.reset();
  }

  reset() {
    this.axes = [0, 0, -1, 0, 1, 0, 1, 0, 0]; // right, up and backwards in the world: the front of the orbit
    this.centre = [...this.told.centre];
    this.zoom = 1;
  }

  // What has been set, as plain values.
  get view() {
    return { axes: [...this.axes], centre: [...this.centre], zoom: this.zoom };
  }

  set view({ axes, centre, zoom }) {
    Object.assign(this, { axes: [...axes], centre: [...centre], zoom });
  }

  get right() { return this.axes.slice(0, 3); }
  get up() { return this.axes.slice(3, 6); }
  get back() { return this.axes.slice(6, 9); }

  // Turn about the camera's own axes, in radians: to the right, upwards, and clockwise in the picture.
  turn(right, up, roll = 0) {
    this.mix(0, 2, right), this.mix(1, 2, up), this.mix(0, 1, roll);
    this.straighten();
  }

  // Rotate two axes of the camera in their plane.
  mix(a, b, angle) {
    const c = Math.cos(angle), s = Math.sin(angle);
    for (let k = 0; k < 3; k++) {
      const first = this.axes[3 * a + k], second = this.axes[3 * b + k];
      this.axes[3 * a + k] = c * first + s * second;
      this.axes[3 * b + k] = c * second - s * first;
    }
  }

  // Remove the rounding errors of many turns.
  straighten() {
    const unit = (v) => v.map((x) => x / Math.hypot(...v));
    const cross = (a, b) => [0, 1, 2].map((k) => a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3]);
    const back = unit(this.back), right = unit(cross(this.up, back));
    this.axes = [...right, ...cross(back, right), ...back];
  }

  // Move in the plane of the picture, in fractions of its shorter side.
  pan(x, y) {
    const width = this.width();
    for (let k = 0; k < 3; k++) this.centre[k] -= width * (x * this.right[k] + y * this.up[k]);
  }

  closer(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, 0.25), 20);
  }

  // Return the width of what is seen at the centre, in world units.
  width() {
    const span = this.told.span ?? 2 * this.told.radius * Math.tan(this.told.fov / 2);
    return span / this.zoom;
  }

  // Return the camera for a picture of this size: its matrix (row by row), angle of view and span, as svv has them.
  camera(width, height) {
    // Zooming brings the camera closer until it would enter the box; from there on the angle of view narrows.
    const near = Math.min(this.zoom, Math.max(1, this.told.nearest)), distance = this.told.radius / near;
    const half = Math.tan(this.told.fov / 2) * (near / this.zoom) * (width / Math.min(width, height));
    const matrix = [0, 1, 2].flatMap((k) => [
      this.right[k], this.up[k], this.back[k], this.centre[k] + distance * this.back[k],
    ]);
    const span = this.told.span === null ? null : (this.told.span / this.zoom) * (width / Math.min(width, height));
    return { camera_to_world: [...matrix, 0, 0, 0, 1], fov_x: 2 * Math.atan(half), span_x: span, width, height };
  }
}

// Return a camera as the shader takes it: axes, position in box coordinates, and lens.
function lensOf(camera, box) {
  const m = camera.camera_to_world, { width, height } = camera, parallel = camera.span_x !== null;
  const focal = parallel ? (width / camera.span_x) * box.size : (0.5 * width) / Math.tan(camera.fov_x / 2);
  return {
    axes: [0, 1, 2].flatMap((column) => [m[column], m[4 + column], m[8 + column]]),
    position: [0, 1, 2].map((k) => (m[4 * k + 3] - box.low[k]) / box.size),
    lens: [focal, width / 2, height / 2, parallel ? 1 : 0],
  };
}

// Return the point at a distance along the ray through a place in a camera's picture, in pixels from its upper left.
function pointOf(camera, x, y, away) {
  const m = camera.camera_to_world, { width, height } = camera, parallel = camera.span_x !== null;
  const scale = parallel ? camera.span_x / width : (2 * Math.tan(camera.fov_x / 2)) / width;
  const across = scale * (x - width / 2), above = scale * (height / 2 - y), length = parallel ? 1 : Math.hypot(across, above, 1);
  return [0, 1, 2].map((k) => {
    const [right, up, back, position] = m.slice(4 * k, 4 * k + 4), aside = across * right + above * up;
    return position + (parallel ? aside : (away / length) * aside) - (away / length) * back;
  });
}
