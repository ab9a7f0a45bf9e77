// Start: read the scene, draw it, and connect the controls.

const page = (id) => document.getElementById(id);

// Show a sentence instead of the picture that moves; the still picture stays.
function cannot(reason) {
  page("said").textContent = `This scene cannot be turned here: ${reason}. The picture shows it from the front.`;
  document.body.classList.add("still");
}

async function begin() {
  const header = JSON.parse(page("scene").textContent), canvas = page("picture");
  if (typeof DecompressionStream === "undefined") throw new Unable("this browser is too old; its newest version can");
  const gl = canvas.getContext("webgl2", { antialias: false, depth: false, powerPreference: "high-performance" });
  if (gl === null) throw new Unable("this browser has no WebGL2, or it is turned off");
  const content = decoded(header, await inflated(page("arrays").textContent));
  const state = stateOf(header), orbit = new Orbit(header.camera);
  let show = start();

  function start() {
    return new Show(canvas, new Painter(gl, header, content), orbit, state);
  }
  const changed = () => show.change(), panel = new Panel(page("controls"), header, state, changed);
  new Hands(canvas, orbit, changed);
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", () => {
    show.stop();
    show = start();
  });
  page("reset-view").addEventListener("click", () => (orbit.reset(), changed()));
  page("reset").addEventListener("click", () => panel.set(() => {
    const fresh = stateOf(header);
    fresh.regions.forEach((region, k) => Object.assign(state.regions[k], region));
    Object.assign(state, { ...fresh, regions: state.regions });
    orbit.reset();
  }));
  page("save").addEventListener("click", () => save(header, show.picture(show.camera())));
  document.body.classList.add("live");
  // For scripts, such as tests and notebooks: the state, and the picture of a camera as svv writes it.
  return { header, state, orbit, panel, changed, picture: (camera) => show.picture(camera), get show() { return show; } };
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

window.svv = begin();
window.svv.catch((error) => {
  cannot(error instanceof Unable ? error.message : `an error occurred (${error.message})`);
  if (!(error instanceof Unable)) throw error;
});
