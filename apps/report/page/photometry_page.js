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

document.getElementById("subtitle").textContent = report.camera;
if (report.response) addResponse(report.response);
