// SPDX-License-Identifier: Apache-2.0
// Sigma of the projection over the image, on one absolute scale for all cameras and runs, or on its own.
import { useState } from "preact/hooks";
import type { SigmaMap } from "../api/calibration";
import { brief, rangeOf } from "../base/numbers";
import { CellMap } from "./image_field";
import type { Size } from "./image_field";

const kScale: [number, number] = [0.001, 10]; // px

export function SigmaPicture({ map, size, note = "" }: { map: SigmaMap; size: Size; note?: string }) {
  const [own, setOwn] = useState(false);
  const [best, worst] = rangeOf(map.sigma);
  return (
    <div>
      <CellMap
        title={`Points ${brief(map.distance)} m away`}
        note={`${note}${worst > 0 ? ` At most ${brief(worst, 2)} px.` : ""}`}
        size={size}
        grid={map}
        values={map.sigma}
        unit="px"
        range={own ? [best, worst] : kScale}
        logarithmic
      />
      <button class="controls" aria-pressed={own} title="colours from the least to the largest value of this map" onClick={() => setOwn(!own)}>
        own scale
      </button>
    </div>
  );
}
