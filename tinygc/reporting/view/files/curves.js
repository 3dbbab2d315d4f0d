// Which curves are drawn: of the span that is seen, as many points as there is room for, from this file or from the server.

"use strict";

const source = { whole: [], fine: null, live: false };

// The first number of sorted ones that is not below a value.
function rowOf(values, value) {
  let low = 0, high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < value) low = middle + 1; else high = middle;
  }
  return low;
}

// Of a piece, what lies between two times, as at most about n spans: [{t, low, high}], low and high by column.
function thinned(piece, from, to, n) {
  const start = Math.max(rowOf(piece.t, from) - 1, 0), stop = Math.min(rowOf(piece.t, to) + 1, piece.t.length);
  const step = Math.max(1, Math.ceil((stop - start) / n)), tops = piece.high ?? piece.low;
  if (step === 1) {
    const part = column => column.slice(start, stop);
    return { t: part(piece.t), low: piece.low.map(part), high: piece.high ? piece.high.map(part) : null };
  }
  const t = [], low = piece.low.map(() => []), high = piece.low.map(() => []);
  for (let row = start; row < stop; row += step) {
    t.push(piece.t[row]);
    for (let column = 0; column < low.length; column++) {
      if (!piece.low[column].length) continue;
      let least = Infinity, most = -Infinity;
      for (let i = row; i < Math.min(row + step, stop); i++) {
        least = Math.min(least, piece.low[column][i]);
        most = Math.max(most, tops[column][i]);
      }
      low[column].push(least);
      high[column].push(most);
    }
  }
  return { t, low, high };
}

function curvesOf(from, to, n) {
  const fine = source.fine, pieces = fine && fine.from <= from && to <= fine.to ? fine.pieces : source.whole;
  return pieces.filter(piece => piece.t.length && piece.t[0] <= to && piece.t.at(-1) >= from).map(piece => thinned(piece, from, to, n));
}

// Ask the server for more detail, once the hand rests; then `drawn` draws it.
let waiting = 0;
function refine(from, to, n, drawn) {
  if (!source.live) return;
  clearTimeout(waiting);
  waiting = setTimeout(async () => {
    const wide = (to - from) / 2, begin = from - wide, end = to + wide;
    const answer = await fetch(`curves/${begin.toFixed(6)}/${end.toFixed(6)}/${2 * n}`).catch(() => null);
    if (!answer?.ok) return;
    source.fine = { from: begin, to: end, pieces: await answer.json() };
    drawn();
  }, 120);
}
