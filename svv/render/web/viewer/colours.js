// Colours: hexadecimal codes, hue, saturation and brightness, and the diffuse colours of the edited palette.

const GREY_SATURATION = 0.02; // below it, a hue is noise

function toHex(rgb) {
  return "#" + rgb.map((v) => Math.round(255 * Math.min(Math.max(v, 0), 1)).toString(16).padStart(2, "0")).join("");
}

function fromHex(text) {
  return [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16) / 255);
}

// Write hue, saturation and brightness of a colour, negative components being 0 (svv/core/colour/colour.py, rgb_to_hsb).
function toHsb(r, g, b, out) {
  r = Math.max(r, 0), g = Math.max(g, 0), b = Math.max(b, 0);
  const value = Math.max(r, g, b), chroma = value - Math.min(r, g, b);
  let hue = 0;
  if (chroma > 1e-30) {
    hue = value === r ? (g - b) / chroma : value === g ? 2 + (b - r) / chroma : 4 + (r - g) / chroma;
    hue = (hue / 6 + 1) % 1;
  }
  out[0] = hue;
  out[1] = value > 1e-30 ? chroma / value : 0;
  out[2] = value;
  return out;
}

function toRgb(hue, saturation, value, out) {
  for (let c = 0; c < 3; c++) {
    const k = (((5 - 2 * c + 6 * hue) % 6) + 6) % 6;
    out[c] = value * (1 - saturation * Math.min(Math.max(Math.min(k, 4 - k), 0), 1));
  }
  return out;
}

// Oklab, and back (svv/core/colour/oklab.py).
const times = (matrix, v) => matrix.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);

function toOklab(rgb, { to_cones, to_lab }) {
  const light = rgb.map((v) => Math.max(v, 0)).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
  return times(to_lab, times(to_cones, light).map(Math.cbrt));
}

function fromOklab(lab, { from_cones, from_lab }) {
  const light = times(from_cones, times(from_lab, lab).map((v) => v ** 3));
  return light.map((v) => (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
}

// As `shifter`, by the difference in Oklab (shift_in_oklab).
function oklabShifter(palette, target, oklab) {
  const before = toOklab(palette, oklab), after = toOklab(target, oklab), unit = (v) => Math.min(Math.max(v, 0), 1);
  return (r, g, b, out) => {
    const lab = toOklab([r, g, b], oklab).map((v, c) => v + after[c] - before[c]);
    fromOklab(lab, oklab).forEach((v, c) => (out[c] = unit(v)));
  };
}

// Return a function that moves colours by the difference between two palette colours (shift_colours); it changes `out`.
function shifter(palette, target) {
  const before = toHsb(...palette, []), after = toHsb(...target, []), hsb = [0, 0, 0];
  const wasGrey = before[1] < GREY_SATURATION, isGrey = after[1] < GREY_SATURATION;
  const turn = wasGrey || isGrey ? 0 : after[0] - before[0];
  const unit = (v) => Math.min(Math.max(v, 0), 1);
  return (r, g, b, out) => {
    toHsb(r, g, b, hsb);
    const hue = wasGrey ? after[0] : hsb[0] + turn;
    return toRgb(hue, unit(hsb[1] + after[1] - before[1]), unit(hsb[2] + after[2] - before[2]), out);
  };
}

// Return a function from a vertex to a channel's value there.
function valuesOf(field, channel) {
  const low = field.low[channel], step = (field.high[channel] - low) / 255, start = channel * field.count;
  return (k) => low + step * field.bytes[start + k];
}

// The diffuse colours I sum_i w_i c_i of the palette's colours c_i as they are edited, vertex by vertex.
class Palette {
  // material: intensity, then three channels a region; weights: one a region.
  constructor(material, weights, regions) {
    this.material = material, this.count = material.count, this.spaces = regions.map(({ oklab }) => oklab);
    this.parts = regions.map(() => null); // the contribution of each region, as long as its colour stays
    this.codes = regions.map(() => undefined);
    const share = new Float32Array(this.count);
    this.weights = regions.map((_, region) => {
      const at = valuesOf(weights, region), own = new Float32Array(this.count);
      for (let k = 0; k < this.count; k++) share[k] += own[k] = at(k);
      return own;
    });
    const intensity = valuesOf(material, 0);
    for (const own of this.weights) for (let k = 0; k < this.count; k++) own[k] *= intensity(k) / share[k];
  }

  // Return the diffuse colours, three numbers a vertex.
  diffuse(regions) {
    const sum = new Float32Array(3 * this.count);
    regions.forEach((region, index) => {
      const wanted = region.edited === null ? null : toHex(region.edited);
      if (this.parts[index] === null || this.codes[index] !== wanted) {
        this.parts[index] = this.part(region, index), this.codes[index] = wanted;
      }
      const part = this.parts[index];
      for (let k = 0; k < sum.length; k++) sum[k] += part[k];
    });
    return sum;
  }

  // Return what a region adds to the diffuse colours.
  part(region, index) {
    const [red, green, blue] = [0, 1, 2].map((c) => valuesOf(this.material, 1 + 3 * index + c));
    const weights = this.weights[index], out = new Float32Array(3 * this.count), rgb = [0, 0, 0];
    const oklab = this.spaces[index], moved = oklab === null ? shifter : oklabShifter;
    const shift = region.edited === null ? null : moved(region.colour, region.edited, oklab);
    for (let k = 0; k < this.count; k++) {
      const w = weights[k];
      if (w === 0) continue;
      rgb[0] = red(k), rgb[1] = green(k), rgb[2] = blue(k);
      if (shift !== null) shift(rgb[0], rgb[1], rgb[2], rgb);
      out[3 * k] = w * rgb[0], out[3 * k + 1] = w * rgb[1], out[3 * k + 2] = w * rgb[2];
    }
    return out;
  }
}
