// Building blocks of the sections of a page; `report` is the data of the page.

const report = JSON.parse(document.getElementById("report-data").textContent);
const main = document.getElementById("main");

function section(title) {
  const id = title.toLowerCase().replace(/[^a-z]+/g, "-");
  const node = element("section", { id }, element("h2", {}, title));
  document.getElementById("contents").append(element("a", { href: `#${id}` }, title));
  main.append(node);
  return node;
}
const note = (parent, text) => parent.append(element("p", { class: "note" }, text));
const figures = (parent, more = "") => { const node = element("div", { class: `figures ${more}` }); parent.append(node); return node; };
const cell = (text, value) => element("td", value === undefined || value === null ? {} : { "data-value": String(value) }, text);
const row = (...cells) => element("tr", {}, ...cells);
const table = (caption, head, rows) => element("div", { class: "scroll" }, element("table", {},
  element("caption", {}, caption),
  element("thead", {}, row(...head.map((text) => element("th", {}, text)))), element("tbody", {}, ...rows)));
const unitText = (unit) => (unit === "1" ? "" : unit.replace(/\^-?\d+/g, (power) => [...power.slice(1)].map((c) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[c] || "⁻").join("")));
const counted = (count, thing) => `${count} ${thing}${count === 1 ? "" : "s"}`;

/** value and sigma with the digits that sigma justifies. */
function withSigma(value, sigma) {
  if (sigma === null) return [brief(value, 6), "not determined"];
  if (!(sigma > 0)) return [brief(value, 9), "fixed"];
  const digits = 1 - Math.floor(Math.log10(sigma));
  if (Math.abs(value) >= 1e6 || (value !== 0 && Math.abs(value) < 1e-4) || digits > 9) {
    const significant = Math.max(2, Math.min(15, Math.floor(Math.log10(Math.abs(value) || 1)) + digits + 1));
    return [value.toExponential(significant - 1), sigma.toExponential(1)];
  }
  const shown = Math.min(Math.max(digits, 0), 12);
  return [value.toFixed(shown), sigma.toFixed(shown)];
}
