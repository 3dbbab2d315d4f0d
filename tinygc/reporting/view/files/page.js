// The page of a recording: it shows what the file or the server gives, and asks the server for changes and a refit.

"use strict";

let version = -1;

function ask(wish) {
  fetch("wish", { method: "POST", body: JSON.stringify(wish) }).catch(() => { document.getElementById("doing").textContent = "the program has ended"; });
}
const takeBack = choice => ask({ do: "take back", ...choice });
const moveStill = (number, ends) => ask({ do: "move", kind: "still", number, ends });
function toggle(choice) {
  const each = found(choice), out = each.by_hand === true || each.by_hand === "left out";
  if (out) takeBack(choice); else if (!each.problem) ask({ do: "leave out", ...choice });
}

function sayClosure() {
  const now = content.closure, before = content.before, place = document.getElementById("answer");
  if (!now) place.textContent = content.why ? `no fit: ${content.why}` : "";
  else {
    const refit = before ? `refit: ${short(before.after_deg)}° → ${short(now.after_deg)}°` : `raw ${short(now.raw_deg)}° → calibrated ${short(now.after_deg)}°`;
    place.textContent = `closure of ${now.turns} turns, ${refit} (floor ${short(now.floor_deg)}°)${content.stale ? "; changed since the fit" : ""}`;
  }
  document.getElementById("refit").classList.toggle("wanted", content.stale);
}

function take(given) {
  const first = !content;
  content = given;
  document.getElementById("name").textContent = content.session;
  document.getElementById("sensor").textContent = content.sensor;
  if (!found(seen.choice)) seen.choice = null;
  seen.edge = null;
  if (first) look(0, content.length_s);
  sayClosure();
  listChoice();
  listChanges();
  listUnused();
  listTurns();
  redraw();
}

function listAxes() {
  "xyz".split("").forEach((axis, i) => {
    const place = document.getElementById("axes"), swatch = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
    for (const [name, value] of Object.entries({ x1: 0, y1: 4, x2: 34, y2: 4, stroke: `var(--${axis})`, "stroke-width": 3, "stroke-dasharray": DASHES[i].join(" ") })) line.setAttribute(name, value);
    swatch.append(line);
    const each = button(axis, () => {
      seen.axes[i] = !seen.axes[i];
      each.setAttribute("aria-pressed", seen.axes[i]);
      redraw();
    }, { ariaPressed: "true" });
    each.prepend(swatch);
    place.append(each);
  });
}

async function state(event) {
  const now = JSON.parse(event.data);
  document.getElementById("doing").textContent = now.doing;
  document.getElementById("refused").textContent = now.refused;
  document.getElementById("refit").disabled = Boolean(now.doing);
  if (now.version === version || !now.version) return;
  version = now.version;
  const [pieces, given] = await Promise.all([source.whole.length ? source.whole : fetch("curves").then(answer => answer.json()), fetch("content").then(answer => answer.json())]);
  source.whole = pieces;
  if (now.version === version) take(given); // else a newer one is on its way
}

addEventListener("beforeprint", () => { document.getElementById("turns").open = true; });
listAxes();
const data = document.getElementById("data");
if (data) {
  const all = JSON.parse(data.textContent);
  document.body.classList.add("shown-only");
  source.whole = all.curves;
  take(all.content);
} else {
  source.live = true;
  const refit = document.getElementById("refit"), events = new EventSource("events");
  refit.hidden = false;
  refit.addEventListener("click", () => ask({ do: "refit" }));
  events.addEventListener("state", state);
  events.addEventListener("error", () => { document.getElementById("doing").textContent = "no connection to the program"; });
}
