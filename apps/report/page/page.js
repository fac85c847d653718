// From the report's data to the page, section by section.

function addVerdict() {
  const { grade, headline, findings } = report.verdict;
  const node = section("Verdict");
  const box = element("div", { class: `verdict ${grade}` }, element("strong", {}, headline));
  for (const camera of report.cameras) {
    const r = camera.residuals;
    box.append(element("div", {}, `${camera.name}: reprojection error ${brief(r.rms, 4)} px RMS over ${r.points} points in ${r.views} images; noise ${brief(r.noise, 3)} px per coordinate` +
      (r.detector_sigma ? `, detector ${brief(r.detector_sigma, 3)} px` : "") + "."));
  }
  node.append(box);
  if (findings.length === 0) {
    note(node, "All parameters are determined, the points cover the image and a range of distances and tilts, and the residuals are noise.");
    return;
  }
  node.append(element("ul", { class: "findings" }, ...findings.map((finding) =>
    element("li", { class: finding.grade }, finding.what, finding.remedy ? element("em", {}, finding.remedy) : null))));
}

function addParameters() {
  const node = section("Parameters");
  for (const camera of report.cameras) {
    const r = camera.residuals;
    node.append(element("h3", {}, `${camera.name}: ${camera.model}, ${camera.image_size[0]} x ${camera.image_size[1]} px`));
    const tables = element("div", { class: "tables" });
    node.append(tables);
    tables.append(table("parameters", ["", "value", "standard error", "unit"], camera.parameters.map((p) => {
      const [value, sigma] = withSigma(p.value, p.sigma);
      return row(cell(p.name), cell(value, p.value), cell(sigma, p.sigma), cell(unitText(p.unit)));
    })));
    if (camera.coefficients > 0) note(node, `The model also has ${camera.coefficients} coefficients of a field over the image; see calibration.yaml.`);
    tables.append(table("residuals", ["", "", ""], [
      ["RMS reprojection error", r.rms, "px"], ["points used", r.points, ""], ["points rejected", r.rejected, ""], ["images", r.views, ""],
      ["noise of one coordinate", r.noise, "px"], ["noise stated by the detector", r.detector_sigma, "px"], ["noise floor (any model)", r.noise_floor, "px"],
      ...Object.entries(r.rms_by_type).map(([type, rms]) => [`RMS of lens type ${type}`, rms, "px"]),
    ].filter(([, value]) => value !== undefined).map(([name, value, unit]) => row(cell(name), cell(brief(value, 6), value), cell(unit)))));
    if (camera.xi_camera_rig.some((v) => v !== 0)) {
      tables.append(table("T_camera_rig as se(3) vector", ["", "value", "standard error", "unit"], ["v_x", "v_y", "v_z", "w_x", "w_y", "w_z"].map((name, i) => {
        const [value, sigma] = withSigma(camera.xi_camera_rig[i], camera.sigma_xi[i]);
        return row(cell(name), cell(value, camera.xi_camera_rig[i]), cell(sigma, camera.sigma_xi[i]), cell(i < 3 ? "m" : "rad"));
      })));
    }
    note(node, camera.source);
  }
}

function addResiduals(camera, parent) {
  const { sample, field, histogram, frames, markers, types } = camera.plots;
  parent.append(element("h3", {}, camera.name));
  if (sample.step > 1) note(parent, `Plots of single points show every ${sample.step}th of ${sample.all} points; all other plots use every point.`);
  const grid = figures(parent);
  const points = (used) => sample.x.map((unused, i) => ({ x: sample.dx[i], y: sample.dy[i], i })).filter(({ i }) => sample.used[i] === used);
  const used = points(1), rejected = points(0);
  const reach = roundUp(1.05 * used.reduce((a, p) => Math.max(a, Math.abs(p.x), Math.abs(p.y)), 0) || 1);
  const beyond = rejected.filter((p) => Math.abs(p.x) > reach || Math.abs(p.y) > reach).length;
  const name = (item) => { const { i } = item.raw; return `frame ${report.frames[sample.frame[i]].name}, marker ${sample.marker[i]}: (${brief(sample.dx[i])}, ${brief(sample.dy[i])}) px`; };
  addFigure(grid, "Residuals", "Measured minus predicted." + (beyond ? ` ${counted(beyond, "rejected point")} outside.` : ""), used.length, (canvas) => scatter(canvas, [
    { label: "used", data: used, pointRadius: 1.5, backgroundColor: Colours.faint, borderWidth: 0 },
    { label: "rejected", data: rejected, pointRadius: 2.5, backgroundColor: Colours.rejected, borderWidth: 0 },
  ], { x: axis("dx, px", { min: -reach, max: reach, ticks: { callback: (v) => brief(v, 2) } }), y: axis("dy, px", { min: -reach, max: reach, reverse: true, ticks: { callback: (v) => brief(v, 2) } }) }, { label: name }), { aspect: 1.2 });
  addArrowMap(grid, "Direction and magnitude over the image", "Mean residual in each cell. Random directions are noise; a pattern is an error of the camera model.", camera.image_size, field, field.rms, "px");
  addFigure(grid, "Histogram of both coordinates", `Residuals divided by their noise sigma, with the normal distribution.` + (histogram.noise_left < 0.9 ? ` The estimated parameters absorb ${Math.round(100 * (1 - histogram.noise_left))} % of the noise.` : "") + (histogram.outside ? ` ${histogram.outside} of ${histogram.coordinates} outside.` : ""), histogram.coordinates, (canvas) => bars(canvas, histogram.sigmas, [
    { type: "line", label: "normal", data: histogram.expected, borderColor: Colours.second, pointRadius: 0, borderWidth: 2 },
    { label: "residuals", data: histogram.counts, backgroundColor: Colours.faint },
  ], { x: { title: { display: true, text: "residual / sigma" }, ticks: { autoSkip: false, maxRotation: 0, callback: (i) => (Number.isInteger(histogram.sigmas[i]) ? histogram.sigmas[i] : null) } }, y: axis("coordinates") }), { aspect: 1.2 });
  const groupBars = (title, text, names, group, unit) => addFigure(grid, title, text, group.points.length, (canvas) => bars(canvas, names, [
    { label: "RMS", data: group.rms, backgroundColor: Colours.main },
  ], { x: { title: { display: true, text: unit }, ticks: { maxTicksLimit: 20 } }, y: axis("RMS, px", { beginAtZero: true }) }, {
    tooltip: { afterLabel: (item) => `${group.points[item.dataIndex]} points, ${group.rejected[item.dataIndex]} rejected` },
  }), names.length > 150 ? { breadth: "wide", aspect: 3.5 } : names.length > 40 ? { breadth: "broad", aspect: 2.5 } : { aspect: 1.2 });
  groupBars("Per frame", "RMS reprojection error.", frames.frame.map((f) => report.frames[f].name), frames, "frame");
  groupBars("Per marker", "RMS reprojection error.", markers.marker, markers, "marker");
  if (types.type.length > 0) groupBars("Per lens type", "The numbers are arbitrary names of the lens types.", types.type, types, "lens type");
}

function addCoverage(camera, parent) {
  const { sample, field, depth } = camera.plots;
  parent.append(element("h3", {}, camera.name));
  const grid = figures(parent), size = camera.image_size;
  const points = sample.x.map((x, i) => ({ x, y: sample.y[i], i })).filter(({ i }) => sample.used[i]);
  const depths = points.map(({ i }) => sample.depth[i]);
  const near = depths.reduce((a, b) => Math.min(a, b), Infinity), far = depths.reduce((a, b) => Math.max(a, b), -Infinity);
  addFigure(grid, "Points in the image", "Colour: depth." + (sample.step > 1 ? ` Every ${sample.step}th of ${sample.all} points.` : ""), points.length, (canvas) => scatter(canvas, [
    { data: points, pointRadius: 2, borderWidth: 0, backgroundColor: depths.map((z) => Colours.ramp((z - near) / (far - near || 1))) },
  ], imageScales(size), { label: (item) => `frame ${report.frames[sample.frame[item.raw.i]].name}, marker ${sample.marker[item.raw.i]}, depth ${brief(sample.depth[item.raw.i])} m` }),
  { aspect: imageAspect(size), legend: colourScale(`${brief(near)} m`, `${brief(far)} m`, Colours.ramp) });
  addCellMap(grid, "Points in each part of the image", "White: no points; the distortion is extrapolated there.", size, field.columns, field.rows, field.points.map((n) => (n > 0 ? n : null)), "points", { range: [0, field.points.reduce((a, b) => Math.max(a, b), 1)] });
  if (depth.counts) {
    addFigure(grid, "Depth", "z of the markers in the camera's frame.", depth.counts.length, (canvas) => bars(canvas, depth.middles.map((z) => brief(z, 2)), [
      { label: "points", data: depth.counts, backgroundColor: Colours.main },
    ], { x: { title: { display: true, text: "depth, m" }, ticks: { maxTicksLimit: 8, maxRotation: 0 } }, y: axis("points") }), { aspect: imageAspect(size) });
  }
}

// The graph of a rig: a line from each camera to each target that it saw, as thick as the frames are many.
function addSightings() {
  const { targets, seen, common } = report.sightings;
  if (!targets) return;
  const node = section("Who saw what");
  note(node, "Numbers are frames. Cameras that share no target in any frame are placed by the motion of the rig.");
  const names = report.cameras.map((camera) => camera.name), step = 44, width = 560;
  const height = step * Math.max(names.length, targets.length) + 16;
  const y = (i, n) => height / 2 + step * (i - (n - 1) / 2);
  const shape = (tag, attributes, text = "") => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.textContent = text;
    return made;
  };
  const graph = shape("svg", { viewBox: `0 0 ${width} ${height}`, width, height, class: "graph", "font-size": 14, fill: "currentColor" });
  const most = Math.max(1, ...seen.flat());
  seen.forEach((frames, c) => frames.forEach((n, k) => {
    if (n === 0) return;
    const [y1, y2] = [y(c, names.length), y(k, targets.length)], at = 0.25;
    graph.append(shape("line", { x1: 140, y1, x2: 420, y2, stroke: Colours.main, "stroke-opacity": 0.6, "stroke-width": 1 + 7 * n / most }));
    graph.append(shape("text", { x: 140 + 280 * at, y: y1 + (y2 - y1) * at - 4, "text-anchor": "middle", "font-size": 12 }, n));
  }));
  names.forEach((name, c) => graph.append(shape("text", { x: 132, y: y(c, names.length) + 5, "text-anchor": "end" }, name)));
  targets.forEach((name, k) => graph.append(shape("text", { x: 428, y: y(k, targets.length) + 5 }, name)));
  node.append(graph);
  node.append(table("frames in common", ["", ...names], names.map((name, c) => row(cell(name), ...common[c].map((n) => cell(String(n), n))))));
}

function addMarkers() {
  const moved = report.markers.filter((marker) => marker.moved);
  const node = section("Markers");
  if (moved.length === 0) {
    note(node, report.scene ? "The points are of the scene: they have no nominal positions." : "The markers were fixed at their nominal positions.");
    return;
  }
  const length = (v) => Math.hypot(...v);
  const rms = Math.sqrt(moved.reduce((sum, m) => sum + length(m.moved) ** 2, 0) / moved.length);
  const worst = moved.reduce((a, b) => (length(b.moved) > length(a.moved) ? b : a));
  note(node, `The refined markers are ${brief(1e3 * rms)} mm RMS from their nominal positions (tolerance ${brief(1e3 * report.marker_tolerance)} mm per coordinate), at most ${brief(1e3 * length(worst.moved))} mm (marker ${worst.number}).`);
  const grid = figures(node), names = ["x", "y", "z"];
  const span = names.map((unused, k) => moved.reduce((a, m) => Math.max(a, m.place[k]), -Infinity) - moved.reduce((a, m) => Math.min(a, m.place[k]), Infinity));
  // Two coordinates show a flat target; one in space needs a second view.
  const views = [[0, 1], [0, 2], [1, 2]].filter(([a, b]) => Math.min(span[a], span[b]) > 0.02 * Math.max(...span));
  for (const [a, b] of views) {
    const c = 3 - a - b;
    const magnify = 0.08 * Math.max(span[a], span[b]) / (rms || 1);
    const most = 1e3 * moved.reduce((w, m) => Math.max(w, Math.abs(m.moved[c])), 0) || 1;
    const points = moved.map((m) => ({ x: 1e3 * m.place[a], y: 1e3 * m.place[b], m }));
    // The range includes the tips of the arrows.
    const range = (k) => {
      const values = moved.flatMap((m) => [1e3 * m.place[k], 1e3 * (m.place[k] + magnify * m.moved[k])]);
      const low = values.reduce((u, v) => Math.min(u, v)), high = values.reduce((u, v) => Math.max(u, v)), step = roundUp((high - low) / 20);
      return [step * Math.floor(low / step - 0.2), step * Math.ceil(high / step + 0.2)];
    };
    const [[x0, x1], [y0, y1]] = [range(a), range(b)];
    const places = (title, min, max) => axis(title, { min, max, ticks: { maxTicksLimit: 8, callback: (v) => brief(v) } });
    addFigure(grid, `From nominal to refined, ${names[a]} and ${names[b]}`, `Arrows are ${brief(magnify, 2)} times as long as the displacement; colour: along ${names[c]}.`, points.length, (canvas) =>
      scatter(canvas, [{ ...carriers(points), pointRadius: 1, backgroundColor: Colours.grey }], { x: places(`${names[a]}, mm`, x0, x1), y: places(`${names[b]}, mm`, y0, y1) }, {
        paint: (ctx, toX, toY) => {
          for (const { x, y, m } of points) {
            const dx = 1e3 * m.moved[a] * magnify, dy = 1e3 * m.moved[b] * magnify;
            const part = 1e3 * m.moved[c] / most;
            drawArrow(ctx, toX(x), toY(y), toX(x + dx) - toX(x), toY(y + dy) - toY(y), Colours.ramp(0.85 * (part + 1) / 2));
          }
        },
        label: (item) => { const { m } = item.raw; return `marker ${m.number}: (${m.moved.map((v) => brief(1e3 * v)).join(", ")}) mm, sigma (${m.sigma.map((v) => brief(1e3 * v, 2)).join(", ")})`; },
      }), { breadth: views.length === 1 ? "broad" : "", aspect: Math.min(Math.max((x1 - x0) / (y1 - y0), 0.8), 2.2), legend: colourScale(`${names[c]}: ${brief(-most)} mm`, `${brief(most)} mm`, (part) => Colours.ramp(0.85 * part)) });
  }
}

function addCorrelations() {
  const { names, below_diagonal: rows } = report.correlation;
  const node = section("Correlations");
  if (rows.length < 2) {
    note(node, "No correlations: there is no correlations.csv beside this calibration, or fewer than two unknowns.");
    return;
  }
  const n = names.length, value = (i, j) => (i === j ? 1 : i > j ? rows[i][j] : rows[j][i]);
  const points = [];
  for (let i = 0; i < n; ++i) for (let j = 0; j < n; ++j) points.push({ x: j, y: i });
  const tick = (k) => (Number.isInteger(k) && names[k] ? names[k].replace("T_camera_rig.", "") : "");
  const scale = (more) => ({ type: "linear", min: -0.5, max: n - 0.5, grid: { display: false }, afterBuildTicks: (s) => { s.ticks = names.map((unused, k) => ({ value: k })); }, ticks: { callback: tick, autoSkip: true, font: { size: n > 25 ? 8 : 10 }, ...more } });
  addFigure(figures(node), "Correlation matrix", "Two unknowns with a correlation near 1 or -1 cannot be determined separately by these images.", points.length, (canvas) =>
    scatter(canvas, [carriers(points)], { x: scale({ maxRotation: 90, minRotation: 90 }), y: { ...scale({}), reverse: true } }, {
      paint: (ctx, toX, toY) => {
        for (const { x, y } of points) {
          ctx.fillStyle = Colours.signed(value(y, x));
          ctx.fillRect(toX(x - 0.5), toY(y - 0.5), toX(x + 0.5) - toX(x - 0.5) + 0.3, toY(y + 0.5) - toY(y - 0.5) + 0.3);
        }
      },
      label: (item) => `${names[item.raw.y]}, ${names[item.raw.x]}: ${value(item.raw.y, item.raw.x)}`,
    }), { breadth: n > 10 ? "wide" : "", aspect: 1.1, legend: colourScale("−1", "1", (part) => Colours.signed(2 * part - 1)) }).canvas.closest("figure").style.maxWidth = "900px";
}

function addPrecision() {
  const node = section("Uncertainty in use");
  note(node, "Standard deviation of the projection of a point, in its worst direction, caused by the errors of the parameters. Errors that a rotation and translation of the camera frame compensates are not counted. Colours are logarithmic; white: outside the domain of the model, or no point was seen.");
  for (const camera of report.cameras) {
    node.append(element("h3", {}, camera.name));
    if (camera.projection.length === 0) {
      note(node, "Not known: some parameter is not determined, or there is no correlations.csv beside this calibration.");
      continue;
    }
    const grid = figures(node, "small"), sigmas = camera.projection.flatMap((map) => map.sigma).filter((v) => v !== null);
    // One scale for all distances; between an image's middle and its corners lie powers of ten.
    const range = [sigmas.reduce((a, b) => Math.min(a, b), Infinity), sigmas.reduce((a, b) => Math.max(a, b), 0)];
    ["Distance of the nearest marker", "Median distance of the markers", "Distance of the farthest marker", "Ten times the farthest marker"].forEach((which, i) => {
      const map = camera.projection[i];
      if (map.sigma.some((v) => v !== null)) addCellMap(grid, `Points ${brief(map.distance)} m away`, `${which}.`, camera.image_size, map.columns, map.rows, map.sigma, "px", { range, logarithmic: range[0] > 0 });
    });
    const { distance, calibration, noise } = camera.distance;
    if (distance.length > 0) {
      const series = (values) => distance.map((x, i) => ({ x, y: 1e3 * values[i] }));
      addFigure(grid, "Measured distance of a marker", "Standard deviation of the distance of one marker, measured from one image.", distance.length, (canvas) => scatter(canvas, [
        { label: "from errors of the calibration", data: series(calibration), pointRadius: 2, borderWidth: 0, backgroundColor: Colours.second },
        { label: "from noise of the marker's points", data: series(noise), pointRadius: 2, borderWidth: 0, backgroundColor: Colours.faint },
      ], { x: axis("distance, m"), y: logarithmic("sigma, mm") }), { breadth: "broad", aspect: 1.8 });
    }
  }
}

function addWhite() {
  const cameras = report.cameras.filter((camera) => camera.vignetting.values || camera.micro_lenses.lenses);
  if (cameras.length === 0) return;
  const node = section("White images");
  for (const camera of cameras) {
    node.append(element("h3", {}, camera.name));
    const grid = figures(node, "small"), v = camera.vignetting, lenses = camera.micro_lenses, size = camera.image_size;
    if (v.values) {
      addCellMap(grid, "Vignetting", `Relative brightness; 1: no attenuation.${v.detail ? " Each cell shows the brightest pixel of about one micro image." : ""}`, size, v.columns, v.rows, v.values, "");
      const line = ({ step, values }) => values.map((y, i) => ({ x: (i + 0.5) * step - 0.5, y }));
      addFigure(grid, "Cross section of the vignetting", v.row.step > 1 ? `Means of ${v.row.step} px.` : "", v.row.values.length, (canvas) => scatter(canvas, [
        { label: "middle row", data: line(v.row), showLine: true, pointRadius: 0, borderWidth: 1, borderColor: Colours.main },
        { label: "middle column", data: line(v.column), showLine: true, pointRadius: 0, borderWidth: 1, borderColor: Colours.second },
      ], { x: axis("x or y, px", { max: Math.max(...size) }), y: axis("attenuation", { beginAtZero: true }) }), { aspect: imageAspect(size) });
      if (v.detail) {
        const profile = v.detail.values.map((y, i) => ({ x: v.detail.first + i, y }));
        addFigure(grid, "Cross section of micro images", "Middle row.", profile.length, (canvas) => scatter(canvas, [
          { data: profile, showLine: true, pointRadius: 1.5, borderWidth: 1, borderColor: Colours.main },
        ], { x: axis("x, px", { min: profile[0].x, max: profile[profile.length - 1].x, ticks: { maxTicksLimit: 8 } }), y: axis("attenuation", { beginAtZero: true }) }), { aspect: imageAspect(size) });
      }
    }
    if (lenses.lenses) {
      addArrowMap(grid, "Micro-image centres against a regular lattice", `${lenses.lenses} micro lenses (${lenses.types.map((t) => `type ${t.type}: ${t.lenses}`).join(", ")}), ${brief(lenses.pitch, 5)} px apart; RMS ${brief(lenses.rms)} px. Distortion of the main lens deforms the lattice.`, size, lenses, null, "px");
    }
  }
}

function addLensTypes() {
  const cameras = report.cameras.filter((camera) => camera.lens_types.length > 0);
  if (cameras.length === 0) return;
  const node = section("Lens types");
  note(node, "From the blur of the markers in micro images. Sharp: between the distances at which the aperture blurs a point to a disc of one pixel.");
  const colours = [Colours.main, Colours.second, Colours.rejected, Colours.faint];
  for (const camera of cameras) {
    node.append(element("h3", {}, camera.name));
    const metres = (z) => (z === null ? "infinity" : brief(z, 3));
    node.append(table("optics of the micro lenses", ["lens type", "focal length, mm", "standard error", "aperture, mm", "standard error", "in focus, m", "sharp from, m", "to, m"], camera.lens_types.map((t) => {
      const [f, f_sigma] = withSigma(1e3 * t.focal_length, 1e3 * t.focal_length_sigma), [d, d_sigma] = withSigma(1e3 * t.aperture, 1e3 * t.aperture_sigma);
      return row(cell(String(t.type)), cell(f), cell(f_sigma), cell(d), cell(d_sigma), cell(metres(t.in_focus)), cell(metres(t.near)), cell(metres(t.far)));
    })));
    const grid = figures(node), most = camera.lens_types.reduce((a, t) => Math.max(a, ...t.disc), 0);
    addFigure(grid, "Blur by distance", "Diameter of the disc by which the aperture of each lens type blurs a point.", camera.lens_types.length, (canvas) => scatter(canvas, [
      ...camera.lens_types.map((t, i) => ({ label: `lens type ${t.type}`, data: t.distance.map((x, k) => ({ x, y: t.disc[k] })), showLine: true, pointRadius: 0, borderWidth: 2, borderColor: colours[i % colours.length] })),
      { label: "one pixel", data: [camera.lens_types[0].distance[0], camera.lens_types[0].distance.at(-1)].map((x) => ({ x, y: 1 })), showLine: true, pointRadius: 0, borderWidth: 1, borderDash: [4, 4], borderColor: Colours.faint },
    ], { x: logarithmic("distance, m"), y: axis("diameter, px", { min: 0, max: Math.min(most, 6) }) }), { breadth: "broad", aspect: 1.8 });
  }
}

function addSamples() {
  const node = section("Sample images");
  const cameras = report.cameras.filter((camera) => Object.keys(camera.sample.pictures).length > 0);
  if (cameras.length === 0) {
    note(node, "No pictures: the points came from files, or sample_<camera>.jpg is not beside this calibration.");
    return;
  }
  note(node, "The frame with the most markers of each camera; crosses and numbers mark detected markers.");
  const grid = element("div", { class: "pictures" });
  node.append(grid);
  const add = (title, text, source) => grid.append(element("figure", {},
    element("figcaption", {}, title, element("small", {}, text)), element("img", { src: source, alt: title })));
  for (const camera of cameras) {
    const { frame, pictures: { picture, depth } } = camera.sample;
    if (picture) add(`${camera.name}, frame ${frame}`, depth ? "Totally focused image." : "Image.", picture);
    if (depth) add(`${camera.name}, frame ${frame}`, "Virtual depth: scale on the right; black: no depth could be measured.", depth);
  }
}

function addLeftOut() {
  const node = section("Left out");
  const rejected = report.cameras.filter((camera) => camera.residuals.rejected > 0);
  for (const camera of rejected) note(node, `${camera.name}: ${counted(camera.residuals.rejected, "point")} rejected as outliers or outside the model's domain (used = 0 in residuals.csv).`);
  if (report.left_out.length === 0) note(node, rejected.length ? "No image was left out." : "Nothing was left out.");
  else node.append(element("ul", { class: "list" }, ...report.left_out.map((text) => element("li", {}, text))));
}

function addAgain() {
  const node = section("Reproduce"), values = Object.fromEntries(report.provenance);
  if (values.command) node.append(element("pre", {}, values.command));
  note(node, `Plenocal ${values.plenocal_version || "of unknown version"}${values.folder ? ` in the folder ${values.folder}` : ""}; session ${values.session || "unknown"}, target ${values.target || "unknown"}.`);
  for (const [title, text] of [["Session", values.session_text], ["Target, as given", values.target_text]]) {
    if (text) node.append(element("h3", {}, title), element("pre", { class: "list" }, text));
  }
}

document.getElementById("subtitle").textContent =
  `${report.cameras.map((camera) => `${camera.name} (${camera.model})`).join(", ")}; ${report.frames.length} frames, ${report.markers.length} markers`;
addVerdict();
addParameters();
const residualSection = section("Residuals");
for (const camera of report.cameras) addResiduals(camera, residualSection);
const coverageSection = section("Coverage");
for (const camera of report.cameras) addCoverage(camera, coverageSection);
addSightings();
addScene(section("In space"), report);
addMarkers();
addCorrelations();
addPrecision();
addLensTypes();
addWhite();
addSamples();
addLeftOut();
addAgain();
