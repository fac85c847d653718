// The page of `plenocal groundtruth`: what is known how well, the points and the path of both segments.

const { truth } = report;
const segmentColours = { start: Colours.main, end: Colours.second };

function addResult() {
  const node = section("Result");
  const box = element("div", { class: `verdict ${truth.findings.length ? "usable" : "good"}` },
    element("strong", {}, `End against start: ± ${brief(1e3 * truth.relative.position, 2)} mm, ± ${brief(1e3 * truth.relative.rotation, 2)} mrad, ± ${brief(100 * truth.relative.scale, 2)} % of scale; absolute scale ± ${brief(100 * truth.scale_sigma, 2)} %`));
  for (const finding of truth.findings) box.append(element("p", {}, finding));
  node.append(box);
  node.append(table("segments", ["", "frames", "left out", "first", "last", "extent along its principal directions, m"],
    Object.entries(truth.segments).map(([name, s]) => row(cell(name), cell(s.frames.length), cell(s.left_out), cell(s.frames[0]), cell(s.frames[s.frames.length - 1]), cell(s.extent.map((v) => brief(v, 2)).join(", "))))));
  node.append(table("points and observations", ["", ""], [
    ["points", truth.points], ["of them in both segments", truth.common], ["observations", truth.observations],
    ...report.cameras.map((camera) => [`RMS of ${camera.name}, px`, brief(camera.rms, 3)]),
  ].map(([name, value]) => row(cell(name), cell(value, value)))));
  node.append(table("alignment error of a perfect estimate (floor of e_align)", ["loop, m", "floor, mm"],
    truth.floors.map(([length, floor]) => row(cell(length), cell(brief(1e3 * floor, 2), floor)))));
}

function addMap() {
  const node = section("Points and path");
  addScene(figures(node), report);
  const grid = figures(node);
  const top = (places) => places.map(([x, , z]) => ({ x, y: z }));
  addFigure(grid, "From above", "x to the right, z forward, in the frame of the first rig pose. Points that both segments show are green.", truth.points, (canvas) => scatter(canvas, [
    { label: "points", data: top(report.markers.filter((m) => !m.common).map((m) => m.place)), pointRadius: 1, backgroundColor: Colours.faint, borderWidth: 0 },
    { label: "points of both", data: top(report.markers.filter((m) => m.common).map((m) => m.place)), pointRadius: 1.5, backgroundColor: Colours.third, borderWidth: 0 },
    ...Object.entries(truth.segments).map(([name, s]) => ({ label: name, data: top(s.path), pointRadius: 2, showLine: true, borderColor: segmentColours[name], backgroundColor: segmentColours[name] })),
  ], { x: axis("x, m"), y: axis("z, m") }), { breadth: "wide", aspect: 1.4 });
}

function addFrames() {
  const node = section("Frames");
  const grid = figures(node), names = report.frames.map((frame) => frame.name);
  addFigure(grid, "Reprojection error", "RMS of the residuals of each frame.", names.length, (canvas) => bars(canvas, names,
    [{ label: "RMS", data: report.frames.map((frame) => frame.rms), backgroundColor: Colours.main }], { y: axis("px") }), { breadth: "wide", aspect: 3 });
  addFigure(grid, "Points", "Used observations of each frame; those of points that both segments show.", names.length, (canvas) => bars(canvas, names, [
    { label: "observations", data: report.frames.map((frame) => frame.observations), backgroundColor: Colours.faint },
    { label: "of common points", data: report.frames.map((frame) => frame.common), backgroundColor: Colours.third },
  ], { y: axis("observations") }), { breadth: "wide", aspect: 3 });
  addFigure(grid, "Position", "Standard error of the rig's position against the first pose.", names.length, (canvas) => bars(canvas, names,
    [{ label: "position", data: report.frames.map((frame) => 1e3 * frame.position_sigma), backgroundColor: Colours.main }], { y: axis("mm") }), { breadth: "wide", aspect: 3 });
}

document.getElementById("subtitle").textContent = `${report.cameras.map((camera) => camera.name).join(", ")}; ${report.frames.length} frames, ${truth.points} points`;
addResult();
addMap();
addFrames();
