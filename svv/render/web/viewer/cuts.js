// Cuts: those of the scene's file, and one by a plane that is dragged on the page (svv/core/geometry/cuts.py).

const CUT_PLANES = 6; // most planes of a cut, as march.glsl has room for
const SECTIONS = { learned: 0, flat: 1, hatched: 2 };

// The cuts that show, in world units: planes n . x > d as [x, y, z, d], centre, axis and radius of a ball or cylinder, whether what is
// outside is cut off instead, and the regions that are cut, as bits; 0 for all.
function cutsOf(state, header) {
  const { axis, at, below } = state.cut, cuts = state.cuts ? [...header.cuts] : [];
  if (axis === null) return cuts;
  const [low, high] = header.bounds, sign = below ? -1 : 1, plane = [0, 0, 0, sign * (low[axis] + at * (high[axis] - low[axis]))];
  plane[axis] = sign;
  return [...cuts, { planes: [plane], centre: null, axis: null, radius: 0, outside: false, regions: 0, text: `${"xyz"[axis]}${below ? "<" : ">"}${100 * at}%` }];
}

// Whether samples have to know their region for the cuts that show.
function cutsByRegion(cuts, header) {
  return cuts.some(({ regions }) => regions !== 0) || (cuts.length > 0 && header.regions.some(({ section, section_line }) => section !== "learned" || section_line > 0));
}

// Rows of the block Cuts of march.glsl, in the box coordinates of each layer.
function cutRows(cuts, header) {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2], planes = [], balls = [], axes = [], kinds = [];
  for (const { box } of header.layers)
    for (const cut of cuts) {
      const own = cut.planes.map((plane) => [...plane.slice(0, 3), (plane[3] - dot(plane, box.low)) / box.size]);
      planes.push(...own, ...Array.from({ length: CUT_PLANES - own.length }, () => [0, 0, 0, 0]));
      balls.push(cut.centre === null ? [0, 0, 0, 0] : [...cut.centre.map((v, k) => (v - box.low[k]) / box.size), cut.radius / box.size]);
      axes.push([...(cut.axis ?? [0, 0, 0]), 0]);
    }
  for (const cut of cuts) kinds.push([cut.planes.length, cut.centre === null ? 0 : cut.axis === null ? 1 : 2, Number(cut.outside), 0]);
  return [...planes, ...balls, ...axes, ...kinds];
}

// The unlit colour of each region as it shows in sections, and how: rows of the uniform uSection. Errors are those of faces as learned.
function sectionRows(state, header) {
  const shares = sharesOf(state, header);
  return header.regions.map(({ section }, k) => {
    const plain = state.regions[k].edited ?? state.regions[k].colour;
    const main = shares[k] === 0 ? plain : header.paintings[state.painting].flat[k] ?? plain;
    return [...plain.map((v, c) => v + shares[k] * (main[c] - v)), SECTIONS[state.doubt ? "learned" : section]];
  });
}
