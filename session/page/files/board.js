// The board as it lies now, where the coach wants it (dashed), and the arrow of the turn.

import { arrowhead, canvasOf, colour, line, word } from "./canvas.js";
import { about, cross, rotated, seen, unit } from "./turning.js";

const HALF = [0.95, 0.62, 0.09];
const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7].map(i => HALF.map((half, axis) => (i >> axis & 1 ? half : -half)));
const FACES = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
const ARROW = 1.3, FINE = 5 * Math.PI / 180, RADIUS = 1.12;

const begin = canvasOf("board");

export function drawBoard(pose, target, turned_deg) {
  const { context, width, height } = begin();
  const scale = Math.min(width, height) / 3.5;
  const at = vector => {
    const [right, up, near] = seen(vector), nearer = 1 + 0.08 * near;
    return [width / 2 + scale * nearer * right, height / 2 - scale * nearer * up];
  };
  line(context, circle([0, 0, 1], [1, 0, 0], 2 * Math.PI).map(v => at([v[0] * 1.5, v[1] * 1.5, -1.1])), colour("line"), 1);
  if (target) drawBox(context, at, target.q, true);
  if (pose) {
    drawBox(context, at, pose.q, false);
    drawAxes(context, at, pose.q, scale);
  }
  if (target) drawTurn(context, at, target.turns, turned_deg, scale);
}

function drawBox(context, at, q, wanted) {
  const corners = CORNERS.map(corner => rotated(q, corner));
  const near = face => face.reduce((sum, i) => sum + seen(corners[i])[2], 0);
  for (const face of [...FACES].sort((a, b) => near(a) - near(b))) {
    const points = face.map(i => at(corners[i]));
    if (!wanted) {
      context.beginPath();
      points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.closePath();
      context.fillStyle = colour(FACES.indexOf(face) === 1 ? "board" : "board-dark");
      context.fill();
    }
    line(context, [...points, points[0]], colour(wanted ? "wanted" : "now"), wanted ? 2.5 : 2, wanted ? [8, 6] : []);
  }
  if (wanted) drawMark(context, at, q);
}

function drawMark(context, at, q) {  // which end and which side of the wanted board is which
  line(context, [at(rotated(q, [0, 0, 0])), at(rotated(q, [HALF[0], 0, 0]))], colour("wanted"), 2.5, [3, 4]);
  word(context, "x", at(rotated(q, [HALF[0] + 0.15, 0, 0])), colour("wanted"), 15);
  line(context, [at(rotated(q, [0, 0, 0])), at(rotated(q, [0, 0, 0.5]))], colour("wanted"), 2.5, [3, 4]);
  word(context, "z", at(rotated(q, [0, 0, 0.65])), colour("wanted"), 15);
}

function drawAxes(context, at, q, scale) {
  const axes = ["x", "y", "z"].map((name, i) => [name, rotated(q, [0, 1, 2].map(k => (k === i ? ARROW : 0)))]);
  for (const [name, axis] of axes.sort((a, b) => seen(a[1])[2] - seen(b[1])[2])) {
    const from = at([0, 0, 0]), to = at(axis);
    line(context, [from, to], colour("ink"), 3);
    arrowhead(context, from, to, colour("ink"), 9);
    word(context, name, at(axis.map(part => part * 1.16)), colour("ink"), Math.max(16, scale * 0.2));
  }
}

function circle(axis, start, angle) {
  const steps = Math.max(2, Math.ceil(Math.abs(angle) / FINE));
  return Array.from({ length: steps + 1 }, (_, i) => rotated(about(axis, angle * i / steps), start));
}

function drawTurn(context, at, turns, turned_deg, scale) {
  const total = turns.length;
  let number = 0, before = 0;
  while (number < total - 1 && turned_deg > before + 0.85 * Math.abs(turns[number].angle_deg)) before += Math.abs(turns[number++].angle_deg);
  const turn = turns[number], axis = turn.axis;
  // It begins at the side that the eye sees, square to the axis.
  const eye = [Math.cos(0.42) * Math.cos(0.5), -Math.cos(0.42) * Math.sin(0.5), Math.sin(0.42)];
  const side = cross(axis, eye), start = unit(Math.hypot(...side) > 0.2 ? side : cross(axis, [0, 1, 0])).map(part => part * RADIUS);
  const points = circle(axis, start, turn.angle_deg * Math.PI / 180).map((point, i, all) => {
    const grows = 1 + 0.12 * i / all.length;  // a whole turn is a spiral, whose ends are seen
    return at(point.map(part => part * grows));
  });
  line(context, points, colour("wanted"), 6);
  arrowhead(context, points.at(-3) || points[0], points.at(-1), colour("wanted"), 18);
  line(context, [at(axis.map(part => -1.35 * part)), at(axis.map(part => 1.35 * part))], colour("wanted"), 1.5, [2, 5]);
  const label = `${Math.round(turn.angle_deg)}°${total > 1 ? ` (${number + 1} of ${total})` : ""}`;
  const [x, y] = points[points.length >> 1];
  word(context, label, [x, y - 20], colour("wanted"), Math.max(18, scale * 0.22));
}
