// Zoom and movement by wheel, drag, buttons and keys; what lies under the pointer; and a still's ends, dragged.

"use strict";

const plot = document.getElementById("plot"), map = document.getElementById("map"), tip = document.getElementById("tip");
const LEAST_S = 0.05, CLICK_PX = 5;

function look(from, to) {
  const span = Math.min(Math.max(to - from, LEAST_S), content.length_s);
  seen.from = Math.min(Math.max(from, 0), content.length_s - span);
  seen.to = seen.from + span;
  refine(seen.from, seen.to, Math.max(300, Math.round(plot.clientWidth)), redraw);
  redraw();
}

function zoom(factor, at = (seen.from + seen.to) / 2) {
  look(at - (at - seen.from) * factor, at + (seen.to - at) * factor);
}

const move = share => look(seen.from + share * (seen.to - seen.from), seen.to + share * (seen.to - seen.from));

// Show something with a little around it.
function show(each) {
  const around = Math.max(each.to_s - each.from_s, 1) * 1.5;
  look(each.from_s - around, each.to_s + around);
}

function choose(kind, number) {
  seen.choice = kind ? { kind, number } : null;
  seen.edge = null;
  listChoice();
  redraw();
}

const found = choice => choice && content[`${choice.kind}s`].find(each => each.number === choice.number);

function next(step) {
  const list = content.segments, at = seen.choice?.kind === "segment" ? list.findIndex(each => each.number === seen.choice.number) : -1;
  if (!list.length) return;
  const each = list[(at + step + list.length) % list.length];
  choose("segment", each.number);
  if (each.from_s < seen.from || each.to_s > seen.to) show(each);
}

const KEYS = {
  "+": () => zoom(0.5), "=": () => zoom(0.5), "-": () => zoom(2), "0": () => look(0, content.length_s), Home: () => look(0, content.length_s),
  ArrowLeft: () => move(-0.3), ArrowRight: () => move(0.3), ",": () => next(-1), ".": () => next(1), Escape: () => choose(null),
  x: () => seen.choice && source.live && toggle(seen.choice),
};
addEventListener("keydown", event => {
  if (!content || event.ctrlKey || event.metaKey || event.altKey || /INPUT|BUTTON|SUMMARY/.test(event.target.tagName) || !KEYS[event.key]) return;
  event.preventDefault();
  KEYS[event.key]();
});
for (const button of document.querySelectorAll("nav [data-key]")) button.addEventListener("click", () => content && KEYS[button.dataset.key]());

plot.addEventListener("wheel", event => {
  if (!content) return;
  const whole = seen.from <= 0 && seen.to >= content.length_s;
  if (whole && event.deltaY > 0) return;  // the page scrolls
  event.preventDefault();
  if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) move(event.deltaX / plot.clientWidth); else zoom(Math.exp(event.deltaY / 400), t_of(event.offsetX));
}, { passive: false });

// What is under a point: a mark, a still, or a segment.
function under(x, y) {
  const t = t_of(x), close = (seen.to - seen.from) * 6 / frame.width, inside = each => each.from_s - 1e-9 <= t && t <= each.to_s;
  const mark = content.marks.find(each => each.from_s - close <= t && t <= each.to_s + close && Math.abs(y - frame.panels[0].top - 6) < 10);
  if (mark) return { mark };
  const still = content.stills.find(inside), closure = frame.panels.at(-1);
  if (still && y > frame.strip.bottom && y < closure.top - 10) return { kind: "still", each: still };
  const segment = content.segments.find(inside);
  return segment ? { kind: "segment", each: segment } : {};
}

let held = null;
plot.addEventListener("pointerdown", event => {
  if (!content || event.button) return;
  const still = seen.choice?.kind === "still" && source.live ? found(seen.choice) : null, reach = event.pointerType === "mouse" ? 8 : 18;
  const end = still ? [still.from_s, still.to_s].findIndex(t => Math.abs(x_of(t) - event.offsetX) <= reach) : -1;
  held = { x: event.offsetX, from: seen.from, to: seen.to, end, touch: event.pointerType !== "mouse", moved: false };
  if (end >= 0) seen.edge = { ends: [still.from_s, still.to_s] };
  plot.setPointerCapture(event.pointerId);
});
plot.addEventListener("pointermove", event => {
  if (!content) return;
  if (!held) return hover(event);
  held.moved ||= Math.abs(event.offsetX - held.x) > CLICK_PX;
  if (!held.moved) return;
  tip.hidden = true;
  if (held.end >= 0) {
    seen.edge.ends[held.end] = Math.min(Math.max(t_of(event.offsetX), 0), content.length_s);
    listChoice();
  } else if (held.touch || event.shiftKey) {
    const by = (event.offsetX - held.x) / (frame.width - frame.left - frame.right) * (held.to - held.from);
    look(held.from - by, held.to - by);
  } else seen.band = [t_of(held.x), t_of(event.offsetX)];
  redraw();
});
plot.addEventListener("pointerup", event => {
  const done = held;
  held = null;
  if (!done) return;
  const band = seen.band?.toSorted((a, b) => a - b);
  seen.band = null;
  if (!done.moved) {
    const { kind, each } = under(event.offsetX, event.offsetY);
    choose(kind ?? null, each?.number);
    if (done.touch) hover(event);
  } else if (done.end >= 0) moveStill(seen.choice.number, seen.edge.ends);
  else if (band) look(...band);
  redraw();
});
plot.addEventListener("pointercancel", () => { held = seen.band = null; redraw(); });
plot.addEventListener("pointerleave", () => { tip.hidden = true; });

function hover(event) {
  const { mark, kind, each } = under(event.offsetX, event.offsetY), t = t_of(event.offsetX);
  const lines = [`${t.toFixed(seen.to - seen.from < 20 ? 3 : 1)} s`];
  if (mark) lines.push(mark.why);
  if (each) lines.push(`${kind} ${each.number}${each.by_hand ? `, ${each.by_hand === true ? "left out" : each.by_hand} by hand` : ""}`);
  if (kind === "segment" && each.after_deg != null) lines.push(`raw ${short(each.raw_deg)}°, calibrated ${short(each.after_deg)}°`);
  if (each?.problem) lines.push(`not used: ${each.problem}`);
  if (each?.note) lines.push(each.note);
  tip.textContent = lines.join("\n");
  tip.hidden = event.offsetX < frame.left;
  tip.style.left = `${Math.min(event.offsetX + 14, Math.max(0, frame.width - tip.offsetWidth - 4))}px`;
  tip.style.top = `${Math.max(0, event.offsetY - tip.offsetHeight - 10)}px`;
  const edge = seen.choice?.kind === "still" && source.live && [found(seen.choice)?.from_s, found(seen.choice)?.to_s].some(s => Math.abs(x_of(s) - event.offsetX) < 8);
  plot.style.cursor = edge ? "ew-resize" : "";
}

map.addEventListener("pointerdown", event => {
  map.setPointerCapture(event.pointerId);
  follow(event);
});
map.addEventListener("pointermove", event => event.buttons && follow(event));
function follow(event) {
  if (!content) return;
  const t = (event.offsetX - frame.left) / (map.clientWidth - frame.left - frame.right) * content.length_s, half = (seen.to - seen.from) / 2;
  look(t - half, t + half);
}
addEventListener("resize", redraw);
