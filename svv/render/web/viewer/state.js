// What the user has set: the regions' edits, the painting shown, the light and the background.

function stateOf(header) {
  return {
    regions: header.regions.map(({ colour, edited, opacity, hidden }) => ({ colour, edited, opacity, hidden })),
    painting: header.painting,
    strength: 1, // of all styles, on top of each region's own
    light: 1, // of the light's effect, on top of each region's own
    lamp: { ...header.lamp },
    background: [...header.background],
    doubt: false, // whether the picture shows its expected errors instead of colours
    cuts: true, // whether those of the file show
    cut: { axis: null, at: 0.5, below: false }, // by a plane across this axis, at this part of the bounds; which side is cut off
  };
}

// Set a state to another one, whose objects it does not share.
function overwrite(state, fresh) {
  fresh.regions.forEach((region, k) => Object.assign(state.regions[k], region));
  Object.assign(state, { ...fresh, regions: state.regions });
}

// The region's style in the painting shown; null where it is not painted.
function styleOf(state, header, region) {
  return state.painting === null ? null : header.paintings[state.painting].styles[region];
}

function opacitiesOf(state) {
  return state.regions.map((region) => (region.hidden ? 0 : region.opacity));
}

// How strongly paint covers each region, from 0 to 1.
function sharesOf(state, header) {
  return state.regions.map((_, k) => (styleOf(state, header, k) === null ? 0 : state.strength * header.regions[k].strength));
}

// How each region responds to light: factor, scale of the shade, less specular (svv/fields/scene/paint_light.py, lights_of).
function lightsOf(state, header) {
  return sharesOf(state, header).map((share, k) => {
    const { lighting, mean_light: mean } = header.regions[k], f = state.light * lighting;
    if (share === 0) return [f, 1, 0];
    const plain = 1 - share, paint = share * header.paintings[state.painting].paint_light[k];
    if (plain + paint === 0) return [0, 1, 0];
    const part = paint / (plain + paint);
    return [f * (plain + paint), 1 - part + part / mean[0], part * mean[1]];
  });
}

// How each region's extinction follows the strokes of its paint: gain, slope, mean and reach, of which the header tells those at the
// region's own strength.
function strokesOf(state, header) {
  const s = state.strength;
  return header.paintings[state.painting].strokes.map(([gain, slope, mean, reach]) => [s * gain, s * slope, mean, s * reach]);
}

// The part of a list over all regions that is of one layer.
function ofLayer(list, { first, count }) {
  return list.slice(first, first + count);
}
