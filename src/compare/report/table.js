// The table of all figures, sortable by any column.

/**
 * @typedef {object} Column
 * @property {string} title
 * @property {(entry: Entry) => string|number|null} value the sort key
 * @property {(entry: Entry) => string} text
 */

/** @returns {Column[]} */
function columns() {
  const column = (title, value, text) => ({ title, value, text });
  const fixed = (title, of, digits) => column(title, of, (entry) => figure(of(entry), digits));
  const all = [
    column("Setting", (entry) => entry.name, (entry) => entry.name),
    fixed("CPU s", (entry) => entry.cpu_seconds, 3),
    fixed("Wall s", (entry) => entry.seconds, 3),
  ];
  if (hasPrediction) {
    all.push(fixed("Predicted CPU s", (entry) => entry.predicted?.cpu_seconds ?? null, 3));
    all.push(fixed("Predicted wall s", (entry) => entry.predicted?.seconds ?? null, 3));
  }
  all.push(fixed("Whole CPU s", (entry) => entry.whole.cpu_seconds, 3));
  all.push(fixed("Whole wall s", (entry) => entry.whole.seconds, 3));
  all.push(fixed("Sampling, dB", (entry) => entry.sampling.psnr_db, 1));
  all.push(column("95 %, dB", (entry) => entry.sampling.interval_db[0], (entry) => interval(entry.sampling)));
  if (hasReference) {
    all.push(fixed("Model, dB", (entry) => entry.model?.psnr_db ?? null, 2));
    all.push(fixed("SSIM", (entry) => entry.model?.ssim ?? null, 4));
    all.push(fixed("FLIP", (entry) => entry.model?.flip ?? null, 4));
  }
  return all;
}

const COLUMNS = columns();

/** The column that the table is sorted by. */
const order = { column: 1, descending: false };

/** @param {Entry} a @param {Entry} b */
function compareEntries(a, b) {
  const [left, right] = [a, b].map(COLUMNS[order.column].value);
  // Entries without a figure come last in either order.
  if (left === null || right === null) return (left === null) - (right === null);
  const ascending = typeof left === "string" ? left.localeCompare(right, "en", { numeric: true }) : left - right;
  return order.descending ? -ascending : ascending;
}

/** @param {Column} column @param {number} i */
function headerCell({ title }, i) {
  const state = i !== order.column ? "none" : order.descending ? "descending" : "ascending";
  const button = element("button", { type: "button" }, title);
  button.addEventListener("click", () => {
    order.descending = order.column === i && !order.descending;
    order.column = i;
    drawTable();
    byId("table").querySelectorAll("th button")[i].focus();
  });
  return element("th", { scope: "col", "aria-sort": state }, button);
}

/** @param {Entry} entry @param {boolean} onFront */
function row(entry, onFront) {
  const star = element("span", { class: "star" }, onFront ? "★" : "");
  if (onFront) star.append(element("span", { class: "unseen" }, "on the front: "));
  const name = element("th", { scope: "row" }, star, inlineMark(entry.method), " ", element("span", { class: "name" }, ...broken(entry.name)));
  const cells = COLUMNS.slice(1).map(({ text }) => element("td", {}, text(entry)));
  return element("tr", { class: onFront ? "on-front" : "" }, name, ...cells);
}

function drawTable() {
  const rows = shown().sort(compareEntries);
  const best = new Set(front(shown()));
  const head = element("thead", {}, element("tr", {}, ...COLUMNS.map(headerCell)));
  byId("table").replaceChildren(head, element("tbody", {}, ...rows.map((entry) => row(entry, best.has(entry)))));
  const { cpu_seconds: cpu, seconds: wall } = results.prepared;
  const runs = results.repeats > 1 ? `, the median of ${results.repeats} runs` : ", a single run";
  byId("table-note").textContent = `★ no other visible entry is both faster and more accurate, by the time and the error of the chart.`
    + ` Times are of the blur${runs}; "whole" adds reading and planning, which all entries share: CPU ${seconds(cpu)} s, wall ${seconds(wall)} s.`;
}
