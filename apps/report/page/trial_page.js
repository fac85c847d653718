// The page of `plenocal try`: models in a table, then their residuals side by side.

const compared = report.models.filter((model) => !model.why_not);

function addTable() {
  const node = section("Models");
  node.append(element("div", { class: "verdict good" }, element("strong", {}, `Recommended: ${report.recommendation}`),
    element("p", {}, `Target: ${report.target}`)));
  const head = ["", "judgement", "parameters", "held-out RMS, px", "standard error", "difference from the best, px", "P(as bad by chance)", "in-sample RMS, px", "standard error of the projection, supported image, px", "whole image, px", "not determined"];
  node.append(table("each model on held-out frames", head, report.models.map((model) => {
    const name = cell(model.recommended ? `${model.model} (recommended)` : model.model);
    if (model.why_not) return row(name, element("td", { colspan: String(head.length - 1), style: "text-align:left;white-space:normal" }, model.why_not));
    return row(name, element("td", { style: "text-align:left;white-space:normal;min-width:14em" }, model.judgement), cell(model.parameters),
      cell(brief(model.rms, 4), model.rms), cell(brief(model.rms_sigma, 2), model.rms_sigma),
      cell(brief(model.difference, 2), model.difference), cell(brief(model.probability, 2), model.probability), cell(brief(model.in_sample_rms, 4), model.in_sample_rms), cell(brief(model.sigma, 2), model.sigma), cell(brief(model.image_sigma, 2), model.image_sigma),
      element("td", { style: "text-align:left;white-space:normal;min-width:12em" }, model.undetermined.join(", ") || "–"));
  })));
  note(node, "Of a held-out frame only the pose is estimated. The difference is that of the projection over the supported image, after the best rigid motion. The probability is the smaller one of two paired t-tests over frames against the best model: of the mean squared residuals, corrected for the overlap of the training sets, and of the share of the residuals that the best model predicts.");
  addFigure(figures(node), "Held-out RMS", "Bars: RMS, and RMS plus its standard error.", compared.length, (canvas) => bars(canvas, compared.map((model) => model.model), [
    { label: "RMS", data: compared.map((model) => model.rms), backgroundColor: Colours.main },
    { label: "RMS plus standard error", data: compared.map((model) => model.rms + model.rms_sigma), backgroundColor: Colours.faint },
  ], { y: axis("RMS, px", { type: "logarithmic", min: 0.5 * Math.min(...compared.map((model) => model.rms)), ticks: { callback: (v) => brief(v, 2) } }) }), { breadth: "wide", aspect: 3 });
}

/** Scales that show small differences between good models: from what the best model leaves to three times its typical cell. */
function commonRange(fields) {
  const known = fields[0].rms.filter((value) => value !== null).sort((a, b) => a - b);
  const middle = known[Math.floor(known.length / 2)];
  return { arrow: typicalArrow(fields[0]), low: known[Math.floor(0.05 * known.length)], value: 3 * middle };
}

function addPatterns() {
  const node = section("Residuals of held-out points");
  note(node, "Mean residual in each cell of the image. All models of a camera have the same scales: longer arrows and brighter cells are errors that a model leaves. The brightest cells may be beyond the scale.");
  for (const camera of report.cameras) {
    node.append(element("h3", {}, camera.name));
    const grid = figures(node), range = commonRange(camera.fields.map(({ field }) => field));
    for (const { model, field } of camera.fields) addArrowMap(grid, model, "", camera.image_size, field, field.rms, "px", range);
  }
}

document.getElementById("subtitle").textContent =
  `${report.cameras.map((camera) => camera.name).join(", ")}; ${report.frames} frames, ${report.folds} folds, ${report.points} points, ${report.outliers} outliers`;
addTable();
addPatterns();
