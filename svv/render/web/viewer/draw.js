// Drawing a scene with WebGL2: programs, what they are told, and one picture.

const CORNERS = "#version 300 es\nvoid main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0, 1); }";

const BLENDED = "#version 300 es\nprecision highp float;\nuniform sampler2D uLayer;\nout vec4 pixel;\nvoid main() { pixel = texelFetch(uLayer, ivec2(gl_FragCoord.xy), 0); }";

const FARTHEST = 64; // distance of places in sizes of the first layer's box that a pixel can tell

const KINDS = { none: 0, network: 1, phong: 2 }; // of light, in march.glsl

class Painter {
  // content: shape, leaps and fields of each layer; levels: those of the expected errors, null where they are not known.
  constructor(gl, header, content, levels) {
    Object.assign(this, { gl, header, content, programs: new Map(), textures: new Textures(gl) });
    const { textures } = this, shapes = content.map(({ shape }) => shape), most = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE);
    const side = Math.max(...stacked(shapes).size);
    if (side > most) throw new Unable(`this browser's graphics hold ${most} points a side and the scene has ${side} cells`);
    textures.make("Leaps", shapes, 0);
    content.forEach(({ leaps }, layer) => textures.fill("Leaps", layer, leaps));
    textures.upload("Extinction", this.fields("extinction"), 0, 1);
    this.weights = header.layers.some(({ count }) => count > 1) ? textures.split("Weights", this.fields("weights")) : 0;
    this.lights = textures.split("Light", this.fields("light"));
    this.basis = basisOf(header.layers, this.fields("light"), Math.max(this.lights, 1));
    textures.make("Diffuse", this.fields("material").map(({ grid }) => grid.size), CHANNELS);
    if (header.matcaps.count > 0) {
      const { count, side, texels } = header.matcaps;
      textures.make("Matcaps", [[count, side, side]], CHANNELS);
      textures.fill("Matcaps", 0, Uint8Array.from(atob(texels), (letter) => letter.charCodeAt(0)));
    }
    this.shadows = header.shadows === null ? null : new Shadows(header, content, textures);
    if (levels !== null) {
      textures.make("Doubt", [header.doubt.shape], -1);
      textures.fill("Doubt", 0, errorsOf(levels, { most: 1 }));
    }
    this.palettes = content.map(({ fields }, layer) =>
      new Palette(fields.material, fields.weights, ofLayer(header.regions, header.layers[layer])));
    this.diffuseTops = [], this.wanted = []; // value of byte 255, and the edits, of each layer's diffuse colours
    this.vertices = gl.createVertexArray(), this.block = gl.createBuffer(), this.cutBlock = gl.createBuffer();
    if (gl.getError() === gl.OUT_OF_MEMORY) throw new Unable("this browser's graphics have too little memory");
  }

  // A field of each layer, null where it has none.
  fields(name) {
    return this.content.map(({ fields }) => fields[name] ?? null);
  }

  // Take over the edits that textures hold: the palettes' colours, the painting shown, and shadows, which are coarse at first.
  prepare(state, camera) {
    this.shadows?.prepare(state, lensOf(camera, this.header.layers[0].box).axes);
    this.header.layers.forEach((layer, number) => {
      const regions = ofLayer(state.regions, layer), wanted = regions.map((region) => region.edited && toHex(region.edited)).join();
      if (this.wanted[number] === wanted) return;
      this.recolour(number, regions);
      this.wanted[number] = wanted;
    });
    if (state.painting !== null && this.painting !== state.painting) {
      this.textures.upload("Paint", this.fields(`paint${state.painting}`), 0, CHANNELS);
      this.painting = state.painting;
    }
  }

  // Go on for some time with what is coarse while something moves, and return whether it is done.
  refine(ms) {
    return this.shadows?.refine(ms) ?? true;
  }

  recolour(layer, regions) {
    const palette = this.palettes[layer], diffuse = palette.diffuse(regions), { size, places } = palette.material.grid;
    let top = 0.01;
    for (let k = 0; k < diffuse.length; k++) if (diffuse[k] > top) top = diffuse[k];
    this.diffuseTops[layer] = top = Math.min(top, 2);
    const data = new Uint8ClampedArray(CHANNELS * size[0] * size[1] * size[2]);
    for (let k = 0; k < places.length; k++)
      for (let c = 0; c < 3; c++) data[CHANNELS * places[k] + c] = (255 * diffuse[3 * k + c]) / top;
    this.textures.fill("Diffuse", layer, new Uint8Array(data.buffer));
  }

  // Return the program for a state; compiling takes a moment, so each kind is compiled once.
  program(state, place = false, lines = false) {
    const { header } = this, { layers } = header, painted = state.painting !== null;
    const strokes = painted && strokesOf(state, header).flat().some((v) => v !== 0);
    const lists = [lightsOf(state, header), opacitiesOf(state), sharesOf(state, header)];
    const alike = layers.every((layer) => lists.every((list) => ofLayer(list, layer).every((v, _, [first]) => `${v}` === `${first}`)));
    const cuts = cutsOf(state, header);
    const kinds = new Set(layers.map(({ lighting }) => KINDS[lighting]));
    const lit = [...kinds].reduce((a, b) => a | b) | (kinds.size > 1 ? 4 : 0);
    const defines = {
      LAYERS: layers.length, REGIONS: state.regions.length, WEIGHTS: this.weights, LIGHTS: Math.max(this.lights, 1), LIT: lit,
      BASIS: this.basis.harmonics, PAINTED: Number(painted), STROKES: Number(strokes),
      CUTS: cuts.length, CUTS_BY_REGION: Number(cutsByRegion(cuts, header)), HATCHES: header.hatches.count.toFixed(1), HATCH_WIDTH: header.hatches.width.toFixed(6),
      HATCH_SOFTNESS: header.hatches.softness.toFixed(6), HATCH_INK: header.hatches.ink.toFixed(6), DEEP: header.hatches.deep.toFixed(6),
      PLACE: Number(place), DOUBT: Number(state.doubt && !place), LINES: Number(lines), SHADOWS: Number(this.shadows !== null && state.lamp.shadow > 0), FARTHEST: FARTHEST.toFixed(1), MATCAPS: header.matcaps.count, BEHIND: header.matcaps.behind.toFixed(6), INSET: header.matcaps.inset.toFixed(6),
      EXTINCTION_POWER: header.matcaps.power.toFixed(6), BY_REGION: Number(place || lines || strokes || !alike || cutsByRegion(cuts, header) || header.matcaps.count > 0), SOFTNESS: header.normal_softness.toFixed(6), RIM: header.rim_cosine.toFixed(6),
    };
    const key = JSON.stringify(defines);
    if (!this.programs.has(key)) this.programs.set(key, this.compiled(MARCH, defines));
    return this.programs.get(key);
  }

  compiled(shader, defines) {
    const gl = this.gl, program = gl.createProgram(), counts = { WEIGHTS: this.weights, LIGHTS: this.lights };
    const body = shader.replace(/^@(\w+) (.*)$/gm, (_, name, line) =>
      Array.from({ length: counts[name] }, (_, number) => line.replaceAll("#", number)).join("\n"));
    const named = Object.entries(defines).map(([name, value]) => `#define ${name} ${value}\n`).join("");
    for (const [kind, source] of [[gl.VERTEX_SHADER, CORNERS], [gl.FRAGMENT_SHADER, body.replace("\n", `\n${named}`)]]) {
      const part = gl.createShader(kind);
      gl.shaderSource(part, source);
      gl.compileShader(part);
      gl.attachShader(program, part);
      if (!gl.getShaderParameter(part, gl.COMPILE_STATUS) && !gl.isContextLost())
        throw new Unable(`this browser's graphics refuse the program (${gl.getShaderInfoLog(part)})`);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
      throw new Unable(`this browser's graphics refuse the program (${gl.getProgramInfoLog(program)})`);
    // Tables are bound to 0, Cuts to 1.
    const block = defines.CUTS > 0 ? gl.getUniformBlockIndex(program, "Cuts") : gl.INVALID_INDEX;
    if (block !== gl.INVALID_INDEX) gl.uniformBlockBinding(program, block, 1);
    const at = new Proxy({}, { get: (known, name) => (known[name] ??= gl.getUniformLocation(program, name)) });
    return { program, at };
  }

  // Draw the rows [from, to) of a camera's picture, at `part` of its size and with samples `stride` times as far apart,
  // into the bound framebuffer; `columns` [first, end) draw a part of the rows. With `place`, pixels tell what they show instead of their
  // colours, and where errors are shown, what `showDoubt` takes; with `lines`, a second attachment gets what lines.js takes.
  draw(now, camera, part, from, to, { stride = 1, columns = null, place = false, lines = false } = {}) {
    const state = now.doubt && !place ? doubted(now) : now;
    const gl = this.gl, { program, at } = this.program(state, place, lines), { layers } = this.header;
    const width = Math.max(1, Math.round(camera.width * part)), height = Math.max(1, Math.round(camera.height * part));
    gl.useProgram(program);
    this.textures.bind(at);
    const { axes, lens } = lensOf(camera, layers[0].box);
    gl.uniformMatrix3fv(at.uAxes, false, axes);
    gl.uniform4fv(at.uLens, lens);
    gl.uniform2f(at.uPixel, camera.width / width, camera.height / height);
    gl.uniform1f(at.uStop, Math.exp(-Math.max(...layers.map(({ stop }) => stop))));
    gl.uniform3fv(at.uBackground, state.background);
    if (state.doubt && !place) gl.uniform3fv(at.uDoubtSize, [2, 1, 0].map((k) => this.header.doubt.cells / this.header.doubt.shape[k]));
    for (const [name, size] of this.sizes()) gl.uniform3fv(at[name], [size[2], size[1], size[0]]);
    this.setLamp(at, state, axes);
    if (lines) gl.uniform1f(at.uUnit, layers[0].box.size);
    if (this.shadows !== null && state.lamp.shadow > 0) {
      gl.uniform1f(at.uShadow, state.lamp.shadow);
      gl.uniform2fv(at["uShadowsGrid[0]"], this.shadows.rows());
    }
    gl.bindBuffer(gl.UNIFORM_BUFFER, this.block);
    gl.bufferData(gl.UNIFORM_BUFFER, new Float32Array(this.rows(state, camera, stride).flat(2)), gl.DYNAMIC_DRAW);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, 0, this.block);
    this.setCuts(at, state);
    gl.bindVertexArray(this.vertices);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.SCISSOR_TEST);
    const [left, right] = columns ?? [0, width];
    gl.scissor(left, from, right - left, to - from);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.SCISSOR_TEST);
  }

  // Draw the errors of a camera's picture into the bound framebuffer, from a texture with what `draw` has left of them.
  showDoubt(state, camera, marched) {
    const gl = this.gl, { doubt } = this.header, { width, height } = marched;
    this.doubting ??= this.compiled(DOUBTED, {});
    const { program, at } = this.doubting;
    gl.useProgram(program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, marched.texture);
    gl.uniform1i(at.uMarched, 0);
    gl.uniform3fv(at.uBackground, state.background);
    gl.uniform3fv(at["uHeat[0]"], doubt.heat.flat());
    gl.uniform1f(at.uMost, doubt.most);
    gl.uniform1f(at.uEdge, edgeOf(doubt, { ...camera, width }));
    gl.uniform1f(at.uDarkest, Math.max(doubt.darkest, 1e-12));
    gl.bindVertexArray(this.vertices);
    gl.viewport(0, 0, width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // Blend a texture over the bound framebuffer.
  blend({ texture, width, height }) {
    const gl = this.gl;
    this.blending ??= this.compiled(BLENDED, {});
    const { program, at } = this.blending;
    gl.useProgram(program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.uniform1i(at.uLayer, 0);
    gl.bindVertexArray(this.vertices);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.BLEND);
  }

  // Names of uniforms and the sizes of textures that they tell.
  sizes() {
    const { Extinction, Diffuse, Light0, Paint, Shadows } = this.textures.all;
    const all = { uExtinctionSize: Extinction, uColourSize: Diffuse, uLightSize: Light0, uPaintSize: Paint, uShadowsSize: Shadows };
    return Object.entries(all).filter(([, texture]) => texture).map(([name, { size }]) => [name, size]);
  }

  // Return the rows of the block Tables, list by list in the order of march.glsl.
  rows(state, camera, stride) {
    const { header, textures } = this, { layers } = header, opacities = opacitiesOf(state), painted = state.painting !== null;
    const fields = this.content.map((layer) => layer.fields), first = layers[0].box;
    const of = (act) => layers.map((layer, l) => act(layer, fields[l], l));
    const lights = lightsOf(state, header), shares = sharesOf(state, header);
    const low = ({ low }) => low, range = ({ low, high }) => high.map((v, k) => v - low[k]);
    const normals = (take) => of(({ lighting }, { light }) => (lighting === "phong" ? [...take(light), 0] : [0, 0, 0, 0]));
    return [
      of(({ box }) => [...lensOf(camera, box).position, box.size / first.size]),
      of(({ box, cells }) => [...box.extent, cells]),
      of(({ shape }, _, l) => [...shape, textures.all.Leaps.offsets[l]]),
      of(({ step, joined, box, ...layer }) => [
        stride * step, (stride * step * box.size) / first.size, stride * joined, Number(ofLayer(opacities, layer).some((v) => v > 0)),
      ]),
      of(({ first, count, lighting, headlight }) => [first, count, KINDS[lighting], Number(headlight === "axis")]),
      of((_, { extinction }, l) => [low(extinction)[0], range(extinction)[0], this.diffuseTops[l], 0]),
      of((_, { extinction, material }, l) => [
        ...textures.grid("Extinction", l, extinction), ...textures.grid("Diffuse", l, material),
      ]),
      of((_, own, l) => [
        ...textures.grid("Light0", l, own.light), ...textures.grid("Paint", l, painted && own[`paint${this.painting}`]),
      ]),
      normals(low), normals(range),
      opacities.map((opacity, k) => [opacity, ...lights[k]]),
      header.regions.map(({ reflects }) => reflects),
      (painted ? strokesOf(state, header) : opacities.map(() => [0, 0, 0, 0])),
      shares.map((share, k) => [share, header.regions[k].matcap, 0, 0]),
      this.basis.rows,
    ];
  }

  setCuts(at, state) {
    const gl = this.gl, cuts = cutsOf(state, this.header);
    if (cuts.length === 0) return;
    gl.bindBuffer(gl.UNIFORM_BUFFER, this.cutBlock);
    gl.bufferData(gl.UNIFORM_BUFFER, new Float32Array(cutRows(cuts, this.header).flat()), gl.DYNAMIC_DRAW);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, 1, this.cutBlock);
    if (!cutsByRegion(cuts, this.header)) return;
    gl.uniform1iv(at.uCutRegions, cuts.map(({ regions }) => regions));
    gl.uniform4fv(at.uSection, sectionRows(state, this.header).flat());
  }

  setLamp(at, state, axes) {
    const gl = this.gl, { direction, intensity } = state.lamp;
    gl.uniformMatrix3fv(at.uLamp, false, lampTurn(state.lamp, axes));
    gl.uniform4fv(at.uSun, direction === null ? [0, 0, 0, 0] : [...direction.map((v) => v / Math.hypot(...direction)), 1]);
    gl.uniform1f(at.uBrightness, intensity);
  }
}

// Why a scene cannot be shown here, as the end of a sentence.
class Unable extends Error {}

// What a byte of each channel of the layers' lights counts for, harmonic by harmonic, and what the light is where all bytes are 0:
// rows of four numbers, which are 0 for a layer whose light no network provides.
function basisOf(layers, fields, textures) {
  const harmonics = Math.max(1, ...layers.map(({ light }) => light.harmonics ?? 0)), shade = [], specular = [], zero = [];
  layers.forEach(({ light: { mean, axes = [] } }, layer) => {
    const own = () => Array.from({ length: textures * harmonics }, () => [0, 0, 0, 0]), shades = own(), speculars = own();
    for (let k = 0; k < harmonics; k++) {
      const sum = mean ? [mean[k], mean[harmonics + k], 0, 0] : [0, 0, 0, 0];
      axes.forEach((axis, channel) => {
        const low = fields[layer].low[channel], range = fields[layer].high[channel] - low;
        const row = Math.floor(channel / CHANNELS) * harmonics + k;
        shades[row][channel % CHANNELS] = range * axis[k], speculars[row][channel % CHANNELS] = range * axis[harmonics + k];
        sum[0] += low * axis[k], sum[1] += low * axis[harmonics + k];
      });
      zero.push(sum);
    }
    shade.push(...shades), specular.push(...speculars);
  });
  return { harmonics, rows: [...shade, ...specular, ...zero] };
}

// Return the rotation, column by column, from directions towards the camera to directions towards the light (Lamp.turn).
function lampTurn(lamp, axes) {
  const a = (lamp.azimuth * Math.PI) / 180, e = (lamp.elevation * Math.PI) / 180;
  const up = [[1, 0, 0], [0, Math.cos(e), Math.sin(e)], [0, -Math.sin(e), Math.cos(e)]];
  const right = [[Math.cos(a), 0, Math.sin(a)], [0, 1, 0], [-Math.sin(a), 0, Math.cos(a)]];
  const times = (m, n) => m.map((row) => [0, 1, 2].map((c) => row.reduce((sum, v, k) => sum + v * n[k][c], 0)));
  const flipped = (m) => m[0].map((_, c) => m.map((row) => row[c]));
  const camera = [0, 1, 2].map((k) => [axes[k], axes[3 + k], axes[6 + k]]);
  return flipped(times(times(times(camera, right), up), flipped(camera))).flat();
}
