// The lists: what is chosen, what was changed by hand, what is not used and why, every turn.

"use strict";

function made(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}
const button = (text, act, properties = {}) => {
  const element = made("button", { type: "button", textContent: text, ...properties });
  element.addEventListener("click", act);
  return element;
};
const seconds = each => `${each.from_s.toFixed(2)} to ${each.to_s.toFixed(2)} s`;

function listChoice() {
  const place = document.getElementById("chosen"), each = found(seen.choice);
  if (!each) {
    place.replaceChildren(made("h2", { textContent: "nothing chosen" }), made("p", { textContent: "Click a segment, a bar or a still." }));
    return;
  }
  const { kind, number } = seen.choice, facts = [["from", seconds(each)]];
  if (kind === "segment") {
    facts.push(["turn", `${each.turn_deg.toFixed(0)}° in ${each.turn_s.toFixed(1)} s`]);
    facts.push(["closure error", each.after_deg == null ? "in no fit" : `raw ${short(each.raw_deg)}°, calibrated ${short(each.after_deg)}°`]);
  } else if (each.temp_c != null) facts.push(["temperature", `${each.temp_c.toFixed(1)} °C`]);
  if (each.note) facts.push(["note", each.note]);
  facts.push(["used", each.problem ? `no: ${each.problem}` : "yes"]);
  const list = made("dl", {}, ...facts.flatMap(([name, value]) => [made("dt", { textContent: name }), made("dd", { textContent: value })]));
  place.replaceChildren(made("h2", { textContent: `${kind} ${number}` }), list, button("show it", () => show(each)));
  if (!source.live) return;
  const out = each.by_hand === true || each.by_hand === "left out";
  if (out || !each.problem) place.append(" ", button(out ? "take it back" : "leave it out", () => toggle(seen.choice), { id: "toggle" }));
  if (kind !== "still" || out) return;
  const ends = seen.edge?.ends ?? [each.from_s, each.to_s];
  const fields = ends.map((end, i) => made("input", { type: "number", step: "0.005", value: end.toFixed(3), ariaLabel: ["from, s", "to, s"][i] }));
  const form = made("form", { noValidate: true }, "from ", fields[0], " to ", fields[1], " s ", made("button", { textContent: "use these ends" }));
  form.addEventListener("submit", event => {
    event.preventDefault();
    moveStill(number, fields.map(field => Number(field.value)));
  });
  place.append(form);
  if (each.by_hand) place.append(button("as it was found", () => takeBack(seen.choice)));
}

// A line that shows what it speaks of when it is clicked.
const line = (text, each, kind = null, ...more) => made("li", {}, button(text, () => { show(each); if (kind) choose(kind, each.number); }, { className: "there" }), ...more);

function listChanges() {
  const rows = ["segment", "still"].flatMap(kind => content[`${kind}s`].filter(each => each.by_hand).map(each => {
    const what = each.by_hand === "moved" ? `ends moved: ${seconds(each)}` : "left out";
    const back = source.live ? [button("take back", () => takeBack({ kind, number: each.number }))] : [];
    return line(`${kind} ${each.number} ${what}`, each, kind, ...back);
  }));
  const note = made("p", { textContent: source.live ? "Kept in session.toml; every command obeys it." : "From session.toml." });
  document.getElementById("changed").replaceChildren(made("h2", { textContent: `changed by hand: ${rows.length || "nothing"}` }), ...(rows.length ? [made("ul", {}, ...rows), note] : []));
}

function listUnused() {
  const rows = ["segment", "still"].flatMap(kind => content[`${kind}s`].filter(each => each.problem && (!each.by_hand || each.by_hand === "moved")).map(each =>
    line(`× ${kind} ${each.number}: ${each.problem}`, each, kind)));
  for (const mark of content.marks) {
    const what = { rest: "○ rest not used", gap: "◆ gap", clipped: "▲ clipped" }[mark.what];
    rows.push(line(`${what} at ${mark.from_s.toFixed(2)} s: ${mark.why}`, mark));
  }
  const remarks = content.segments.filter(each => each.note).map(each => line(`segment ${each.number}: ${each.note}`, each, "segment"));
  for (const warning of content.warnings) remarks.push(made("li", {}, made("span", { textContent: warning })));
  const titled = (title, lines) => [made("h2", { textContent: title }), ...(lines.length ? [made("ul", {}, ...lines)] : [])];
  const unused = titled(`clipped, bridged, not used: ${rows.length || "nothing"}`, rows);
  document.getElementById("unused").replaceChildren(...unused, ...(remarks.length ? titled("remarks", remarks) : []));
}

function listTurns() {
  const cells = (tag, texts) => made("tr", {}, ...texts.map(text => made(tag, { textContent: text })));
  const head = made("thead", {}, cells("th", ["turn", "at, s", "turned, °", "raw, °", "calibrated, °", "used"]));
  const body = made("tbody", {}, ...content.segments.map(each => cells("td", [each.number, each.from_s.toFixed(1), each.turn_deg.toFixed(0),
    short(each.raw_deg), short(each.after_deg), each.problem ? `no: ${each.problem}` : "yes"])));
  document.querySelector("#turns table").replaceChildren(head, body);
}
