// Targets of the top view: the pointer shows that they can be dragged.
//
// Bokeh takes a pointer that is held still for 0.3 s for a long press and ends the gesture, so
// whoever aims at a target could not drag it. No figure here uses long presses.

function findView(name) {
  const within = (view) =>
    view.model.name === name ? view : [...view.children()].map(within).find(Boolean);
  return Object.values(window.Bokeh.index).map(within).find(Boolean);
}

function letTargetsBeDragged() {
  const view = findView("scene");
  if (!view) return;  // no lesson has one
  const { ui_gestures, hit_area } = view.canvas_view.ui_event_bus;
  ui_gestures.constructor.press_threshold = 2 ** 31 - 1;  // in ms, the longest of a timer
  const targets = view.model.renderers.find((renderer) => renderer.name === "targets");
  const isNearTarget = ({ offsetX, offsetY }) => {
    const { x_scale, y_scale } = view.frame;
    const { x, y } = targets.data_source.data, [reach] = targets.tags;
    const [left, ahead] = [x_scale.invert(offsetX), y_scale.invert(offsetY)];
    return [...x].some((value, i) => Math.hypot(value - left, y[i] - ahead) <= reach);
  };
  let isHeld = false;
  const showGrip = (event) => {
    const isNear = isHeld || isNearTarget(event);
    if (isNear) hit_area.style.cursor = isHeld ? "grabbing" : "grab";  // after Bokeh's own
    hit_area.title = isNear ? "Drag to move this target" : "";
  };
  hit_area.addEventListener("pointerdown", (event) => {
    isHeld = event.button === 0 && isNearTarget(event);
    showGrip(event);
  });
  // A finger on a target drags it, elsewhere it scrolls the page.
  hit_area.addEventListener("touchstart", (event) => {
    if (isHeld) event.preventDefault();
  }, { passive: false });
  hit_area.addEventListener("pointermove", showGrip);
  for (const end of ["pointerup", "pointercancel"])
    hit_area.addEventListener(end, (event) => {
      isHeld = false;
      showGrip(event);
    });
}
