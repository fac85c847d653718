// SPDX-License-Identifier: Apache-2.0
// The pages of `plenocal response` and `plenocal vignette`: curves with their standard deviations.
import { brief, isKnown, rangeOf } from "../base/numbers";
import { FindingsBox } from "../parts/findings";
import type { Cell } from "../parts/table";
import { Table } from "../parts/table";
import { BarChart } from "../plot/bar_chart";
import { CellMap } from "../plot/image_field";
import type { Grid } from "../plot/image_field";
import { LineChart } from "../plot/line_chart";
import { Figures, SectionPage } from "./page";
import type { AttenuationRows, Comparison, Photometry, Response, Vignette } from "./types";

const numbered = (name: string, value: number): [string, Cell] => [name, { text: String(value), value }];
const percent = (value: number | null): number | null => (value === null ? null : 100 * value);

function ResponseSection({ response: r, page }: { response: Response; page: Photometry }) {
  const values = r.U.map((_, k) => k);
  return (
    <>
      <FindingsBox {...page} />
      <Figures>
        <LineChart
          title="Response"
          note="Light U by grey value I; a straight line would be a sensor without tone curve."
          places={values}
          x={{ label: "grey value" }}
          y={{ label: "light, 255: full" }}
          series={[
            { label: "U", values: r.U, colour: "--series-0" },
            { label: "straight", values, colour: "--faint" },
          ]}
        />
        <LineChart
          title="Standard deviation"
          note="Of U, from the scatter over the pixels and from errors of exposures."
          places={values}
          x={{ label: "grey value" }}
          y={{ label: "% of full scale" }}
          series={[{ label: "sigma", values: r.sigma.map((s) => (s === null ? null : (100 * s) / 255)), colour: "--series-0" }]}
        />
        <BarChart
          title="Images against their exposures"
          note="Mean difference of each image from what its exposure and all other images predict."
          breadth="wide"
          aspect={3}
          names={r.frames}
          y={{ label: "%" }}
          unit="%"
          series={[{ label: "difference", values: r.exposure_errors.map(percent), colour: "--series-0" }]}
        />
        <BarChart
          title="Pixels by grey value"
          note="Values that hardly occur are extrapolated."
          breadth="wide"
          aspect={3}
          names={values.map(String)}
          y={{ label: "pixels" }}
          series={[{ label: "pixels", values: r.count, colour: "--series-1" }]}
        />
      </Figures>
      <Table
        caption="noise"
        head={[]}
        rows={[
          numbered("pixels", r.pixels),
          numbered("pixels left out, the scene moved there", r.moving),
          numbered("images", r.frames.length),
          ["exposures, ms", rangeOf(r.exposures).map((ms) => brief(ms)).join(" to ")],
          ["errors of single exposures, %", brief(100 * r.exposure_sigma, 2)],
          ["electrons of a full pixel", r.gain > 0 ? brief(255 / r.gain) : "not known"],
          ["read noise, % of full scale", brief((100 * r.read) / 255, 2)],
          ["RMS of U(I) - t E, % of full scale", brief((100 * r.rms) / 255, 2)],
        ]}
      />
    </>
  );
}

interface Picture extends Grid {
  values: (number | null)[];
}

function VignetteSection({ vignette: v, page }: { vignette: Vignette; page: Photometry }) {
  const maps: [string, string, Picture, string][] = [
    ["Attenuation", "Share of the light that reaches each pixel; largest value 1.", v.attenuation, ""],
    ["Standard deviation", "Relative, up to a common factor of all pixels.", { ...v.sigma, values: v.sigma.values.map(percent) }, "%"],
  ];
  return (
    <>
      <FindingsBox {...page} />
      <Figures>
        {(["row", "column"] as const).map((name) => {
          const { values, sigma } = v[name];
          const beside = (sigmas: number): number[] => values.map((a, i) => a * (1 + sigmas * (sigma[i] ?? 0)));
          return (
            <LineChart
              key={name}
              title={`Middle ${name}`}
              note="Attenuation and its band of ten standard deviations."
              places={values.map((_, i) => i)}
              x={{ label: "px" }}
              y={{ label: "attenuation" }}
              series={[
                { label: "attenuation", values, colour: "--series-0" },
                { label: "+10 sigma", values: beside(10), colour: "--faint" },
                { label: "-10 sigma", values: beside(-10), colour: "--faint" },
              ]}
            />
          );
        })}
        {maps.map(([title, note, map, unit]) => (
          <CellMap key={title} title={title} note={note} size={v.image_size} grid={map} values={map.values} unit={unit} />
        ))}
        <CellMap
          title="Wall"
          note="Brightness of the wall; the marker and what fewer than three images show is left out."
          size={[v.wall.columns, v.wall.rows]}
          grid={v.wall}
          values={v.wall.values}
          unit=""
        />
        <BarChart
          title="Residuals by angle"
          note="Mean residual in fifths of the angles of view; a glossy wall shows a trend."
          aspect={1.3}
          names={v.by_angle.map((_, i) => `to ${brief((180 / Math.PI) * (v.angles[i + 1] ?? 0), 2)}°`)}
          y={{ label: "%" }}
          unit="%"
          series={[{ label: "residual", values: v.by_angle.map(percent), colour: "--series-0" }]}
        />
        <BarChart
          title="Gains"
          note="Brightness of each image against its exposure and all other images."
          breadth="wide"
          aspect={3}
          names={v.frames}
          y={{ label: "%" }}
          unit="%"
          series={[{ label: "gain", values: v.gains.map((gain) => 100 * (gain - 1)), colour: "--series-1" }]}
        />
      </Figures>
      <Table
        caption="measurements"
        head={[]}
        rows={[
          numbered("images", v.frames.length),
          numbered("measurements", v.measurements),
          ["residuals, %", brief(100 * v.residual)],
          ["the same by noise, %", brief(100 * v.expected)],
          ["beyond 3 standard deviations, %", brief(100 * v.outliers, 2)],
        ]}
      />
    </>
  );
}

function Curves({ title, x, rows, first, second }: { title: string; x: string; rows: AttenuationRows; first: string; second: string }) {
  const ratio = rows.first.map((value, i) => 100 * (value / (rows.second[i] ?? NaN) - 1));
  const band = (sign: number) => ({ label: `${sign > 0 ? "+" : "-"}1 sigma`, values: rows.sigma.map((s) => (s === null ? null : sign * 100 * s)), colour: "--faint" });
  return (
    <>
      <LineChart
        title={title}
        note="Both attenuations."
        places={rows.x}
        x={{ label: x }}
        y={{ label: "attenuation" }}
        series={[
          { label: first, values: rows.first, colour: "--series-0" },
          { label: second, values: rows.second, colour: "--series-1" },
        ]}
      />
      <LineChart
        title={`${title}: ratio`}
        note={`${first} / ${second} - 1, with its standard deviation.`}
        places={rows.x}
        x={{ label: x }}
        y={{ label: "%" }}
        series={[{ label: "ratio", values: ratio, colour: "--series-0" }, ...(rows.sigma.some(isKnown) ? [band(1), band(-1)] : [])]}
      />
    </>
  );
}

function ComparisonSection({ first, second, rms, largest, row, radial }: Comparison) {
  return (
    <>
      <p>
        {first} against {second}: RMS {brief(100 * rms, 2)} %, largest {brief(100 * largest, 2)} %. Both have a common factor that makes their mean
        ratio 1.
      </p>
      <Figures>
        <Curves title="Middle row" x="px" rows={row} first={first} second={second} />
        <Curves title="Means over circles" x="px from the image's middle" rows={radial} first={first} second={second} />
      </Figures>
    </>
  );
}

export function PhotometryPage({ page }: { page: Photometry }) {
  const { camera, response, vignette, comparison } = page;
  return (
    <SectionPage
      subtitle={camera}
      sections={[
        response ? { title: "Response", content: <ResponseSection response={response} page={page} /> } : null,
        vignette ? { title: "Vignetting", content: <VignetteSection vignette={vignette} page={page} /> } : null,
        comparison ? { title: "Comparison", content: <ComparisonSection {...comparison} /> } : null,
      ]}
    />
  );
}
