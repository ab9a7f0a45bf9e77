// Cast shadows, computed on the page as svv/fields/scene/shadows.py does: optical depths towards the light are summed up along sheared
// columns of a grid. Numbers are those of header.shadows; lengths are in cells of the grid.

const SOFT_MS = 30; // for which shadows are refined at a time

// The unit direction towards the light that casts shadows, in the world; `axes` are the camera's (lensOf). See Lamp.casting.
function shadowsFrom(lamp, axes, upperLeft) {
  let { azimuth, elevation, direction } = lamp;
  if (lamp.shadow_light?.length === 3) direction = lamp.shadow_light;
  else if (lamp.shadow_light) [azimuth, elevation] = lamp.shadow_light, direction = null;
  else if (direction === null && azimuth === 0 && elevation === 0) [azimuth, elevation] = upperLeft;
  if (direction !== null) return direction.map((v) => v / Math.hypot(...direction));
  const turn = lampTurn({ azimuth, elevation }, axes), back = axes.slice(6);
  return [0, 1, 2].map((row) => [0, 1, 2].reduce((sum, k) => sum + turn[3 * k + row] * back[k], 0));
}

// Unit vectors on a spiral, spread evenly over a cone of an opening angle in degrees around one (cone).
function coneAround(towards, softness, count) {
  if (softness === 0) return [towards];
  const cross = (a, b) => [0, 1, 2].map((k) => a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3]);
  const unit = (v) => v.map((x) => x / Math.hypot(...v)), least = towards.map(Math.abs).indexOf(Math.min(...towards.map(Math.abs)));
  const first = unit(cross(towards, [0, 1, 2].map((k) => Number(k === least)))), second = cross(towards, first);
  return Array.from({ length: count }, (_, n) => {
    const away = Math.tan((softness * Math.PI) / 360) * Math.sqrt((n + 0.5) / count), angle = Math.PI * (1 + Math.sqrt(5)) * (n + 0.5);
    return unit(towards.map((v, k) => v + away * (Math.cos(angle) * first[k] + Math.sin(angle) * second[k])));
  });
}

// The matter of a layer at the vertices of a coarse lattice: optical depth of one cell, and region (matter.py, _mean_depth).
class Matter {
  constructor({ shape, leaps, fields: { extinction, weights } }, { box, cells, first, count }, resolution) {
    const occupied = leaps.map((leap) => Number(leap === 0)), finer = resampled(occupied, shape, cells, resolution);
    Object.assign(this, { box, resolution, first }, verticesOf(finer.occupied, finer.shape));
    const log = samplerOf(extinction, 0), low = extinction.low[0], step = (extinction.high[0] - low) / 255;
    const whole = Array.from({ length: count > 1 ? count : 0 }, (_, region) => samplerOf(weights, region));
    this.depth = new Float32Array(this.places.length), this.region = new Uint8Array(this.places.length);
    const [, ny, nz] = this.size, side = 0.25 / resolution, [ex, ey, ez] = box.extent, [sx, sy, sz] = shape;
    for (let v = 0; v < this.places.length; v++) {
      const place = this.places[v], row = Math.floor(place / nz);
      const x = Math.min(Math.floor(row / ny) / resolution, ex), y = Math.min((row % ny) / resolution, ey), z = Math.min((place % nz) / resolution, ez);
      let sum = 0, most = -1;
      for (let k = 0; k < 8; k++) {
        const p = x + (k & 1 ? side : -side), q = y + (k & 2 ? side : -side), r = z + (k & 4 ? side : -side);
        if (p < 0 || q < 0 || r < 0 || p > ex || q > ey || r > ez) continue;
        const i = Math.min(Math.floor(p * cells), sx - 1), j = Math.min(Math.floor(q * cells), sy - 1), l = Math.min(Math.floor(r * cells), sz - 1);
        if (leaps[(i * sy + j) * sz + l] === 0) sum += Math.exp(Math.min(low + step * log(p, q, r), 9));
      }
      this.depth[v] = sum / (8 * resolution);
      for (let region = 0; region < whole.length; region++) {
        const own = whole[region](x, y, z);
        if (own > most) most = own, this.region[v] = region;
      }
    }
  }

  // Return where the vertex with a number is, in box coordinates.
  at(v) {
    const [, ny, nz] = this.size, place = this.places[v], row = Math.floor(place / nz);
    return [Math.floor(row / ny), row % ny, place % nz].map((n, k) => Math.min(n / this.resolution, this.box.extent[k]));
  }

  // Return the factors on the depths where they follow strokes, null where none does; see march.glsl, and strokesOf for the numbers.
  followed(paint, strokes) {
    if (!paint || !strokes.some((own) => own.some((v) => v !== 0))) return null;
    const channels = [0, 1, 2].map((c) => samplerOf(paint, c)), low = paint.low, step = paint.high.map((v, c) => (v - low[c]) / 255);
    return Float32Array.from(this.places, (_, v) => {
      const [gain, slope, mean, reach] = strokes[this.first + this.region[v]], place = this.at(v);
      const rgb = channels.map((byte, c) => Math.min(Math.max(low[c] + step[c] * byte(...place), 0), 1));
      const pale = slope < 0 ? Math.max(...rgb) : Math.min(...rgb);
      return Math.exp(gain + Math.min(Math.max(slope * (mean - pale), -reach), reach));
    });
  }
}

// Return a function from box coordinates to a channel's byte there, interpolated.
function samplerOf(field, channel) {
  const { grid: { size, places, resolution }, count, bytes } = field, dense = new Uint8Array(size[0] * size[1] * size[2]);
  for (let k = 0; k < count; k++) dense[places[k]] = bytes[channel * count + k];
  const along = size[1] * size[2], across = size[2];
  return (p, q, r) => {
    const x = p * resolution, y = q * resolution, z = r * resolution;
    const i = Math.min(Math.floor(x), size[0] - 2), j = Math.min(Math.floor(y), size[1] - 2), k = Math.min(Math.floor(z), size[2] - 2);
    const f = x - i, g = y - j, h = z - k, at = i * along + j * across + k;
    const row = (n) => dense[n] + h * (dense[n + 1] - dense[n]), slice = (n) => row(n) + g * (row(n + across) - row(n));
    return slice(at) + f * (slice(at + along) - slice(at));
  };
}

// Optical depths of one cell of a grid in the world, and where shadows are looked up: {low, spacing, size, depth, where}. `followed`:
// factors on the depths, or null.
function gridOf(matter, opacities, followed, cuts, around) {
  const { box, resolution, places, first } = matter, size = matter.size.map((n) => n + 2 * around), spacing = box.size / resolution;
  const low = box.low.map((v) => v - around * spacing), total = size[0] * size[1] * size[2];
  const grid = { low, spacing, size, depth: new Float32Array(total), where: new Uint8Array(total) };
  const [, ny, nz] = matter.size;
  for (let v = 0; v < places.length; v++) {
    const place = places[v], row = Math.floor(place / nz), x = Math.floor(row / ny), y = row % ny, z = place % nz, region = first + matter.region[v];
    let depth = matter.depth[v] * opacities[region] * (followed?.[v] ?? 1);
    for (const cut of cuts)
      if (cut.regions === 0 || cut.regions & (1 << region)) {
        const world = matter.at(v).map((own, k) => box.low[k] + box.size * own);
        depth *= Math.min(Math.max(0.5 - depthInCut(cut, world) / spacing, 0), 1);
      }
    const to = ((x + around) * size[1] + y + around) * size[2] + z + around;
    grid.depth[to] = depth, grid.where[to] = 1;
  }
  for (let k = 0; k < around; k++) grid.where = dilated(grid.where, size);
  return grid;
}

// How deep a place in the world lies in what a cut takes away, in world units; negative outside (Cut.depth).
function depthInCut({ planes, centre, axis, radius, outside }, p) {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  let depth = Math.min(1e9, ...planes.map((plane) => dot(plane, p) - plane[3]));
  if (centre !== null) {
    const away = p.map((v, k) => v - centre[k]), along = axis === null ? 0 : dot(away, axis);
    depth = Math.min(depth, radius - Math.hypot(...away.map((v, k) => v - (axis === null ? 0 : along * axis[k]))));
  }
  return outside ? -depth : depth;
}

// Mark the neighbours along the axes as well.
function dilated(where, [nx, ny, nz]) {
  const out = where.slice(), along = ny * nz;
  let at = 0;
  for (let x = 0; x < nx; x++)
    for (let y = 0; y < ny; y++)
      for (let z = 0; z < nz; z++, at++) {
        if (!where[at]) continue;
        if (x > 0) out[at - along] = 1;
        if (x < nx - 1) out[at + along] = 1;
        if (y > 0) out[at - nz] = 1;
        if (y < ny - 1) out[at + nz] = 1;
        if (z > 0) out[at - 1] = 1;
        if (z < nz - 1) out[at + 1] = 1;
      }
  return out;
}

// Return a function from places in a grid, in cells, to a value interpolated between its vertices; beyond them, that of the border.
function between(values, [nx, ny, nz]) {
  const along = ny * nz;
  return (x, y, z) => {
    const i = Math.min(Math.max(Math.floor(x), 0), nx - 2), j = Math.min(Math.max(Math.floor(y), 0), ny - 2), k = Math.min(Math.max(Math.floor(z), 0), nz - 2);
    const f = Math.min(Math.max(x - i, 0), 1), g = Math.min(Math.max(y - j, 0), 1), h = Math.min(Math.max(z - k, 0), 1), at = i * along + j * nz + k;
    const row = (n) => values[n] + h * (values[n + 1] - values[n]), slice = (n) => row(n) + g * (row(n + nz) - row(n));
    return slice(at) + f * (slice(at + along) - slice(at));
  };
}

// Return the sum of the optical depths of several layers on one grid around all (_together).
function togetherOf(grids, finest) {
  const [first] = grids, fits = (grid) => grid.spacing === first.spacing && grid.size.every((n, k) => n === first.size[k] && grid.low[k] === first.low[k]);
  if (grids.length === 1) return first;
  if (grids.every(fits)) {
    const depth = first.depth.map((_, k) => grids.reduce((sum, grid) => sum + grid.depth[k], 0));
    return { ...first, depth, where: first.where.map((_, k) => Number(grids.some((grid) => grid.where[k]))) };
  }
  const low = [0, 1, 2].map((k) => Math.min(...grids.map((grid) => grid.low[k])));
  const sides = low.map((v, k) => Math.max(...grids.map((grid) => grid.low[k] + grid.spacing * (grid.size[k] - 1))) - v);
  const spacing = Math.max(Math.min(...grids.map((grid) => grid.spacing)), Math.max(...sides) / finest);
  const size = sides.map((side) => Math.ceil(side / spacing - 1e-6) + 1), depth = new Float32Array(size[0] * size[1] * size[2]);
  for (const grid of grids) {
    const own = between(grid.depth, grid.size), ratio = spacing / grid.spacing, [p, q, r] = low.map((v, k) => (v - grid.low[k]) / grid.spacing);
    const [mx, my, mz] = grid.size.map((n) => n - 1), inside = (v, most) => v >= 0 && v <= most;
    for (let x = 0, at = 0; x < size[0]; x++)
      for (let y = 0; y < size[1]; y++)
        for (let z = 0; z < size[2]; z++, at++) {
          const i = p + ratio * x, j = q + ratio * y, k = r + ratio * z;
          if (inside(i, mx) && inside(j, my) && inside(k, mz)) depth[at] += ratio * own(i, j, k);
        }
  }
  return { low, spacing, size, depth, where: new Uint8Array(depth.length).fill(1) };
}

// Return a grid with half the vertices a side, whose cells are twice as large.
function coarserGrid(grid) {
  const [nx, ny, nz] = grid.size, size = grid.size.map((n) => (n >> 1) + 1), depth = new Float32Array(size[0] * size[1] * size[2]), where = new Uint8Array(depth.length);
  // Each vertex gives its depth to the one at its place, or in equal parts to those beside it.
  for (let x = 0, at = 0; x < nx; x++)
    for (let y = 0; y < ny; y++)
      for (let z = 0; z < nz; z++, at++) {
        if (!grid.where[at]) continue;
        const part = 0.25 * grid.depth[at] * 0.5 ** ((x & 1) + (y & 1) + (z & 1));
        for (let i = x >> 1; i <= (x + 1) >> 1; i++)
          for (let j = y >> 1; j <= (y + 1) >> 1; j++)
            for (let k = z >> 1; k <= (z + 1) >> 1; k++) {
              const to = (i * size[1] + j) * size[2] + k;
              depth[to] += part, where[to] = 1;
            }
      }
  return { low: grid.low, spacing: 2 * grid.spacing, size, depth, where };
}

// Compute the mean transmittance to a light from some directions where a grid says, in steps that end with a yield (_transmittance).
function* transmittance(grid, directions, numbers) {
  const { size, where } = grid, light = new Float32Array(grid.depth.length);
  for (const direction of directions) {
    const lengths = direction.map(Math.abs), axis = lengths.indexOf(Math.max(...lengths));
    addLight(grid, direction, axis, 1 / directions.length, numbers, light);
    yield;
  }
  let clear = grid.depth.map((depth, k) => (where[k] ? Math.max(Math.exp(-depth / numbers.clear_depth), numbers.least_clear) : 0)), found = light;
  for (let k = 0; k < numbers.deep; k++) {
    [found, clear] = carriedInside(found, clear, size, numbers.even);
    yield;
  }
  return found;
}

// Add a share of the transmittance in one direction, whose longest component is that of an axis (shadow_kernels.py).
function addLight({ size, depth, where }, direction, axis, share, { near, far }, light) {
  const others = [0, 1, 2].filter((k) => k !== axis), strides = [size[1] * size[2], size[2], 1], along = Math.abs(direction[axis]);
  const count = size[axis], [rows, columns] = others.map((k) => size[k]), [p, q] = others.map((k) => direction[k] / along);
  // Slice 0 is on the side of the light.
  const start = direction[axis] > 0 ? (count - 1) * strides[axis] : 0, slice = (direction[axis] > 0 ? -1 : 1) * strides[axis];
  const [down, right] = others.map((k) => strides[k]), step = 1 / along;
  const shifts = [(count - 1) * p, (count - 1) * q], first = shifts.map((shift) => Math.floor(Math.min(0, shift)));
  const [wide, high] = [rows, columns].map((n, k) => Math.floor(n - 1 + Math.max(0, shifts[k])) - first[k] + 2);
  const nearer = Array.from({ length: Math.ceil(far / step) }, (_, m) => Math.min(Math.max((m * step - near) / (far - near), 0), 1)), lag = nearer.length;
  const found = new Float32Array(wide * count * high), own = new Float32Array(count * high), total = new Float32Array(high);
  for (let u = 0; u < wide; u++) {
    own.fill(0), total.fill(0);
    for (let k = 0; k < count; k++) {
      const x = u + first[0] - k * p, y = first[1] - k * q, i = Math.floor(x), j = Math.floor(y), f = x - i, g = y - j;
      for (let side = 0; side < 2; side++) {
        const row = i + side, part = step * (side ? f : 1 - f);
        if (row < 0 || row >= rows) continue;
        const base = start + k * slice + row * down, to = k * high;
        for (let v = Math.max(0, -j), end = Math.min(high, columns - j); v < end; v++) own[to + v] += part * (1 - g) * depth[base + (j + v) * right];
        for (let v = Math.max(0, -j - 1), end = Math.min(high, columns - j - 1); v < end; v++) own[to + v] += part * g * depth[base + (j + v + 1) * right];
      }
    }
    for (let k = 0; k < count; k++) {
      const to = (u * count + k) * high;
      for (let v = 0; v < high; v++) {
        if (k >= lag) total[v] += own[(k - lag) * high + v];
        let sum = total[v];
        for (let m = 0; m < lag && m <= k; m++) sum += nearer[m] * own[(k - m) * high + v];
        found[to + v] = sum > 0 ? Math.exp(-sum) : 1;
      }
    }
  }
  for (let k = 0; k < count; k++) {
    const x = k * p - first[0], y = k * q - first[1], a = Math.floor(x), b = Math.floor(y), f = x - a, g = y - b;
    for (let i = 0; i < rows; i++) {
      const low = ((i + a) * count + k) * high + b, up = ((i + a + 1) * count + k) * high + b, base = start + k * slice + i * down;
      for (let j = 0; j < columns; j++) {
        const at = base + j * right;
        if (!where[at]) continue;
        light[at] += share * ((1 - f) * ((1 - g) * found[low + j] + g * found[low + j + 1]) + f * ((1 - g) * found[up + j] + g * found[up + j + 1]));
      }
    }
  }
}

// Let vertices that are not clear take part of the light of clearer ones in front of their surface (carry_inside).
function carriedInside(light, clear, [nx, ny, nz], even) {
  const after = new Float32Array(light.length), cleared = new Float32Array(light.length), along = ny * nz, around = [];
  for (let i = -1; i < 2; i++)
    for (let j = -1; j < 2; j++)
      for (let k = -1; k < 2; k++) {
        const axes = i * i + j * j + k * k;
        around.push({ i, j, k, by: i * along + j * nz + k, share: 0.5 ** axes, square: Math.max(axes, 1) });
      }
  for (let x = 1; x < nx - 1; x++)
    for (let y = 1; y < ny - 1; y++)
      for (let z = 1; z < nz - 1; z++) {
        const at = x * along + y * nz + z, own = clear[at];
        after[at] = light[at], cleared[at] = own;
        if (own <= 0 || own >= 0.99) continue;
        let a = 0, b = 0, c = 0, sum = 0;
        for (const { i, j, k, by, share } of around) {
          const weight = share * clear[at + by];
          a += i * weight, b += j * weight, c += k * weight, sum += weight;
        }
        let total = 0, weights = 0;
        for (const { i, j, k, by, share, square } of around) {
          const ahead = Math.max(a * i + b * j + c * k, 0), weight = share * clear[at + by] * ((ahead * ahead) / square + even * sum * sum);
          total += weight * light[at + by], weights += weight;
        }
        after[at] = own * light[at] + ((1 - own) * total) / weights;
        cleared[at] = own + ((1 - own) * sum) / 8;
      }
  return [after, cleared];
}

// The shadows that a page shows: coarse while something moves, then as the renderer has them.
class Shadows {
  constructor(header, content, textures) {
    Object.assign(this, { header, content, textures, numbers: header.shadows });
    this.wanted = this.shown = ""; // what the shadows are of, and whether they are fine
    this.work = null; // the refinement that is going on
    textures.make("Shadows", this.sizes(), 1);
  }

  // Numbers of vertices of the layers' lattices; an empty one until shadows are shown.
  sizes() {
    return this.header.layers.map((_, layer) => this.matters?.[layer].size ?? [1, 1, 1]);
  }

  // Prepare the shadows of a state before a camera; coarse ones unless they are known.
  prepare(state, axes) {
    if (state.lamp.shadow === 0) return;
    const { header, numbers } = this, cuts = cutsOf(state, header), towards = shadowsFrom(state.lamp, axes, numbers.upper_left);
    const strokes = state.painting === null ? [] : strokesOf(state, header);
    const matter = JSON.stringify([opacitiesOf(state), cuts, state.painting, strokes]), key = JSON.stringify([matter, towards, state.lamp.shadow_softness]);
    if (key === this.wanted) return;
    this.wanted = key;
    if (matter !== this.of) this.lay(matter, state, cuts, strokes);
    this.show(this.coarse, finished(transmittance(this.coarse, [towards], numbers)));
    this.work = transmittance(this.grid, coneAround(towards, state.lamp.shadow_softness, numbers.directions), numbers);
  }

  lay(matter, state, cuts, strokes) {
    const { header, content, numbers } = this;
    this.of = matter;
    if (!this.matters) {
      this.matters = header.layers.map((layer, number) => new Matter(content[number], layer, numbers.resolutions[number]));
      this.textures.make("Shadows", this.sizes(), 1);
    }
    const followed = this.matters.map((one, layer) => one.followed(content[layer].fields[`paint${state.painting}`], strokes));
    this.grid = togetherOf(this.matters.map((one, layer) => gridOf(one, opacitiesOf(state), followed[layer], cuts, numbers.around)), numbers.finest);
    this.coarse = coarserGrid(this.grid);
  }

  // Go on refining for some time, and return whether nothing is left to do.
  refine(ms = Infinity) {
    const end = performance.now() + ms;
    while (this.work !== null) {
      const { done, value } = this.work.next();
      if (done) this.show(this.grid, value), (this.work = null);
      if (performance.now() > end) break;
    }
    return this.work === null;
  }

  // Upload the transmittance at a grid's vertices.
  show(grid, found) {
    const at = between(found, grid.size), { around } = this.numbers;
    this.matters.forEach((matter, layer) => {
      const { size: [nx, ny, nz], places, box, resolution } = matter, bytes = new Uint8Array(nx * ny * nz).fill(255), spacing = box.size / resolution;
      const same = grid === this.grid && grid.spacing === spacing && box.low.every((v, k) => v - around * spacing === grid.low[k]);
      const ratio = spacing / grid.spacing, [p, q, r] = box.low.map((v, k) => (v - grid.low[k]) / grid.spacing);
      for (let v = 0; v < places.length; v++) {
        const row = Math.floor(places[v] / nz), x = Math.floor(row / ny), y = row % ny, z = places[v] % nz;
        const light = same ? found[((x + around) * grid.size[1] + y + around) * grid.size[2] + z + around] : at(p + ratio * x, q + ratio * y, r + ratio * z);
        bytes[places[v]] = 255 * Math.min(Math.max(light, 0), 1) + 0.5;
      }
      this.textures.fill("Shadows", layer, bytes);
    });
  }

  // Cells per box unit and begin of each layer's lattice in the texture.
  rows() {
    return this.header.layers.flatMap((_, layer) => [this.matters[layer].resolution, this.textures.all.Shadows.offsets[layer]]);
  }
}

// Return what a computation that is made in steps gives.
function finished(work) {
  for (;;) {
    const { done, value } = work.next();
    if (done) return value;
  }
}
