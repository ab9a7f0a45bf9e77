// Mouse, touch and keys on the picture.

const TURN = 3.2; // radians for a drag across the shorter side
const STILL = 4; // pixels that a click may move
const KEY_TURN = Math.PI / 36, KEY_ZOOM = 1.1, KEY_PAN = 0.03;

class Hands {
  // moved: called after every movement of the orbit; clicked: with the place of a click, in fractions of the canvas.
  constructor(canvas, orbit, moved, clicked) {
    Object.assign(this, { canvas, orbit, moved, clicked });
    this.points = new Map(); // pointers that are down, by their number
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    canvas.addEventListener("pointercancel", (event) => this.points.delete(event.pointerId));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", () => this.act(() => orbit.reset()));
  }

  act(movement) {
    movement();
    this.moved();
  }

  get side() {
    return Math.min(this.canvas.clientWidth, this.canvas.clientHeight) || 1;
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    const { clientX: x, clientY: y } = event, pans = event.button > 0 || event.shiftKey;
    this.points.set(event.pointerId, { x, y, pans, still: !pans && this.points.size === 0, first: [x, y] });
  }

  up(event) {
    const point = this.points.get(event.pointerId), seen = this.canvas.getBoundingClientRect();
    this.points.delete(event.pointerId);
    if (point?.still) this.clicked((point.x - seen.left) / seen.width, (point.y - seen.top) / seen.height);
  }

  move(event) {
    const point = this.points.get(event.pointerId);
    if (point === undefined) return;
    if (Math.hypot(event.clientX - point.first[0], event.clientY - point.first[1]) > STILL) point.still = false;
    const before = [...this.points.values()].map(({ x, y }) => ({ x, y }));
    const dx = (event.clientX - point.x) / this.side, dy = (event.clientY - point.y) / this.side;
    point.x = event.clientX, point.y = event.clientY;
    const after = [...this.points.values()];
    this.act(() => {
      if (after.length > 1) this.pinch(before, after);
      else if (point.pans) this.orbit.pan(dx, -dy);
      else this.orbit.turn(-TURN * dx, TURN * dy);
    });
  }

  // Two fingers zoom, move and roll.
  pinch([a, b], [c, d]) {
    const length = (p, q) => Math.max(Math.hypot(q.x - p.x, q.y - p.y), 1), angle = (p, q) => Math.atan2(q.y - p.y, q.x - p.x);
    this.orbit.closer(length(c, d) / length(a, b));
    this.orbit.pan((c.x + d.x - a.x - b.x) / (2 * this.side), -(c.y + d.y - a.y - b.y) / (2 * this.side));
    let roll = angle(c, d) - angle(a, b);
    if (Math.abs(roll) > Math.PI) roll -= 2 * Math.PI * Math.sign(roll);
    this.orbit.turn(0, 0, roll);
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    this.act(() => this.orbit.closer(Math.exp(-0.0015 * lines * event.deltaY)));
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { orbit } = this, arrows = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const others = {
      "+": () => orbit.closer(KEY_ZOOM), "=": () => orbit.closer(KEY_ZOOM), "-": () => orbit.closer(1 / KEY_ZOOM),
      "[": () => orbit.turn(0, 0, KEY_TURN), "]": () => orbit.turn(0, 0, -KEY_TURN),
      Home: () => orbit.reset(), 0: () => orbit.reset(),
    };
    let movement = others[event.key];
    if (arrows !== undefined && event.shiftKey) movement = () => orbit.pan(-KEY_PAN * arrows[0], KEY_PAN * arrows[1]);
    else if (arrows !== undefined) movement = () => orbit.turn(KEY_TURN * arrows[0], KEY_TURN * arrows[1]);
    if (movement === undefined) return;
    event.preventDefault();
    this.act(movement);
  }
}
