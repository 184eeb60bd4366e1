// What Bokeh does each time that it paints, and need not: it tells the browser anew where
// everything lies that it draws, and asks for its styles in between. So 40 times a frame the browser
// works out all styles, 30 ms of 80. Nearly all places are as they were, no colour of these pages
// is in a variable of Bokeh's, and letters keep their size.

function lighten() {
  const lighter = new Set();
  const change = (made, name, by) => {
    while (made && !Object.hasOwn(made, name)) made = Object.getPrototypeOf(made);
    if (!made || lighter.has(made)) return;
    lighter.add(made);
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
  const visit = (view) => {
    change(view.position, "_update", ifChanged);
    for (const visual of view.visuals ?? []) change(visual, "_get_css_value", nothing);
    if (view.model.type === "Figure") change(view, "base_font_size", once);
    for (const child of view.children()) visit(child);
  };
  for (const root of Object.values(window.Bokeh.index)) visit(root);
}
