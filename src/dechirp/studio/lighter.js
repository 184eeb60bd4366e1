// What Bokeh does each time that something changes, and need not.
//
// It tells the browser anew where everything lies that it draws, and asks for its styles in
// between. So 40 times a frame the browser works out all styles, 30 ms of 80. Nearly all places are
// as they were, no colour of these pages is in a variable of Bokeh's, and letters keep their size.
// Nothing on a page asks where marks lie.
//
// All that is drawn is made ready five times, also as it would look if it were selected.
//
// Rows of a table are drawn five times for each change, and its columns fitted to its width: 15 ms.
// For other words in a line, 4 ms each, the whole tile is laid out.

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
  const onceAFrame = (draw) => ({
    ...draw,
    value() {
      this.due ||= requestAnimationFrame(() => {
        this.due = 0;
        this.isOld = this.root.el.closest("[hidden]") !== null;  // until its tab is chosen
        if (!this.isOld) draw.value.call(this);
      });
    },
  });
  const ifResized = (fit) => ({
    ...fit,
    value(initialized, rowsAlone) {
      if (!rowsAlone) fit.value.call(this, initialized, rowsAlone);
      if (this.isOld) this.updateGrid();
    },
  });
  const visit = (view) => {
    change(view.position, "_update", ifChanged);
    for (const visual of view.visuals ?? []) change(visual, "_get_css_value", nothing);
    if (view.model.type === "Figure") change(view, "base_font_size", once);
    if (view.model.type === "GlyphRenderer") {
      view.update_position = () => {};
      for (const kind of ["decimated", "selection", "nonselection", "muted"])
        Object.assign(view[`${kind}_glyph`], { set_data() {}, set_visuals() {}, map_data() {} });
    }
    if (view.model.type === "DataTable") {
      change(view, "updateGrid", onceAFrame);
      change(view, "updateLayout", ifResized);
      // It looks at how many rows there are, not at what they say.
      view.model.source.properties.data.change.connect(() => view.updateGrid());
    }
    if (view.model.css_classes?.includes("line")) {
      view.rerender = () => { view.markup_el.innerHTML = view.model.text; };
    }
    for (const child of view.children()) visit(child);
  };
  for (const root of Object.values(window.Bokeh.index)) visit(root);
}
