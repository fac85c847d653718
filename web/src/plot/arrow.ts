// SPDX-License-Identifier: Apache-2.0

/** A line with a head; `unit`: a CSS pixel. */
export function arrow(canvas: CanvasRenderingContext2D, x: number, y: number, dx: number, dy: number, unit = 1): void {
  canvas.beginPath();
  canvas.moveTo(x, y);
  canvas.lineTo(x + dx, y + dy);
  const angle = Math.atan2(dy, dx);
  const head = Math.min(6 * unit, 0.4 * Math.hypot(dx, dy));
  for (const side of [-0.5, 0.5]) {
    canvas.moveTo(x + dx, y + dy);
    canvas.lineTo(x + dx - head * Math.cos(angle + side), y + dy - head * Math.sin(angle + side));
  }
  canvas.stroke();
}
