// A canvas that is as sharp as the screen, and the page's colours.

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
    return { context, width, height };
  };
}

export const colour = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

export function line(context, points, style, width, dash = []) {
  context.beginPath();
  points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.strokeStyle = style;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke();
  context.setLineDash([]);
}

export function arrowhead(context, [x0, y0], [x, y], style, size) {
  const angle = Math.atan2(y - y0, x - x0);
  context.beginPath();
  context.moveTo(x + size * Math.cos(angle), y + size * Math.sin(angle));
  for (const side of [2.4, -2.4]) context.lineTo(x + size * Math.cos(angle + side), y + size * Math.sin(angle + side));
  context.closePath();
  context.fillStyle = style;
  context.fill();
}

export function word(context, text, [x, y], style, size = 16) {
  context.font = `600 ${size}px system-ui, sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineWidth = 4;
  context.strokeStyle = colour("ground");
  context.strokeText(text, x, y);
  context.fillStyle = style;
  context.fillText(text, x, y);
}
