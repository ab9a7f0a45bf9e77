// The picture on the page: coarse while something moves, then drawn again in full, a few rows at a time.

const MOVING_MS = 60; // time aimed at for a picture while something moves
const MOVING_STRIDE = 1.5; // distance between samples while something moves, as a multiple of that at rest
const ROWS_MS = 40; // time aimed at for the rows that are drawn at once at rest, so that the page stays responsive
const REST_MS = 160; // time without a movement after which the picture is drawn in full
const SMALLEST = 0.15; // size of the coarsest picture, as a part of the canvas's
const MOST_PIXELS = 2.2e6; // of a picture; screens with more show it enlarged

class Show {
  constructor(canvas, painter, orbit, state) {
    Object.assign(this, { canvas, painter, orbit, state });
    this.gl = painter.gl, this.part = 0.5, this.rows = 32;
    this.frames = 0; // pictures shown so far
    this.fence = null;
    this.targets = { coarse: this.target(), full: this.target(), finished: this.target(), doubted: this.target(), lined: this.target(), ink: this.target() };
    this.inking = null; // the ink that is being computed for the picture at rest
    this.change();
    requestAnimationFrame(() => this.step());
  }

  // Whether the picture has ink, once nothing moves any more.
  get lines() {
    const { outlines, sections } = inkOf(this.state, this.painter.header);
    return !this.state.doubt && (outlines || sections);
  }

  // The target of a picture's march: what is left of errors has 16 bits, and what ink is drawn from is in a second texture.
  marched(target) {
    return this.state.doubt ? this.targets.doubted : target === this.targets.full && this.lines ? this.targets.lined : target;
  }

  target() {
    const gl = this.gl, texture = gl.createTexture(), buffer = gl.createFramebuffer();
    return { texture, buffer, width: 0, height: 0 };
  }

  // Bind a target of this size.
  into(target, width, height) {
    const gl = this.gl, { doubted, lined } = this.targets;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.buffer);
    if (target.width === width && target.height === height) return;
    Object.assign(target, { width, height });
    gl.activeTexture(gl.TEXTURE0);
    this.attach(target.texture, gl.COLOR_ATTACHMENT0, target === doubted ? [gl.RGBA16UI, gl.RGBA_INTEGER, gl.UNSIGNED_SHORT] : [gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE], width, height);
    if (target !== lined) return;
    target.told ??= gl.createTexture();
    this.attach(target.told, gl.COLOR_ATTACHMENT1, [gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT], width, height);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
  }

  // Give the bound framebuffer a texture of some format.
  attach(texture, place, [format, layout, type], width, height) {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, format, width, height, 0, layout, type, null);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, place, gl.TEXTURE_2D, texture, 0);
  }

  bind(target) {
    this.gl.bindFramebuffer(this.gl.FRAMEBUFFER, target.buffer);
  }

  // Something was moved or edited: the picture has to be drawn again.
  change() {
    this.changed = this.stale = true, this.since = performance.now(), this.done = 0, this.inking = null;
  }

  // Return the camera of the canvas, which has the size at which it is seen, within limits.
  camera() {
    const seen = this.canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
    const scale = Math.min(ratio, Math.sqrt(MOST_PIXELS / Math.max(1, seen.width * seen.height)));
    return this.orbit.camera(Math.max(1, Math.round(seen.width * scale)), Math.max(1, Math.round(seen.height * scale)));
  }

  // End for good, when the graphics were lost.
  stop() {
    this.stopped = true;
  }

  step() {
    if (this.stopped) return;
    requestAnimationFrame(() => this.step());
    if (this.gl.isContextLost() || !this.free()) return;
    const camera = this.camera();
    if (camera.width !== this.canvas.width || camera.height !== this.canvas.height) {
      this.canvas.width = camera.width, this.canvas.height = camera.height;
      this.change();
    }
    if (this.changed) this.drawCoarse(camera);
    else if (this.stale && performance.now() - this.since > REST_MS && this.painter.refine(SOFT_MS)) {
      if (this.inking === null) this.drawRows(camera);
      else this.drawInk();
    }
  }

  // Whether the last drawing has ended; its time sets the size of the next one.
  free() {
    if (this.fence === null) return true;
    const gl = this.gl, state = gl.clientWaitSync(this.fence, 0, 0);
    if (state === gl.TIMEOUT_EXPIRED) return false;
    gl.deleteSync(this.fence);
    this.fence = null;
    this.learn(performance.now() - this.began);
    return true;
  }

  begin(learn) {
    this.began = performance.now(), this.learn = learn;
  }

  end() {
    this.fence = this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.gl.flush();
  }

  drawCoarse(camera) {
    this.changed = false;
    const { state, painter } = this, height = Math.max(1, Math.round(camera.height * this.part));
    painter.prepare(state, camera);
    this.begin((ms) => {
      const better = this.part * Math.sqrt(MOVING_MS / Math.max(ms, 1));
      this.part = Math.min(Math.max(0.5 * (this.part + better), SMALLEST), 1);
    });
    const target = this.marched(this.targets.coarse);
    this.into(target, Math.max(1, Math.round(camera.width * this.part)), height);
    painter.draw(state, camera, this.part, 0, height, { stride: MOVING_STRIDE });
    this.present(this.finished(target, camera));
    this.end();
  }

  drawRows(camera) {
    const target = this.marched(this.targets.full), from = this.done, to = Math.min(camera.height, from + this.rows);
    this.begin((ms) => (this.rows = Math.max(4, Math.round(this.rows * Math.min(Math.max(ROWS_MS / Math.max(ms, 1), 0.5), 2)))));
    this.into(target, camera.width, camera.height);
    const lines = target === this.targets.lined;
    this.painter.draw(this.state, camera, 1, from, to, { lines });
    this.done = to;
    if (to === camera.height) {
      this.stale = lines;
      this.present(this.finished(target, camera));
      if (lines) this.inking = inkLayer(this.told(target), camera, this.state, this.painter.header);
    }
    this.end();
  }

  // What a march has told of the pixels, for ink.
  told({ width, height }) {
    const gl = this.gl, told = new Uint32Array(4 * width * height);
    this.bind(this.targets.lined);
    gl.readBuffer(gl.COLOR_ATTACHMENT1);
    this.read(0, 0, width, height, told);
    gl.readBuffer(gl.COLOR_ATTACHMENT0);
    return told;
  }

  // Go on with the ink of the picture at rest, and show both once it is there.
  drawInk() {
    const end = performance.now() + SOFT_MS;
    for (;;) {
      const { done, value } = this.inking.next();
      if (done) {
        this.inking = null, this.stale = false;
        return this.present(this.inked(this.targets.lined, value));
      }
      if (performance.now() > end) return;
    }
  }

  // Return a target with a picture under a layer of ink.
  inked(target, layer) {
    const gl = this.gl, { finished, ink } = this.targets, { width, height } = target;
    this.into(ink, width, height);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, ink.texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, layer);
    this.into(finished, width, height);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, target.buffer);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    this.bind(finished);
    this.painter.blend(ink);
    return finished;
  }

  // Return a target with what is shown of a picture that was drawn into one.
  finished(target, camera) {
    if (!this.state.doubt) return target;
    this.into(this.targets.finished, target.width, target.height);
    this.painter.showDoubt(this.state, camera, target);
    return this.targets.finished;
  }

  // Show a target on the canvas.
  present(target) {
    const gl = this.gl, { width, height } = this.canvas;
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, target.buffer);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    const filter = target.width === width && target.height === height ? gl.NEAREST : gl.LINEAR;
    gl.blitFramebuffer(0, 0, target.width, target.height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, filter);
    this.frames++;
  }

  // Read the pixels of a rectangle; lost graphics would leave them empty.
  read(left, bottom, width, height, into) {
    const gl = this.gl, [layout, type] = into instanceof Uint32Array ? [gl.RGBA_INTEGER, gl.UNSIGNED_INT] : [gl.RGBA, gl.UNSIGNED_BYTE];
    gl.readPixels(left, bottom, width, height, layout, type, into);
    if (gl.isContextLost()) throw new Unable("the browser has taken the graphics away");
  }

  // Return the point that a camera's pixel shows, in world coordinates, and its region; null where nothing is visible.
  placeAt(camera, column, row) {
    const { width, height } = camera, [first] = this.painter.header.layers, told = new Uint8Array(4);
    this.painter.prepare(this.state, camera);
    this.into(this.targets.full, width, height);
    this.painter.draw(this.state, camera, 1, height - 1 - row, height - row, { columns: [column, column + 1], place: true });
    this.read(column, height - 1 - row, 1, 1, told);
    this.change();
    if (told[3] === 0) return null;
    const away = (FARTHEST * first.box.size * (65536 * told[0] + 256 * told[1] + told[2])) / 16777215;
    return { point: pointOf(camera, column + 0.5, row + 0.5, away), region: told[3] - 1 };
  }

  // Return the error that a camera's pixel is expected to have; null where nothing is visible, or it is not known.
  doubtAt(camera, column, row) {
    const { width, height } = camera, { doubt } = this.painter.header, right = Math.min(column + 1, width - 1), below = Math.min(row + 1, height - 1);
    if (doubt === null) return null;
    this.into(this.targets.doubted, width, height);
    this.painter.draw({ ...this.state, doubt: true }, camera, 1, height - 1 - below, height - row, { columns: [column, right + 1] });
    const told = [[column, row], [right, row], [column, below]].map(([x, y]) => {
      const whole = new Uint32Array(4);
      this.read(x, height - 1 - y, 1, 1, whole);
      return whole;
    });
    this.change();
    return errorOf(doubt, camera, ...told);
  }

  // Return a camera's picture, drawn in full: RGBA bytes, row 0 at the top.
  picture(camera) {
    const { width, height } = camera, flipped = new Uint8Array(4 * width * height), target = this.marched(this.targets.full);
    this.painter.prepare(this.state, camera);
    this.painter.refine();
    this.into(target, width, height);
    const lines = target === this.targets.lined;
    this.painter.draw(this.state, camera, 1, 0, height, { lines });
    this.bind(lines ? this.inked(target, finished(inkLayer(this.told(target), camera, this.state, this.painter.header))) : this.finished(target, camera));
    this.read(0, 0, width, height, flipped);
    this.change();
    const data = new Uint8ClampedArray(flipped.length);
    for (let row = 0; row < height; row++)
      data.set(flipped.subarray(4 * width * row, 4 * width * (row + 1)), 4 * width * (height - 1 - row));
    return new ImageData(data, width, height);
  }
}
