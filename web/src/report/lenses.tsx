// SPDX-License-Identifier: Apache-2.0
// Micro lenses by type, and white images.
import type { LensType, MicroLenses, ReportCamera, Section, Vignetting } from "../api/calibration";
import { brief, rangeOf } from "../base/numbers";
import { sigmaCells, Table } from "../parts/table";
import { seriesName } from "../plot/colours";
import { ArrowMap, CellMap, imageAspect } from "../plot/image_field";
import { LineChart } from "../plot/line_chart";
import type { LineSeries } from "../plot/line_chart";
import { Figures, Note } from "./page";

function TypesOf({ name, types }: { name: string; types: LensType[] }) {
  const metres = (z: number | null): string => (z === null ? "infinity" : brief(z, 3));
  const thousandfold = (value: number | null): number | null => (value === null ? null : 1e3 * value);
  const most = rangeOf(types.flatMap((type) => type.disc))[1];
  const places = types[0]?.distance ?? [];
  const curves: LineSeries[] = types.map(({ type, disc }, i) => ({ label: `lens type ${type}`, values: disc, colour: seriesName(i), width: 2 }));
  return (
    <>
      <h3>{name}</h3>
      <Table
        caption="optics of the micro lenses"
        head={["lens type", "focal length, mm", "standard error", "aperture, mm", "standard error", "in focus, m", "sharp from, m", "to, m"]}
        rows={types.map((t) => [
          String(t.type),
          ...sigmaCells(1e3 * t.focal_length, thousandfold(t.focal_length_sigma)),
          ...sigmaCells(1e3 * t.aperture, thousandfold(t.aperture_sigma)),
          metres(t.in_focus),
          metres(t.near),
          metres(t.far),
        ])}
      />
      <Figures>
        <LineChart
          title="Blur by distance"
          note="Diameter of the disc by which the aperture of each lens type blurs a point."
          breadth="broad"
          aspect={1.8}
          places={places}
          x={{ label: "distance, m", logarithmic: true, range: rangeOf(places) }}
          y={{ label: "diameter, px", range: [0, Math.min(most, 6)] }}
          series={[...curves, { label: "one pixel", values: places.map(() => 1), colour: "--quiet", dashed: true, width: 1 }]}
        />
      </Figures>
    </>
  );
}

export function LensTypes({ cameras }: { cameras: ReportCamera[] }) {
  return (
    <>
      <Note>
        From the blur of the markers in micro images. Sharp: between the distances at which the aperture blurs a point to a disc of one pixel.
      </Note>
      {cameras.map(({ name, lens_types }) => (
        <TypesOf key={name} name={name} types={lens_types} />
      ))}
    </>
  );
}

export const hasWhiteImages = ({ vignetting, micro_lenses }: ReportCamera): boolean => (vignetting ?? micro_lenses) !== null;

/** Values of two sections of the same step at the places of the longer one. */
function sectionsOf(row: Section, column: Section): { places: number[]; row: (number | null)[]; column: (number | null)[] } {
  const at = ({ step, values }: Section): [number, number][] => values.map((value, i) => [(i + 0.5) * step - 0.5, value]);
  const places = [...new Set([...at(row), ...at(column)].map(([place]) => place))].sort((a, b) => a - b);
  const on = (section: Section): (number | null)[] => {
    const known = new Map(at(section));
    return places.map((place) => known.get(place) ?? null);
  };
  return { places, row: on(row), column: on(column) };
}

function Attenuation({ v, size }: { v: Vignetting; size: [number, number] }) {
  const sections = sectionsOf(v.row, v.column);
  const attenuation = { label: "attenuation", range: [0, 1.05] as [number, number] };
  return (
    <>
      <CellMap
        title="Vignetting"
        note={`Relative brightness; 1: no attenuation.${v.detail ? " Each cell shows the brightest pixel of about one micro image." : ""}`}
        size={size}
        grid={v}
        values={v.values}
        unit=""
      />
      <LineChart
        title="Cross section of the vignetting"
        note={v.row.step > 1 ? `Means of ${v.row.step} px.` : ""}
        aspect={imageAspect(size)}
        places={sections.places}
        x={{ label: "x or y, px" }}
        y={attenuation}
        series={[
          { label: "middle row", values: sections.row, colour: "--series-0", width: 1 },
          { label: "middle column", values: sections.column, colour: "--series-1", width: 1 },
        ]}
      />
      {v.detail && (
        <LineChart
          title="Cross section of micro images"
          note="Middle row."
          aspect={imageAspect(size)}
          places={v.detail.values.map((_, i) => (v.detail?.first ?? 0) + i)}
          x={{ label: "x, px" }}
          y={attenuation}
          series={[{ label: "attenuation", values: v.detail.values, colour: "--series-0" }]}
        />
      )}
    </>
  );
}

function Lattice({ lenses, size }: { lenses: MicroLenses; size: [number, number] }) {
  const types = lenses.types.map((t) => `type ${t.type}: ${t.lenses}`).join(", ");
  return (
    <ArrowMap
      title="Micro-image centres against a regular lattice"
      note={`${lenses.lenses} micro lenses (${types}), ${brief(lenses.pitch, 5)} px apart; RMS ${brief(lenses.rms)} px. Distortion of the main lens deforms the lattice.`}
      size={size}
      field={lenses.field}
    />
  );
}

export function WhiteImages({ cameras }: { cameras: ReportCamera[] }) {
  return (
    <>
      {cameras.map(({ name, image_size, vignetting, micro_lenses }) => (
        <div key={name}>
          <h3>{name}</h3>
          <Figures small>
            {vignetting && <Attenuation v={vignetting} size={image_size} />}
            {micro_lenses && <Lattice lenses={micro_lenses} size={image_size} />}
          </Figures>
        </div>
      ))}
    </>
  );
}
