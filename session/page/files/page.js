// Takes the recording's events and shows them.

import { drawBoard } from "./board.js";
import { play, soundButton } from "./sound.js";
import { drawSphere } from "./sphere.js";
import { rotated } from "./turning.js";

const SILENT_MS = 6000, FAST = 85;
const part = id => document.getElementById(id);
let pose = null, state = null, heard = performance.now(), sounded = null, asked = false, sigmasShown = "", saidShown = "";

const write = (id, text) => {
  if (part(id).textContent !== text) part(id).textContent = text;
};
const bar = (id, share) => {
  const percent = Math.round(1000 * Math.max(0, Math.min(1, share))) / 10;
  part(id).firstElementChild.style.width = `${percent}%`;
  part(id).setAttribute("aria-valuenow", String(percent));
};

function showPose() {
  const of = 100 * pose.peak_dps / pose.full_scale_dps;
  bar("speed", of / 100);
  part("speed").classList.toggle("fast", of > FAST);
  write("rate", `${pose.peak_dps.toFixed(0)} of ${pose.full_scale_dps} dps${of > FAST ? ": slower" : ""}`);
}

function showState() {
  document.body.className = `${state.good ? "" : "bad"} ${state.stage === "done" ? "done" : ""}`;
  write("stage", state.stage);
  write("count", `${state.accepted} of ${state.wanted} turns${state.rejected ? `, ${state.rejected} rejected` : ""}`);
  write("do", state.do);
  write("why", state.why);
  part("still").classList.toggle("none", state.part === null);
  bar("still", state.part ?? 0);
  write("closure", state.closure_deg === null ? "–" : `${state.closure_deg.toFixed(2)}°`);
  write("stills", String(state.up.length));
  showSigmas(state.sigmas);
  showSaid(state.said);
  const warm = state.temp_c === null ? "" : `; ${state.temp_c} °C${state.wait ? `: ${state.wait}` : ""}`;
  write("stream", `${state.odr_hz ?? "–"} Hz; ${state.samples} samples, ${state.lost} lost${warm}`);
}

function showSigmas(sigmas) {
  const shown = JSON.stringify(sigmas);
  if (shown === sigmasShown) return;
  sigmasShown = shown;
  write("reached", sigmas.length ? `${sigmas.filter(each => each.of_target <= 1).length} of ${sigmas.length} reached` : "–");
  part("sigmas").replaceChildren(...sigmas.map(({ name, of_target }) => {
    const item = document.createElement("li"), reached = of_target <= 1;
    item.className = reached ? "" : "above";
    item.append(cell(name), cell(reached ? `${of_target.toFixed(2)} ✓` : of_target >= 100 ? "not seen" : `${of_target.toFixed(1)}×`));
    return item;
  }));
}

function showSaid(said) {
  const last = said.at(-1)?.number ?? 0;
  if (sounded !== null) said.filter(({ number }) => number > sounded).forEach(({ kind }) => play(kind));
  sounded = last;
  const shown = JSON.stringify(said);
  if (shown === saidShown) return;
  saidShown = shown;
  part("said").replaceChildren(...[...said].reverse().map(({ at_s, text }) => {
    const item = document.createElement("li"), at = cell(`${at_s.toFixed(1)} s`);
    at.className = "at";
    item.append(at, cell(text));
    return item;
  }));
}

function cell(text) {
  const made = document.createElement("span");
  made.textContent = text;
  return made;
}

// What the board's axes say of the vertical: its third row.
const upNow = ([w, x, y, z]) => rotated([w, -x, -y, -z], [0, 0, 1]);

function draw() {
  asked = false;
  if (pose) showPose();
  if (state) showState();
  drawBoard(pose, state?.target ?? null, state?.turned_deg ?? 0);
  drawSphere(state?.up ?? [], pose ? upNow(pose.q) : null);
}

function soon() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(draw);
}

const events = new EventSource("events");
const heed = (name, take) => events.addEventListener(name, event => {
  heard = performance.now();
  take(JSON.parse(event.data));
  soon();
});
heed("pose", value => { pose = value; });
heed("state", value => { state = value; });
setInterval(() => {
  if (performance.now() - heard < SILENT_MS || state?.stage === "done") return;
  document.body.className = "bad";
  write("stage", "no connection");
  write("why", "the recording says nothing: it has ended, or this page is cut off from it");
}, 1000);
soundButton(part("sound"));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", soon);
addEventListener("resize", soon);
soon();
