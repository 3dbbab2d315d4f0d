// The board as it lies now; where the coach wants it, dashed, turning there again and again; and the arrow of the turn.

import { area, arrowhead, canvasOf, colour, disc, line, word } from "./canvas.js";
import { arcOf, turnedBy } from "./path.js";
import { rotated, seen, times } from "./turning.js";

const HALF = [0.95, 0.62, 0.07], TABLE = [1.4, -1.12], TIP = { x: 1.3, y: 1.18, z: 1.1 };
const LARGER = 1.05;  // a ghost that lies as the board does is still seen around it
const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7].map(i => HALF.map((half, axis) => (i >> axis & 1 ? half : -half)));
const FACES = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
const BOTTOM = 0, TOP = 1;
const flat = (x0, x1, y0, y1, z) => [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]];
const CHIP = flat(-0.24, 0.24, -0.24, 0.24, HALF[2]), PLUG = flat(-1.06, -0.68, -0.22, 0.22, HALF[2]);
const DOT = [0.14, 0.14, HALF[2]], LETTERS = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };
const STRIPES = [-0.75, -0.5, -0.25, 0, 0.25, 0.5, 0.75].map(x => [[x - 0.18, -HALF[1], -HALF[2]], [x + 0.18, HALF[1], -HALF[2]]]);

const begin = canvasOf("board");
let left = 0.5;

export const turnTheView = () => { left += Math.PI / 4; };

// goal: of path.js, or null; phase: where on the way to it the ghost is, 0 to 1; there: the board has come to it.
// moving: the bar shows how much is left, and a second angle would not help.
export function drawBoard(pose, goal, phase, there, moving) {
  const { context, width, height } = begin(), scale = Math.min(width / 3.7, height / 3.6), middle = height * 0.49;
  const view = vector => seen(vector, left);
  const at = vector => {
    const [right, up, near] = view(vector), nearer = 1 + 0.09 * near;
    return [width / 2 + scale * nearer * right, middle - scale * nearer * up];
  };
  const scene = { context, at, view, scale };
  drawTable(scene);
  const arc = goal && !there ? arcOf(goal.turn, view) : null, ghost = goal && turnedBy(goal.turn, phase);
  if (arc) drawArc(scene, arc, false);
  if (ghost) drawThing(scene, ghost, "ghost");
  if (pose) drawThing(scene, pose.q, "now");
  if (ghost) drawThing(scene, ghost, "edges");
  if (arc) drawArc(scene, arc, true);
  if (ghost) drawLetters(scene, ghost, true);
  if (pose) drawLetters(scene, pose.q, false);
  if (arc && !moving) drawLabel(scene, arc, [width, height]);
}

function drawTable({ context, at }) {
  const ring = radius => Array.from({ length: 61 }, (_, i) => {
    const angle = i * Math.PI / 30;
    return at([radius * Math.cos(angle), radius * Math.sin(angle), TABLE[1]]);
  });
  area(context, ring(TABLE[0]), colour("table"));
  line(context, ring(TABLE[0]), colour("line"), 1.5);
  line(context, ring(0.12), colour("line"), 1.5);
}

function drawThing(scene, q, kind) {
  const { context, at, view } = scene, ghost = kind !== "now", larger = ghost ? LARGER : 1;
  const put = points => points.map(point => at(rotated(q, times(point, larger))));
  const corners = CORNERS.map(corner => rotated(q, times(corner, larger))), edge = colour(ghost ? "wanted" : "now");
  const near = face => face.reduce((sum, i) => sum + view(corners[i])[2], 0), up = view(rotated(q, LETTERS.z))[2] > 0;
  const letters = Object.keys(LETTERS).sort((a, b) => view(rotated(q, LETTERS[a]))[2] - view(rotated(q, LETTERS[b]))[2]);
  const behind = letters.filter(name => view(rotated(q, LETTERS[name]))[2] < 0);
  if (kind !== "edges") behind.forEach(name => drawAxis(scene, q, name, ghost));
  for (const face of [...FACES].sort((a, b) => near(a) - near(b)).slice(3)) {
    const points = face.map(i => at(corners[i])), which = FACES.indexOf(face);
    if (kind === "ghost") area(context, points, colour("ghost"));
    if (kind === "now") area(context, points, colour(which === TOP ? "board" : which === BOTTOM ? "under" : "side"));
    if (kind === "now" && which === BOTTOM) STRIPES.forEach(stripe => line(context, put(stripe), colour("now"), 2));
    line(context, [...points, points[0]], edge, ghost ? 2.5 : 2, ghost ? [9, 6] : []);
  }
  if (up) {
    for (const part of [PLUG, CHIP]) {
      if (!ghost) area(context, put(part), colour(part === CHIP ? "chip" : "plug"));
      line(context, [...put(part), put(part)[0]], edge, ghost ? 2 : 1.5, ghost ? [5, 4] : []);
    }
    disc(context, put([DOT])[0], 3, colour(ghost ? "wanted" : "ground"));
  }
  if (kind !== "ghost") letters.filter(name => !behind.includes(name)).forEach(name => drawAxis(scene, q, name, ghost));
}

function drawAxis({ context, at, scale }, q, name, ghost) {
  const inside = { x: HALF[0], y: HALF[1], z: HALF[2] }[name], size = Math.max(15, scale * 0.17);
  const from = at(rotated(q, times(LETTERS[name], inside))), tip = rotated(q, times(LETTERS[name], TIP[name])), to = at(tip);
  const style = colour(ghost ? "wanted" : "ink");
  line(context, [from, to], style, ghost ? 2.5 : 4, ghost ? [7, 6] : []);
  drawLetter(context, to, name, size, ghost);
}

// Those in front, over everything but the words.
function drawLetters({ context, at, view, scale }, q, ghost) {
  const size = Math.max(15, scale * 0.17);
  for (const [name, letter] of Object.entries(LETTERS)) {
    const tip = rotated(q, times(letter, TIP[name]));
    if (view(tip)[2] >= 0) drawLetter(context, at(tip), name, size, ghost);
  }
}

function drawLetter(context, to, name, size, ghost) {
  const style = colour(ghost ? "wanted" : "ink");
  disc(context, to, size * 0.72, colour(ghost ? "ground" : "ink"), style, 2);
  word(context, name, to, ghost ? style : colour("ground"), size, ghost ? colour("ground") : style);
}

// The way of one of the board's letters, from where it is to where it is wanted; what is nearer is wider.
function drawArc({ context, at, view, scale }, { points, axis }, front) {
  const drawn = points.map(at), wide = Math.max(6, scale * 0.065), last = points.length - 1, style = colour("wanted");
  const shown = points.map(point => (view(point)[2] > -0.15) === front);
  const stroke = (i, colours, width) => line(context, [drawn[i], drawn[i + 1]], colours, width * (1 + 0.3 * view(points[i])[2]));
  const head = (colours, edge) => shown[last] && arrowhead(context, drawn[last - 2], drawn[last], colours, wide * 2.6, edge);
  if (!front) line(context, [at(times(axis, -1.5)), at(times(axis, 1.5))], style, 2, [2, 7]);
  context.lineCap = "butt";
  for (let i = 0; i < last; i++) if (shown[i]) stroke(i, colour("ground"), wide + 6);
  context.lineCap = "round";
  head(colour("ground"), 7);
  for (let i = 0; i < last; i++) if (shown[i]) stroke(i, style, wide);
  head(style);
  if (shown[0]) disc(context, drawn[0], wide * 0.95, colour("ground"), style, 3);
}

// Outside, where the arrow is farthest from the middle.
function drawLabel({ context, at, scale }, { points, angle_deg }, [width, height]) {
  const [x0, y0] = at([0, 0, 0]), far = ([x, y]) => Math.hypot(x - x0, y - y0), few = points.length / 7;
  const [x, y] = points.slice(Math.floor(few), -Math.floor(few) || undefined).map(at).reduce((a, b) => (far(b) > far(a) ? b : a));
  const text = `${Math.abs(Math.round(angle_deg))}°`, size = Math.max(22, scale * 0.22);
  const half = size * text.length * 0.3, inside = (value, edge, whole) => Math.max(edge, Math.min(whole - edge, value));
  const right = x + (x - x0) / far([x, y]) * (half + size * 0.6), low = y + (y - y0) / far([x, y]) * size * 1.2;
  word(context, text, [inside(right, half, width), inside(low, size * 0.7, height)], colour("wanted"), size);
}
