// Ink: outlines and the lines around sections, from what the march tells of each pixel, as svv/core/images/edges.py, outlines.py and
// svv/fields/scene/sections.py find and draw them. Their constants are those of header.lines. Images are arrays of w x h numbers, row
// by row from the top; a computation ends its parts with a yield, so that the page stays responsive.

// Whether there is ink in a state, and of which kinds.
function inkOf(state, header) {
  const shown = opacitiesOf(state).map((v) => v > 0), cut = cutsOf(state, header).length > 0;
  const outlines = header.regions.some(({ outline }) => outline > 0);
  return { outlines, sections: cut && header.regions.some(({ section_line }, k) => section_line > 0 && shown[k]) };
}

const ramp = (value, [low, high]) => {
  const t = Math.min(Math.max((value - low) / (high - low), 0), 1);
  return t * t * (3 - 2 * t);
};

// Smooth along both axes with a kernel; `beyond` gives values outside of a line of n, of which `at` returns one.
function smoothed(image, w, h, kernel, beyond) {
  const radius = kernel.length >> 1;
  const pass = (from, count, length, stride, next) => {
    const to = new Float32Array(from.length), line = new Float64Array(length + 2 * radius);
    for (let k = 0; k < count; k++) {
      const start = k * next, at = (i) => from[start + i * stride];
      for (let i = -radius; i < length + radius; i++) line[i + radius] = i >= 0 && i < length ? at(i) : beyond(at, i, length);
      for (let i = 0; i < length; i++) {
        let sum = 0;
        for (let m = 0; m < kernel.length; m++) sum += kernel[m] * line[i + m];
        to[start + i * stride] = sum;
      }
    }
    return to;
  };
  return pass(pass(image, w, h, w, 1), h, w, 1, w);
}

function kernelOf(sigma, radius) {
  const weights = Array.from({ length: 2 * radius + 1 }, (_, k) => Math.exp(-0.5 * ((k - radius) / sigma) ** 2)), sum = weights.reduce((a, b) => a + b);
  return weights.map((v) => v / sum);
}

// Beyond its borders, an image is extrapolated with the same slope (_gauss), or mirrored with its border (SciPy's reflect).
function sloped(at, i, n) {
  if (n === 1) return at(0);
  if (i >= 0 && i < n) return at(i);
  return i < 0 ? 2 * at(0) - sloped(at, -i, n) : 2 * at(n - 1) - sloped(at, 2 * (n - 1) - i, n);
}

function mirrored(at, i, n) {
  const k = ((i % (2 * n)) + 2 * n) % (2 * n);
  return at(k < n ? k : 2 * n - 1 - k);
}

const gauss = (image, w, h, sigma) => smoothed(image, w, h, kernelOf(sigma, Math.ceil(2.7 * sigma)), sloped);

// The change per pixel at a place, to the right and down.
function slopeAt(image, w, h, x, y) {
  const along = (at, stride, k, n) => (n === 1 ? 0 : k === 0 ? image[at + stride] - image[at] : k === n - 1 ? image[at] - image[at - stride] : 0.5 * (image[at + stride] - image[at - stride]));
  const at = y * w + x;
  return [along(at, 1, x, w), along(at, w, y, h)];
}

function addSquare(square, image, w, h, factor = () => 1) {
  for (let y = 0, at = 0; y < h; y++)
    for (let x = 0; x < w; x++, at++) {
      const [right, down] = slopeAt(image, w, h, x, y);
      square[at] += (right * right + down * down) * factor(at);
    }
}

// The ink of outlines, on the picture {w, h, alpha, depth, region} of a part of an image: how much of each pixel it covers, and the pixel
// whose region's pen draws it, as {coverage, source} (_draw); `pixelAt` is the width of a pixel at a distance.
function* outlinesOf(seen, pens, pixelAt, box, scale, c) {
  const { w, h } = seen, coverage = new Float32Array(w * h), source = new Int32Array(w * h).fill(-1), nearest = seen.depth.reduce((a, b) => (b < a ? b : a), Infinity);
  const lines = yield* linesOf(seen, pixelAt, box, scale, c);
  for (const [{ edges, ink }, thin] of [[lines.silhouettes, 1], [lines.creases, c.CREASE_WIDTH]]) {
    for (let e = 0; e < edges.x.length; e++) {
      const side = sideOf(edges, e, seen, pens, scale, nearest, c);
      if (side < 0) continue;
      const pen = pens[seen.region[side]];
      if (ink[e] * pen.outline > c.LEAST_COVERAGE) stroke(edges, e, ink[e], pen.outline, thin * scale * pen.outline_width, side, seen, coverage, source, c);
    }
    yield;
  }
  return { coverage, source };
}

// Silhouettes and creases, each with the strength of its points (lines_of).
function* linesOf({ w, h, alpha, depth, region }, pixelAt, box, scale, c) {
  const sigma = Math.max(c.LEAST_DEVIATION, c.CHANGE_DEVIATION * scale), share = gauss(alpha, w, h, sigma);
  yield;
  const smooth = gauss(alpha.map((a, k) => a * (Number.isNaN(depth[k]) ? 0 : depth[k])), w, h, sigma).map((v, k) => v / Math.max(share[k], 1e-4));
  yield;
  const square = new Float32Array(w * h);
  for (const number of new Set(region)) {
    if (number < 0) continue;
    addSquare(square, gauss(alpha.map((a, k) => (region[k] === number ? a : 0)), w, h, sigma), w, h);
    yield;
  }
  addSquare(square, smooth, w, h, (k) => (ramp(share[k], c.OPAQUE_ALPHAS) / Math.max(c.DEPTH_JUMP * box, c.DEPTH_JUMP_PIXELS * scale * pixelAt(smooth[k]), 1e-30)) ** 2);
  const rise = spreadOf(sigma, c) * Math.sqrt(2 * Math.PI), change = square.map((v) => Math.log1p(Math.sqrt(v) * rise));
  const edges = ridgesOf(change, w, h, sigma, Math.max(c.LEAST_DEVIATION, c.SMOOTHING_DEVIATION * scale), 0.5 * c.WEAK_CHANGE, c);
  yield;
  const ink = along(edges, edges.change.map((v) => ramp(v, [c.WEAK_CHANGE, c.STRONG_CHANGE])), w, h, c.EVENING_DEVIATION * Math.max(scale, 1), c);
  const reach = Math.ceil(c.PARTED_REACH * scale);
  for (let e = 0; e < ink.length; e++) {
    let most = 0;
    const [x, y] = pixelOf(edges, e, w, h);
    for (let j = Math.max(0, y - reach); j <= Math.min(h - 1, y + reach); j++)
      for (let i = Math.max(0, x - reach); i <= Math.min(w - 1, x + reach); i++) most = Math.max(most, alpha[j * w + i]);
    ink[e] *= most;
  }
  yield;
  const silhouettes = { edges, ink };
  return { silhouettes, creases: yield* creasesOf(silhouettes, smooth, share, w, h, pixelAt, box, scale, c) };
}

// Edges of the surface normal, and the strength of their points (_creases).
function* creasesOf({ edges: rims, ink }, depth, share, w, h, pixelAt, box, scale, c) {
  let whole = 0, weighted = 0;
  for (let k = 0; k < share.length; k++) (whole += share[k]), (weighted += share[k] * depth[k]);
  const away = weighted / Math.max(whole, 1e-30);
  let sigma = Math.max(2 * c.LEAST_DEVIATION, c.FOLD_DEVIATION * scale, Math.min((c.FOLD_BOX * box) / Math.max(pixelAt(away), 1e-30), 32 * scale));
  const factor = Math.min(Math.max(1, Math.floor(sigma / 1.5)), 3), planes = Array.from({ length: 5 }, () => new Float32Array(w * h));
  for (let y = 0, at = 0; y < h; y++)
    for (let x = 0; x < w; x++, at++) {
      const normal = [...slopeAt(depth, w, h, x, y), pixelAt(depth[at])], length = Math.max(Math.hypot(...normal), 1e-30);
      for (let k = 0; k < 3; k++) planes[k][at] = normal[k] / length;
      planes[3][at] = ramp(share[at], c.OPAQUE_ALPHAS);
    }
  for (let e = 0; e < ink.length; e++) {
    const [x, y] = pixelOf(rims, e, w, h);
    planes[4][y * w + x] = ink[e];
  }
  yield;
  const small = planes.map((plane) => pooled(plane, w, h, factor)), m = Math.ceil(w / factor), n = Math.ceil(h / factor), band = (c.BAND_DEVIATION * scale) / factor;
  const near = gauss(small[4], m, n, band), free = small[3].map((v, k) => v * Math.min(Math.max(1 - near[k] * factor * band * 4 * Math.sqrt(2 * Math.PI), 0), 1));
  sigma /= factor;
  const known = gauss(free, m, n, sigma);
  yield;
  const normal = small.slice(0, 3).map((part) => gauss(part.map((v, k) => v * free[k]), m, n, sigma).map((v, k) => v / Math.max(known[k], 1e-3)));
  yield;
  const length = known.map((_, k) => Math.max(Math.hypot(normal[0][k], normal[1][k], normal[2][k]), 1e-3)), square = new Float32Array(m * n);
  for (const part of normal) addSquare(square, part.map((v, k) => v / length[k]), m, n);
  const rise = spreadOf(sigma, c) * Math.sqrt(2 * Math.PI), edges = ridgesOf(square.map((v, k) => Math.sqrt(v) * rise * free[k]), m, n, sigma, 0.7 * sigma, 0.6 * c.FOLD_BOUNDS[0], c);
  const there = edges.change.map((v, e) => {
    const [x, y] = pixelOf(edges, e, m, n);
    return ramp(v, c.FOLD_BOUNDS) * ramp(known[y * m + x], [0.5, 0.8]);
  });
  const strength = along(edges, there, m, n, 1.8 * sigma, c), centre = 0.5 * (factor - 1), scaled = (list) => list.map((v) => v * factor + centre);
  return { edges: { ...edges, x: scaled(edges.x), y: scaled(edges.y), spacing: factor }, ink: strength };
}

const spreadOf = (sigma, c) => Math.sqrt(sigma ** 2 + c.SAMPLING_VARIANCE);

function pooled(image, w, h, factor) {
  const m = Math.ceil(w / factor), n = Math.ceil(h / factor), out = new Float32Array(m * n);
  for (let y = 0; y < n * factor; y++)
    for (let x = 0; x < m * factor; x++) out[Math.floor(y / factor) * m + Math.floor(x / factor)] += image[Math.min(y, h - 1) * w + Math.min(x, w - 1)] / factor ** 2;
  return out;
}

// Points where a measure of change, smoothed, is largest along the direction of its largest curvature (_ridges).
function ridgesOf(change, w, h, sigma, again, least, c) {
  const spread = spreadOf(sigma, c), image = gauss(change, w, h, again), found = { x: [], y: [], nx: [], ny: [], change: [], spacing: 1 };
  for (let y = 1; y < h - 1; y++)
    for (let x = 1; x < w - 1; x++) {
      const k = y * w + x;
      if (image[k] <= 0.5 * least) continue;
      const gx = 0.5 * (image[k + 1] - image[k - 1]), gy = 0.5 * (image[k + w] - image[k - w]);
      const xx = image[k + 1] - 2 * image[k] + image[k - 1], yy = image[k + w] - 2 * image[k] + image[k - w];
      const xy = 0.25 * (image[k + w + 1] - image[k + w - 1] - image[k - w + 1] + image[k - w - 1]);
      const bend = 0.5 * (xx + yy) - Math.hypot(0.5 * (xx - yy), xy), height = (-bend * (spread ** 2 + again ** 2 + 1 / 6) ** 1.5) / spread;
      if (height <= least) continue;
      const angle = 0.5 * Math.atan2(2 * xy, xx - yy) + 0.5 * Math.PI, nx = Math.cos(angle), ny = Math.sin(angle);
      const far = -(gx * nx + gy * ny) / Math.min(bend, -1e-12);
      if (Math.abs(far * nx) > 0.6 || Math.abs(far * ny) > 0.6) continue;
      found.x.push(x + far * nx), found.y.push(y + far * ny), found.nx.push(nx), found.ny.push(ny), found.change.push(height);
    }
  return found;
}

const within = (v, n) => Math.min(Math.max(Math.round(v), 0), n - 1);
// The pixel that contains a point, moved along its normal.
const pixelOf = (edges, e, w, h, reach = 0) => [within(edges.x[e] + reach * edges.nx[e], w), within(edges.y[e] + reach * edges.ny[e], h)];

// Average strengths twice along the lines, following their points (_along).
function along(edges, strength, w, h, even, c) {
  const count = edges.x.length, at = new Int32Array((w + 2) * (h + 2)).fill(count), path = [];
  for (const [i, j] of [[0, 0], [0, 2], [2, 0], [2, 2], [0, 1], [2, 1], [1, 0], [1, 2], [1, 1]])
    for (let e = 0; e < count; e++) {
      const [x, y] = pixelOf(edges, e, w, h);
      at[(y + i) * (w + 2) + x + j] = e;
    }
  const steps = Math.ceil((2 * even) / c.STRIDE), weights = Array.from({ length: steps }, (_, k) => Math.exp(-0.5 * (((k + 1) * c.STRIDE) / Math.max(even, 1e-3)) ** 2));
  const hits = new Int32Array(count * 2 * steps), parts = new Float64Array(count * 2 * steps);
  const clip = (v, n) => Math.min(Math.max(Math.round(v), -1), n) + 1;
  for (let e = 0; e < count; e++)
    for (const sign of [1, -1]) {
      let px = edges.x[e], py = edges.y[e], dx = -sign * edges.ny[e], dy = sign * edges.nx[e], one = 1;
      for (let k = 0; k < steps; k++) {
        px += c.STRIDE * dx, py += c.STRIDE * dy;
        const j = at[clip(py, h) * (w + 2) + clip(px, w)], to = (e * 2 + (sign > 0 ? 0 : 1)) * steps + k;
        if (j < count) {
          const tx = -edges.ny[j], ty = edges.nx[j], cosine = tx * dx + ty * dy, foot = (px - edges.x[j]) * tx + (py - edges.y[j]) * ty;
          one *= ramp(Math.abs(cosine), c.TURN_COSINES);
          dx = cosine < 0 ? -tx : tx, dy = cosine < 0 ? -ty : ty, px = edges.x[j] + foot * tx, py = edges.y[j] + foot * ty;
        }
        hits[to] = j, parts[to] = weights[k] * one;
      }
    }
  const total = 1 + 2 * weights.reduce((a, b) => a + b, 0);
  let known = Float64Array.from(strength);
  for (let turn = 0; turn < 2; turn++)
    known = known.map((own, e) => {
      let sum = own;
      for (let k = e * 2 * steps; k < (e + 1) * 2 * steps; k++) if (hits[k] < count) sum += known[hits[k]] * parts[k];
      return ramp(sum / total, c.WHOLE_BOUNDS);
    });
  return known;
}

// The pixel whose region's pen draws a point, -1 for none (_sides).
function sideOf(edges, e, { w, h, depth, region }, pens, scale, nearest, c) {
  let best = -1, pixel = -1;
  for (const way of [-1, 1, 0]) {
    const [x, y] = pixelOf(edges, e, w, h, way * Math.max(1, c.PARTED_REACH * scale)), at = y * w + x;
    if (region[at] < 0 || (way === 0 && pixel >= 0)) continue;
    const worth = pens[region[at]].outline + (1e-3 * nearest) / Math.max(depth[at], 1e-30);
    if (worth > best) best = worth, pixel = at;
  }
  return pixel;
}

// Draw a piece of a point's tangent; the most ink wins (_strokes).
function stroke(edges, e, ink, strength, full, side, { w, h }, coverage, source, c) {
  const width = full * (1 - c.PRESSURE_SHARE + c.PRESSURE_SHARE * ink), [column, row] = pixelOf(edges, e, w, h), reach = Math.ceil(0.5 * width + 1) + edges.spacing;
  const most = Math.min(width, 1), end = 0.75 * edges.spacing + 1, { x, y, nx, ny } = edges;
  for (let i = Math.max(0, row - reach); i <= Math.min(h - 1, row + reach); i++)
    for (let j = Math.max(0, column - reach); j <= Math.min(w - 1, column + reach); j++) {
      const across = Math.abs((j - x[e]) * nx[e] + (i - y[e]) * ny[e]), far = Math.abs((i - y[e]) * nx[e] - (j - x[e]) * ny[e]);
      if (far >= end || across >= 0.5 * width + 0.5) continue;
      const amount = ink * strength * Math.min(0.5 * width + 0.5 - across, most) * Math.min(end - far, 1);
      if (amount > coverage[i * w + j]) coverage[i * w + j] = amount, source[i * w + j] = side;
    }
}

// Blend the lines around sections over a layer of ink (with_lines); `share` is the part of each pixel's light that is from faces of cuts.
function* sectionLines({ w, h, region }, share, pens, scale, c, blend) {
  for (let number = 0; number < pens.length; number++) {
    const { section_line: line, outline_colour: colour } = pens[number], uneven = share.map((v, k) => (region[k] === number ? v : 0));
    if (line === 0 || uneven.reduce((a, b) => Math.max(a, b), 0) < c.LEAST_SHARE) continue;
    const width = Math.max(line * scale, 0.5), own = withoutSpots(uneven, w, h, width, c), blur = Math.max(0.35 * width, 0.7);
    const soften = (image, sigma) => smoothed(image, w, h, kernelOf(sigma, Math.floor(4 * sigma + 0.5)), mirrored), soft = soften(own, blur);
    yield;
    const most = soften(largestAround(soft, w, h, Math.ceil(c.BESIDE * width)), 0.5 * width);
    yield;
    const steepest = largestAround(steepnessOf(own, w, h, blur), w, h, Math.ceil(2 * blur));
    yield;
    for (let k = 0; k < own.length; k++) {
      const spread = most[k] / Math.max(Math.sqrt(2 * Math.PI) * steepest[k], 1e-6);
      const away = spread * Math.abs(quantile(Math.min(Math.max(soft[k] / Math.max(most[k], 1e-6), 1e-6), 1 - 1e-6)));
      const cover = Math.min(Math.max(0.5 * width + 0.5 - away, 0), Math.min(width, 1)) * Math.min(Math.max((most[k] - c.LEAST_SHARE) / (c.FULL_SHARE - c.LEAST_SHARE), 0), 1);
      if (cover > c.LEAST_COVERAGE) blend(k, cover, colour);
    }
  }
}

// The shares of a face without shallow spots (_without_spots).
function withoutSpots(own, w, h, width, c) {
  const reach = Math.ceil(c.BESIDE * width), full = largestAround(largestAround(own, w, h, reach).map((v) => -v), w, h, reach);
  return own.map((v, k) => v + ramp(v / Math.max(-full[k], 1e-6), c.DIPS) * (-full[k] - v));
}

// The largest value within some pixels along both axes.
function largestAround(image, w, h, reach) {
  const pass = (from, count, length, stride, next) => {
    const to = new Float32Array(from.length);
    for (let k = 0; k < count; k++)
      for (let i = 0; i < length; i++) {
        let most = -Infinity;
        for (let m = Math.max(0, i - reach); m <= Math.min(length - 1, i + reach); m++) most = Math.max(most, from[k * next + m * stride]);
        to[k * next + i * stride] = most;
      }
    return to;
  };
  return pass(pass(image, w, h, w, 1), h, w, 1, w);
}

// The length of the gradient by derivatives of a Gaussian (SciPy's gaussian_gradient_magnitude).
function steepnessOf(image, w, h, sigma) {
  const kernel = kernelOf(sigma, Math.floor(4 * sigma + 0.5)), radius = kernel.length >> 1, slope = kernel.map((v, k) => (v * (k - radius)) / sigma ** 2);
  const one = (across, down) => {
    const pass = (from, count, length, stride, next, weights) => {
      const to = new Float32Array(from.length);
      for (let k = 0; k < count; k++)
        for (let i = 0; i < length; i++) {
          let sum = 0;
          for (let m = 0; m < weights.length; m++) sum += weights[m] * mirrored((n) => from[k * next + n * stride], i + m - radius, length);
          to[k * next + i * stride] = sum;
        }
      return to;
    };
    return pass(pass(image, w, h, w, 1, down), h, w, 1, w, across);
  };
  const right = one(slope, kernel), below = one(kernel, slope);
  return right.map((v, k) => Math.hypot(v, below[k]));
}

// The quantile of the normal distribution (Acklam's rational approximations, off by at most 1.2e-9 of it).
function quantile(p) {
  const a = [-39.69683028665376, 220.9460984245205, -275.9285104469687, 138.357751867269, -30.66479806614716, 2.506628277459239];
  const b = [-54.47609879822406, 161.5858368580409, -155.6989798598866, 66.80131188771972, -13.28068155288572, 1];
  const c = [-0.007784894002430293, -0.3223964580411365, -2.400758277161838, -2.549732539343734, 4.374664141464968, 2.938163982698783];
  const d = [0.007784695709041462, 0.3224671290700398, 2.445134137142996, 3.754408661907416, 1];
  const sum = (list, x) => list.reduce((before, v) => before * x + v, 0);
  if (p > 0.97575) return -quantile(1 - p);
  if (p < 0.02425) {
    const q = Math.sqrt(-2 * Math.log(p));
    return sum(c, q) / sum(d, q);
  }
  const q = p - 0.5;
  return (q * sum(a, q * q)) / sum(b, q * q);
}

// Compute the ink of a camera's picture from what the march has told of its pixels, four numbers each (LINES in march.glsl), row 0 at the
// bottom: RGBA bytes of the same pixels, a layer to be blended over the picture.
function* inkLayer(told, camera, state, header) {
  const { width, height } = camera, c = header.lines, kinds = inkOf(state, header), floats = new Float32Array(told.buffer), ink = new Uint8Array(4 * width * height);
  const rows = [height, -1], columns = [width, -1], scale = Math.min(width, height) / c.VIEW, margin = Math.ceil(scale * (c.WIDEST + 8) + 4);
  for (let k = 0; k < width * height; k++)
    if (told[4 * k + 2] > 0) {
      const x = k % width, y = height - 1 - Math.floor(k / width);
      rows[0] = Math.min(rows[0], y), rows[1] = Math.max(rows[1], y), columns[0] = Math.min(columns[0], x), columns[1] = Math.max(columns[1], x);
    }
  if (rows[1] < 0) return ink;
  const top = Math.max(0, rows[0] - margin), left = Math.max(0, columns[0] - margin), h = Math.min(height, rows[1] + 1 + margin) - top, w = Math.min(width, columns[1] + 1 + margin) - left;
  const seen = { w, h, alpha: new Float32Array(w * h), depth: new Float32Array(w * h).fill(NaN), region: new Int16Array(w * h).fill(-1) }, share = new Float32Array(w * h), place = new Int32Array(w * h);
  for (let y = 0, at = 0; y < h; y++)
    for (let x = 0; x < w; x++, at++) {
      const from = place[at] = (height - 1 - top - y) * width + left + x;
      share[at] = floats[4 * from + 3];
      if (told[4 * from + 2] > 0) seen.alpha[at] = floats[4 * from], seen.depth[at] = floats[4 * from + 1], seen.region[at] = told[4 * from + 2] - 1;
    }
  const layer = new Float32Array(4 * w * h), blend = (k, amount, colour) => {
    const before = layer[4 * k + 3], after = amount + (1 - amount) * before;
    for (let n = 0; n < 3; n++) layer[4 * k + n] = (amount * colour[n] + (1 - amount) * before * layer[4 * k + n]) / after;
    layer[4 * k + 3] = after;
  };
  if (kinds.outlines) {
    const flat = camera.span_x === null ? (2 * Math.tan(camera.fov_x / 2)) / width : camera.span_x / width;
    const pixelAt = camera.span_x === null ? (distance) => flat * distance : () => flat, { coverage, source } = yield* outlinesOf(seen, header.regions, pixelAt, header.layers[0].box.size, scale, c);
    const region = seen.region.slice();
    for (let k = 0; k < coverage.length; k++)
      if (coverage[k] > c.LEAST_COVERAGE) {
        const number = seen.region[source[k]];
        blend(k, coverage[k], header.regions[number].outline_colour);
        if (region[k] < 0) region[k] = number;
      }
    seen.region = region;
  }
  if (kinds.sections) yield* sectionLines(seen, share, header.regions, scale, c, blend);
  for (let k = 0; k < w * h; k++) for (let n = 0; n < 4; n++) ink[4 * place[k] + n] = 255 * layer[4 * k + n] + 0.5;
  return ink;
}
