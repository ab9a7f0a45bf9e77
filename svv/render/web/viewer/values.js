// The volume's values where a scene shows something, read off as `svv probe` does (svv/fields/radiance/kept_values.py).

const LARGEST = 65472, COARSE = 64; // of codes, of which 0 is no value
const BESIDE_BOX = 1e-3, LEAST_WEIGHT = 1e-6, HALF = 0.5;

class Values {
  // told: of each layer, null where it keeps none; text: their compressed bytes.
  constructor(told, text) {
    Object.assign(this, { told, text, known: [] });
  }

  // Return what is read off at a point of a layer, for the values `within` an interval if those have none between; null for nothing.
  async at(layer, point, within) {
    const kept = this.told[layer];
    if (kept === null) return null;
    this.known[layer] ??= this.lattice(layer);
    return readAt(kept, await this.known[layer], point, within);
  }

  async lattice(layer) {
    const before = this.told.slice(0, layer).flatMap((kept) => kept?.bytes ?? []).reduce((a, b) => a + b, 0), { bytes, shape } = this.told[layer];
    const content = Uint8Array.from(atob(this.text), (letter) => letter.charCodeAt(0)).subarray(before, before + bytes[0] + bytes[1]);
    const [there, codes] = await Promise.all([unpacked(content.subarray(0, bytes[0])), unpacked(content.subarray(bytes[0]))]);
    return restored(cellsFromBits(there, shape), codes, shape);
  }
}

// Return the codes of all vertices from the differences of those that are seen from what their neighbours predict (kept_kernels.py).
function restored(seen, halves, [nx, ny, nz]) {
  const own = new Uint16Array(seen.length), count = halves.length / 2, across = nz, along = ny * nz;
  let number = 0, last = 0, at = 0;
  for (let x = 0; x < nx; x++)
    for (let y = 0; y < ny; y++)
      for (let z = 0; z < nz; z++, at++) {
        if (!seen[at]) continue;
        const a = z > 0 && seen[at - 1], b = y > 0 && seen[at - across], c = x > 0 && seen[at - along];
        let total = 0, terms = 0;
        if (a && b && seen[at - across - 1]) total += own[at - 1] + own[at - across] - own[at - across - 1], terms++;
        if (a && c && seen[at - along - 1]) total += own[at - 1] + own[at - along] - own[at - along - 1], terms++;
        if (b && c && seen[at - along - across]) total += own[at - across] + own[at - along] - own[at - along - across], terms++;
        if (terms === 0) {
          if (a) total += own[at - 1], terms++;
          if (b) total += own[at - across], terms++;
          if (c) total += own[at - along], terms++;
        }
        const predicted = terms === 0 ? last : Math.floor((2 * total + terms) / (2 * terms)), folded = halves[number] | (halves[count + number] << 8);
        own[at] = last = (predicted + ((folded >> 1) ^ -(folded & 1))) & 65535;
        number++;
      }
  return { seen, own };
}

// Return value, uncertainty, and on which side of it the volume's may be: -1, 0 or 1; null where none is kept.
function readAt(kept, { seen, own }, point, within) {
  const { shape, cells, box, interval: [low, high], step, nearest, whole } = kept, unit = (v) => Math.min(Math.max(v, 0), 1);
  const place = point.map((v, k) => ((v - box.low[k]) / box.size) * cells);
  if (place.some((v, k) => v < -BESIDE_BOX || v > shape[k] - 1 + BESIDE_BOX)) return null;
  const first = place.map((v, k) => Math.min(Math.max(Math.floor(v), 0), shape[k] - 2)), part = place.map((v, k) => unit(v - first[k]));
  const code = (offset) => {
    const [x, y, z] = offset.map((v, k) => first[k] + v);
    if (x < 0 || y < 0 || z < 0 || x >= shape[0] || y >= shape[1] || z >= shape[2]) return 0;
    const at = (x * shape[1] + y) * shape[2] + z;
    return seen[at] ? 1 + own[at] * (kept.coarse ? COARSE : 1) : 0;
  };
  const width = (high - low) / LARGEST, corners = [];
  for (let k = 0; k < 8; k++) {
    const offset = [k >> 2, (k >> 1) & 1, k & 1], own = code(offset), weight = offset.reduce((w, side, axis) => w * (side ? part[axis] : 1 - part[axis]), 1);
    corners.push({ code: own, value: low + width * (own - 1), weight: own > 0 ? weight : 0 });
  }
  const weights = corners.reduce((sum, { weight }) => sum + weight, 0), known = corners.filter((corner) => corner.code > 0);
  if (weights < HALF) return null;
  const all = known.map(({ value }) => value), spread = Math.max(...all) - Math.min(...all);
  const counts = known.filter(({ weight }) => weight > LEAST_WEIGHT);
  const beyond = Number(counts.some((corner) => corner.code === LARGEST + 1)) - Number(counts.some((corner) => corner.code === 1));
  if (nearest) {
    const exact = whole && step < 1, fits = ({ value }) => within !== null && value >= within[0] - LEAST_WEIGHT && value <= within[1] + LEAST_WEIGHT;
    const worth = (corner) => corner.weight + (corner.weight > 0 && fits(corner) ? 1 : 0), best = corners.reduce((a, b) => (worth(b) > worth(a) ? b : a));
    return { value: exact ? Math.round(best.value) : best.value, uncertainty: spread + (exact ? 0 : 0.5 * step), beyond };
  }
  const missed = width * Math.hypot(...[[0, 1, 2], [1, 0, 2], [2, 0, 1]].map((order) => bend(kept, code, part, order, step / width)));
  const value = corners.reduce((sum, corner) => sum + corner.weight * (corner.code > 0 ? corner.value : 0), 0) / weights;
  return { value, uncertainty: step + missed + (known.length === 8 ? 0 : spread), beyond };
}

// What linear interpolation along the first axis of an order misses (_bends).
function bend({ finer, finest }, code, part, order, rounding) {
  const [axis, second, third] = order, along = part[axis], offset = [0, 0, 0], edges = [];
  const reach = Math.min(2 * finer[axis] * along * (1 - along), 0.5 * Math.min(finer[axis], finest));
  for (let j = 0; j < 2; j++)
    for (let k = 0; k < 2; k++) {
      const line = [-1, 0, 1, 2].map((i) => {
        offset[axis] = i, offset[second] = j, offset[third] = k;
        return code(offset);
      });
      let most = 0, both = true;
      for (let m = 0; m < 2; m++) {
        const [a, b, c] = line.slice(m, m + 3), there = a > 0 && b > 0 && c > 0;
        both &&= there;
        if (there) most = Math.max(most, Math.abs(a - 2 * b + c) - rounding);
      }
      edges.push((both ? reach : 1) * most);
    }
  const across = [0, 1].map((k) => edges[k] * (1 - part[second]) + edges[2 + k] * part[second]);
  return across[0] * (1 - part[third]) + across[1] * part[third];
}

// Return what was read off in words (Probe.describe), empty for nothing.
function valueInWords(kept, read, unit) {
  if (read === null) return "";
  const { interval: [low, high], range, mean_of, array, time } = kept, margin = 1e-6 * (high - low), number = (v, digits) => Number(v.toPrecision(digits));
  const [least, most] = range ?? [-Infinity, Infinity];
  const side = read.beyond < 0 && least < low - margin ? "at most " : read.beyond > 0 && most > high + margin ? "at least " : "";
  const off = side === "" && read.uncertainty ? ` ± ${number(read.uncertainty, 2)}` : "";
  return `; ${side}${number(read.value, 5)}${off}${unit && ` ${unit}`}${array ? ` of ${array}` : ""}${mean_of > 1 ? ` (mean of ${mean_of} voxels)` : ""}${time === null ? "" : ` at time ${number(time, 6)}`}`;
}
