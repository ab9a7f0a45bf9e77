// Start: read the scene, draw it, and connect the controls.

const page = (id) => document.getElementById(id);

const LOST = "The browser has taken the graphics away, as it does with too many pages at once; the picture returns with them.";

// Show a sentence instead of the scene, and its orbit as a movie; where that cannot be played, the picture stays.
function cannot(reason) {
  const say = (rest) => (page("said").textContent = `This scene cannot be turned here: ${reason}. ${rest}`), movie = page("movie");
  say("The picture shows it from the front.");
  document.body.classList.replace("live", "still") || document.body.classList.add("still");
  movie.addEventListener("canplay", () => {
    say("The movie shows it from all around.");
    document.body.classList.add("moving");
  });
  movie.autoplay = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  movie.preload = "auto";
  movie.load();
}

// Say how far the last of the places that were clicked on is from the one before, and the angle that three make there.
function measured(places, unit) {
  if (places.length < 2) return "";
  const [last, middle, first] = places.slice(-3).reverse(), from = (place) => place.map((v, k) => v - middle[k]);
  const number = (v) => Number(v.toPrecision(5)), one = from(last), away = Math.hypot(...one), said = `, ${number(away)}${unit && ` ${unit}`} from the last place`;
  if (first === undefined) return said;
  const other = from(first), across = Math.hypot(...one.map((_, k) => one[(k + 1) % 3] * other[(k + 2) % 3] - one[(k + 2) % 3] * other[(k + 1) % 3]));
  if (away === 0 || Math.hypot(...other) === 0) return said;
  const angle = Math.atan2(across, one.reduce((sum, v, k) => sum + v * other[k], 0));
  return `${said}, angle there ${number((180 * angle) / Math.PI)}°`;
}

async function begin() {
  const header = JSON.parse(page("scene").textContent), canvas = page("picture");
  if (typeof DecompressionStream === "undefined") throw new Unable("this browser is too old; its newest version can");
  const gl = canvas.getContext("webgl2", { antialias: false, depth: false, powerPreference: "high-performance" });
  if (gl === null) throw new Unable("this browser has no WebGL2, or it is turned off");
  const { layers: content, doubted: levels } = decoded(header, await inflated(page("arrays").textContent));
  const most = { side: gl.getParameter(gl.MAX_3D_TEXTURE_SIZE), bytes: MOST_BYTES };
  const { layers, said } = fitted(content.map(({ fields }) => fields), most);
  page("said").textContent = said;
  const state = stateOf(header), orbit = new Orbit(header.camera), heard = [], places = [];
  let show = start();

  function start() {
    return new Show(canvas, new Painter(gl, header, content.map((layer, number) => ({ ...layer, fields: layers[number] })), levels), orbit, state);
  }
  function changed() {
    show.change();
    for (const one of heard) one();
  }
  const panel = new Panel(page("controls"), header, state, changed);
  const take = ({ view, edits }) => {
    if (view) orbit.view = view;
    if (edits) overwrite(state, edits);
    panel.set(() => {});
  };
  const size = () => [show.camera().width, show.camera().height], say = (sentence) => (page("said").textContent = sentence);
  const film = new Film(page("controls"), header, () => ({ view: orbit.view, edits: state }), take, size, say);
  const values = new Values(header.values, page("values")?.textContent ?? "");
  // Return the value that is read off at a point of a region, in words, as it is told.
  async function read(point, region) {
    const layer = header.layers.findIndex(({ first, count }) => region >= first && region < first + count);
    const found = await values.at(layer, point, header.regions[region].interval);
    return { ...found, words: valueInWords(header.values[layer], found, header.units.value) };
  }
  // Say what is at a place of the picture, as the commands take it.
  async function clicked(x, y) {
    if (gl.isContextLost()) return (page("said").textContent = LOST);
    const camera = show.camera(), pixel = [x * camera.width, y * camera.height].map(Math.floor), found = show.placeAt(camera, ...pixel);
    if (found === null) return (page("said").textContent = "Nothing is visible there.");
    const told = header.regions[found.region], name = told.name ?? `Region ${told.number}`;
    const error = show.doubtAt(camera, ...pixel), trust = error === null ? "" : `; expected error ${(100 * error).toPrecision(2)} %`;
    places.push(found.point);
    const away = measured(places, header.units.length), number = places.length, { words } = await read(found.point, found.region);
    if (number !== places.length) return; // there was another click meanwhile
    page("said").textContent = `${name} at ${found.point.map((v) => Number(v.toPrecision(5))).join(",")}${away}${words}${trust}`;
  }
  new Hands(canvas, orbit, changed, clicked);
  canvas.addEventListener("webglcontextlost", (event) => {
    event.preventDefault(); // or they would not return
    page("said").textContent = LOST;
  });
  canvas.addEventListener("webglcontextrestored", () => {
    show.stop();
    try {
      show = start();
    } catch (error) {
      return failed(error);
    }
    page("said").textContent = said;
  });
  page("reset-view").addEventListener("click", () => (orbit.reset(), changed()));
  page("reset").addEventListener("click", () => panel.set(() => {
    overwrite(state, stateOf(header));
    orbit.reset();
  }));
  page("save").addEventListener("click", () => {
    if (gl.isContextLost()) page("said").textContent = LOST;
    else save(header, show.picture(show.camera()));
  });
  document.body.classList.add("live");
  // For scripts, such as tests and notebooks: the state, the picture of a camera as svv writes it, functions to call
  // after each change, what the user has set so far, and a way to set it.
  return {
    header, state, orbit, panel, film, changed, heard, place: (camera, column, row) => show.placeAt(camera, column, row), read, doubt: (camera, column, row) => show.doubtAt(camera, column, row), picture: (camera) => show.picture(camera), get show() { return show; },
    told: () => ({ view: orbit.view, camera: show.camera(), edits: state }),
    take,
  };
}

// Save a picture as a PNG file.
function save(header, picture) {
  const canvas = made("canvas", { width: picture.width, height: picture.height });
  canvas.getContext("2d").putImageData(picture, 0, 0);
  canvas.toBlob((blob) => {
    const link = made("a", { href: URL.createObjectURL(blob), download: `${header.file}.png` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    page("said").textContent = `The picture was saved as ${header.file}.png.`;
  }, "image/png");
}

// Say why the scene cannot be turned.
function failed(error) {
  cannot(error instanceof Unable ? error.message : `an error occurred (${error.message})`);
  if (!(error instanceof Unable)) throw error;
}

window.svv = begin();
window.svv.catch(failed);
