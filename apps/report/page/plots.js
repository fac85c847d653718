"use strict";
// The page's plots: Chart.js with one addition, fields of cells and arrows in a chart's coordinates.

/** An element with properties and children; strings become text, never markup. */
function element(tag, properties, ...children) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(properties || {})) {
    if (key === "class") node.className = value;
    else if (key === "style") node.style.cssText = value;
    else node.setAttribute(key, value);
  }
  for (const child of children) if (child !== null && child !== undefined) node.append(child);
  return node;
}

/** value with a number of significant digits, without needless zeros. */
function brief(value, digits = 3) {
  if (value === null || value === undefined) return "–";
  return String(Number(value.toPrecision(digits)));
}

/** The least of 1, 1.5, 2, 3, 5, 7 times a power of ten that is not below a positive value: where an axis ends. */
function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return Number(((([1, 1.5, 2, 3, 5, 7].find((step) => step * power >= value * (1 - 1e-9)) || 10) * power).toPrecision(3)));
}
/** Ticks of a logarithmic axis: 1, 2 and 5. */
const logarithmic = (title) => axis(title, { type: "logarithmic", ticks: { autoSkip: false, callback: (v) => (/^[125]/.test(v.toExponential()) ? brief(v, 1) : null) } });

const Colours = {
  main: "#175a9e", second: "#c25e00", third: "#1a7f4b", faint: "rgba(23,90,158,0.35)", rejected: "#b3261e", grey: "#8a949e",
  series: ["#175a9e", "#c25e00", "#1a7f4b", "#7b3fa0", "#b3261e", "#4a8f95", "#8a6d00", "#5d6975"],
  // From dark blue over green to yellow, even in lightness, so that it survives a grey printer.
  ramp(part) {
    const stops = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
    const place = Math.min(Math.max(part, 0), 1) * (stops.length - 1);
    const k = Math.min(Math.floor(place), stops.length - 2), t = place - k;
    return `rgb(${stops[k].map((v, i) => Math.round(v + t * (stops[k + 1][i] - v))).join(",")})`;
  },
  // Blue, white, red for -1, 0, 1.
  signed(value) {
    const t = Math.min(Math.abs(value), 1), end = value < 0 ? [23, 90, 158] : [179, 38, 30];
    return `rgb(${end.map((v) => Math.round(255 + t * (v - 255))).join(",")})`;
  },
};

/** All figures of the page, for printing and for tests. */
const plenocalReport = { figures: [], errors: [], drawAll() { for (const figure of this.figures) figure.draw(); } };
window.plenocalReport = plenocalReport;
window.addEventListener("error", (event) => plenocalReport.errors.push(String(event.message)));

const visible = "IntersectionObserver" in window
  ? new IntersectionObserver((entries) => {
      for (const entry of entries) if (entry.isIntersecting) entry.target.drawFigure();
    }, { rootMargin: "800px" })
  : null;

/** Adds a figure to `parent`. `make(canvas)` draws it, once, when it comes near the window. `count`: things it shows. */
function addFigure(parent, title, note, count, make, options = {}) {
  const canvas = element("canvas", { role: "img", "aria-label": title });
  const plot = element("div", { class: "plot", style: `aspect-ratio:${options.aspect || 1.5}` }, canvas);
  const node = element("figure", options.breadth ? { class: options.breadth } : {},
    element("figcaption", {}, title, note ? element("small", {}, note) : null), plot, options.legend || null);
  parent.append(node);
  const figure = { title, count, canvas, chart: null, drawn: false };
  figure.draw = () => {
    if (figure.drawn) return;
    figure.drawn = true;
    if (visible) visible.unobserve(node);
    figure.chart = make(canvas);
  };
  node.drawFigure = figure.draw;
  plenocalReport.figures.push(figure);
  if (visible) visible.observe(node); else figure.draw();
  return figure;
}

Chart.defaults.animation = false;
Chart.defaults.maintainAspectRatio = false;
Chart.defaults.font.family = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif";
Chart.defaults.color = "#1c2530";

const axis = (title, more = {}) => ({ type: "linear", title: { display: true, text: title }, ...more });
/** Axes of an image: px, y downward. */
const imageScales = ([width, height]) => ({
  x: axis("x, px", { min: -0.5, max: width - 0.5, ticks: { maxTicksLimit: 8, callback: (v) => Math.round(v) } }),
  y: axis("y, px", { min: -0.5, max: height - 0.5, reverse: true, ticks: { maxTicksLimit: 8, callback: (v) => Math.round(v) } }),
});
const imageAspect = ([width, height]) => Math.min(Math.max(width / height, 0.7), 2.2);

/** Chart.js plugin that calls paint(context, toX, toY) below the data. */
const painter = (paint) => ({
  id: "paint",
  beforeDatasetsDraw(chart) {
    const { ctx, chartArea: area, scales } = chart;
    ctx.save();
    ctx.beginPath();
    ctx.rect(area.left, area.top, area.right - area.left, area.bottom - area.top);
    ctx.clip();
    paint(ctx, (x) => scales.x.getPixelForValue(x), (y) => scales.y.getPixelForValue(y));
    ctx.restore();
  },
});

function drawArrow(ctx, x, y, dx, dy, colour) {
  const length = Math.hypot(dx, dy), head = Math.min(6, 0.4 * length);
  const angle = Math.atan2(dy, dx);
  ctx.strokeStyle = ctx.fillStyle = colour;
  ctx.lineWidth = 1.3;
  ctx.beginPath();
  ctx.moveTo(x, y);
  ctx.lineTo(x + dx, y + dy);
  ctx.stroke();
  ctx.beginPath();
  ctx.moveTo(x + dx, y + dy);
  for (const side of [2.6, -2.6]) ctx.lineTo(x + dx + head * Math.cos(angle + side), y + dy + head * Math.sin(angle + side));
  ctx.fill();
}

function scatter(canvas, datasets, scales, more = {}) {
  return new Chart(canvas, {
    type: "scatter",
    data: { datasets },
    options: {
      parsing: false, normalized: true, scales,
      plugins: {
        legend: { display: datasets.filter((d) => d.label).length > 1, labels: { boxWidth: 10 } },
        tooltip: { callbacks: { label: more.label || ((item) => `${brief(item.parsed.x, 4)}, ${brief(item.parsed.y, 4)}`) } },
      },
    },
    plugins: more.paint ? [painter(more.paint)] : [],
  });
}

function bars(canvas, labels, datasets, scales, more = {}) {
  return new Chart(canvas, {
    type: "bar",
    data: { labels, datasets },
    options: {
      scales, interaction: { mode: "index", intersect: false },
      plugins: { legend: { display: datasets.length > 1, labels: { boxWidth: 10 } }, tooltip: { callbacks: more.tooltip || {} } },
      datasets: { bar: { barPercentage: 1, categoryPercentage: labels.length > 60 ? 1 : 0.85 } },
    },
  });
}

/** Invisible points that carry the tooltips of painted cells. */
const carriers = (points) => ({ data: points, pointRadius: 0, hitRadius: 8, hoverRadius: 3 });

/** A strip that says what colours from `low` to `high` mean. */
function colourScale(low, high, colour) {
  const stops = Array.from({ length: 11 }, (unused, i) => colour(i / 10)).join(",");
  return element("div", { class: "scale" }, low, element("i", { style: `background:linear-gradient(90deg,${stops})` }), high);
}

/** Cells of an image as { x, y, cell } of their middles. */
function cellMiddles(columns, rows, [width, height]) {
  return Array.from({ length: columns * rows }, (unused, cell) => ({
    x: ((cell % columns) + 0.5) * width / columns - 0.5,
    y: (Math.floor(cell / columns) + 0.5) * height / rows - 0.5,
    cell,
  }));
}

/** Paints cells; colour(cell) gives a colour or null. */
function paintCells(ctx, toX, toY, columns, rows, [width, height], colour) {
  for (let cell = 0; cell < columns * rows; ++cell) {
    const fill = colour(cell);
    if (fill === null) continue;
    const column = cell % columns, row = Math.floor(cell / columns);
    const left = toX(column * width / columns - 0.5), right = toX((column + 1) * width / columns - 0.5);
    const top = toY(row * height / rows - 0.5), bottom = toY((row + 1) * height / rows - 0.5);
    ctx.fillStyle = fill;
    ctx.fillRect(left, top, right - left + 0.5, bottom - top + 0.5);
  }
}

/** A field over an image: cells in colours. `values` may hold nulls. `more`: { range: [low, high], logarithmic }. */
function addCellMap(parent, title, note, size, columns, rows, values, unit, more = {}) {
  const known = values.filter((value) => value !== null);
  const [low, high] = more.range || [Math.min(...known), Math.max(...known)];
  const height = more.logarithmic ? Math.log : (value) => value;
  const colour = (value) => Colours.ramp((height(value) - height(low)) / (height(high) - height(low) || 1));
  const points = cellMiddles(columns, rows, size).filter((point) => values[point.cell] !== null);
  addFigure(parent, title, note, known.length, (canvas) => scatter(canvas, [carriers(points)], imageScales(size), {
    paint: (ctx, toX, toY) => paintCells(ctx, toX, toY, columns, rows, size, (cell) => values[cell] === null ? null : colour(values[cell])),
    label: (item) => `${brief(values[item.raw.cell])} ${unit}`,
  }), { aspect: imageAspect(size), legend: colourScale(`${brief(low)} ${unit}`, `${brief(high)} ${unit}`, Colours.ramp) });
}

/** Length of an arrow of a field that is drawn a cell and a half long: 95 of 100 are shorter, and none is longer than four cells. */
function typicalArrow({ mean_x: dx, mean_y: dy }) {
  const lengths = dx.map((x, cell) => (x === null ? null : Math.hypot(x, dy[cell]))).filter((length) => length !== null).sort((a, b) => a - b);
  return Math.max(lengths[Math.floor(0.95 * (lengths.length - 1))], 1.5 / 4 * lengths[lengths.length - 1]);
}

/** Arrows over an image, scaled to be seen; under them cells in the colours of `values`. `range`: { arrow, low, value } of several such maps. */
function addArrowMap(parent, title, note, size, field, values, unit, range = {}) {
  const { columns, rows, mean_x: dx, mean_y: dy } = field;
  const points = cellMiddles(columns, rows, size).filter((point) => dx[point.cell] !== null);
  const magnify = 1.5 * size[0] / columns / (range.arrow || typicalArrow(field) || 1);
  const known = values ? values.filter((value) => value !== null) : [0];
  const low = range.low || 0, high = range.value || known.reduce((a, b) => Math.max(a, b), 0) || 1;
  const tint = (part) => Colours.ramp(part).replace("rgb", "rgba").replace(")", ",0.45)");
  addFigure(parent, title, `${note} Arrows are ${brief(magnify, 2)} times as long as what they stand for.`, points.length, (canvas) =>
    scatter(canvas, [carriers(points)], imageScales(size), {
      paint: (ctx, toX, toY) => {
        if (values) paintCells(ctx, toX, toY, columns, rows, size, (cell) => values[cell] === null ? null : tint((values[cell] - low) / (high - low)));
        for (const point of points) {
          const x = toX(point.x), y = toY(point.y);
          drawArrow(ctx, x, y, toX(point.x + magnify * dx[point.cell]) - x, toY(point.y + magnify * dy[point.cell]) - y, "#1c2530");
        }
      },
      label: (item) => `mean (${brief(dx[item.raw.cell])}, ${brief(dy[item.raw.cell])}) ${unit}` +
        (values ? `; RMS ${brief(values[item.raw.cell])} ${unit}` : "") + `; ${field.points[item.raw.cell]} points`,
    }), { aspect: imageAspect(size), legend: values ? colourScale(`RMS ${brief(low)} ${unit}`, `${brief(high)} ${unit}`, tint) : null });
}

window.addEventListener("beforeprint", () => {
  plenocalReport.drawAll();
  for (const { chart } of plenocalReport.figures) {
    if (!chart) continue;
    chart.options.devicePixelRatio = 2;  // paper is finer than the window
    chart.resize();
  }
});
