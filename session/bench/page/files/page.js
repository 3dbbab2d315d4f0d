// Takes the recording's events and shows them.

import { drawBoard, turnTheView } from "./board.js";
import { forgetColours } from "./canvas.js";
import { showEnd, showMessages, showSigmas } from "./lists.js";
import { goalOf, toGo } from "./path.js";
import { drawRates, remember } from "./rates.js";
import { follow } from "./stream.js";
import { soundButton, soundIsOn } from "./sound.js";
import { drawSphere, facesOf } from "./sphere.js";
import { inverse, rotated } from "./turning.js";
import { ask, wishOf } from "./wishes.js";
import { part, share, write } from "./writing.js";

const FAST = 85, LONG = 72, THERE_DEG = 12, ROUND_MS = 3600, GOES = 0.6, FRAME_MS = 33;
const quiet = matchMedia("(prefers-reduced-motion: reduce)");
let pose = null, state = null, end = null, requested = false, drawn = 0;

function showPose() {
  const of = 100 * pose.peak_dps / pose.full_scale_dps;
  part("rate").classList.toggle("fast", of > FAST);
  write("rate", `${pose.peak_dps.toFixed(0)} of ${pose.full_scale_dps} °/s${of > FAST ? ": slower!" : ""}`);
  drawRates(pose.full_scale_dps);
}

// The still's countdown, or how much of the coach's present turn is left.
function showBar(goal, left, there) {
  const turns = state.part === null && goal, whole = turns && Math.abs(goal.turn.angle_deg);
  part("still").className = turns ? "turns" : state.part === null ? "none" : "";
  part("still").setAttribute("aria-label", turns ? "turned" : "still");
  share("still", turns ? 1 - goal.left_deg / whole : state.part ?? 0);
  write("left", there ? "✓ there: let go" : turns ? (state.moving ? `${left.toFixed(0)}° to go` : "")
    : state.remaining_s === null ? "" : `${state.remaining_s.toFixed(1)} s`);
}

// One step at a time: of several turns the one that comes now.
const stepOf = goal => (goal && goal.total > 1 && goal.turn.words ? `${goal.number + 1} of ${goal.total}: ${goal.turn.words}` : state.do);

function showState(goal, left, there) {
  const broken = end?.report === "none";  // nothing is requested any more: what came last is no instruction
  if (broken) state = { ...state, stage: "ended", do: "the recording has ended", why: "", target: null, part: null, remaining_s: null, good: true };
  const unplugged = !state.connected && state.samples > 0;
  document.body.className = [state.good ? "" : "bad", state.stage === "done" ? `over ${state.good ? "done" : ""}` : "", unplugged ? "unplugged" : ""].join(" ");
  write("stage", unplugged ? "no board" : state.stage === "done" && !state.good ? "ended" : state.stage);
  const turns = state.wanted === null ? `${state.accepted}` : `${state.accepted} of ${state.wanted}`;
  write("count", `${turns} turns${state.rejected ? `, ${state.rejected} rejected` : ""}`);
  const met = state.sigmas.filter(each => each.of_target <= 1).length;
  share("progress", state.wanted === null ? met / (state.sigmas.length || 1) : state.accepted / state.wanted);
  const step = stepOf(goal);
  write("do", step);
  part("do").classList.toggle("long", step.length > LONG);
  write("why", state.why);
  showBar(goal, left, there);
  write("stills", `${facesOf(state.up).length} of 6 faces`);
  showSigmas(state.sigmas);
  showMessages(state.messages);
  const warm = state.temp_c === null ? "" : `; ${state.temp_c} °C${state.wait ? `: ${state.wait}` : ""}`;
  write("stream", `${state.odr_hz ?? "–"} Hz; ${state.samples} samples, ${state.lost} lost${warm}`);
  const over = end !== null || state.stage === "done";
  part("finish").hidden = over || !state.enough;
  part("here").hidden = over || state.stage !== "closure run";
  part("pause").hidden = part("drop").hidden = part("note").hidden = over;
  write("pause", state.stage === "paused" ? "go on" : "pause", state.stage === "closure run" ? "p" : "space");
  write("drop", state.stage === "closure run" ? "the closure run again" : "drop the last turn", "d");
}

// What the ghost shows: it goes the way, and stays at its end for a while; while the board turns it waits there.
function phaseOf(now) {
  if (quiet.matches || state?.moving) return 1;
  return Math.min(1, (now % ROUND_MS) / ROUND_MS / GOES);
}

function draw(now) {
  requested = false;
  const moves = Boolean(state?.target) && !state.moving && !quiet.matches;
  if (now - drawn >= FRAME_MS || !moves) {
    drawn = now;
    if (pose) showPose();
    const goal = pose && state?.target ? goalOf(state.target.turns, state.turned_deg) : null, left = goal && toGo(goal, pose.q);
    const there = goal !== null && left < THERE_DEG && goal.number === goal.total - 1;
    if (state) showState(goal, left, there);
    part("wanted").hidden = !goal;
    drawBoard(pose, goal, there ? 1 : phaseOf(now), there, state?.moving);
    drawSphere(state?.up ?? [], pose ? rotated(inverse(pose.q), [0, 0, 1]) : null);
  }
  if (moves) soon();
}

function soon() {
  if (requested) return;
  requested = true;
  requestAnimationFrame(draw);
}

function wish(words, done = () => {}) {
  ask(words, ok => {
    write("sent", ok ? "" : "the recording does not answer: not done");
    if (ok) done();
  });
}

follow({
  pose: value => { pose = value; remember(value); soon(); },
  state: value => { state = value; soon(); },
  alive: () => {},
  end: value => { end = value; showEnd(end); soon(); },
}, {
  lost: () => {
    if (end && end.report !== "offered" && end.report !== "making") return;
    document.body.className = "bad lost";
    write("stage", "no connection");
    write("why", "this page is cut off from the recording; it asks again by itself. A new recording has a new address");
  },
  listens: soundIsOn,
});

for (const name of ["here", "finish", "pause", "drop"]) part(name).addEventListener("click", () => wish(name));
part("make").addEventListener("click", () => wish("report"));
part("view").addEventListener("click", () => { turnTheView(); soon(); });
part("note").addEventListener("submit", event => {
  event.preventDefault();
  const text = part("text").value;
  if (text.trim()) wish(`note ${text.trim()}`, () => { if (part("text").value === text) part("text").value = ""; });
  part("text").blur();
});
addEventListener("keydown", event => {
  if (event.target instanceof HTMLInputElement || event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.target instanceof HTMLElement && event.target.closest("button, a") && (event.key === " " || event.key === "Enter")) return;
  const words = wishOf(event.key, state?.stage, end), other = { v: part("view"), s: part("sound") }[event.key];
  if (words || event.key === " " || event.key === "n" || other) event.preventDefault();
  if (event.repeat) return;
  if (words) wish(words);
  else if (event.key === "n") part("text").focus();
  else other?.click();
});
soundButton(part("sound"));
navigator.wakeLock?.request("screen").catch(() => {});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { forgetColours(); soon(); });
addEventListener("resize", soon);
soon();
