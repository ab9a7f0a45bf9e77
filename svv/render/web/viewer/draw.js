// Drawing a scene with WebGL2: textures, programs, one picture, and a sequence of ever sharper ones.

const CORNERS = "#version 300 es\nvoid main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0, 1); }";
const CHANNELS = 4; // of a texture

class Painter {
  constructor(gl, header, content) {
    this.gl = gl, this.header = header, this.fields = content.fields, this.programs = new Map(), this.textures = {};
    const { shape, leaps } = content, most = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE);
    if (Math.max(...shape) > most)
      throw new Unable(`this browser's graphics hold ${most} points a side and the scene has ${Math.max(...shape)} cells`);
    this.upload("Leaps", gl.R8UI, gl.RED_INTEGER, shape, leaps, gl.NEAREST);
    this.uploadField("Extinction", this.fields.extinction, 0, 1, 1);
    this.weights = this.split("Weights", header.regions.length > 1 ? this.fields.weights : null);
    this.lights = this.split("Light", this.fields.light ?? null);
    this.basis = header.lighting === "network" ? basisOf(header.light, this.fields.light, this.lights) : null;
    this.palette = new Palette(this.fields.material, this.fields.weights, header.regions);
    this.vertices = gl.createVertexArray();
    if (gl.getError() === gl.OUT_OF_MEMORY) throw new Unable("this browser's graphics have too little memory");
  }

  upload(name, format, layout, size, data, filter) {
    const gl = this.gl, [x, y, z] = size;
    this.textures[name] ??= gl.createTexture();
    gl.bindTexture(gl.TEXTURE_3D, this.textures[name]);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage3D(gl.TEXTURE_3D, 0, format, z, y, x, 0, layout, gl.UNSIGNED_BYTE, data);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_3D, side, filter);
    for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R])
      gl.texParameteri(gl.TEXTURE_3D, axis, gl.CLAMP_TO_EDGE);
  }

  // Upload some channels of a field, `each` a texel: its bytes on the whole grid, zero at vertices that it does not have.
  uploadField(name, field, first, count, each) {
    const gl = this.gl, { size, places } = field.grid;
    const data = new Uint8Array(each * size[0] * size[1] * size[2]);
    for (let c = 0; c < count; c++) {
      const bytes = field.bytes.subarray((first + c) * field.count, (first + c + 1) * field.count);
      for (let k = 0; k < bytes.length; k++) data[each * places[k] + c] = bytes[k];
    }
    this.upload(name, each > 1 ? gl.RGBA8 : gl.R8, each > 1 ? gl.RGBA : gl.RED, size, data, gl.LINEAR);
  }

  // Upload the channels of a field to as many textures as they need, and return how many.
  split(name, field) {
    if (field === null) return 0;
    const textures = Math.ceil(field.channels / CHANNELS);
    for (let t = 0; t < textures; t++)
      this.uploadField(name + t, field, CHANNELS * t, Math.min(CHANNELS, field.channels - CHANNELS * t), CHANNELS);
    return textures;
  }

  // Take over the edits that textures hold: the palette's colours and the painting shown.
  prepare(state) {
    const wanted = state.regions.map((region) => region.edited && toHex(region.edited)).join();
    if (this.wanted !== wanted) {
      const diffuse = this.palette.diffuse(state.regions), { size, places } = this.palette.material.grid;
      let top = 0.01;
      for (let k = 0; k < diffuse.length; k++) if (diffuse[k] > top) top = diffuse[k];
      this.diffuseTop = top = Math.min(top, 2);
      const data = new Uint8ClampedArray(CHANNELS * size[0] * size[1] * size[2]);
      for (let k = 0; k < places.length; k++)
        for (let c = 0; c < 3; c++) data[CHANNELS * places[k] + c] = (255 * diffuse[3 * k + c]) / top;
      this.upload("Diffuse", this.gl.RGBA8, this.gl.RGBA, size, new Uint8Array(data.buffer), this.gl.LINEAR);
      this.wanted = wanted;
    }
    if (state.painting !== null && this.painting !== state.painting) {
      this.uploadField("Paint", this.fields[`paint${state.painting}`], 0, 3, CHANNELS);
      this.painting = state.painting;
    }
  }

  // Return the program for a state; compiling takes a moment, so each kind is compiled once.
  program(state) {
    const { header } = this, lit = { none: 0, network: 1, phong: 2 }[header.lighting], painted = state.painting !== null;
    const strokes = painted && strokesOf(state, header).flat().some((v) => v !== 0);
    const alike = [lightsOf(state, header), opacitiesOf(state), sharesOf(state, header)].every((list) =>
      list.every((v) => `${v}` === `${list[0]}`));
    const defines = {
      REGIONS: state.regions.length, WEIGHTS: this.weights, LIGHTS: Math.max(this.lights, 1), LIT: lit,
      BASIS: lit === 1 ? header.light.harmonics : 1, PAINTED: Number(painted), STROKES: Number(strokes),
      BY_REGION: Number(strokes || !alike), SOFTNESS: header.normal_softness.toFixed(6), RIM: header.rim_cosine.toFixed(6),
    };
    const key = JSON.stringify(defines);
    if (!this.programs.has(key)) this.programs.set(key, this.compiled(defines));
    return this.programs.get(key);
  }

  compiled(defines) {
    const gl = this.gl, program = gl.createProgram(), counts = { WEIGHTS: this.weights, LIGHTS: this.lights };
    const body = MARCH.replace(/^@(\w+) (.*)$/gm, (_, name, line) =>
      Array.from({ length: counts[name] }, (_, number) => line.replaceAll("#", number)).join("\n"));
    const named = Object.entries(defines).map(([name, value]) => `#define ${name} ${value}\n`).join("");
    for (const [kind, source] of [[gl.VERTEX_SHADER, CORNERS], [gl.FRAGMENT_SHADER, body.replace("\n", `\n${named}`)]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost())
        throw new Unable(`this browser's graphics refuse the program (${gl.getShaderInfoLog(shader)})`);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
      throw new Unable(`this browser's graphics refuse the program (${gl.getProgramInfoLog(program)})`);
    const at = new Proxy({}, { get: (known, name) => (known[name] ??= gl.getUniformLocation(program, name)) });
    return { program, at };
  }

  // Draw the rows [from, to) of a camera's picture, at `part` of its size and with samples `stride` times as far apart,
  // into the bound framebuffer.
  draw(state, camera, part, from, to, stride = 1) {
    const gl = this.gl, { program, at } = this.program(state), header = this.header;
    const width = Math.max(1, Math.round(camera.width * part)), height = Math.max(1, Math.round(camera.height * part));
    gl.useProgram(program);
    this.bind(at);
    const { axes, position, lens } = lensOf(camera, header.box);
    gl.uniformMatrix3fv(at.uAxes, false, axes);
    gl.uniform3fv(at.uPosition, position);
    gl.uniform4fv(at.uLens, lens);
    gl.uniform2f(at.uPixel, camera.width / width, camera.height / height);
    gl.uniform3fv(at.uExtent, header.box.extent);
    gl.uniform1f(at.uCells, header.cells);
    gl.uniform3f(at.uMarch, stride * header.step, stride * header.joined, Math.exp(-header.stop));
    gl.uniform3fv(at.uBackground, state.background);
    this.setRegions(at, state);
    if (header.lighting === "phong") this.setLamp(at, state, axes);
    gl.bindVertexArray(this.vertices);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, from, width, to - from);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.SCISSOR_TEST);
  }

  bind(at) {
    const gl = this.gl, grid = (name, field) => {
      const { resolution, size } = field.grid;
      gl.uniform4f(at[name], resolution, size[2], size[1], size[0]);
    };
    Object.entries(this.textures).forEach(([name, texture], unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_3D, texture);
      gl.uniform1i(at[`u${name}`], unit);
    });
    const { extinction, material, light } = this.fields;
    grid("uExtinctionGrid", extinction), grid("uColourGrid", material);
    gl.uniform2f(at.uExtinctionCode, extinction.low[0], extinction.high[0] - extinction.low[0]);
    gl.uniform1f(at.uDiffuseTop, this.diffuseTop);
    if (light) grid("uLightGrid", light);
    if (this.header.lighting === "network") {
      gl.uniform4fv(at.uShade, this.basis.shade), gl.uniform4fv(at.uSpecular, this.basis.specular);
      gl.uniform2fv(at.uLightZero, this.basis.zero);
    } else if (this.header.lighting === "phong") {
      gl.uniform3fv(at.uNormalLow, light.low);
      gl.uniform3fv(at.uNormalRange, light.high.map((v, k) => v - light.low[k]));
    }
    if (this.painting !== undefined) grid("uPaintGrid", this.fields[`paint${this.painting}`]);
  }

  setRegions(at, state) {
    const gl = this.gl;
    gl.uniform1fv(at.uOpacity, opacitiesOf(state));
    gl.uniform3fv(at.uLight, lightsOf(state, this.header).flat());
    if (state.painting === null) return;
    gl.uniform1fv(at.uShare, sharesOf(state, this.header));
    gl.uniform4fv(at.uStrokes, strokesOf(state, this.header).flat());
  }

  setLamp(at, state, axes) {
    const gl = this.gl, lamp = state.lamp, direction = lamp.direction;
    gl.uniform4fv(at.uReflects, this.header.regions.flatMap((region) => region.reflects));
    gl.uniformMatrix3fv(at.uLamp, false, lampTurn(lamp, axes));
    gl.uniform4fv(at.uSun, direction === null ? [0, 0, 0, 0] : [...direction.map((v) => v / Math.hypot(...direction)), 1]);
    gl.uniform2f(at.uLampHow, lamp.intensity, this.header.headlight === "axis" ? 1 : 0);
  }
}

// Why a scene cannot be shown here, as the end of a sentence.
class Unable extends Error {}

// What a byte of each channel of the light counts for, harmonic by harmonic, and what the light is where all bytes are 0.
function basisOf({ harmonics, mean, axes }, field, textures) {
  const shade = new Float32Array(CHANNELS * textures * harmonics), specular = shade.slice(), zero = new Float32Array(2 * harmonics);
  for (let k = 0; k < harmonics; k++) {
    zero[2 * k] = mean[k], zero[2 * k + 1] = mean[harmonics + k];
    axes.forEach((axis, channel) => {
      const range = field.high[channel] - field.low[channel], low = field.low[channel];
      const at = CHANNELS * (Math.floor(channel / CHANNELS) * harmonics + k) + (channel % CHANNELS);
      shade[at] = range * axis[k], specular[at] = range * axis[harmonics + k];
      zero[2 * k] += low * axis[k], zero[2 * k + 1] += low * axis[harmonics + k];
    });
  }
  return { shade, specular, zero };
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
