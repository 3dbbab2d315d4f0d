// The picture: rates, force and temperature over time, stills shaded, segments with their numbers, and the closure of each as bars.

"use strict";

const DASHES = [[], [8, 4], [2, 3]];
const PANELS = [
  { name: "rate (°/s)", columns: [0, 1, 2], share: 3 },
  { name: "force (g)", columns: [3, 4, 5], share: 2.2 },
  { name: "temperature (°C)", columns: [6], share: 1.1 },
  { name: "closure error (°)", columns: [], share: 2.4 },
];
const seen = { from: 0, to: 1, axes: [true, true, true], choice: null, band: null, edge: null };
let content = null, frame = { left: 56, right: 10, width: 0, height: 0, rows: [] };

let colours = null;
const colour = name => (colours ??= getComputedStyle(document.documentElement)).getPropertyValue(`--${name}`).trim();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { colours = null; redraw(); });

const x_of = t => frame.left + (t - seen.from) / (seen.to - seen.from) * (frame.width - frame.left - frame.right);
const t_of = x => seen.from + (x - frame.left) / (frame.width - frame.left - frame.right) * (seen.to - seen.from);

function sized(canvas) {
  const sharp = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * sharp) || canvas.height !== Math.round(height * sharp)) {
    canvas.width = Math.round(width * sharp);
    canvas.height = Math.round(height * sharp);
  }
  const g = canvas.getContext("2d");
  g.setTransform(sharp, 0, 0, sharp, 0, 0);
  g.clearRect(0, 0, width, height);
  return { g, width, height };
}

// Round numbers between two: about n of them.
function ticks(low, high, n) {
  const raw = (high - low) / n, power = 10 ** Math.floor(Math.log10(raw)), step = power * [1, 2, 5, 10].find(m => m * power >= raw * 0.999);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i++) found.push([i * step, (i * step).toFixed(digits).replace("-", "−")]);
  return found;
}

// A number with three significant digits, and no exponent.
const short = value => value == null ? "–" : value >= 100 ? value.toFixed(0) : value.toFixed(Math.min(5, Math.max(0, 2 - Math.floor(Math.log10(Math.max(value, 1e-5))))));

function rowsOf(height, letters) {
  const strip = letters + 12, foot = letters + 12, gap = letters + 8;
  const panels = PANELS.filter(panel => panel.columns[0] !== 6 || source.whole.some(piece => piece.low[6].length));
  const room = height - strip - foot - gap * panels.length, shares = panels.reduce((sum, panel) => sum + panel.share, 0);
  let top = 0;
  return {
    strip: { top: 0, bottom: strip },
    panels: panels.map((panel, i) => {
      top = (i ? top : strip) + gap;
      const row = { ...panel, top, bottom: top + room * panel.share / shares };
      top = row.bottom;
      return row;
    }),
  };
}

function hatch(g, left, top, width, height, style) {
  g.save();
  g.beginPath();
  g.rect(left, top, width, height);
  g.clip();
  g.strokeStyle = style;
  g.lineWidth = 1;
  g.setLineDash([]);
  g.beginPath();
  for (let x = left - height - (left % 7); x < left + width; x += 7) {
    g.moveTo(x, top + height);
    g.lineTo(x + height, top);
  }
  g.stroke();
  g.restore();
}

const isChosen = (kind, number) => seen.choice?.kind === kind && seen.choice.number === number;
const inSight = each => each.to_s >= seen.from && each.from_s <= seen.to;

function draw() {
  if (!content) return;
  const { g, width, height } = sized(document.getElementById("plot")), letters = width > 1600 ? 15 : 12;
  frame = { left: width < 500 ? 46 : letters * 5, right: 10, width, height, ...rowsOf(height, letters) };
  g.font = `${letters}px system-ui, sans-serif`;
  g.textBaseline = "middle";
  const [first, last] = [frame.panels[0].top, frame.panels.at(-1).bottom];
  drawStills(g, first, frame.panels.at(-2).bottom);
  drawTimes(g, first, last, letters);
  const curves = curvesOf(seen.from, seen.to, Math.max(300, Math.round(width)));
  for (const panel of frame.panels) {
    g.fillStyle = colour("dim");
    g.textAlign = "left";
    if (panel.columns.length || width > 600) g.fillText(panel.name, frame.left, panel.top - letters * 0.7);
    if (panel.columns.length) drawCurves(g, panel, curves); else drawClosure(g, panel, letters);
  }
  drawSegments(g, letters);
  drawMarks(g, frame.panels[0]);
  if (seen.band) {
    const [a, b] = seen.band.map(x_of);
    g.fillStyle = colour("choice");
    g.globalAlpha = 0.2;
    g.fillRect(Math.min(a, b), first, Math.abs(b - a), last - first);
    g.globalAlpha = 1;
  }
  drawMap();
}

function drawStills(g, top, bottom) {
  for (const still of content.stills.filter(inSight)) {
    const chosen = isChosen("still", still.number), ends = chosen && seen.edge ? seen.edge.ends : [still.from_s, still.to_s];
    const left = Math.max(x_of(ends[0]), frame.left), right = Math.min(x_of(ends[1]), frame.width - frame.right);
    g.fillStyle = colour("still");
    if (still.problem) hatch(g, left, top, right - left, bottom - top, colour("line")); else g.fillRect(left, top, right - left, bottom - top);
    if (still.by_hand === "moved" || chosen) {
      g.strokeStyle = colour("choice");
      g.lineWidth = chosen ? 2.5 : 1.5;
      g.setLineDash(chosen ? [] : [3, 3]);
      g.strokeRect(left, top, right - left, bottom - top);
      g.setLineDash([]);
    }
    if (chosen && source.live && right - left > 24) {
      g.fillStyle = colour("choice");
      for (const x of ends.map(x_of)) g.fillRect(x - 4, (top + bottom) / 2 - 18, 8, 36);
    }
  }
}

function drawTimes(g, top, bottom, letters) {
  g.strokeStyle = colour("line");
  g.lineWidth = 1;
  const narrow = frame.width < 600, minutes = seen.to - seen.from > 900, unit = minutes ? 60 : 1;
  for (const [value, text] of ticks(seen.from / unit, seen.to / unit, narrow ? 4 : 9)) {
    const x = x_of(value * unit);
    g.beginPath();
    g.moveTo(x, top);
    g.lineTo(x, bottom);
    g.stroke();
    g.fillStyle = colour("dim");
    g.textAlign = x < frame.left + 12 ? "left" : x > frame.width - 30 ? "right" : "center";
    g.fillText(`${text} ${minutes ? "min" : "s"}`, x, bottom + letters);
  }
  for (const log of content.logs.slice(1).filter(log => log.from_s < seen.to)) {
    g.strokeStyle = colour("ink");
    g.setLineDash([2, 4]);
    g.beginPath();
    g.moveTo(x_of(log.from_s), top);
    g.lineTo(x_of(log.from_s), bottom);
    g.stroke();
    g.setLineDash([]);
    const at = x_of(log.from_s) < frame.left + 90 ? frame.left + 90 : x_of(log.from_s) + 4, cut = at + g.measureText(log.name).width > frame.width;
    g.textAlign = cut ? "right" : "left";
    g.fillStyle = colour("ink");
    g.fillText(log.name, cut ? frame.width - frame.right : at, top - letters * 0.7);
  }
}

function levels(g, panel, values, y) {
  g.textAlign = "right";
  for (const [value, text] of values) {
    g.strokeStyle = colour("line");
    g.lineWidth = 1;
    g.beginPath();
    g.moveTo(frame.left, y(value));
    g.lineTo(frame.width - frame.right, y(value));
    g.stroke();
    g.fillStyle = colour("dim");
    g.fillText(text, frame.left - 6, y(value));
  }
}

function clipped(g, panel, drawing) {
  g.save();
  g.beginPath();
  g.rect(frame.left, panel.top, frame.width - frame.left - frame.right, panel.bottom - panel.top);
  g.clip();
  drawing();
  g.restore();
}

function drawCurves(g, panel, curves) {
  const columns = panel.columns.filter(column => column === 6 || seen.axes[column % 3]);
  let low = Infinity, high = -Infinity;
  for (const piece of curves) {
    for (const column of columns) {
      for (const value of piece.low[column]) low = Math.min(low, value);
      for (const value of (piece.high ?? piece.low)[column]) high = Math.max(high, value);
    }
  }
  if (low > high) return;
  const margin = Math.max((high - low) * 0.06, 1e-4), y = value => panel.bottom - (value - low + margin) / (high - low + 2 * margin) * (panel.bottom - panel.top);
  levels(g, panel, ticks(low, high, Math.max(3, (panel.bottom - panel.top) / 38)), y);
  clipped(g, panel, () => {
    for (const piece of curves) {
      for (const column of columns) {
        if (piece.low[column].length) drawCurve(g, piece.t, piece.low[column], piece.high?.[column], y, column);
      }
    }
  });
}

function drawCurve(g, t, low, high, y, column) {
  g.strokeStyle = g.fillStyle = colour(column === 6 ? "temp" : "xyz"[column % 3]);
  if (high) {
    g.globalAlpha = 0.3;
    g.beginPath();
    t.forEach((each, i) => g.lineTo(x_of(each), y(high[i])));
    for (let i = t.length - 1; i >= 0; i--) g.lineTo(x_of(t[i]), y(low[i]));
    g.fill();
    g.globalAlpha = 1;
  }
  g.lineWidth = 1.5;
  g.setLineDash(column === 6 ? [] : DASHES[column % 3]);
  g.beginPath();
  t.forEach((each, i) => g.lineTo(x_of(each), y(high ? (low[i] + high[i]) / 2 : low[i])));
  g.stroke();
  g.setLineDash([]);
}

// Raw as outlines, calibrated filled, the floor a dashed line; a segment that is in no fit has a cross.
function drawClosure(g, panel, letters) {
  const some = content.segments.filter(each => each.after_deg != null);
  if (!some.length) {
    g.fillStyle = colour("dim");
    g.textAlign = "left";
    g.fillText(content.why ? "no fit, and so no closure" : "not fitted yet", frame.left + 8, (panel.top + panel.bottom) / 2);
    return;
  }
  const floor = content.closure.floor_deg, all = some.flatMap(each => [each.raw_deg, each.after_deg]);
  const low = Math.log10(Math.max(Math.min(floor / 6, ...all), floor / 100)), high = Math.log10(Math.max(...all) * 1.4);
  const y = value => panel.bottom - (Math.log10(Math.max(value, 1e-9)) - low) / (high - low) * (panel.bottom - panel.top);
  const tens = [];
  for (let power = Math.ceil(low); power <= high; power++) tens.push([10 ** power, power < 0 ? (10 ** power).toFixed(-power) : `${10 ** power}`]);
  levels(g, panel, tens, y);
  clipped(g, panel, () => {
    for (const each of content.segments.filter(inSight)) {
      const left = x_of(each.from_s), wide = Math.max(x_of(each.to_s) - left - 2, 1.5);
      if (each.after_deg == null) {
        g.fillStyle = colour("dim");
        g.textAlign = "center";
        g.fillText("×", left + wide / 2, panel.bottom - letters / 2);
        continue;
      }
      g.strokeStyle = colour("dim");
      g.lineWidth = 1;
      g.strokeRect(left, y(each.raw_deg), wide, panel.bottom + 2 - y(each.raw_deg));
      g.fillStyle = colour(isChosen("segment", each.number) ? "choice" : "good");
      g.fillRect(left + wide * 0.2, y(each.after_deg), Math.max(wide * 0.6, 1), panel.bottom - y(each.after_deg));
    }
    g.strokeStyle = colour("ink");
    g.lineWidth = 1.5;
    g.setLineDash([6, 4]);
    g.beginPath();
    g.moveTo(frame.left, y(floor));
    g.lineTo(frame.width, y(floor));
    g.stroke();
    g.setLineDash([]);
  });
  g.textAlign = "right";
  g.fillStyle = colour("dim");
  g.fillText(`${frame.width > 600 ? "" : "closure (°): "}□ raw  ■ calibrated  ┄ floor ${short(floor)}°`, frame.width - frame.right, panel.top - letters * 0.7);
}

function drawSegments(g, letters) {
  const { top, bottom } = frame.strip, boxes = [];
  for (const each of content.segments.filter(inSight)) {
    const left = Math.max(x_of(each.from_s), frame.left) + 0.5, right = Math.min(x_of(each.to_s), frame.width - frame.right) - 0.5;
    if (right > left) boxes.push({ each, left, right, chosen: isChosen("segment", each.number) });
  }
  for (const { each, left, right, chosen } of boxes) {
    g.strokeStyle = colour(chosen ? "choice" : "dim");
    g.lineWidth = chosen ? 3 : 1;
    if (chosen || right - left > 4) g.strokeRect(left, top + 2, right - left, bottom - top - 4);
    if (each.problem) hatch(g, left, top + 2, right - left, bottom - top - 4, colour("bad"));
  }
  let free = 0;
  g.textAlign = "center";
  for (const { each, left, right } of boxes) {
    const text = `${each.problem ? "×" : ""}${each.number}`, middle = (left + right) / 2, half = g.measureText(text).width / 2 + 1;
    if (middle - half < free || (half > (right - left) / 2 && each.number % 5)) continue;
    free = middle + half;
    g.fillStyle = colour("ground");
    if (each.problem || half > (right - left) / 2) g.fillRect(middle - half + 1, top + 3, 2 * half - 2, bottom - top - 6);
    g.fillStyle = colour(each.problem ? "bad" : "ink");
    g.fillText(text, middle, (top + bottom) / 2 + 0.5);
  }
}

// What was put in (◆), and rests that are no reference (○), at the top of the rates.
function drawMarks(g, panel) {
  g.textAlign = "center";
  for (const mark of content.marks.filter(inSight)) {
    g.fillStyle = colour("bad");
    g.fillText(mark.what === "rest" ? "○" : mark.what === "gap" ? "◆" : "▲", x_of((mark.from_s + mark.to_s) / 2), panel.top + 6);
  }
}

function drawMap() {
  const { g, width, height } = sized(document.getElementById("map")), x = t => frame.left + t / content.length_s * (width - frame.left - frame.right);
  g.strokeStyle = colour("dim");
  let most = 1;
  const pieces = source.whole.map(piece => thinned(piece, 0, content.length_s, Math.round(width / 2)));
  const size = (piece, i) => Math.max(...[0, 1, 2].map(c => Math.max(Math.abs(piece.low[c][i] ?? 0), Math.abs((piece.high ?? piece.low)[c][i] ?? 0))));
  for (const piece of pieces) piece.t.forEach((_, i) => { most = Math.max(most, size(piece, i)); });
  g.beginPath();
  for (const piece of pieces) {
    piece.t.forEach((t, i) => {
      g.moveTo(x(t), height - 1);
      g.lineTo(x(t), height - 2 - size(piece, i) / most * (height - 8));
    });
  }
  g.stroke();
  g.strokeStyle = colour("choice");
  g.lineWidth = 2.5;
  g.strokeRect(x(seen.from), 1.5, Math.max(x(seen.to) - x(seen.from), 4), height - 3);
}

let awaited = 0;
function redraw() {
  cancelAnimationFrame(awaited);
  awaited = requestAnimationFrame(draw);
}
