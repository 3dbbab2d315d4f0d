// What pointed up in the rests so far, in the board's own axes: filled in front, hollow behind.

import { canvasOf, colour, disc, line, word } from "./canvas.js";
import { about, dot, rotated, seen, times } from "./turning.js";

const FACES = { "+x": [1, 0, 0], "−x": [-1, 0, 0], "+y": [0, 1, 0], "−y": [0, -1, 0], "+z": [0, 0, 1], "−z": [0, 0, -1] };
const RINGS = [[[0, 0, 1], [1, 0, 0]], [[1, 0, 0], [0, 1, 0]], [[0, 1, 0], [0, 0, 1]]];
const NEAR = Math.cos(20 * Math.PI / 180);

const begin = canvasOf("sphere");

export const facesOf = up => Object.entries(FACES).filter(([, face]) => up.some(each => dot(each, face) > NEAR)).map(([name]) => name);

export function drawSphere(up, now) {
  const { context, width, height } = begin();
  if (!height) return;  // a telephone on its side has no place for it
  const letters = width < 150 ? 12 : 14, aside = 2.9 * letters, scale = Math.min(width / 2 - aside, height / 2 - 1.5 * letters), filled = facesOf(up);
  const at = vector => {
    const [right, high] = seen(vector);
    return [width / 2 + scale * right, height / 2 - scale * high];
  };
  disc(context, [width / 2, height / 2], scale, colour("table"), colour("dim"));
  for (const [axis, start] of RINGS) {
    const ring = Array.from({ length: 73 }, (_, i) => rotated(about(axis, i * Math.PI / 36), start));
    for (let i = 0; i < 72; i++) {
      const front = seen(ring[i])[2] > 0;
      if (front || i % 2) line(context, [at(ring[i]), at(ring[i + 1])], colour("line"), front ? 1.5 : 1);
    }
  }
  // Names lie around the sphere, each with a line from its side: none hides another, nor a point.
  for (const [name, face] of Object.entries(FACES)) {
    const [right, high] = seen(face), far = Math.hypot(right, high), there = filled.includes(name), text = there ? `${name}✓` : name;
    context.font = `700 ${letters}px system-ui, sans-serif`;
    const out = scale + 5 + Math.abs(right / far) * context.measureText(text).width / 2 + Math.abs(high / far) * letters / 2;
    line(context, [at(face), at(times(face, 1 / far))], colour("dim"), 1, [2, 2]);
    word(context, text, [width / 2 + out * right / far, height / 2 - out * high / far], colour(there ? "good" : "ink"), letters);
  }
  for (const vector of up) {
    const front = seen(vector)[2] > 0;
    disc(context, at(vector), 4.5, front ? colour("now") : colour("ground"), colour("now"));
  }
  if (!now) return;
  const [x, y] = at(now);
  for (const [style, wide] of [[colour("ground"), 6], [colour("ink"), 2.5]]) {
    line(context, [[x - 9, y], [x + 9, y]], style, wide);
    line(context, [[x, y - 9], [x, y + 9]], style, wide);
  }
}
