// SPDX-License-Identifier: Apache-2.0
// The page of `plenocal try`: models in a table, then their residuals side by side.
import type { Field } from "../api/calibration";
import { brief, isKnown } from "../base/numbers";
import type { Cell } from "../parts/table";
import { Table } from "../parts/table";
import { BarChart } from "../plot/bar_chart";
import { ArrowMap, typicalArrow } from "../plot/image_field";
import { Figures, Note, SectionPage } from "./page";
import type { StressTest, Trial, TrialModel } from "./types";

const kHead = [
  "",
  "judgement",
  "parameters",
  "held-out RMS, px",
  "standard error",
  "difference from the best, px",
  "P(as bad by chance)",
  "in-sample RMS, px",
  "standard error of the projection, supported image, px",
  "90 % of the image, px",
  "not determined",
];

function modelRow(model: TrialModel): [string, ...Cell[]] {
  const name = model.recommended ? `${model.model} (recommended)` : model.model;
  if (model.why_not) return [name, { text: model.why_not, words: true }];
  const number = (value: number | null | undefined, digits: number): Cell => ({ text: brief(value, digits), value });
  return [
    name,
    { text: model.judgement, words: true },
    number(model.parameters, 6),
    number(model.rms, 4),
    number(model.rms_sigma, 2),
    number(model.difference, 2),
    number(model.probability, 2),
    number(model.in_sample_rms, 4),
    number(model.sigma, 2),
    number(model.projection, 2),
    { text: model.undetermined.join(", ") || "–", words: true },
  ];
}

function Models({ recommendation, target, evidence, models }: Trial) {
  const compared = models.filter((model) => !model.why_not);
  const rms = compared.map((model) => model.rms ?? null);
  return (
    <>
      <div class="verdict good">
        <strong>Recommended: {recommendation}</strong>
        <p>Target: {target}</p>
        {evidence && <p>{evidence}</p>}
      </div>
      <Table caption="each model on held-out frames" head={kHead} rows={models.map(modelRow)} />
      <Note>
        Of a held-out frame only the pose is estimated. The difference is that of the projection over the supported image, after the best rigid
        motion. The probability is the smaller one of two paired t-tests over frames against the best model: of the mean squared residuals,
        corrected for the overlap of the training sets, and of the share of the residuals that the best model predicts.
      </Note>
      <Figures>
        <BarChart
          title="Held-out RMS"
          note="Bars: RMS, and RMS plus its standard error."
          breadth="wide"
          aspect={3}
          names={compared.map(({ model }) => model)}
          y={{ label: "RMS, px", logarithmic: true, text: (value) => brief(value, 2) }}
          unit="px"
          series={[
            { label: "RMS plus standard error", values: compared.map((model) => (model.rms ?? 0) + (model.rms_sigma ?? 0)), colour: "--faint" },
            { label: "RMS", values: rms, colour: "--series-0" },
          ]}
        />
      </Figures>
    </>
  );
}

/** Scales that show small differences between good models: from what the best model leaves to three times its typical cell. */
function commonScale({ rms, ...field }: Field): { arrow: number; low: number; high: number } {
  const known = rms.filter(isKnown).sort((a, b) => a - b);
  return {
    arrow: typicalArrow(field),
    low: known[Math.floor(0.05 * known.length)] ?? 0,
    high: 3 * (known[Math.floor(known.length / 2)] ?? 1),
  };
}

function Patterns({ cameras }: Trial) {
  return (
    <>
      <Note>
        Mean residual in each cell of the image. All models of a camera have the same scales: longer arrows and brighter cells are errors that a
        model leaves. The brightest cells may be beyond the scale.
      </Note>
      {cameras.map(({ name, image_size, fields }) => (
        <div key={name}>
          <h3>{name}</h3>
          <Figures>
            {fields.map(({ model, field }) => (
              <ArrowMap
                key={model}
                title={model}
                size={image_size}
                field={field}
                values={field.rms}
                {...(fields[0] ? { scale: commonScale(fields[0].field) } : {})}
              />
            ))}
          </Figures>
        </div>
      ))}
    </>
  );
}

function stressRow({ camera, what, failure, fails, ...test }: StressTest): [string, ...Cell[]] {
  const name = `${camera}, ${what}`;
  if (failure) return [name, { text: failure, words: true }];
  const number = (value: number | undefined): Cell => ({ text: brief(value, 3), value });
  return [
    name,
    { text: fails ? "differs" : "agrees", words: true },
    number(test.probability),
    number(test.difference),
    number(test.predicted),
    number(test.factor),
  ];
}

function Stress({ stress }: Trial) {
  return (
    <>
      <Table
        caption="calibrations from a part of the points against the other points"
        head={["", "", "P(by chance)", "difference, px", "predicted, px", "factor"]}
        rows={stress.map(stressRow)}
      />
      <Note>
        Of halves of the frames the difference is that of both projections over the supported image, after the best rigid motion. Of a region of the
        image it is the error with which the other points predict those of the region. The factor is the RMS residual of points that a calibration did
        not have over that of its own. The probabilities are corrected for the number of tests: of a camera that lacks nothing, one is below 0.05 in at
        most 5 % of recordings.
      </Note>
    </>
  );
}

export function TrialPage({ trial }: { trial: Trial }) {
  return (
    <SectionPage
      subtitle={`${trial.cameras.map(({ name }) => name).join(", ")}; ${trial.frames} frames, ${trial.folds} folds, ${trial.points} points, ${trial.outliers} outliers`}
      sections={[
        { title: "Models", content: <Models {...trial} /> },
        trial.stress.length > 0 ? { title: "Stress tests", content: <Stress {...trial} /> } : null,
        { title: "Residuals of held-out points", content: <Patterns {...trial} /> },
      ]}
    />
  );
}
