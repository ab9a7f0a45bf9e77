// How far the picture can be trusted: the errors that its pixels are expected to have (svv/fields/scene/doubt.py).

// The state of which errors are known: without paint, and in the light of the views, without cast shadows.
function doubted(state) {
  return { ...state, painting: null, lamp: { ...state.lamp, azimuth: 0, elevation: 0, direction: null, intensity: 1, shadow: 0 } };
}

// Return the errors of the grid's cells, from their levels.
function errorsOf(levels, { most }) {
  return Float32Array.from(levels, (level) => most * (level / 255) ** 2);
}

// What the difference of a pixel from its neighbours counts for in a camera's picture (pixel_ratio).
function edgeOf({ edge, pixel, centre, most_ratio }, { camera_to_world: m, width, fov_x, span_x }) {
  if (pixel === null) return edge;
  const away = Math.max(Math.hypot(...centre.map((v, k) => m[4 * k + 3] - v)), 1e-9);
  const own = span_x === null ? (2 * Math.tan(fov_x / 2) * away) / width : span_x / width;
  return edge * Math.min(Math.max(pixel / Math.max(own, 1e-12), 1 / most_ratio), most_ratio);
}

// Return the error of a pixel, from what the march has left there, to the right and below: null where nothing is visible.
function errorOf(doubt, camera, own, right, below) {
  if (own[3] === 0) return null;
  const change = [0, 1, 2].reduce((sum, c) => sum + Math.abs(right[c] - own[c]) + Math.abs(below[c] - own[c]), 0) / (3 * 65535);
  return Math.min(doubt.most * (own[3] / 65535) ** 2 + edgeOf(doubt, camera) * change, 1);
}
