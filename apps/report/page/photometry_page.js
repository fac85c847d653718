// The pages of `plenocal response` and `plenocal vignette`: curves with their standard deviations.

// Curve and its band of one standard deviation.
function curve(label, xs, ys, colour, more = {}) {
  return { label, data: xs.map((x, i) => ({ x, y: ys[i] })), showLine: true, pointRadius: 0, borderWidth: 1.5, borderColor: colour, backgroundColor: colour, ...more };
}

function addFindings(node, good) {
  const box = element("div", { class: `verdict ${report.findings.length ? "usable" : "good"}` }, element("strong", {}, good));
  for (const finding of report.findings) box.append(element("p", {}, finding));
  node.append(box);
}

function addResponse(r) {
  const node = section("Response");
  const known = r.sigma.filter((s) => s !== null);
  addFindings(node, `Light by grey value: standard deviation up to ${brief(100 * Math.max(...known) / 255, 2)} % of full scale`);
  const values = r.U.map((_, k) => k), grid = figures(node);
  addFigure(grid, "Response", "Light U by grey value I; a straight line would be a sensor without tone curve.", values.length, (canvas) => scatter(canvas, [
    curve("U", values, r.U, Colours.main),
    curve("straight", [0, 255], [0, 255], Colours.faint),
  ], { x: axis("grey value"), y: axis("light, 255: full") }), { aspect: 1.3 });
  addFigure(grid, "Standard deviation", "Of U, from its scatter over disjoint sets of pixels and from errors of exposures.", known.length, (canvas) => scatter(canvas, [
    curve("sigma", values, r.sigma.map((s) => s && 100 * s / 255), Colours.main),
  ], { x: axis("grey value"), y: axis("% of full scale") }), { aspect: 1.3 });
  addFigure(grid, "Images against their exposures", "Mean difference of each image from what its exposure and all other images predict.", r.frames.length, (canvas) => bars(canvas, r.frames,
    [{ label: "difference", data: r.exposure_errors.map((e) => 100 * e), backgroundColor: Colours.main }], { y: axis("%") }), { breadth: "wide", aspect: 3 });
  addFigure(grid, "Pixels by grey value", "Values that hardly occur are extrapolated.", values.length, (canvas) => bars(canvas, values,
    [{ label: "pixels", data: r.count, backgroundColor: Colours.second }], { y: axis("pixels") }), { breadth: "wide", aspect: 3 });
  node.append(table("noise", ["", ""], [
    ["pixels", r.pixels], ["pixels left out, the scene moved there", r.moving], ["images", r.frames.length],
    ["exposures, ms", `${brief(Math.min(...r.exposures))} to ${brief(Math.max(...r.exposures))}`],
    ["errors of single exposures, %", brief(100 * r.exposure_sigma, 2)],
    ["electrons of a full pixel", r.gain > 0 ? brief(255 / r.gain) : "not known"],
    ["read noise, % of full scale", brief(100 * r.read / 255, 2)], ["RMS of U(I) - t E, % of full scale", brief(100 * r.rms / 255, 2)],
  ].map(([name, value]) => row(cell(name), cell(value, value)))));
}

function addVignette(v) {
  const node = section("Vignetting");
  addFindings(node, `Attenuation with a standard deviation of ${brief(100 * v.mean_sigma, 2)} %`);
  const grid = figures(node);
  for (const [name, line] of [["row", v.row], ["column", v.column]]) {
    const places = line.values.map((_, i) => i);
    addFigure(grid, `Middle ${name}`, "Attenuation and its band of ten standard deviations.", places.length, (canvas) => scatter(canvas, [
      curve("attenuation", places, line.values, Colours.main),
      curve("+10 sigma", places, line.values.map((a, i) => a * (1 + 10 * line.sigma[i])), Colours.faint),
      curve("-10 sigma", places, line.values.map((a, i) => a * (1 - 10 * line.sigma[i])), Colours.faint),
    ], { x: axis("px"), y: axis("attenuation") }), { aspect: 1.3 });
  }
  addCellMap(grid, "Attenuation", "Share of the light that reaches each pixel; largest value 1.", v.image_size, v.attenuation.columns, v.attenuation.rows, v.attenuation.values, "");
  addCellMap(grid, "Standard deviation", "Relative, up to a common factor of all pixels.", v.image_size, v.sigma.columns, v.sigma.rows, v.sigma.values.map((s) => 100 * s), "%");
  addCellMap(grid, "Wall", "Brightness of the wall; the marker and what fewer than three images show is left out.", [v.wall.columns, v.wall.rows], v.wall.columns, v.wall.rows, v.wall.values, "");
  addFigure(grid, "Residuals by angle", "Mean residual in fifths of the angles of view; a glossy wall shows a trend.", v.by_angle.length, (canvas) => bars(canvas,
    v.by_angle.map((_, i) => `to ${brief(180 / Math.PI * v.angles[i + 1], 2)}°`), [{ label: "residual", data: v.by_angle.map((r) => 100 * r), backgroundColor: Colours.main }], { y: axis("%") }), { aspect: 1.3 });
  addFigure(grid, "Gains", "Brightness of each image against its exposure and all other images.", v.frames.length, (canvas) => bars(canvas, v.frames,
    [{ label: "gain", data: v.gains.map((g) => 100 * (g - 1)), backgroundColor: Colours.second }], { y: axis("%") }), { breadth: "wide", aspect: 3 });
  node.append(table("measurements", ["", ""], [
    ["images", v.frames.length], ["measurements", v.measurements], ["residuals, %", brief(100 * v.residual, 3)],
    ["the same by noise, %", brief(100 * v.expected, 3)], ["beyond 3 standard deviations, %", brief(100 * v.outliers, 2)],
  ].map(([name, value]) => row(cell(name), cell(value, value)))));
}

function addComparison(c) {
  const node = section("Comparison");
  node.append(element("p", {}, `${c.first} against ${c.second}: RMS ${brief(100 * c.rms, 2)} %, largest ${brief(100 * c.largest, 2)} %. Both have a common factor that makes their mean ratio 1.`));
  const grid = figures(node);
  for (const [name, part, x] of [["Middle row", c.row, "px"], ["Means over circles", c.radial, "px from the image's middle"]]) {
    addFigure(grid, name, "Both attenuations.", part.x.length, (canvas) => scatter(canvas, [
      curve(c.first, part.x, part.first, Colours.main), curve(c.second, part.x, part.second, Colours.second),
    ], { x: axis(x), y: axis("attenuation") }), { aspect: 1.3 });
    const ratio = part.x.map((_, i) => 100 * (part.first[i] / part.second[i] - 1));
    const band = part.sigma.some((s) => s !== null) ? [1, -1].map((sign) => curve(`${sign > 0 ? "+" : "-"}1 sigma`, part.x, part.sigma.map((s) => sign * 100 * s), Colours.faint)) : [];
    addFigure(grid, `${name}: ratio`, `${c.first} / ${c.second} - 1, with its standard deviation.`, part.x.length, (canvas) => scatter(canvas, [
      curve("ratio", part.x, ratio, Colours.main), ...band,
    ], { x: axis(x), y: axis("%") }), { aspect: 1.3 });
  }
}

document.getElementById("subtitle").textContent = report.camera;
if (report.response) addResponse(report.response);
if (report.vignette) addVignette(report.vignette);
if (report.comparison) addComparison(report.comparison);
