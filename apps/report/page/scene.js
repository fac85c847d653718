// Target, camera poses and rig in 3D, rotated by dragging.

function addScene(parent, report) {
  const canvas = element("canvas", { class: "scene", role: "img", "aria-label": "Target and camera poses in space" });
  const slider = element("input", { type: "range", min: "-1", max: String(report.frames.length - 1), value: "-1", "aria-label": "frame" });
  const label = element("span", {}, "all frames");
  const button = (text, title) => element("button", { type: "button", title }, text);
  const nearer = button("+", "nearer"), farther = button("−", "farther");
  const turns = [button("front", "from the front"), button("side", "from the side"), button("above", "from above")];
  const alone = button("rig", "the rig alone, or with the target");
  parent.append(element("figure", { class: "wide" },
    element("figcaption", {}, "Target and camera poses",
      element("small", {}, "Points: markers. Pyramids: cameras of the rig, at their optical centres, not to scale. Drag to rotate.")),
    canvas,
    element("div", { class: "controls" }, nearer, farther, ...turns, report.cameras.length > 1 ? alone : null, element("label", {}, "frame "), slider, label)));

  const apply = ({ R, t }, p) => [0, 1, 2].map((r) => R[3 * r] * p[0] + R[3 * r + 1] * p[1] + R[3 * r + 2] * p[2] + t[r]);
  const inverse = ({ R, t }) => {
    const Rt = [0, 3, 6, 1, 4, 7, 2, 5, 8].map((i) => R[i]);
    return { R: Rt, t: apply({ R: Rt, t: [0, 0, 0] }, t).map((v) => -v) };
  };
  const rigs = report.cameras.map((camera) => inverse(camera.T_camera_rig));
  const centres = report.frames.flatMap((frame) => rigs.map((T) => apply(frame.T_target_rig, T.t)));
  // Of points: the middle, and a radius that holds all of them. Pyramids have `part` of it as their size.
  function world(points, part) {
    const range = [0, 1, 2].map((k) => [points.reduce((a, p) => Math.min(a, p[k]), Infinity), points.reduce((a, p) => Math.max(a, p[k]), -Infinity)]);
    const radius = Math.hypot(...range.map(([a, b]) => b - a)) / 2 || 1, size = part * radius;
    const pyramids = report.cameras.map(({ image_size: [w, h] }, c) => {
      const k = size / Math.max(w, h);
      const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => apply(rigs[c], [x * w * k, y * h * k, 1.6 * size]));
      return { apex: rigs[c].t, corners };
    });
    return { middle: range.map(([a, b]) => (a + b) / 2), radius, size, pyramids };
  }
  const markers = report.markers.map((marker) => marker.place);
  const still = { R: [1, 0, 0, 0, 1, 0, 0, 0, 1], t: [0, 0, 0] };
  const scenes = {
    all: { ...world(markers.concat(centres), 0.035), places: markers, poses: report.frames.map((frame) => frame.T_target_rig) },
    rig: { ...world(rigs.map((T) => T.t), 0.25), places: [], poses: [still] },
  };

  const view = { yaw: 0.6, pitch: -0.35, zoom: 1, shift: [0, 0], scene: scenes.all };
  // How the scene is seen: size of the canvas and where a point is in it.
  function look() {
    const { middle, radius } = view.scene;
    const width = canvas.clientWidth || 600, height = Math.min(520, Math.max(280, 0.55 * width));
    const [cy, sy, cp, sp] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
    const scale = 0.5 * Math.min(width, height) / radius * view.zoom;
    const project = (p) => {
      const [x, y, z] = p.map((v, k) => v - middle[k]);
      const u = cy * x + sy * z, d = cy * z - sy * x;
      const f = 3.5 * radius / (3.5 * radius + (sp * y + cp * d));
      return [width / 2 + scale * (u * f - view.shift[0] * radius), height / 2 + scale * ((cp * y - sp * d) * f - view.shift[1] * radius)];
    };
    return { width, height, project };
  }
  // All of the scene, seen from where it is turned to, fills the canvas.
  function fit() {
    Object.assign(view, { zoom: 1, shift: [0, 0] });
    const { width, height, project } = look();
    const { places, pyramids, poses } = view.scene;
    const rigPoints = pyramids.flatMap(({ apex, corners }) => [apex, ...corners]);
    const points = places.concat(poses.flatMap((T) => rigPoints.map((p) => apply(T, p)))).map(project);
    const [across, down] = [0, 1].map((k) => [points.reduce((a, p) => Math.min(a, p[k]), Infinity), points.reduce((a, p) => Math.max(a, p[k]), -Infinity)]);
    const half = 0.5 * Math.min(width, height);
    view.zoom = 0.92 * Math.min(width / (across[1] - across[0]), height / (down[1] - down[0]));
    view.shift = [(across[0] + across[1] - width) / 2 / half, (down[0] + down[1] - height) / 2 / half];
  }
  function draw() {
    const { size, pyramids, places, poses } = view.scene;
    const { width, height, project } = look(), dpr = window.devicePixelRatio || 1;
    canvas.width = width * dpr;
    canvas.height = height * dpr;
    canvas.style.height = `${height}px`;
    const ctx = canvas.getContext("2d");
    ctx.setTransform(dpr, 0, 0, dpr, 0, 0);
    const line = (...points) => points.forEach((p, i) => (i ? ctx.lineTo(...project(p)) : ctx.moveTo(...project(p))));
    ctx.clearRect(0, 0, width, height);
    ctx.fillStyle = "#1c2530";
    for (const place of places) {
      const [u, v] = project(place);
      ctx.fillRect(u - 1.2, v - 1.2, 2.4, 2.4);
    }
    // Axes of the target's frame, or of the rig's.
    const reach = (view.scene === scenes.all ? 4 : 1.2) * size;
    const axes = [["x", "#b3261e", [reach, 0, 0]], ["y", "#1a7f4b", [0, reach, 0]], ["z", "#175a9e", [0, 0, reach]]];
    ctx.font = "12px sans-serif";
    for (const [name, colour, end] of axes) {
      ctx.strokeStyle = ctx.fillStyle = colour;
      ctx.lineWidth = 2;
      ctx.beginPath();
      line([0, 0, 0], end);
      ctx.stroke();
      ctx.fillText(name, ...project(end));
    }
    const chosen = view.scene === scenes.all ? Number(slider.value) : -1;
    // One path for all pyramids of a colour: a thousand frames turn as smoothly as ten.
    const drawRigs = (some, width, alpha) => {
      ctx.lineWidth = width;
      ctx.globalAlpha = alpha;
      pyramids.forEach(({ apex, corners }, c) => {
        ctx.strokeStyle = Colours.series[c % Colours.series.length];
        ctx.beginPath();
        for (const T of some) {
          const a = apply(T, apex), q = corners.map((p) => apply(T, p));
          line(...q, q[0]);
          for (const corner of q) line(a, corner);
        }
        ctx.stroke();
      });
      ctx.strokeStyle = Colours.grey;
      ctx.beginPath();
      if (pyramids.length > 1) for (const T of some) line(...pyramids.map(({ apex }) => apply(T, apex)));
      ctx.stroke();
      ctx.globalAlpha = 1;
    };
    drawRigs(poses, 0.8, chosen < 0 ? 1 : 0.12);
    if (chosen >= 0) drawRigs([poses[chosen]], 2, 1);
    report.cameras.forEach((camera, c) => {
      ctx.fillStyle = Colours.series[c % Colours.series.length];
      if (view.scene === scenes.rig) ctx.fillText(camera.name, ...project(pyramids[c].apex).map((v) => v + 6));
      else ctx.fillText(camera.name, 10, 18 + 16 * c);
    });
    label.textContent = chosen < 0 ? "all frames" : report.frames[chosen].name;
  }
  let waiting = false;
  function drawSoon() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; draw(); });
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
    drawSoon();
  });
  nearer.addEventListener("click", () => { view.zoom *= 1.25; draw(); });
  farther.addEventListener("click", () => { view.zoom /= 1.25; draw(); });
  [[0, 0], [Math.PI / 2, 0], [0, -1.57]].forEach(([yaw, pitch], i) => turns[i].addEventListener("click", () => { Object.assign(view, { yaw, pitch }); fit(); draw(); }));
  alone.addEventListener("click", () => { view.scene = view.scene === scenes.all ? scenes.rig : scenes.all; fit(); draw(); });
  slider.addEventListener("input", drawSoon);
  window.addEventListener("resize", drawSoon);
  plenocalReport.figures.push({ title: "Target and camera poses", count: centres.length + markers.length, canvas, chart: null, drawn: true, draw });
  fit();
  draw();
}
