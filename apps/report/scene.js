// Target, camera poses and rig in space, turned by dragging.

function addScene(parent, report) {
  const canvas = element("canvas", { class: "scene", role: "img", "aria-label": "Target and camera poses in space" });
  const slider = element("input", { type: "range", min: "-1", max: String(report.frames.length - 1), value: "-1", "aria-label": "frame" });
  const label = element("span", {}, "all frames");
  const button = (text, title) => element("button", { type: "button", title }, text);
  const nearer = button("+", "nearer"), farther = button("−", "farther");
  const turns = [button("front", "from the front"), button("side", "from the side"), button("above", "from above")];
  parent.append(element("figure", { class: "wide" },
    element("figcaption", {}, "Target and camera poses",
      element("small", {}, "Points: markers. Pyramids: cameras of the rig, at the place of their centres; their size has no meaning. Drag to turn.")),
    canvas,
    element("div", { class: "controls" }, nearer, farther, ...turns, element("label", {}, "frame "), slider, label)));

  const apply = ({ R, t }, p) => [0, 1, 2].map((r) => R[3 * r] * p[0] + R[3 * r + 1] * p[1] + R[3 * r + 2] * p[2] + t[r]);
  const inverse = ({ R, t }) => {
    const Rt = [0, 3, 6, 1, 4, 7, 2, 5, 8].map((i) => R[i]);
    return { R: Rt, t: apply({ R: Rt, t: [0, 0, 0] }, t).map((v) => -v) };
  };
  const rigs = report.cameras.map((camera) => inverse(camera.T_camera_rig));
  const centres = report.frames.flatMap((frame) => rigs.map((T) => apply(frame.T_target_rig, T.t)));
  const places = report.markers.map((marker) => marker.place);
  const all = places.concat(centres);
  const range = [0, 1, 2].map((k) => [all.reduce((a, p) => Math.min(a, p[k]), Infinity), all.reduce((a, p) => Math.max(a, p[k]), -Infinity)]);
  const middle = range.map(([a, b]) => (a + b) / 2);
  const radius = Math.hypot(...range.map(([a, b]) => b - a)) / 2 || 1;
  const size = 0.035 * radius;
  // Corners of the pyramids in each camera's frame.
  const pyramids = report.cameras.map(({ image_size: [w, h] }, c) => {
    const k = size / Math.max(w, h);
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => apply(rigs[c], [x * w * k, y * h * k, 1.6 * size]));
    return { apex: rigs[c].t, corners };
  });

  const view = { yaw: 0.6, pitch: -0.35, zoom: 1 };
  function draw() {
    const width = canvas.clientWidth || 600, height = Math.min(520, Math.max(280, 0.55 * width)), dpr = window.devicePixelRatio || 1;
    canvas.width = width * dpr;
    canvas.height = height * dpr;
    canvas.style.height = `${height}px`;
    const ctx = canvas.getContext("2d");
    ctx.setTransform(dpr, 0, 0, dpr, 0, 0);
    const [cy, sy, cp, sp] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
    const scale = 0.42 * Math.min(width, height * 1.6) / radius * view.zoom;
    const project = (p) => {
      const [x, y, z] = p.map((v, k) => v - middle[k]);
      const u = cy * x + sy * z, d = cy * z - sy * x;
      const f = 3.5 * radius / (3.5 * radius + (sp * y + cp * d));
      return [width / 2 + scale * u * f, height / 2 + scale * (cp * y - sp * d) * f];
    };
    const line = (points, closed) => {
      ctx.beginPath();
      points.forEach((p, i) => (i ? ctx.lineTo(...project(p)) : ctx.moveTo(...project(p))));
      if (closed) ctx.closePath();
      ctx.stroke();
    };
    ctx.clearRect(0, 0, width, height);
    ctx.fillStyle = "#1c2530";
    for (const place of places) {
      const [u, v] = project(place);
      ctx.fillRect(u - 1.2, v - 1.2, 2.4, 2.4);
    }
    // Axes of the target's frame.
    const axes = [["x", "#b3261e", [4 * size, 0, 0]], ["y", "#1a7f4b", [0, 4 * size, 0]], ["z", "#175a9e", [0, 0, 4 * size]]];
    ctx.font = "12px sans-serif";
    for (const [name, colour, end] of axes) {
      ctx.strokeStyle = ctx.fillStyle = colour;
      ctx.lineWidth = 2;
      line([[0, 0, 0], end], false);
      ctx.fillText(name, ...project(end));
    }
    const chosen = Number(slider.value);
    report.frames.forEach((frame, f) => {
      if (chosen >= 0 && f !== chosen) ctx.globalAlpha = 0.12;
      ctx.lineWidth = f === chosen ? 2 : 0.8;
      pyramids.forEach(({ apex, corners }, c) => {
        ctx.strokeStyle = Colours.series[c % Colours.series.length];
        const a = apply(frame.T_target_rig, apex), q = corners.map((p) => apply(frame.T_target_rig, p));
        line(q, true);
        for (const corner of q) line([a, corner], false);
      });
      if (pyramids.length > 1) {
        ctx.strokeStyle = Colours.grey;
        line(pyramids.map(({ apex }) => apply(frame.T_target_rig, apex)), false);
      }
      ctx.globalAlpha = 1;
    });
    report.cameras.forEach((camera, c) => {
      ctx.fillStyle = Colours.series[c % Colours.series.length];
      ctx.fillText(camera.name, 10, 18 + 16 * c);
    });
    label.textContent = chosen < 0 ? "all frames" : report.frames[chosen].name;
  }

  let from = null;
  canvas.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointerup", () => { from = null; });
  canvas.addEventListener("pointercancel", () => { from = null; });
  canvas.addEventListener("pointermove", (event) => {
    if (!from) return;
    view.yaw += 0.008 * (event.clientX - from[0]);
    view.pitch = Math.min(Math.max(view.pitch - 0.008 * (event.clientY - from[1]), -1.57), 1.57);
    from = [event.clientX, event.clientY];
    draw();
  });
  nearer.addEventListener("click", () => { view.zoom *= 1.25; draw(); });
  farther.addEventListener("click", () => { view.zoom /= 1.25; draw(); });
  [[0, 0], [Math.PI / 2, 0], [0, -1.57]].forEach(([yaw, pitch], i) => turns[i].addEventListener("click", () => { Object.assign(view, { yaw, pitch }); draw(); }));
  slider.addEventListener("input", draw);
  window.addEventListener("resize", draw);
  plenocalReport.figures.push({ title: "Target and camera poses", count: centres.length + places.length, canvas, chart: null, drawn: true, draw });
  draw();
}
