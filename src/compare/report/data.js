// The data of the page, read once, and its formatting.

/**
 * @typedef {{cpu_seconds: number, seconds: number}} Cost
 * @typedef {{psnr_db: number|null, interval_db: [number, number|null], pixels: number, rays_per_pixel: number}} Sampling
 * @typedef {{psnr_db: number, ssim: number|null, flip: number}} Model
 * @typedef {object} Entry
 * @property {string} name
 * @property {string} method
 * @property {number|null} views
 * @property {number} cpu_seconds
 * @property {number} seconds
 * @property {Cost[]} runs
 * @property {Cost} whole
 * @property {Cost|null} predicted
 * @property {Sampling} sampling
 * @property {Model|null} model
 * @property {string} command
 * @property {string|null} picture
 * @typedef {{x: number, y: number, side_px: number, pinhole_psnr_db: number|null, psnr_db: (number|null)[]}} Crop
 * @typedef {{time: "cpu"|"wall", error: "sampling"|"model", hidden: Set<string>}} View
 */

const { results, assets, methods, scale } = JSON.parse(byId("content").textContent);

/** @type {Entry[]} */
const entries = results.entries;

const hasReference = assets.reference !== null;
const hasPrediction = entries.some((entry) => entry.predicted !== null);

/** The methods of the comparison, in the registry's order. */
const usedMethods = methods.filter((method) => entries.some((entry) => entry.method === method));

/** The axes of the chart, and the hidden methods. @type {View} */
const view = { time: "cpu", error: hasReference ? "model" : "sampling", hidden: new Set() };

/** @param {string} id @returns {HTMLElement} */
function byId(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no element #${id}`);
  return found;
}

/**
 * An element with attributes and children; a child that is not a node becomes text.
 * @param {string} name
 * @param {Record<string, string|number|boolean>} [attributes]
 * @param {...(Node|string|number)} children
 */
function element(name, attributes = {}, ...children) {
  return filled(document.createElement(name), attributes, children);
}

/** As element(), in SVG. */
function svg(name, attributes = {}, ...children) {
  return filled(document.createElementNS("http://www.w3.org/2000/svg", name), attributes, children);
}

/** A usage hint, hidden in print. @param {string} text */
function hint(text) {
  return element("span", { class: "hint" }, ` ${text}`);
}

function filled(node, attributes, children) {
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== false) node.setAttribute(key, value === true ? "" : String(value));
  }
  node.append(...children.map((child) => (child instanceof Node ? child : String(child))));
  return node;
}

/** The name of a setting, with line breaks allowed after its method and between its settings. @param {string} name */
function broken(name) {
  const parts = name.split(/(?<=[:+])/);
  return parts.flatMap((part) => [element("span", {}, part), element("wbr")]);
}

/** @param {number|null|undefined} value @param {number} digits */
function figure(value, digits) {
  return value === null || value === undefined ? "–" : value.toFixed(digits);
}

/** Seconds with three significant digits. @param {number|null|undefined} value */
function seconds(value) {
  if (value === null || value === undefined) return "–";
  if (value >= 100) return value.toFixed(0);
  return value.toFixed(value >= 10 ? 1 : value >= 1 ? 2 : 3);
}

/** @param {Sampling} sampling */
function interval({ interval_db: [min, max] }) {
  return max === null ? `at least ${min.toFixed(1)}` : `${min.toFixed(1)} … ${max.toFixed(1)}`;
}

/** @param {number|null} db */
function decibels(db) {
  return db === null ? "the baseline" : `${db.toFixed(1)} dB`;
}

/** Width and height of the pictures in pixels. */
function pictureSize() {
  const { width, height, supersample } = results.stack;
  return { width: Math.floor(width / supersample), height: Math.floor(height / supersample) };
}

/** The time on the chart's x axis. @param {Entry} entry */
function timeOf(entry) {
  return view.time === "cpu" ? entry.cpu_seconds : entry.seconds;
}

/** The decibels on the chart's y axis; the lower end of the interval where no error was measured. @param {Entry} entry */
function decibelsOf(entry) {
  if (view.error === "model" && entry.model) return entry.model.psnr_db;
  return entry.sampling.psnr_db ?? entry.sampling.interval_db[0];
}

/** All figures of an entry in one sentence. @param {Entry} entry */
function inWords(entry) {
  const model = entry.model ? ` Model error ${entry.model.psnr_db.toFixed(2)} dB, FLIP ${entry.model.flip.toFixed(4)}.` : "";
  const predicted = entry.predicted ? ` Predicted: CPU ${seconds(entry.predicted.cpu_seconds)} s, wall ${seconds(entry.predicted.seconds)} s.` : "";
  const sampling = entry.sampling.psnr_db === null ? "" : `${entry.sampling.psnr_db.toFixed(1)} dB `;
  return `${entry.name}: CPU ${seconds(entry.cpu_seconds)} s, wall ${seconds(entry.seconds)} s.`
    + ` Sampling error ${sampling}(95 %: ${interval(entry.sampling)} dB).${model}${predicted}`;
}

/** The entries of the methods that are not hidden. */
function shown() {
  return entries.filter((entry) => !view.hidden.has(entry.method));
}

/** The Pareto front of `candidates` in time and error, from fastest to slowest. @param {Entry[]} candidates */
function front(candidates) {
  const sorted = [...candidates].sort((a, b) => timeOf(a) - timeOf(b) || decibelsOf(b) - decibelsOf(a));
  let best = -Infinity;
  return sorted.filter((entry) => {
    const better = decibelsOf(entry) > best;
    best = Math.max(best, decibelsOf(entry));
    return better;
  });
}
