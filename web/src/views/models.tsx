// SPDX-License-Identifier: Apache-2.0
// Which camera model fits best, in the words of `plenocal try`; one click takes it into the session.
import { useEffect, useState } from "preact/hooks";
import { ask } from "../api/client";
import type { Tried } from "../api/types";
import { activeJob, addJob, attempt, changeSession, lastJob, session } from "../state/project";

const digits = (value: number | null | undefined): string => value?.toFixed(4) ?? "–";

export function Models() {
  const [tried, setTried] = useState<Tried | null>(null);
  const job = lastJob.value;
  const ended = job?.kind === "try" ? `${job.id} ${job.state}` : "";
  useEffect(() => void attempt(async () => setTried(await ask<Tried | null>("GET", "/api/try"))), [ended]);
  const now = session.value;
  const use = (model: string) => changeSession("POST", "/api/session/model", { cameras: tried?.cameras ?? [], model });
  const used = (model: string) => tried?.cameras.every((name) => now?.cameras.find((each) => each.name === name)?.model === model);
  return (
    <section>
      <h2>Camera models</h2>
      <div class="row">
        <button class="main" disabled={!now || now.problem !== null || activeJob.value !== null} onClick={() => addJob("try")}>
          Try all models
        </button>
        <span class="quiet">Each is calibrated without a part of the images, and judged by these.</span>
      </div>
      {tried && (
        <>
          <p data-recommended={tried.recommended}>
            <b>{tried.recommended}</b>: {tried.why}
          </p>
          {tried.target?.why && <p>Target: {tried.target.why}</p>}
          <div class="scroll" tabIndex={0}>
            <table>
              <caption>
                {tried.cameras.join(", ")}; {tried.frames} frames, held out in {tried.folds} parts
              </caption>
              <thead>
                <tr>
                  <th>model</th>
                  <th>parameters</th>
                  <th>error on held-out images, px</th>
                  <th>sigma of the projection, px</th>
                  <th>judgement</th>
                  <th />
                </tr>
              </thead>
              <tbody>
                {Object.entries(tried.models).map(([name, model]) => (
                  <tr key={name}>
                    <th scope="row">{name}</th>
                    <td>{model.parameters ?? "–"}</td>
                    <td>
                      {digits(model.held_out?.rms)}
                      {model.held_out && ` ± ${digits(model.held_out.sigma)}`}
                    </td>
                    <td>{model.projection === null && !model.failure ? "not determined" : digits(model.projection)}</td>
                    <td class={model.failure ? "bad" : ""}>{model.failure ?? model.judgement}</td>
                    <td>
                      {!model.failure &&
                        (used(name) ? (
                          "in the session"
                        ) : (
                          <button aria-label={`Use ${name}`} onClick={() => use(name)}>
                            Use
                          </button>
                        ))}
                    </td>
                  </tr>
                ))}
              </tbody>
            </table>
          </div>
        </>
      )}
    </section>
  );
}
