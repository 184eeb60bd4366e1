// Tiles: captions, enlargement, pictures, and values under the pointer.

const TOOLS = {
  picture: ["Save a picture", "M8 2v8M5 7l3 3 3-3M3 13h10"],
  enlarge: ["Enlarge", "M3 6V3h3M10 3h3v3M13 10v3h-3M6 13H3v-3"],
};

function beginTiles(tiles) {
  for (const tile of tiles) {
    showCaption(tile);
    showValues(tile);
    const tools = tile.querySelector(".tools");
    for (const [tool, [words, path]] of Object.entries(TOOLS)) {
      const button = document.createElement("button");
      button.type = "button";
      button.title = words;
      button.setAttribute("aria-label", words);
      button.innerHTML = `<svg viewBox="0 0 16 16" width="14" height="14" aria-hidden="true"><path d="${path}" fill="none" stroke="currentColor" stroke-width="1.6"/></svg>`;
      button.addEventListener("click", () => tool === "picture" ? savePicture(tile) : enlarge(tile));
      tools.append(button);
    }
  }
  document.addEventListener("keydown", (event) => {
    const tile = event.key === "Escape" && document.querySelector(".tile.enlarged");
    if (!tile) return;
    event.stopImmediatePropagation();
    enlarge(tile);
  }, { capture: true });
}

// A caption keeps the height of its longest text, so that the figure below it keeps its size.
function showCaption(tile) {
  const caption = window.Bokeh.documents[0].get_model_by_name(`${tile.dataset.part}-caption`);
  const place = tile.querySelector("figcaption");
  for (const [property, words] of [
    [caption.properties.title, tile.querySelector("h2")],
    [caption.properties.note, tile.querySelector("figcaption p")],
  ]) {
    const show = () => {
      words.innerHTML = property.get_value();
      keepHeight(place);
    };
    property.change.connect(show);
    show();
  }
  new ResizeObserver(([entry]) => {
    const width = Math.round(entry.contentRect.width);
    if (place.dataset.width !== String(width)) place.style.minHeight = "";
    place.dataset.width = width;
  }).observe(tile);
}

// Heights are measured once a frame of the screen: after each text, the browser would lay out the
// whole page to answer, 2.6 times a frame.
const grown = new Set();

function keepHeight(place) {
  if (grown.size === 0) requestAnimationFrame(() => {
    const heights = [...grown].map((changed) => [changed, `${changed.offsetHeight}px`]);
    for (const [changed, height] of heights) changed.style.minHeight = height;
    grown.clear();
  });
  grown.add(place);
}

function enlarge(tile) {
  const is = tile.classList.toggle("enlarged");
  tile.querySelector("[title=Enlarge]").setAttribute("aria-pressed", String(is));
}

// The figure that a tile shows now.
function figureView(tile) {
  const within = (view) => view.model.type === "Figure"
    ? view.model.visible && view
    : view.children().map(within).find(Boolean);
  const id = tile.querySelector(".plot [data-root-id]").dataset.rootId;
  return within([...Object.values(window.Bokeh.index)].find((view) => view.model.id === id));
}

function savePicture(tile) {
  const plot = figureView(tile).export("png").canvas;
  const scale = plot.width / figureView(tile).el.offsetWidth;
  const picture = document.createElement("canvas");
  const colour = (role) => getComputedStyle(document.documentElement).getPropertyValue(`--${role}`);
  const pen = picture.getContext("2d");
  const lines = [["h2", "bold 13px", "ink"], ["figcaption p", "12px", "muted"]].flatMap(
    ([place, size, role]) => {
      pen.font = `${size} system-ui, sans-serif`;
      const font = pen.font;
      return wrapped(pen, plainText(tile.querySelector(place)), plot.width / scale - 16)
        .map((text) => ({ text, font, role }));
    },
  );
  const top = 17 * lines.length + 8;
  [picture.width, picture.height] = [plot.width, plot.height + top * scale];
  pen.fillStyle = colour("tile");
  pen.fillRect(0, 0, picture.width, picture.height);
  pen.drawImage(plot, 0, top * scale);
  pen.scale(scale, scale);
  for (const [i, { text, font, role }] of lines.entries()) {
    [pen.font, pen.fillStyle] = [font, colour(role)];
    pen.fillText(text, 8, 18 + 17 * i);
  }
  picture.toBlob((blob) => saveFile(blob, `${tile.dataset.part.replace("_", "-")}.png`));
}

// Text without markup; the turned brackets of a caption become letters of that shape.
function plainText(place) {
  const copy = place.cloneNode(true);
  for (const turned of copy.querySelectorAll(".turned")) turned.textContent = "\u2293\u2294";
  return copy.textContent.trim();
}

function wrapped(pen, text, width) {
  const lines = [];
  for (const word of text.split(/ +/)) {
    const longer = lines.length ? `${lines.at(-1)} ${word}` : word;
    if (lines.length && pen.measureText(longer).width <= width) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  return lines;
}

function showValues(tile) {
  const plot = tile.querySelector(".plot");
  const readout = document.createElement("output");
  readout.className = "readout";
  readout.ariaLive = "off";
  plot.append(readout);
  const show = (event) => {
    const view = figureView(tile), box = view.el.getBoundingClientRect();
    const [sx, sy] = [event.clientX - box.x, event.clientY - box.y];
    readout.textContent = view.frame.bbox.contains(sx, sy)
      ? valuesAt(view, view.frame.x_scale.invert(sx), view.frame.y_scale.invert(sy)) : "";
  };
  plot.addEventListener("pointermove", show);
  plot.addEventListener("pointerdown", show);
  plot.addEventListener("pointerleave", () => { readout.textContent = ""; });
}

// Position, and the power of a map or the values of lines there.
function valuesAt(view, x, y) {
  const { model } = view;
  const renderers = model.renderers.filter((one) => one.visible);
  const quantity = (axis, value) => {
    const [, name, unit] = /^(.*?)(?: \(([^,)]*).*\))?$/.exec(axis.axis_label ?? "");
    return `${name} ${number(value)} ${unit ?? ""}`.trim();
  };
  const image = renderers.find((one) => one.glyph.type === "Image");
  const places = [quantity(model.below[0], x)];
  if (image) {
    places.push(quantity(model.left[0], y), powerAt(image, model.right[0], x, y));
    return places.filter(Boolean).join(", ");
  }
  const lines = renderers.filter((one) => one.glyph.type === "Line" && one.tags.length);
  if (!lines.length) places.unshift(quantity(model.left[0], y));
  const unit = /\((.*)\)/.exec(model.left[0].axis_label)?.[1] ?? "";
  for (const { tags: [label], data_source: { data } } of lines) {
    let best = -1;
    for (let i = 0; i < data.x.length; i++)
      if (best < 0 || Math.abs(data.x[i] - x) < Math.abs(data.x[best] - x)) best = i;
    if (best >= 0 && Number.isFinite(data.y[best])) places.push(`${label} ${number(data.y[best])} ${unit}`);
  }
  if (!lines.length) places.push(`range ${number(Math.hypot(x, y))} m`);
  return places.join(", ");
}

function powerAt({ glyph, data_source }, { color_mapper: { low, high }, title }, x, y) {
  const is = (spec) => spec?.value ?? spec;
  const levels = data_source.data.image[0], [height, width] = levels.shape;
  const column = Math.floor((x - is(glyph.x)) / is(glyph.dw) * width);
  const row = Math.floor((y - is(glyph.y)) / is(glyph.dh) * height);
  if (column < 0 || column >= width || row < 0 || row >= height || width < 2) return "";
  const level = levels[row * width + column];
  const sign = level === 0 ? "≤ " : level === 255 ? "≥ " : "";
  const unit = /\((.*)\)/.exec(title?.text ?? title)?.[1] ?? "dB";
  return `${sign}${(low + (high - low) * level / 255).toFixed(1)} ${unit}`.replace("-", "−");
}

const number = (value) => String(Number(value.toPrecision(3))).replace("-", "−");
