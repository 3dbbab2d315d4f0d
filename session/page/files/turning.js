// Unit quaternions, scalar first, and vectors: what a picture of a turn needs.

export const rotated = ([w, x, y, z], [a, b, c]) => {
  const u = y * c - z * b, v = z * a - x * c, t = x * b - y * a;
  return [a + 2 * (w * u + y * t - z * v), b + 2 * (w * v + z * u - x * t), c + 2 * (w * t + x * v - y * u)];
};

export const about = ([x, y, z], angle) => {
  const s = Math.sin(angle / 2);
  return [Math.cos(angle / 2), x * s, y * s, z * s];
};

export const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];

export const unit = vector => {
  const length = Math.hypot(...vector) || 1;
  return vector.map(part => part / length);
};

// Seen from the front, from above and a little from the right; z is up.  Returns right, up, towards the eye.
const LEFT = 0.5, ABOVE = 0.42;
export const seen = ([x, y, z]) => {
  const right = x * Math.sin(LEFT) + y * Math.cos(LEFT), near = x * Math.cos(LEFT) - y * Math.sin(LEFT);
  return [right, z * Math.cos(ABOVE) - near * Math.sin(ABOVE), near * Math.cos(ABOVE) + z * Math.sin(ABOVE)];
};
