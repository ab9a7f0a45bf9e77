// The controls beside the picture. Names come from files, so they are only ever set as text.

// Return an element with attributes and children; text is text, never HTML.
function made(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (typeof value === "boolean") element.toggleAttribute(key, value);
    else element.setAttribute(key, value);
  }
  element.append(...children);
  return element;
}

const percent = (value) => `${Math.round(100 * value)} %`;
const degrees = (value) => `${Math.round(value)}°`;

class Panel {
  // header: what the file says of the scene; state: what is set; changed: called after every change of it.
  constructor(root, header, state, changed) {
    Object.assign(this, { root, header, state, changed });
    this.updates = []; // functions that bring the controls in line with the state
    root.append(this.regions(), ...this.paintings(), ...this.lights(), ...this.doubts(), this.cuts(), this.background(), this.visions());
    this.update();
  }

  update() {
    for (const one of this.updates) one();
  }

  set(change) {
    change();
    this.update();
    this.changed();
  }

  section(heading, ...content) {
    return made("section", {}, made("h2", {}, heading), ...content);
  }

  // A slider with its label and value in words.
  slider(label, [least, most, step], format, read, write, spoken = label) {
    const said = made("span", { class: "value", "aria-hidden": "true" });
    const input = made("input", {
      type: "range", min: least, max: most, step, "aria-label": spoken,
      oninput: () => this.set(() => write(Number(input.value))),
    });
    this.updates.push(() => {
      input.value = read();
      said.textContent = format(read());
      input.setAttribute("aria-valuetext", said.textContent);
    });
    return made("div", { class: "slider" }, made("span", { class: "label", "aria-hidden": "true" }, label), input, said);
  }

  colour(label, read, write) {
    const input = made("input", { type: "color", "aria-label": label, oninput: () => this.set(() => write(fromHex(input.value))) });
    this.updates.push(() => (input.value = toHex(read())));
    return input;
  }

  regions() {
    const list = made("ul", { class: "regions" });
    this.header.layers.forEach((layer, number, { length }) => {
      if (length > 1) list.append(this.layer(layer, number));
      ofLayer(this.header.regions, layer).forEach((told, k) => list.append(this.region(told, layer.first + k)));
    });
    const all = made("button", { type: "button", onclick: () => this.set(() => this.state.regions.forEach((r) => (r.hidden = false))) }, "Show all");
    this.updates.push(() => (all.disabled = !this.state.regions.some((r) => r.hidden)));
    return this.section("Regions", list, all);
  }

  // Hides and shows all regions of a transfer function.
  layer(layer, number) {
    const name = `Function ${number}`, own = ofLayer(this.state.regions, layer);
    return made("li", { class: "layer row" }, made("span", { class: "name" }, name), this.only(name, own), this.hide(name, own));
  }

  // A button that hides some regions.
  hide(name, own) {
    const hidden = () => own.every((r) => r.hidden);
    return this.toggle("Hide", `Hide ${name}`, hidden, () => {
      const before = hidden();
      for (const region of own) region.hidden = !before;
    });
  }

  // A button that hides all other regions.
  only(name, own) {
    const others = this.state.regions.filter((r) => !own.includes(r));
    const alone = () => own.every((r) => !r.hidden) && others.every((r) => r.hidden);
    return this.toggle("Only", `Show only ${name}`, () => others.length > 0 && alone(), () => {
      const before = alone();
      for (const other of others) other.hidden = !before;
      for (const region of own) region.hidden = false;
    });
  }

  region(told, k) {
    const region = this.state.regions[k], name = told.name ?? `Region ${told.number}`;
    const colour = this.colour(`Colour of ${name}`, () => region.edited ?? region.colour, (rgb) => {
      region.edited = toHex(rgb) === toHex(region.colour) ? null : rgb;
    });
    const style = made("span", { class: "note" });
    this.updates.push(() => {
      const painted = styleOf(this.state, this.header, k);
      const covered = painted !== null && sharesOf(this.state, this.header)[k] >= 1;
      colour.disabled = covered;
      colour.title = covered ? "Its colours come from the style; turn the painting off to recolour it" : "";
      style.textContent = painted ?? told.values;
    });
    const opacity = this.slider("Opacity", [0, Math.max(2, told.opacity), 0.01], percent, () => region.opacity, (v) => (region.opacity = v), `Opacity of ${name}`);
    const item = made("li", {}, made("div", { class: "row" }, colour, made("span", { class: "name" }, name, style), this.only(name, [region]), this.hide(name, [region])), opacity);
    this.updates.push(() => item.classList.toggle("hidden", region.hidden));
    return item;
  }

  // A button that is pressed or not.
  toggle(text, label, read, write) {
    const button = made("button", { type: "button", "aria-label": label, title: label, onclick: () => this.set(write) }, text);
    this.updates.push(() => button.setAttribute("aria-pressed", String(read())));
    return button;
  }

  paintings() {
    const { paintings } = this.header;
    if (!paintings.length) return [];
    const select = made("select", { "aria-label": "Painting", onchange: () => this.set(() => {
      this.state.painting = select.value === "" ? null : Number(select.value);
    }) }, made("option", { value: "" }, "None: the palette's colours"));
    paintings.forEach((painting, k) => select.append(made("option", { value: k }, painting.name)));
    this.updates.push(() => (select.value = this.state.painting ?? ""));
    const strength = this.slider("Strength", [0, 1, 0.01], percent, () => this.state.strength, (v) => (this.state.strength = v), "Strength of the painting");
    this.updates.push(() => (strength.hidden = this.state.painting === null));
    return [this.section("Painting", select, strength)];
  }

  lights() {
    const kinds = this.header.layers.map(({ lighting }) => lighting), { state } = this;
    if (kinds.every((lighting) => lighting === "none")) return this.header.shadows === null ? [] : [this.section("Light", ...this.shadows())];
    const content = [this.slider("Amount", [0, 1, 0.01], (v) => (v === 0 ? "off" : percent(v)), () => state.light, (v) => (state.light = v), "Light")];
    if (kinds.includes("phong")) {
      const angle = (v) => (state.lamp.direction === null ? degrees(v) : "fixed"); // in the world, until it is moved
      const move = (name) => (v) => (state.lamp = { ...state.lamp, direction: null, [name]: v });
      content.push(
        this.slider("Right", [-180, 180, 1], angle, () => state.lamp.azimuth, move("azimuth"), "Light from the right of the camera, in degrees"),
        this.slider("Above", [-90, 90, 1], angle, () => state.lamp.elevation, move("elevation"), "Light from above the camera, in degrees"),
        this.slider("Brightness", [0, Math.max(2, state.lamp.intensity), 0.01], percent, () => state.lamp.intensity, (v) => (state.lamp = { ...state.lamp, intensity: v })),
      );
    }
    return [this.section("Light", ...content, ...this.shadows())];
  }

  // How far shadows darken, and where they come from: in the file, or a light of their own that is moved with the camera.
  shadows() {
    const { state, header: { shadows } } = this;
    if (shadows === null) return [];
    const own = () => {
      const { azimuth, elevation, direction, shadow_light: light } = state.lamp;
      if (light?.length === 2) return light;
      return light === null && direction === null && (azimuth !== 0 || elevation !== 0) ? [azimuth, elevation] : shadows.upper_left;
    };
    const angle = (v) => (state.lamp.shadow_light?.length === 3 || (state.lamp.shadow_light === null && state.lamp.direction !== null) ? "fixed" : degrees(v));
    const moved = (k) => (v) => (state.lamp = { ...state.lamp, shadow_light: own().map((before, axis) => (axis === k ? v : before)) });
    const from = [
      this.slider("From right", [-180, 180, 1], angle, () => own()[0], moved(0), "Shadows from the right of the camera, in degrees"),
      this.slider("From above", [-90, 90, 1], angle, () => own()[1], moved(1), "Shadows from above the camera, in degrees"),
    ];
    this.updates.push(() => from.forEach((slider) => (slider.hidden = state.lamp.shadow === 0)));
    return [this.slider("Shadows", [0, 1, 0.01], percent, () => state.lamp.shadow, (v) => (state.lamp = { ...state.lamp, shadow: v })), ...from];
  }

  // Shows the errors that pixels are expected to have instead of their colours, where the scene knows them.
  doubts() {
    const { state, header: { doubt } } = this;
    if (doubt === null) return [];
    const toggle = this.toggle("Doubt", "Show how far off the picture is expected to be", () => state.doubt, () => (state.doubt = !state.doubt));
    const colours = doubt.heat.map((rgb) => toHex(rgb)).join(), least = made("span", {}, "0 %"), most = made("span", {}, `${(100 * doubt.darkest).toPrecision(2)} % or more`);
    const scale = made("div", { class: "heat", role: "img", "aria-label": `Expected error, from none, pale, to ${most.textContent}, dark` }, least, most);
    scale.style.background = `linear-gradient(to right, ${colours})`;
    this.updates.push(() => (scale.hidden = !state.doubt));
    return [this.section("Expected error", toggle, scale)];
  }

  // A plane that cuts the scene open, and whether the cuts of its file show.
  cuts() {
    const { state } = this, content = [];
    if (this.header.cuts.length > 0)
      content.push(this.toggle("As in the file", "Show the cuts of the file", () => state.cuts, () => (state.cuts = !state.cuts)));
    const select = made("select", { "aria-label": "Cut", onchange: () => this.set(() => {
      state.cut.axis = select.value === "" ? null : Number(select.value);
    }) }, made("option", { value: "" }, "None"));
    ["x", "y", "z"].forEach((name, k) => select.append(made("option", { value: k }, `Across ${name}`)));
    const place = this.slider("Place", [0, 1, 0.005], percent, () => state.cut.at, (v) => (state.cut.at = v), "Place of the cut");
    const other = this.toggle("Other side", "Cut off the other side", () => state.cut.below, () => (state.cut.below = !state.cut.below));
    this.updates.push(() => {
      select.value = state.cut.axis ?? "";
      place.hidden = other.hidden = state.cut.axis === null;
    });
    return this.section("Cut", ...content, select, place, other);
  }

  // Shows the picture as people with a colour vision deficiency see it, or as a grey print; no edit, and not saved.
  visions() {
    const { visions } = this.header, filters = document.getElementById("visions"), [empty] = filters.children;
    const select = made("select", { "aria-label": "Colour vision", onchange: () => {
      document.getElementById("picture").style.filter = select.value === "" ? "" : `url(#vision${select.value})`;
    } }, made("option", { value: "" }, "Normal"));
    Object.entries(visions).forEach(([name, matrix], k) => {
      const filter = empty.cloneNode(true);
      filter.id = `vision${k}`;
      const values = [...matrix.map((row) => [...row, 0, 0]), [0, 0, 0, 1, 0]];
      filter.firstElementChild.setAttribute("values", values.flat().join(" "));
      filters.append(filter);
      select.append(made("option", { value: k }, name[0].toUpperCase() + name.slice(1)));
    });
    return this.section("Seen with", select);
  }

  background() {
    const { state } = this, choices = made("div", { class: "row" });
    choices.append(this.colour("Colour of the background", () => state.background, (rgb) => (state.background = rgb)));
    for (const [name, rgb] of [["White", [1, 1, 1]], ["Grey", [0.5, 0.5, 0.5]], ["Black", [0, 0, 0]]])
      choices.append(made("button", { type: "button", "aria-label": `${name} background`, onclick: () => this.set(() => (state.background = rgb)) }, name));
    return this.section("Background", choices);
  }
}
