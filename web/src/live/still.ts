// SPDX-License-Identifier: Apache-2.0
// When a live image stands still and shows something new.

const kWidth = 160; // px; enough to see motion
const kLooks = 3; // in a row without motion
const kMemory = 50; // differences of which the smaller ones are noise
const kLeastNoise = 0.25; // gray levels, of quantisation

/** Mean absolute difference of two images of one size. */
export function difference(a: Uint8ClampedArray, b: Uint8ClampedArray): number {
  let sum = 0;
  for (let i = 0; i < a.length; ++i) sum += Math.abs((a[i] ?? 0) - (b[i] ?? 0));
  return sum / Math.max(1, a.length);
}

/** One for each camera; looks at its video a few times a second. */
export class Stillness {
  private readonly canvas = document.createElement("canvas");
  private last: Uint8ClampedArray | null = null;
  private kept: Uint8ClampedArray | null = null;
  private differences: number[] = [];
  private looks = 0;

  /** Whether the view has stood still, and differs from that of the picture taken last. */
  look(video: HTMLVideoElement): boolean {
    if (video.videoWidth === 0) return false;
    this.canvas.width = kWidth;
    this.canvas.height = Math.max(1, Math.round((kWidth * video.videoHeight) / video.videoWidth));
    const context = this.canvas.getContext("2d", { willReadFrequently: true });
    if (!context) return false;
    context.drawImage(video, 0, 0, kWidth, this.canvas.height);
    const now = context.getImageData(0, 0, kWidth, this.canvas.height).data;
    const moved = this.last?.length === now.length ? difference(this.last, now) : Infinity;
    this.last = now;
    if (moved === Infinity) return false;
    this.differences = [...this.differences, moved].slice(-kMemory);
    // The noise of an image at rest: at least a tenth of the looks find it at rest.
    const noise = Math.max(kLeastNoise, [...this.differences].sort((a, b) => a - b)[Math.floor(this.differences.length / 10)] ?? 0);
    this.looks = moved <= 2 * noise ? this.looks + 1 : 0;
    if (this.looks < kLooks) return false;
    return this.kept?.length !== now.length || difference(this.kept, now) > 4 * noise;
  }

  /** The present view is known: it is new no more. */
  seen(): void {
    this.kept = this.last;
    this.looks = 0;
  }
}
