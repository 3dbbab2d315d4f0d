// Unit quaternions, scalar first, and vectors: what a picture of a turn needs.

export const rotated = ([w, x, y, z], [a, b, c]) => {
  const u = y * c - z * b, v = z * a - x * c, t = x * b - y * a;
  return [a + 2 * (w * u + y * t - z * v), b + 2 * (w * v + z * u - x * t), c + 2 * (w * t + x * v - y * u)];
};

export const product = ([a, b, c, d], [w, x, y, z]) => [
  a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y, a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w,
];

export const inverse = ([w, x, y, z]) => [w, -x, -y, -z];

// Counter-clockwise for whoever looks against the axis: the right hand's sense.
export const about = ([x, y, z], angle) => {
  const s = Math.sin(angle / 2);
  return [Math.cos(angle / 2), x * s, y * s, z * s];
};

export const between = (p, q) => 2 * Math.acos(Math.min(1, Math.abs(p.reduce((sum, part, i) => sum + part * q[i], 0))));

export const dot = (a, b) => a.reduce((sum, part, i) => sum + part * b[i], 0);

export const times = (vector, by) => vector.map(part => part * by);

export const minus = (a, b) => a.map((part, i) => part - b[i]);

export const unit = vector => times(vector, 1 / (Math.hypot(...vector) || 1));

// Seen from the front, from above and a little from the right; z is up.  Returns right, up, towards the eye: a right-handed frame.
const LEFT = 0.5, ABOVE = 0.42;
export const seen = ([x, y, z], left = LEFT) => {
  const right = x * Math.sin(left) + y * Math.cos(left), near = x * Math.cos(left) - y * Math.sin(left);
  return [right, z * Math.cos(ABOVE) - near * Math.sin(ABOVE), near * Math.cos(ABOVE) + z * Math.sin(ABOVE)];
};
