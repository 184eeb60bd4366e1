// A figure opens large over the page. Without this the page is whole all the same.
const dialog = document.createElement("dialog");
const bar = document.createElement("nav");
const words = document.createElement("p");
const key = { "+": 1.25, "=": 1.25, "-": 0.8, _: 0.8 };
const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
let drawing, whole, box, from;

const show = ([x, y, width, height]) => {
  box = [x, y, width, height];
  drawing.setAttribute("viewBox", box.join(" "));
};
// Larger about a place of the drawing, its middle without one; never smaller than whole.
const zoom = (by, [x, y] = [box[0] + box[2] / 2, box[1] + box[3] / 2]) => {
  const width = Math.max(box[2] / by, whole[2] / 40);
  if (width >= whole[2]) return show(whole);
  const to = box[2] / width;
  show([x - (x - box[0]) / to, y - (y - box[1]) / to, width, box[3] / to]);
};
const move = (x, y) => show([box[0] + x, box[1] + y, box[2], box[3]]);
const place = (event) => {
  const at = new DOMPoint(event.clientX, event.clientY);
  const { x, y } = at.matrixTransform(drawing.getScreenCTM().inverse());
  return [x, y];
};
const button = (text, title, onClick) => {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = text;
  made.title = title;
  made.setAttribute("aria-label", title);
  made.addEventListener("click", onClick);
  return made;
};

const open = (figure) => {
  drawing = figure.querySelector("svg").cloneNode(true);
  words.innerHTML = figure.querySelector("figcaption").innerHTML;
  whole = drawing.getAttribute("viewBox").split(/[\s,]+/).map(Number);
  show(whole);
  dialog.setAttribute("aria-label", words.textContent);
  dialog.replaceChildren(bar, drawing, words);
  dialog.showModal();
};

bar.append(
  button("\u2212", "Smaller", () => zoom(0.8)),
  button("+", "Larger", () => zoom(1.25)),
  button("Whole", "Whole figure", () => show(whole)),
  button("Close", "Close (Escape)", () => dialog.close()),
);
dialog.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(Math.exp(-event.deltaY / 400), place(event));
}, { passive: false });
dialog.addEventListener("pointerdown", (event) => {
  if (!drawing.contains(event.target)) return;
  drawing.setPointerCapture(event.pointerId);
  from = place(event);
});
dialog.addEventListener("pointermove", (event) => {
  if (!from) return;
  const [x, y] = place(event);
  move(from[0] - x, from[1] - y);
});
for (const end of ["pointerup", "pointercancel"]) dialog.addEventListener(end, () => { from = null; });
dialog.addEventListener("keydown", (event) => {
  if (key[event.key]) zoom(key[event.key]);
  else if (event.key === "0") show(whole);
  else if (step[event.key]) move(...step[event.key].map((of, at) => (of * box[2 + at]) / 10));
  else return;
  event.preventDefault();
});
document.body.append(dialog);

for (const figure of document.querySelectorAll("figure")) {
  const drawn = figure.querySelector("svg");
  figure.classList.add("zooms");
  drawn.addEventListener("click", () => open(figure));
  figure.append(button("Enlarge", `Enlarge: ${drawn.getAttribute("aria-label")}`, () => open(figure)));
}
