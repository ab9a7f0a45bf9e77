// Key frames of a shot: what the page shows at some times, for `svv render --shot`.

const REST = 2; // seconds between key frames, unless the user says otherwise

class Film {
  // told: what is set now, {view, edits}; take: sets it again; size: width and height of the picture; say: shows a sentence.
  constructor(root, header, told, take, size, say) {
    Object.assign(this, { header, told, take, size, say });
    this.keys = []; // {time, view, edits}
    this.seconds = made("input", { type: "number", min: 0.1, max: 600, step: 0.1, value: REST, "aria-label": "Seconds from the last key frame to the next one" });
    this.list = made("div", { class: "row keys" });
    this.undo = made("button", { type: "button", onclick: () => this.change(() => this.keys.pop()) }, "Remove last");
    this.save = made("button", { type: "button", class: "main", onclick: () => this.saved() }, "Save shot");
    const add = made("button", { type: "button", onclick: () => this.add() }, "Add key frame");
    const after = made("label", { class: "row" }, made("span", { class: "label" }, "After"), this.seconds, made("span", { class: "label" }, "s"));
    root.append(made("section", {}, made("h2", {}, "Film"), after, made("div", { class: "buttons" }, add, this.undo, this.save), this.list));
    this.change(() => {});
  }

  change(act) {
    act();
    this.undo.disabled = this.keys.length === 0, this.save.disabled = this.keys.length < 2;
    this.list.replaceChildren(...this.keys.map(({ time, view, edits }) =>
      made("button", { type: "button", "aria-label": `Show the key frame at ${time} s`, onclick: () => this.take({ view, edits }) }, `${time} s`)));
  }

  add() {
    const step = Number(this.seconds.value);
    if (this.keys.length && !(step >= 0.1 && step <= 600)) return this.say("Seconds from one key frame to the next are 0.1 to 600.");
    const last = this.keys.at(-1), time = last ? Number((last.time + step).toFixed(3)) : 0;
    this.change(() => this.keys.push({ time, ...structuredClone(this.told()) }));
    this.say(`Key frame ${this.keys.length} is at ${time} s.`);
  }

  // Save the shot, or say why it would not be what the page shows.
  saved() {
    const { keys, header } = this, paintings = new Set(keys.map(({ edits }) => edits.painting).filter((k) => k !== null));
    if (paintings.size > 1) return this.say("A shot shows one painting: choose the same one in all key frames, or none.");
    if (new Set(keys.map(({ edits }) => edits.lamp.direction === null)).size > 1)
      return this.say("The light has angles in some key frames and the file's direction in others: move it in all of them.");
    const shadows = ({ shadow, shadow_softness, shadow_light }) => JSON.stringify([shadow, shadow_softness, shadow_light]);
    if (keys.some(({ edits }) => shadows(edits.lamp) !== shadows(header.lamp)))
      return this.say("A shot has the shadows of its scene: set them as in the file, or change those with svv edit --shadow and --shadow-light.");
    const [painting] = paintings, [width, height] = this.size();
    const shot = { size: [width, height], background: keys.at(-1).edits.background, keys: this.frames() };
    if (painting !== undefined && header.layers.length === 1) shot.painting = header.paintings[painting].name;
    const name = `${header.file}.shot.json`, blob = new Blob([JSON.stringify(shot, null, 1)], { type: "application/json" });
    const link = made("a", { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    this.say(`The shot was saved. This makes the film: svv render SCENE.svv --shot ${name} --out film.mp4`);
  }

  // Return the key frames as the command reads them: everything that differs anywhere from what the file has.
  frames() {
    const { keys, header } = this, [width, height] = this.size();
    const looks = keys.map(({ edits }) => edits.regions.map((region, k) => this.look(edits, region, k)));
    const own = this.file().regions.map((region, k) => this.look(this.file(), region, k));
    const lights = keys.map(({ edits }) => edits.lamp), file = header.lamp;
    const lit = lights.some((lamp) => JSON.stringify(lamp) !== JSON.stringify(file));
    const cut = this.cutsVary();
    return keys.map(({ time, view, edits }, number) => {
      const frame = { time, camera: this.camera(view, width, height) }, regions = {};
      own.forEach((before, k) => {
        const covered = looks.every((look) => look[k].strength >= 1); // by paint: the command does not colour what nobody sees
        const varies = (name) => looks.some((look) => JSON.stringify(look[k][name]) !== JSON.stringify(before[name]));
        const varied = Object.keys(before).filter((name) => varies(name) && !(covered && name === "colour"));
        if (varied.length) regions[header.regions[k].number] = Object.fromEntries(varied.map((name) => [name, looks[number][k][name]]));
      });
      if (Object.keys(regions).length) frame.regions = regions;
      if (cut) frame.cuts = cutsOf(edits, header).map(({ text }) => text);
      if (lit) {
        const { azimuth, elevation, direction, intensity } = lights[number];
        frame.light = direction === null ? { azimuth, elevation, intensity } : { direction, intensity };
      }
      return frame;
    });
  }

  // Whether a key frame is cut otherwise than the file.
  cutsVary() {
    const own = JSON.stringify(cutsOf(this.file(), this.header));
    return this.keys.some(({ edits }) => JSON.stringify(cutsOf(edits, this.header)) !== own);
  }

  file() {
    return stateOf(this.header);
  }

  // What the command calls the edits of a region.
  look(edits, { colour, edited, opacity, hidden }, k) {
    const told = this.header.regions[k], found = { colour: edited ?? colour, opacity, hidden, lighting: edits.light * told.lighting };
    if (this.header.paintings.some(({ styles }) => styles[k] !== null)) found.strength = (edits.painting === null ? 0 : edits.strength) * told.strength;
    return found;
  }

  camera(view, width, height) {
    const orbit = new Orbit(this.header.camera);
    orbit.view = view;
    const { camera_to_world: m, fov_x, span_x } = orbit.camera(width, height);
    const matrix = [0, 1, 2, 3].map((row) => m.slice(4 * row, 4 * row + 4));
    return { camera_to_world: matrix, ...(span_x === null ? { fov: (180 / Math.PI) * fov_x } : { span: span_x }) };
  }
}
