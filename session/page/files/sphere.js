// What pointed up in the rests so far, in the board's own axes: filled in front, hollow behind.

import { canvasOf, colour, line, word } from "./canvas.js";
import { about, rotated, seen } from "./turning.js";

const FACES = { "+x": [1, 0, 0], "−x": [-1, 0, 0], "+y": [0, 1, 0], "−y": [0, -1, 0], "+z": [0, 0, 1], "−z": [0, 0, -1] };
const RINGS = [[[0, 0, 1], [1, 0, 0]], [[1, 0, 0], [0, 1, 0]], [[0, 1, 0], [0, 0, 1]]];
const NEAR = Math.cos(20 * Math.PI / 180);

const begin = canvasOf("sphere");

export function drawSphere(up, now) {
  const { context, width, height } = begin(), scale = Math.min(width, height) / 2.6;
  const at = vector => {
    const [right, high] = seen(vector);
    return [width / 2 + scale * right, height / 2 - scale * high];
  };
  disc(context, [width / 2, height / 2], scale, null, colour("dim"));
  for (const [axis, start] of RINGS) {
    const ring = Array.from({ length: 73 }, (_, i) => rotated(about(axis, i * Math.PI / 36), start));
    line(context, ring.map(at), colour("line"), 1);
  }
  for (const vector of up) {
    const front = seen(vector)[2] > 0;
    disc(context, at(vector), 5, front ? colour("now") : colour("ground"), colour("now"));
  }
  if (now) {
    const [x, y] = at(now);
    line(context, [[x - 9, y], [x + 9, y]], colour("ink"), 2);
    line(context, [[x, y - 9], [x, y + 9]], colour("ink"), 2);
  }
  for (const [name, face] of Object.entries(FACES)) {
    const filled = up.some(([x, y, z]) => x * face[0] + y * face[1] + z * face[2] > NEAR);
    word(context, filled ? `${name} ✓` : name, at(face.map(part => part * 1.17)), colour(filled ? "dim" : "ink"), 14);
  }
}

function disc(context, [x, y], radius, fill, stroke) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  if (fill) {
    context.fillStyle = fill;
    context.fill();
  }
  context.strokeStyle = stroke;
  context.lineWidth = 1.5;
  context.stroke();
}
