// The scene's fields, from the text in the page to bytes on the vertices of grids.

// Return the bytes of a page's base64 text, inflated.
async function inflated(text) {
  return unpacked(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)));
}

async function unpacked(packed) {
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Return the occupied cells, one byte each in raster order, z fastest, from bits.
function cellsFromBits(bits, shape) {
  const cells = new Uint8Array(shape[0] * shape[1] * shape[2]);
  for (let k = 0; k < cells.length; k++) cells[k] = (bits[k >> 3] >> (7 - (k & 7))) & 1;
  return cells;
}

// Return occupancy at another resolution: a coarser cell is occupied if any of its parts is.
function resampled(occupied, shape, cells, resolution) {
  const part = resolution >= cells ? resolution / cells : 1, whole = resolution < cells ? cells / resolution : 1;
  const size = shape.map((n) => Math.ceil(n / whole) * part);
  const out = new Uint8Array(size[0] * size[1] * size[2]);
  const scale = whole / part; // cells of the occupancy per cell of the result
  if (whole > 1) {
    let from = 0;
    for (let x = 0; x < shape[0]; x++)
      for (let y = 0; y < shape[1]; y++) {
        const row = (Math.floor(x / whole) * size[1] + Math.floor(y / whole)) * size[2];
        for (let z = 0; z < shape[2]; z++) if (occupied[from++]) out[row + Math.floor(z / whole)] = 1;
      }
  } else {
    let to = 0;
    for (let x = 0; x < size[0]; x++)
      for (let y = 0; y < size[1]; y++) {
        const row = (Math.floor(x * scale) * shape[1] + Math.floor(y * scale)) * shape[2];
        for (let z = 0; z < size[2]; z++) out[to++] = occupied[row + Math.floor(z * scale)];
      }
  }
  return { occupied: out, shape: size };
}

// Return the size of a grid's vertices and the places of those at the corners of occupied cells, in raster order.
function verticesOf(occupied, shape) {
  const size = shape.map((n) => n + 1), marked = new Uint8Array(size[0] * size[1] * size[2]);
  const across = size[2], along = size[1] * size[2];
  let count = 0, cell = 0;
  for (let x = 0; x < shape[0]; x++)
    for (let y = 0; y < shape[1]; y++) {
      let at = (x * size[1] + y) * size[2];
      for (let z = 0; z < shape[2]; z++, at++) {
        if (!occupied[cell++]) continue;
        marked[at] = marked[at + 1] = marked[at + across] = marked[at + across + 1] = 1;
        const far = at + along;
        marked[far] = marked[far + 1] = marked[far + across] = marked[far + across + 1] = 1;
      }
    }
  for (let k = 0; k < marked.length; k++) count += marked[k];
  const places = new Uint32Array(count);
  for (let k = 0, n = 0; k < marked.length; k++) if (marked[k]) places[n++] = k;
  return { size, places };
}

// Return the chessboard distance of each cell to the nearest occupied one, at most 255: how far a ray may leap.
function leapsOf(occupied, shape) {
  const [nx, ny, nz] = shape, out = new Uint8Array(occupied.length);
  for (let k = 0; k < out.length; k++) out[k] = occupied[k] ? 0 : 255;
  const strides = [ny * nz, nz, 1];
  // Two sweeps suffice, each over the 13 neighbours that it has passed already (Rosenfeld & Pfaltz 1966).
  const before = [];
  for (let x = -1; x <= 1; x++)
    for (let y = -1; y <= 1; y++)
      for (let z = -1; z <= 1; z++) if (x < 0 || (x === 0 && (y < 0 || (y === 0 && z < 0)))) before.push([x, y, z]);
  for (const sign of [1, -1]) {
    const steps = before.map((n) => ({ n: n.map((v) => v * sign), by: sign * (n[0] * strides[0] + n[1] * strides[1] + n[2]) }));
    for (let a = 0; a < nx; a++)
      for (let b = 0; b < ny; b++)
        for (let c = 0; c < nz; c++) {
          const x = sign > 0 ? a : nx - 1 - a, y = sign > 0 ? b : ny - 1 - b, z = sign > 0 ? c : nz - 1 - c;
          const at = x * strides[0] + y * strides[1] + z;
          let least = out[at];
          if (least === 0) continue;
          const inside = x > 0 && x < nx - 1 && y > 0 && y < ny - 1 && z > 0 && z < nz - 1;
          for (const { n, by } of steps) {
            if (!inside) {
              const [i, j, k] = [x + n[0], y + n[1], z + n[2]];
              if (i < 0 || j < 0 || k < 0 || i >= nx || j >= ny || k >= nz) continue;
            }
            if (out[at + by] + 1 < least) least = out[at + by] + 1;
          }
          out[at] = least;
        }
  }
  return out;
}

// Turn the differences between a channel's neighbouring codes into the bytes of their levels, in place.
function bytesOf(codes, start, count, levels) {
  let code = 0;
  for (let k = start; k < start + count; k++) {
    code = (code + codes[k]) & 255;
    codes[k] = levels[code];
  }
}

// Return the fields of each layer, and its leaps of the given shape, and the levels of the expected errors, if they are known. A field
// has channels of bytes in the order of its grid's places; the value of a byte is low + byte / 255 (high - low).
function decoded(header, content) {
  let from = 0;
  const take = (count) => content.subarray(from, (from += count)), { doubt } = header;
  const layers = header.layers.map((layer) => decodedLayer(layer, take));
  return { layers, doubted: doubt && take(doubt.shape.reduce((a, b) => a * b)) };
}

// take: returns the next bytes of the content.
function decodedLayer({ shape, cells, fields: all }, take) {
  const occupied = cellsFromBits(take(Math.ceil((shape[0] * shape[1] * shape[2]) / 8)), shape);
  const grids = new Map(), fields = {};
  for (const told of all) {
    if (!grids.has(told.resolution)) {
      const finer = resampled(occupied, shape, cells, told.resolution);
      grids.set(told.resolution, { resolution: told.resolution, ...verticesOf(finer.occupied, finer.shape) });
    }
    const grid = grids.get(told.resolution), count = grid.places.length;
    const bytes = take(count * told.low.length);
    told.levels.forEach((levels, channel) => bytesOf(bytes, channel * count, count, levels));
    fields[told.name] = { ...told, grid, count, channels: told.low.length, bytes };
  }
  return { shape, leaps: leapsOf(occupied, shape), fields };
}
