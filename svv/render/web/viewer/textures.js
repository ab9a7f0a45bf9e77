// The scene's textures. Only 16 can be counted on, so each holds what is of one kind in all layers: their grids lie one behind
// the other along x, the slowest axis. Places are clamped to a layer's own box, so interpolation never reaches a neighbour.

const CHANNELS = 4; // of a texel

// Return the size of a texture for grids of these sizes, null where a layer has none, and where along x each begins.
function stacked(sizes) {
  const size = [0, 0, 0], offsets = [];
  for (const own of sizes) {
    offsets.push(size[0]);
    if (own === null) continue;
    size[0] += own[0];
    for (const axis of [1, 2]) size[axis] = Math.max(size[axis], own[axis]);
  }
  return { size, offsets };
}

class Textures {
  constructor(gl) {
    this.gl = gl, this.all = {};
  }

  // Make or replace a texture for grids of these sizes; `each` bytes a texel, 0 for whole numbers, -1 for half floats.
  make(name, sizes, each) {
    const gl = this.gl, { size, offsets } = stacked(sizes), texture = this.all[name]?.texture ?? gl.createTexture(), bytes = gl.UNSIGNED_BYTE;
    const [format, layout, type] = {
      [-1]: [gl.R16F, gl.RED, gl.FLOAT], 0: [gl.R8UI, gl.RED_INTEGER, bytes], 1: [gl.R8, gl.RED, bytes], [CHANNELS]: [gl.RGBA8, gl.RGBA, bytes],
    }[each];
    this.all[name] = { texture, layout, type, size, sizes, offsets };
    gl.bindTexture(gl.TEXTURE_3D, texture);
    gl.texImage3D(gl.TEXTURE_3D, 0, format, size[2], size[1], size[0], 0, layout, type, null);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(gl.TEXTURE_3D, side, each === 0 ? gl.NEAREST : gl.LINEAR);
    for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R])
      gl.texParameteri(gl.TEXTURE_3D, axis, gl.CLAMP_TO_EDGE);
  }

  // Fill in a layer's whole grid.
  fill(name, layer, data) {
    const gl = this.gl, { texture, layout, type, sizes, offsets } = this.all[name], [x, y, z] = sizes[layer];
    gl.bindTexture(gl.TEXTURE_3D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texSubImage3D(gl.TEXTURE_3D, 0, 0, 0, offsets[layer], z, y, x, layout, type, data);
  }

  // Upload `each` channels from `first` on of the layers' fields, null where a layer has none: bytes on whole grids, zero at
  // vertices that a field does not have.
  upload(name, fields, first, each) {
    this.make(name, fields.map((field) => field && field.grid.size), each);
    fields.forEach((field, layer) => {
      if (field === null) return;
      const { size, places } = field.grid, data = new Uint8Array(each * size[0] * size[1] * size[2]);
      for (let c = 0; c < Math.min(each, field.channels - first); c++) {
        const bytes = field.bytes.subarray((first + c) * field.count, (first + c + 1) * field.count);
        for (let k = 0; k < bytes.length; k++) data[each * places[k] + c] = bytes[k];
      }
      this.fill(name, layer, data);
    });
  }

  // Upload all channels to as many textures as the layer with most of them needs, and return how many.
  split(name, fields) {
    const textures = Math.ceil(Math.max(...fields.map((field) => field?.channels ?? 0)) / CHANNELS);
    for (let t = 0; t < textures; t++) this.upload(name + t, fields, CHANNELS * t, CHANNELS);
    return textures;
  }

  // Bind all for a program, whose uniforms are `at`.
  bind(at) {
    const gl = this.gl;
    Object.entries(this.all).forEach(([name, { texture }], unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_3D, texture);
      gl.uniform1i(at[`u${name}`], unit);
    });
  }

  // Return cells per box unit of a layer's field, and where along x its grid begins in a texture.
  grid(name, layer, field) {
    return field ? [field.grid.resolution, this.all[name].offsets[layer]] : [0, 0];
  }
}
