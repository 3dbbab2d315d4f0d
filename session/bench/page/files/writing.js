// Words and bars of the page; what is as it was is not touched, so that no screen reader reads it again.

export const part = id => document.getElementById(id);

export function write(id, text, key = null) {
  const shown = key === null ? text : `${text} ${key}`;
  if (part(id).textContent === shown) return;
  part(id).textContent = key === null ? text : `${text} `;
  if (key === null) return;
  const made = document.createElement("kbd");
  made.textContent = key;
  part(id).append(made);
}

export function share(id, of) {
  const percent = Math.round(1000 * Math.max(0, Math.min(1, of))) / 10;
  part(id).firstElementChild.style.width = `${percent}%`;
  part(id).setAttribute("aria-valuenow", String(percent));
}

export function made(text, kind = "", name = "span") {
  const element = document.createElement(name);
  element.textContent = text;
  element.className = kind;
  return element;
}
