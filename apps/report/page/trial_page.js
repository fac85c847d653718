// The page of `plenocal try`: models in a table, then their residuals side by side.

const compared = report.models.filter((model) => !model.why_not);

function addTable() {
  const node = section("Models");
  node.append(element("div", { class: "verdict good" }, element("strong", {}, `Recommended: ${report.recommendation}`)));
  const head = ["", "parameters", "held-out RMS, px", "standard error", "P(as bad by chance)", "in-sample RMS, px", "projection uncertainty, px", "run time, s", "not determined"];
  node.append(table("each model on held-out frames", head, report.models.map((model) => {
    const name = cell(model.recommended ? `${model.model} (recommended)` : model.model);
    if (model.why_not) return row(name, element("td", { colspan: String(head.length - 1), style: "text-align:left;white-space:normal" }, model.why_not));
    return row(name, cell(model.parameters), cell(brief(model.rms, 4), model.rms), cell(brief(model.rms_sigma, 2), model.rms_sigma),
      cell(brief(model.probability, 2), model.probability), cell(brief(model.in_sample_rms, 4), model.in_sample_rms), cell(brief(model.image_sigma, 2), model.image_sigma),
      cell(brief(model.seconds, 2), model.seconds), element("td", { style: "text-align:left;white-space:normal;min-width:12em" }, model.undetermined.join(", ") || "–"));
  })));
  note(node, "Of a held-out frame only the pose is estimated. The probability is the smallest of paired t-tests over frames: of the mean squared residuals against those of the best model, corrected for the overlap of the training sets, and of the share of the residuals that a model with a smaller RMS predicts.");
  addFigure(figures(node), "Held-out RMS", "Bars: RMS, and RMS plus its standard error.", compared.length, (canvas) => bars(canvas, compared.map((model) => model.model), [
    { label: "RMS", data: compared.map((model) => model.rms), backgroundColor: Colours.main },
    { label: "RMS plus standard error", data: compared.map((model) => model.rms + model.rms_sigma), backgroundColor: Colours.faint },
  ], { y: axis("RMS, px", { type: "logarithmic", ticks: { callback: (v) => brief(v, 2) } }) }), { breadth: "wide", aspect: 3 });
}

function addPatterns() {
  const node = section("Residuals of held-out points");
  note(node, "Mean residual in each cell of the image. All models of a camera share the scale of the best one: longer arrows and brighter cells are errors that a model leaves.");
  for (const camera of report.cameras) {
    node.append(element("h3", {}, camera.name));
    const grid = figures(node), best = camera.fields[0].field;
    const range = { arrow: typicalArrow(best), value: 2 * best.rms.reduce((a, b) => Math.max(a, b || 0), 0) };
    for (const { model, field } of camera.fields) addArrowMap(grid, model, "", camera.image_size, field, field.rms, "px", range);
  }
}

document.getElementById("subtitle").textContent =
  `${report.cameras.map((camera) => camera.name).join(", ")}; ${report.frames} frames, ${report.folds} folds, ${report.points} points, ${report.outliers} outliers`;
addTable();
addPatterns();
