// SPDX-License-Identifier: Apache-2.0
// The drawings of the page: each is made when it comes near the window, all of them for paper, and again when colours change.

export interface Drawing {
  title: string;
  /** Things that it shows. */
  count: number;
  canvas: () => HTMLCanvasElement | null;
  /** Makes it, once. */
  draw: () => void;
  redraw: () => void;
}

export const drawings = new Set<Drawing>();

const near = new Map<Element, Drawing>();
const visible = new IntersectionObserver(
  (entries) => {
    for (const { isIntersecting, target } of entries) {
      if (isIntersecting) near.get(target)?.draw();
    }
  },
  { rootMargin: "800px" },
);

/** Returns what ends it. */
export function drawWhenNear(element: Element, drawing: Drawing): () => void {
  drawings.add(drawing);
  near.set(element, drawing);
  visible.observe(element);
  return () => {
    drawings.delete(drawing);
    near.delete(element);
    visible.unobserve(element);
  };
}

export function drawAll(): void {
  for (const drawing of drawings) drawing.draw();
}

function redrawAll(): void {
  for (const drawing of drawings) drawing.redraw();
}

/** Colours follow the system's; paper is light. */
export function followColours(): void {
  const root = document.documentElement.classList;
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redrawAll);
  addEventListener("beforeprint", () => {
    root.add("paper");
    drawAll();
    redrawAll();
  });
  addEventListener("afterprint", () => {
    root.remove("paper");
    redrawAll();
  });
}
