// What comes as lists: sigmas and their targets, what has happened; and what follows the end.

import { play } from "./sound.js";
import { made, part, write } from "./writing.js";

const MARKS = { ready: "●", accepted: "✓", rejected: "✗", warning: "⚠", done: "✓" };
const LEAST = 0.3, MOST = 36;  // times the target, on a bar of logarithms: 25 % of it are 1
let sigmasShown = "", messagesShown = "", sounded = null;

const lengthOf = of => Math.max(2, Math.min(100, 100 * Math.log(of / LEAST) / Math.log(MOST / LEAST)));

export function showSigmas(sigmas) {
  const shown = JSON.stringify(sigmas);
  if (shown === sigmasShown) return;
  sigmasShown = shown;
  write("reached", sigmas.length ? `${sigmas.filter(each => each.of_target <= 1).length} of ${sigmas.length}` : "–");
  const list = part("sigmas");
  while (list.children.length > sigmas.length) list.lastElementChild.remove();
  sigmas.forEach(({ name, of_target }, i) => {
    const item = list.children[i] ?? list.appendChild(empty()), [label, number, bar] = item.children, reached = of_target <= 1;
    item.className = reached ? "" : "above";
    label.title = name;
    label.textContent = name;
    number.textContent = reached ? `✓ ${of_target.toFixed(1)}×` : of_target >= 100 ? "not seen" : `${of_target.toFixed(1)}×`;
    bar.firstElementChild.style.width = `${lengthOf(of_target)}%`;
  });
}

function empty() {
  const item = document.createElement("li"), bar = made("", "bar");
  bar.append(made(""), made("", "", "i"));
  item.append(made("", "name"), made("", "number"), bar);
  return item;
}

export function showMessages(messages) {
  const last = messages.at(-1)?.number ?? 0;
  if (sounded !== null) messages.filter(({ number }) => number > sounded).forEach(({ kind }) => play(kind));
  sounded = last;
  const shown = JSON.stringify(messages);
  if (shown === messagesShown) return;
  messagesShown = shown;
  part("messages").replaceChildren(...messages.slice(-3).reverse().map(({ at_s, text, kind }) => {
    const item = document.createElement("li");
    item.append(made(MARKS[kind] ?? "", "mark"), made(`${at_s.toFixed(1)} s`, "at"), made(text));
    return item;
  }));
}

export function showEnd({ words, command, report }) {
  part("end").hidden = false;
  write("words", words);
  write("command", command);
  part("make").hidden = report !== "offered" && report !== "failed";
  part("open").hidden = report !== "ready";
}
