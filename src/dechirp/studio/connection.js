// Connection to the studio: a page whose session has ended says so, or is loaded again.

const CONNECT_MS = 20_000;  // a busy machine takes seconds; the server keeps the session for 30 s
const RELOAD_INTERVAL_MS = 60_000;

// A page that the browser shows again after "back" has lost its connection.
window.addEventListener("pageshow", (event) => {
  if (event.persisted) location.reload();
});

// Load a page again that was never drawn, unless that was tried a moment ago.
function reloadOnce() {
  const now = Date.now();
  if (now - Number(sessionStorage.getItem("reloaded")) < RELOAD_INTERVAL_MS) showLost();
  else {
    sessionStorage.setItem("reloaded", String(now));
    location.reload();
  }
}
const connecting = setTimeout(reloadOnce, CONNECT_MS);

function showLost() {
  if (document.getElementById("lost")) return;
  const note = document.createElement("div");
  note.id = "lost";
  note.setAttribute("role", "alert");
  let text = "The connection to the studio was lost, so this page no longer changes.";
  if (document.getElementById("page-settings_file"))
    text += " Its settings can still be saved: File, Download.";
  const button = document.createElement("button");
  button.textContent = "Load the page again";
  button.addEventListener("click", () => location.reload());
  note.append(text, button);
  document.body.append(note);
}

function watchConnection(bokeh) {
  clearTimeout(connecting);
  bokeh.on_event("connection_lost", showLost);
}
