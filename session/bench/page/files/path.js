// The way from where the board lay still to where it is wanted: turns one behind the other, each about an axis of the frame with z up.

import { about, between, dot, minus, product, rotated, times, unit } from "./turning.js";

const DEG = Math.PI / 180, FINE = 3 * DEG, RADIUS = 1.45, WIDENS = 0.16, DONE = 0.85, ALONG = 0.9;
const AXES = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

export const turnedBy = ({ from, axis, angle_deg }, part = 1) => product(about(axis, part * angle_deg * DEG), from);

// Of several turns the one that comes now, by how far it has been turned in all: how much of it is left, and where it leads.
export function goalOf(turns, turned_deg) {
  let number = 0, before = 0;
  while (number < turns.length - 1 && turned_deg > before + DONE * Math.abs(turns[number].angle_deg)) before += Math.abs(turns[number++].angle_deg);
  const turn = turns[number], left_deg = Math.max(0, Math.abs(turn.angle_deg) - Math.max(0, turned_deg - before));
  return { turn, number, total: turns.length, left_deg, q: turnedBy(turn) };
}

// How far the board still has to go to it: the way that is left, or what lies between where that is not the way.
export const toGo = (goal, q) => Math.max(goal.left_deg, between(goal.q, q) / DEG);

// The arrow: the way of that one of the board's letters which the eye sees best; a whole turn widens, so that its ends are seen.
export function arcOf(turn, view) {
  const { from, axis, angle_deg } = turn, steps = Math.max(8, Math.ceil(Math.abs(angle_deg) * DEG / FINE));
  const arcs = AXES.map(letter => rotated(from, letter)).filter(start => Math.abs(dot(start, axis)) < ALONG).map(start => {
    const square = times(unit(minus(start, times(axis, dot(start, axis)))), RADIUS);
    return Array.from({ length: steps + 1 }, (_, i) =>
      rotated(about(axis, angle_deg * DEG * i / steps), times(square, 1 + WIDENS * Math.abs(angle_deg) / 360 * i / steps)));
  });
  const near = points => points.reduce((sum, point) => sum + view(point)[2], 0) / points.length;
  return { points: arcs.reduce((a, b) => (near(b) > near(a) ? b : a)), axis, angle_deg };
}
