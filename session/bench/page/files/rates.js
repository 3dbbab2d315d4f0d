// The rates of the last ten seconds: a line for each axis with its letter, a scale in °/s, full scale dashed where it is near.

import { canvasOf, colour, line, word } from "./canvas.js";

const SECONDS = 10, AXES = [["x", "now"], ["y", "wanted"], ["z", "good"]], SHARES = [1 / 16, 1 / 8, 1 / 4, 1 / 2, 1], LETTER = 15;
const LEFT = 60, RIGHT = 22, EDGE = 11;  // CSS px around the lines: the scale, the letters, half a word

const begin = canvasOf("rates");
let past = [];

export function remember({ t_s, rate_dps }) {
  if (t_s < past.at(-1)?.t_s) past = [];  // the board's clock has restarted
  past.push({ t_s, rate_dps });
  past = past.filter(each => each.t_s > t_s - SECONDS);
}

export function drawRates(fullScale) {
  const { context, width, height } = begin();
  if (!height || !past.length) return;  // a telephone on its side has no place for it
  const fastest = Math.max(...past.flatMap(({ rate_dps }) => rate_dps.map(Math.abs)));
  const most = fullScale * (SHARES.find(share => share * fullScale >= fastest) ?? 1), end_s = past.at(-1).t_s;
  const across = t_s => LEFT + (width - LEFT - RIGHT) * (1 + (t_s - end_s) / SECONDS);
  const down = rate => height / 2 - Math.max(-1, Math.min(1, rate / most)) * (height / 2 - EDGE);
  for (const rate of [-most, 0, most]) {
    const full = Math.abs(rate) === fullScale;
    line(context, [[LEFT, down(rate)], [width - RIGHT, down(rate)]], colour(full ? "bad" : "line"), full ? 2 : 1, full ? [6, 5] : []);
    word(context, `${rate > 0 ? "+" : rate < 0 ? "−" : ""}${Math.abs(rate)}`, [LEFT / 2, down(rate)], colour("dim"), 13);
  }
  const letters = AXES.map(([name, style], axis) => {
    line(context, past.map(({ t_s, rate_dps }) => [across(t_s), down(rate_dps[axis])]), colour(style), 2);
    return { name, style, y: down(past.at(-1).rate_dps[axis]) };
  }).sort((a, b) => a.y - b.y);
  const middle = Math.max(EDGE + LETTER, Math.min(height - EDGE - LETTER, letters[1].y));  // so that no letter hides another
  letters[0].y = Math.max(EDGE, Math.min(letters[0].y, middle - LETTER));
  letters[2].y = Math.min(height - EDGE, Math.max(letters[2].y, middle + LETTER));
  letters[1].y = middle;
  for (const { name, style, y } of letters) word(context, name, [width - RIGHT / 2, y], colour(style), LETTER);
}
