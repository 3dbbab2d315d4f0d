// What both pictures draw with.

export function canvasOf(id) {
  const canvas = document.getElementById(id), context = canvas.getContext("2d");
  return () => {
    const sharp = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * sharp) || canvas.height !== Math.round(height * sharp)) {
      canvas.width = Math.round(width * sharp);
      canvas.height = Math.round(height * sharp);
    }
    context.setTransform(sharp, 0, 0, sharp, 0, 0);
    context.clearRect(0, 0, width, height);
    context.lineJoin = context.lineCap = "round";
    return { context, width, height };
  };
}

let colours = null;
export const forgetColours = () => { colours = null; };
export const colour = name => (colours ??= getComputedStyle(document.documentElement)).getPropertyValue(`--${name}`).trim();

function trace(context, points) {
  context.beginPath();
  points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
}

export function line(context, points, style, width, dash = []) {
  trace(context, points);
  context.strokeStyle = style;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke();
  context.setLineDash([]);
}

export function area(context, points, fill, opacity = 1) {
  trace(context, points);
  context.closePath();
  context.globalAlpha = opacity;
  context.fillStyle = fill;
  context.fill();
  context.globalAlpha = 1;
}

export function disc(context, [x, y], radius, fill, stroke = null, width = 1.5) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  if (fill) {
    context.fillStyle = fill;
    context.fill();
  }
  if (!stroke) return;
  context.strokeStyle = stroke;
  context.lineWidth = width;
  context.stroke();
}

export function arrowhead(context, [x0, y0], [x, y], style, size, edge = 0) {
  const angle = Math.atan2(y - y0, x - x0), at = (turn, far) => [x + far * Math.cos(angle + turn), y + far * Math.sin(angle + turn)];
  const head = [at(0, size), at(2.4, size), at(Math.PI, 0.35 * size), at(-2.4, size)];
  if (edge) line(context, [...head, head[0]], style, edge);
  area(context, head, style);
}

export function word(context, text, [x, y], style, size = 16, edge = colour("ground")) {
  context.font = `700 ${size}px system-ui, sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineWidth = Math.max(4, size / 4);
  context.strokeStyle = edge;
  context.strokeText(text, x, y);
  context.fillStyle = style;
  context.fillText(text, x, y);
}
