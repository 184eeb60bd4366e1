// Removal of updates that Bokeh repeats without need at each change.
//
// Bokeh sets the positions of all drawn elements again, and reads their styles in between. So the
// browser computes all styles 40 times a frame, which takes 30 ms of 80: without this script, the
// tab takes 1.3 to 2.1 times as long for a map. On two cores that also did other work, `benchmarks/studio.py`
// drew 9.8 and 12.1 maps a second with it, and in the same minutes 7.3 and 5.2 without it. Nearly all positions are unchanged, no colour of
// these pages is in a variable of Bokeh's, and letters keep their size.
// Nothing on a page reads the positions of marks.
//
// All that is drawn is made ready also as it would look selected, muted or decimated.
//
// For other words in a line or a table, 4 ms each, the whole tile is laid out.

function lighten() {
  const lighter = new Map();  // prototypes that were changed, by the name of what was
  const change = (made, name, by) => {
    while (made && !Object.hasOwn(made, name)) made = Object.getPrototypeOf(made);
    const changed = lighter.get(name) ?? new Set();
    if (!made || changed.has(made)) return;
    lighter.set(name, changed.add(made));
    Object.defineProperty(made, name, by(Object.getOwnPropertyDescriptor(made, name)));
  };
  const ifChanged = (update) => ({
    ...update,
    value(css) {
      if (css !== this.css) update.value.call(this, css);
    },
  });
  const nothing = (get) => ({ ...get, value: () => "" });
  const once = (asked) => ({
    ...asked,
    get() {
      const value = asked.get.call(this);
      Object.defineProperty(this, "base_font_size", { value });
      return value;
    },
  });
  // Bokeh clears from half a pixel on: a line of the other theme would stay.
  const clearWhole = (layer) => layer.undo_transform(
    (ctx) => ctx.clearRect(0, 0, layer.canvas.width, layer.canvas.height),
  );
  const visit = (view) => {
    change(view.position, "_update", ifChanged);
    for (const visual of view.visuals ?? []) change(visual, "_get_css_value", nothing);
    if (view.model.type === "Figure") {
      change(view, "base_font_size", once);
      const { primary, overlays } = view.canvas_view;
      for (const layer of [primary, overlays]) layer.clear = () => clearWhole(layer);
    }
    if (view.model.type === "GlyphRenderer") {
      view.update_position = () => {};
      for (const kind of ["decimated", "selection", "nonselection", "muted"])
        Object.assign(view[`${kind}_glyph`], { set_data() {}, set_visuals() {}, map_data() {} });
    }
    if (view.model.css_classes?.includes("line")) {
      view.rerender = () => { view.markup_el.innerHTML = view.model.text; };
    }
    for (const child of view.children()) visit(child);
  };
  for (const root of Object.values(window.Bokeh.index)) visit(root);
}
