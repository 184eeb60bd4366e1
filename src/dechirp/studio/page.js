// Behaviour of the page: tabs, keys, light and dark theme, and acknowledgement of drawn frames.
"use strict";

// Frames drawn since the page began; benchmarks and tests read it.
window.dechirp = { frames: 0, ready: false };

for (const list of document.querySelectorAll("[role=tablist]")) {
  const tabs = [...list.children];
  const select = (chosen) => {
    for (const tab of tabs) {
      const is = tab === chosen;
      tab.setAttribute("aria-selected", String(is));
      tab.tabIndex = is ? 0 : -1;
      document.getElementById(tab.getAttribute("aria-controls")).hidden = !is;
    }
    chosen.focus();
  };
  tabs.forEach((tab, i) => {
    tab.addEventListener("click", () => select(tab));
    tab.addEventListener("keydown", (event) => {
      const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (by) {
        event.preventDefault();
        event.stopPropagation();
        select(tabs[(i + by + tabs.length) % tabs.length]);
      }
    });
  });
}

// Names of the parts of widgets that Bokeh leaves without one.
for (const [type, method, part] of [
  ["Checkbox", "after_render", (view) => [view.shadow_el.querySelector("input"), view.model.label]],
  ["Slider", "render", (view) => [view.slider_el.querySelector(".noUi-handle"), view.model.title]],
]) {
  const made = window.Bokeh.Models[type].prototype.default_view.prototype;
  const update = made[method];
  made[method] = function (...how) {
    update.apply(this, how);
    const [element, name] = part(this);
    element?.setAttribute("aria-label", name);
  };
}

// With each figure that it paints, Bokeh writes the style sheets of all its parts anew: some eighty
// texts a frame, nearly all as they were. The browser would compute its styles again after each.
const { textContent } = Object.getOwnPropertyDescriptors(window.Node.prototype);
Object.defineProperty(window.HTMLStyleElement.prototype, "textContent", {
  ...textContent,
  set(css) { if (css !== textContent.get.call(this)) textContent.set.call(this, css); },
});

// Those of drawn marks and lines change with their data, but their elements show nothing. Unhidden,
// they would make the browser compute its styles and its layout again, eight times a frame.
window.Bokeh.Models.GlyphRenderer.prototype.default_view.prototype.update_position = function () {
  this.position.replace(":host { display: none; }");
};

// When a text changes, Bokeh rebuilds its widget with style sheets and layout; the text is enough.
window.Bokeh.Models.Div.prototype.default_view.prototype.rerender = function () {
  const { text, render_as_text } = this.model;
  if (this.markup_el) this.markup_el[render_as_text ? "textContent" : "innerHTML"] = text;
};

const shadeButton = document.getElementById("shade");
const wished = window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
let dark = (sessionStorage.getItem("shade") ?? wished) === "dark";  // as on the page before
function wear(browser) {
  document.documentElement.dataset.shade = dark ? "dark" : "light";
  shadeButton.setAttribute("aria-pressed", String(dark));
  if (browser) browser.dark = dark;
}
wear(null);

// What has keys of its own; a figure that was tapped has none.
const KEPT = "a, button, input, select, textarea, summary, [role=tab]";

function begin(browser) {
  watchConnection(window.Bokeh.documents[0]);
  letTargetsBeDragged();
  for (const name of ["detections-rows", "tracks-rows"]) {
    const table = findView(name);
    if (table) letRowsBePicked(table);  // no lesson has one
  }
  wear(browser);
  shadeButton.addEventListener("click", () => {
    dark = !dark;
    sessionStorage.setItem("shade", dark ? "dark" : "light");
    wear(browser);
  });

  // Bokeh draws before the next frame of the screen, and a task runs after it. A second animation
  // frame would keep the browser busy with a frame in which nothing changes: 2 ms.
  const reportDrawn = () => {
    const shown = browser.n_frames_sent;
    requestAnimationFrame(() => setTimeout(() => {
      window.dechirp.frames += 1;
      document.documentElement.dataset.drawn = "";
      if (shown % browser.frames_per_confirmation === 0) browser.n_frames_drawn = shown;
    }));
  };
  browser.properties.n_frames_sent.change.connect(reportDrawn);
  if (browser.n_frames_sent) reportDrawn();  // the first came with the page

  let place = document.getElementById("place");
  if (!place) {  // a lesson shows it only while the first frame is computed
    place = document.createElement("output");
    place.id = "place";
    place.className = "first";
    place.ariaLive = "off";
    document.body.append(place);
  }
  const tellPlace = () => { place.textContent = browser.frame_status; };
  browser.properties.frame_status.change.connect(tellPlace);
  tellPlace();

  const greyOut = () => { document.documentElement.toggleAttribute("data-outdated", browser.is_outdated); };
  browser.properties.is_outdated.change.connect(greyOut);
  beginTiles(document.querySelectorAll(".tile"));

  const rate = document.getElementById("rate");
  let before = 0;
  setInterval(() => {
    const n = window.dechirp.frames - before;
    before = window.dechirp.frames;
    rate.textContent = n > 1 ? `${n} frames/s` : "";
  }, 1000);

  const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  const isLivePage = document.getElementById("page-settings_file") !== null;
  if (isLivePage) followAddress(browser);
  if (isLivePage && !still && !location.hash) browser.play_keys += 1;  // begin to play

  document.addEventListener("keydown", (event) => {
    const inside = event.composedPath()[0];
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !inside.closest("input, textarea")) {
      event.preventDefault();
      if (event.shiftKey) browser.redo_keys += 1;
      else browser.undo_keys += 1;
      return;
    }
    if (event.ctrlKey || event.altKey || event.metaKey || inside.closest(KEPT)) return;
    if (event.key === " ") browser.play_keys += 1;
    else if (event.key === "ArrowRight") browser.step_keys += 1;
    else if (event.key === "Escape") browser.free_keys += 1;
    else return;
    event.preventDefault();
  });
  window.dechirp.ready = true;
}

const fold = document.getElementById("fold");
fold?.addEventListener("click", () => {
  const open = document.getElementById("side").classList.toggle("open");
  fold.setAttribute("aria-expanded", String(open));
});

// Rows of a table are picked by a click or the arrows. A frame may replace them during a click.
function letRowsBePicked(table) {
  const host = table.el, [picked] = table.model.tags;
  const rows = () => [...host.shadowRoot.querySelectorAll("tbody tr")];
  const pick = (index) => {
    const all = rows();
    if (!all[index]) return;
    picked.row = index;
    for (const row of all) row.removeAttribute("aria-current");
    all[index].setAttribute("aria-current", "true");  // the next arrow starts here
    all[index].scrollIntoView({ block: "nearest" });
  };
  let pressed = -1;
  host.addEventListener("pointerdown", (event) => {
    pressed = rows().indexOf(event.composedPath()[0].closest("tr"));
  });
  host.addEventListener("click", () => pick(pressed));
  host.addEventListener("keydown", (event) => {
    const by = { ArrowUp: -1, ArrowDown: 1 }[event.key];
    if (!by) return;
    event.preventDefault();
    pick(rows().findIndex((row) => row.hasAttribute("aria-current")) + by);
  });
  host.tabIndex = 0;
  host.role = "group";
  host.ariaLabel = "Rows";
}

const waiting = setInterval(() => {
  const made = window.Bokeh?.documents[0]?.get_model_by_name("browser");
  if (made) {
    clearInterval(waiting);
    begin(made);
  }
}, 20);

// Escape puts back what holds, which a typed setting has in its tags.
document.addEventListener("keydown", (event) => {
  const input = event.composedPath()[0];
  const id = event.key === "Escape" && input.getRootNode().host?.dataset.model;
  const widget = id && window.Bokeh.documents[0].get_model_by_id(id);
  if (!widget || !("value" in input)) return;
  input.value = widget.tags[0];
  widget.value = widget.tags[0];
});

// Text of a model, which it has in its tags, to the clipboard or to a file.
async function copy(text, button) {
  if (navigator.clipboard) await navigator.clipboard.writeText(text);
  else { // a page from another machine, without TLS
    const held = document.createElement("textarea");
    held.value = text;
    document.body.append(held);
    held.select();
    document.execCommand("copy");
    held.remove();
  }
  const label = button.textContent;
  button.textContent = "Copied";
  setTimeout(() => { button.textContent = label; }, 1500);
}

// The address holds the settings, compressed after "#", which a browser does not send. Settings of
// the address with which the page was loaded replace those of the server.
async function followAddress(browser) {
  const area = [...window.Bokeh.documents[0].get_model_by_name("settings_file").references()]
    .find((model) => model.type === "TextAreaInput");
  const [atStart] = area.tags;
  const shown = location.hash.slice(1);
  area.properties.tags.change.connect(async () => {
    const [text] = area.tags;
    const address = text === atStart ? location.pathname : `#${await pack(text)}`;
    if (text === area.tags[0]) history.replaceState(null, "", address);
  });
  if (shown) browser.shared_settings = await unpack(shown);
}

const through = (bytes, stream) => new Response(new Blob([bytes]).stream().pipeThrough(stream));

async function pack(text) {
  const packed = await through(text, new CompressionStream("deflate-raw")).arrayBuffer();
  const letters = [...new Uint8Array(packed)].map((byte) => String.fromCharCode(byte)).join("");
  return btoa(letters).replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
}

// Text that is not packed is returned as it is; the server reports what is wrong with it.
async function unpack(packed) {
  try {
    const letters = atob(packed.replaceAll("-", "+").replaceAll("_", "/"));
    const bytes = Uint8Array.from(letters, (letter) => letter.charCodeAt(0));
    return await through(bytes, new DecompressionStream("deflate-raw")).text();
  } catch {
    return packed;
  }
}

document.getElementById("share")?.addEventListener("click", (event) => {
  copy(location.href, event.target);
});

function saveFile(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

document.addEventListener("click", (event) => {
  const [button] = event.composedPath();
  const { copies, downloads } = button.getRootNode?.().host?.dataset ?? {};
  const model = window.Bokeh?.documents[0]?.get_model_by_id(copies ?? downloads);
  if (model && copies) copy(model.tags[0], button);
  else if (model) saveFile(new Blob([model.tags[0]], { type: "application/yaml" }), "scenario.yaml");
});
