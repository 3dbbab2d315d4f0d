// Buttons, keys and pedals: each asks the recording for what a key of its terminal does.  A pedal is a keyboard with one to three keys.

const AGAIN_MS = 600;  // a foot rests longer on a pedal than a finger on a key
const FORWARD = [" ", "PageDown", "ArrowRight"], BACK = ["PageUp", "ArrowLeft"];
let last = ["", 0];

export function ask(wish, heard) {
  if (wish === last[0] && performance.now() - last[1] < AGAIN_MS) return;
  last = [wish, performance.now()];
  fetch("wish", { method: "POST", body: wish }).then(answer => heard(answer.ok), () => heard(false));
}

// What a pedal's forward key means now.
export function forwardOf(stage, end) {
  if (end?.report === "offered" || end?.report === "failed") return "report";
  if (end || !stage || stage === "done") return null;
  return stage === "closure run" ? "here" : "pause";
}

// The wish of a key; null: none.
export function wishOf(key, stage, end) {
  const forward = forwardOf(stage, end);
  if (FORWARD.includes(key)) return forward;
  if (key === "Enter") return forward === "pause" && stage !== "paused" ? null : forward;
  if (end || stage === "done") return null;
  if (key === "p" || key === "P") return "pause";
  if (key === "f" || key === "F") return "finish";
  return BACK.includes(key) || key === "d" || key === "D" ? "drop" : null;
}
