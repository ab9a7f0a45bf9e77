// Coarser grids for graphics that cannot hold those of the scene.

const MOST_BYTES = 5e8; // that the textures may take: half of what laptops and new phones spare for a page

// Return the size of the texture that holds one field of all layers (null where a layer does not have it), and its bytes: of the
// material, only its diffuse colour is one (textures.js).
function textureOf(name, fields) {
  const { size } = stacked(fields.map((field) => field && field.grid.size)), texels = size[0] * size[1] * size[2];
  const channels = Math.max(...fields.map((field) => field?.channels ?? 0));
  return { side: Math.max(...size), bytes: texels * (name === "extinction" ? 1 : 4 * (name === "material" ? 1 : Math.ceil(channels / 4))) };
}

// Return the layers' fields such that they fit: no texture has more points a side than most.side, and one painting with all else
// takes at most most.bytes. Also return what there is to say about it, empty where nothing had to be changed.
function fitted(layers, most) {
  const names = [...new Set(layers.flatMap((fields) => Object.keys(fields)))];
  const finestOfAll = () => layers.flatMap((fields) => Object.values(fields)).map(finest).reduce((a, b) => Math.max(a, b));
  const wanted = finestOfAll();
  let long = false;
  for (;;) {
    const textures = names.map((name) => [name, textureOf(name, layers.map((fields) => fields[name] ?? null))]);
    const bytes = textures.filter(([name]) => !/^paint[1-9]/.test(name)).reduce((sum, [, { bytes }]) => sum + bytes, 0);
    const tooLong = textures.some(([, { side }]) => side > most.side), largest = finestOfAll();
    if ((!tooLong && bytes <= most.bytes) || largest <= 2) break;
    long ||= tooLong;
    const smaller = new Map();
    layers = layers.map((fields) => Object.fromEntries(Object.entries(fields).map(([name, field]) => {
      if (finest(field) < largest) return [name, field];
      if (!smaller.has(field.grid)) smaller.set(field.grid, halved(field.grid));
      return [name, coarser(field, smaller.get(field.grid))];
    })));
  }
  const left = finestOfAll(), why = long ? `hold ${most.side} points a side` : "have little memory";
  const said = left === wanted ? "" : `This browser's graphics ${why}: the scene is drawn from ${left} points a side instead of ${wanted}, without its finest details.`;
  return { layers, said };
}

const finest = (field) => Math.max(...field.grid.size);

const BESIDE = 1e-4; // weight of a point beside a coarser one: it counts only where there is none at the same place

// Call act(to, from, weight) for each point of a grid and each point of one with half the cells a side that it counts for.
function spread(grid, size, act) {
  const { places } = grid, [, ny, nz] = grid.size, along = (n) => (n & 1 ? [(n - 1) / 2, (n + 1) / 2] : [n / 2]);
  for (let k = 0; k < places.length; k++) {
    const z = places[k] % nz, row = (places[k] - z) / nz, y = row % ny, x = (row - y) / ny;
    const xs = along(x), ys = along(y), zs = along(z), weight = xs.length * ys.length * zs.length === 1 ? 1 : BESIDE;
    for (const i of xs) for (const j of ys) for (const l of zs) act((i * size[1] + j) * size[2] + l, k, weight);
  }
}

// Return a grid with half the cells a side, of which points have neighbours in a grid, and how much these weigh in all.
function halved(grid) {
  const size = grid.size.map((n) => (n >> 1) + 1), weights = new Float32Array(size[0] * size[1] * size[2]);
  spread(grid, size, (to, from, weight) => (weights[to] += weight));
  const places = Uint32Array.from(weights.keys()).filter((place) => weights[place] > 0);
  const numbers = new Uint32Array(weights.length); // of the points, by their places
  places.forEach((place, number) => (numbers[place] = number));
  return { grid: { resolution: grid.resolution / 2, size, places }, weights, numbers };
}

// Return a field on a halved grid: each point keeps its value, or gets the mean of those around it. (A mean of all would blur
// the logarithm of the extinction, and thin surfaces with it.)
function coarser(field, { grid, weights, numbers }) {
  const count = grid.places.length, sums = new Float32Array(field.channels * count);
  spread(field.grid, grid.size, (to, from, weight) => {
    const number = numbers[to], part = weight / weights[to];
    for (let c = 0; c < field.channels; c++) sums[c * count + number] += part * field.bytes[c * field.count + from];
  });
  return { ...field, grid, count, bytes: Uint8Array.from(sums, Math.round) };
}
