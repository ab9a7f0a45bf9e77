// A scene's page below a notebook's cell, in a frame of its own: pages neither meet each other nor the notebook's styles.
// It takes the place of the page that stands there as plain HTML, for notebooks that are shown without this program.
// What is set in the page goes to Python and comes from there: the view, its camera, and the edits.

const PAUSE_MS = 100; // without a further change before Python is told

function render({ model, el }) {
  const frame = document.createElement("iframe");
  frame.style.cssText = "width: 100%; border: 0; display: block";
  let page = null, timer = null, known = "";

  const bar = document.createElement("progress"), told = document.createElement("span"), work = document.createElement("div");
  work.append(bar, " ", told);
  function progressed() {
    bar.value = model.get("fraction");
    bar.hidden = bar.value >= 1;
    told.textContent = bar.hidden && model.get("told") === "done" ? "" : model.get("told");
    work.hidden = bar.hidden && told.textContent === "";
  }
  function replaced() {
    page = null;
    frame.title = model.get("_said");
    frame.srcdoc = model.get("page");
  }

  const sized = () => (frame.style.height = `${model.get("height")}px`);
  const written = ({ view, edits }) => JSON.stringify([view, edits]);

  function tell() {
    const { view, camera, edits } = JSON.parse(JSON.stringify(page.told())); // the page's own objects go on changing
    known = written({ view, edits });
    for (const [name, value] of Object.entries({ view, _camera: camera, edits })) model.set(name, value);
    model.save_changes();
  }

  function hear() {
    const set = structuredClone({ view: model.get("view"), edits: model.get("edits") });
    if (page === null || !set.view.axes) return;
    if (!set.edits.regions) set.edits = JSON.parse(JSON.stringify(page.told().edits)); // of a scene that has just come
    if (written(set) === known) return;
    known = written(set);
    page.take(set);
  }

  // A frame that is moved within the notebook loads again: what was set is kept.
  frame.addEventListener("load", async () => {
    page = null;
    const opened = await frame.contentWindow.svv?.catch(() => null); // a page that cannot draw the scene says so itself
    if (opened === null || opened === undefined) return;
    page = opened;
    known = "";
    hear();
    page.heard.push(() => {
      clearTimeout(timer);
      timer = setTimeout(tell, PAUSE_MS);
    });
    tell();
  });
  model.on("change:view", hear);
  model.on("change:edits", hear);
  model.on("change:height", sized);
  model.on("change:page", replaced);
  model.on("change:fraction", progressed);
  model.on("change:told", progressed);
  sized();
  progressed();
  for (const page of document.querySelectorAll(`[data-svv="${model.get("_name")}"]`)) page.remove();
  replaced();
  el.append(work, frame);
  return () => {
    clearTimeout(timer);
    model.off("change:view", hear);
    model.off("change:edits", hear);
    model.off("change:height", sized);
    model.off("change:page", replaced);
    model.off("change:fraction", progressed);
    model.off("change:told", progressed);
  };
}

export default { render };
