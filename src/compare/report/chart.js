// The chart: seconds on a logarithmic x axis, decibels on the y axis; one series per method, and the Pareto front.

const MARGIN = { top: 14, right: 18, bottom: 44, left: 46 };

/** Margin in decibels above and below the points. */
const MARGIN_DB = 1.5;

/** @typedef {{x: (seconds: number) => number, y: (db: number) => number, width: number, height: number}} Scales */

/** 1, 2 and 5 times the powers of ten within a range. */
function secondsTicks(min, max) {
  const ticks = [];
  for (let power = Math.floor(Math.log10(min)); power <= Math.log10(max); power += 1) {
    for (const step of [1, 2, 5]) ticks.push(step * 10 ** power);
  }
  return ticks.filter((tick) => tick >= min && tick <= max);
}

/** About `count` round values within a range. */
function decibelTicks(min, max, count) {
  const step = [1, 2, 5, 10, 20].find((size) => (max - min) / size <= count) ?? 50;
  const first = Math.ceil(min / step);
  return Array.from({ length: Math.max(0, Math.floor(max / step) - first + 1) }, (_, i) => (first + i) * step);
}

/** The ranges of the axes, from all entries, so that hiding a method moves no point. */
function ranges() {
  const times = entries.map(timeOf).map((time) => Math.max(time, 1e-4));
  const decibel = entries.map(decibelsOf);
  const [min, max] = [Math.min(...times), Math.max(...times)];
  return { seconds: [min / 1.35, max * 1.35], db: [Math.min(...decibel) - MARGIN_DB, Math.max(...decibel) + MARGIN_DB] };
}

/** @returns {Scales} */
function scales(width, height, { seconds: [t0, t1], db: [d0, d1] }) {
  const [inner, tall] = [width - MARGIN.left - MARGIN.right, height - MARGIN.top - MARGIN.bottom];
  return {
    width,
    height,
    x: (time) => MARGIN.left + (inner * Math.log(Math.max(time, 1e-4) / t0)) / Math.log(t1 / t0),
    y: (db) => MARGIN.top + tall * (1 - (Math.min(Math.max(db, d0), d1) - d0) / (d1 - d0)),
  };
}

/** @param {Scales} at */
function axes(at, range) {
  const group = svg("g", { class: "axes", "aria-hidden": "true" });
  const [right, bottom] = [at.width - MARGIN.right, at.height - MARGIN.bottom];
  let last = -Infinity;
  for (const tick of secondsTicks(...range.seconds)) {
    const x = at.x(tick);
    group.append(svg("line", { class: "grid", x1: x, x2: x, y1: MARGIN.top, y2: bottom }));
    if (x - last < 34) continue;
    last = x;
    group.append(svg("text", { x, y: bottom + 16, "text-anchor": "middle" }, String(Number(tick.toPrecision(1)))));
  }
  for (const tick of decibelTicks(...range.db, Math.max(4, at.height / 50))) {
    const y = at.y(tick);
    group.append(svg("line", { class: "grid", x1: MARGIN.left, x2: right, y1: y, y2: y }));
    group.append(svg("text", { x: MARGIN.left - 7, y: y + 4, "text-anchor": "end" }, tick));
  }
  const time = `${view.time === "cpu" ? "CPU" : "wall"} seconds of the blur`;
  group.append(svg("text", { class: "title", x: right, y: at.height - 6, "text-anchor": "end" }, `${time} →`));
  group.append(svg("text", { class: "title", x: MARGIN.left + 6, y: MARGIN.top + 8 }, "↑ PSNR, dB"));
  return group;
}

/** The line through the points of a method, from coarse to fine. @param {Scales} at @param {string} method */
function series(at, method) {
  const points = entries.filter((entry) => entry.method === method);
  const path = points.map((entry) => `${at.x(timeOf(entry)).toFixed(1)} ${at.y(decibelsOf(entry)).toFixed(1)}`);
  return svg("path", { class: `series m${indexOf(method)}`, d: `M${path.join("L")}`, "aria-hidden": "true" });
}

/** The Pareto front: a step at each of its entries. @param {Scales} at */
function frontLine(at) {
  const best = front(shown());
  if (best.length === 0) return svg("g");
  let path = `M${at.x(timeOf(best[0])).toFixed(1)} ${at.height - MARGIN.bottom}`;
  for (const entry of best) path += `H${at.x(timeOf(entry)).toFixed(1)}V${at.y(decibelsOf(entry)).toFixed(1)}`;
  return svg("path", { class: "front", d: `${path}H${at.width - MARGIN.right}`, "aria-hidden": "true" });
}

/** The 95 % interval of the sampling error; without an upper end where no error may be measurable. @param {Scales} at @param {Entry} entry */
function whisker(at, entry) {
  const [min, max] = entry.sampling.interval_db;
  const [x, y0, y1] = [at.x(timeOf(entry)), at.y(min), max === null ? MARGIN.top : at.y(max)];
  const cap = (y) => `M${x - 3} ${y}h6`;
  const top = max === null ? `M${x - 3} ${y1 + 5}L${x} ${y1}L${x + 3} ${y1 + 5}` : cap(y1);
  return svg("path", { class: `whisker m${indexOf(entry.method)}`, d: `${cap(y0)}M${x} ${y0}V${y1}${top}`, "aria-hidden": "true" });
}

/** @param {Scales} at @param {Entry} entry @param {boolean} onFront */
function point(at, entry, onFront) {
  const place = `translate(${at.x(timeOf(entry)).toFixed(1)} ${at.y(decibelsOf(entry)).toFixed(1)})`;
  const group = svg("g", {
    class: `point${onFront ? " on-front" : ""}`,
    transform: place,
    tabindex: 0,
    role: "button",
    "aria-label": inWords(entry),
    "data-name": entry.name,
  });
  group.append(svg("circle", { class: "halo", r: 10 }), mark(entry.method, 5.5));
  for (const event of ["pointerenter", "focus"]) group.addEventListener(event, () => showFigures(entry));
  group.addEventListener("click", () => choose(entry));
  group.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    choose(entry);
  });
  return group;
}

/** Shows an entry's figures below the chart. @param {Entry} entry */
function showFigures(entry) {
  byId("figures").replaceChildren(inlineMark(entry.method), ` ${inWords(entry)}`);
}

/** Whether two boxes [left, top, right, bottom] overlap. */
function overlap(a, b) {
  return a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
}

/** Names of methods beside their points, where they fit. @param {Scales} at */
function labels(at) {
  const group = svg("g", { class: "labels", "aria-hidden": "true" });
  const occupied = entries.map((entry) => {
    const [x, y] = [at.x(timeOf(entry)), at.y(decibelsOf(entry))];
    return [x - 6, y - 6, x + 6, y + 6];
  });
  for (const method of usedMethods.filter((name) => !view.hidden.has(name))) {
    const label = labelOf(at, method, occupied);
    if (label) group.append(label);
  }
  return group;
}

/** The name of `method` beside one of its points, at the first free side, the finest level first. @param {Scales} at */
function labelOf(at, method, occupied) {
  const width = method.length * 6.6;
  const points = entries.filter((entry) => entry.method === method).reverse();
  for (const entry of points) {
    const [x, y] = [at.x(timeOf(entry)), at.y(decibelsOf(entry))];
    const places = [[x + 11, y + 4], [x - 11 - width, y + 4], [x - width / 2, y - 12], [x - width / 2, y + 20]];
    for (const [left, base] of places) {
      const box = [left - 2, base - 11, left + width + 2, base + 4];
      const inside = box[0] > MARGIN.left && box[2] < at.width - 4 && box[1] > MARGIN.top + 14 && box[3] < at.height - MARGIN.bottom;
      if (!inside || occupied.some((other) => overlap(box, other))) continue;
      occupied.push(box);
      return svg("text", { class: `label t${indexOf(method)}`, x: left, y: base }, method);
    }
  }
  return null;
}

/** Width of the chart in print, in CSS pixels: its text is then as large as the surrounding text. */
const PAPER_PX = 680;

/** Draws the chart, as wide as its container by default. @param {number} [widthPx] */
function drawChart(widthPx) {
  const container = byId("chart");
  const width = Math.max(280, widthPx ?? Math.floor(container.clientWidth));
  const height = Math.round(Math.min(520, Math.max(320, width * 0.52)));
  const range = ranges();
  const at = scales(width, height, range);
  const [points, best] = [shown(), new Set(front(shown()))];
  const name = `Chart of ${points.length} settings: seconds of the blur on the x axis, PSNR in decibels on the y axis`;
  const chart = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "group", "aria-label": name }, axes(at, range), frontLine(at));
  chart.append(...usedMethods.filter((method) => !view.hidden.has(method)).map((method) => series(at, method)));
  if (view.error === "sampling") chart.append(...points.map((entry) => whisker(at, entry)));
  chart.append(labels(at), ...points.map((entry) => point(at, entry, best.has(entry))));
  const focused = document.activeElement?.getAttribute?.("data-name");
  container.replaceChildren(chart);
  if (focused) chart.querySelector(`[data-name="${CSS.escape(focused)}"]`)?.focus();
}

/** The check boxes and buttons that hide and show methods. */
function drawLegend() {
  const legend = byId("legend");
  for (const method of usedMethods) {
    const box = element("input", { type: "checkbox", checked: true, value: method });
    box.addEventListener("change", () => setHidden([method], !box.checked));
    legend.append(element("label", {}, box, inlineMark(method), " ", method));
  }
  for (const [text, on] of [["All", true], ["None", false]]) {
    const button = element("button", { type: "button", class: "quiet" }, text);
    button.addEventListener("click", () => {
      for (const box of legend.querySelectorAll("input")) box.checked = on;
      setHidden(usedMethods, !on);
    });
    legend.append(button);
  }
}

/** @param {string[]} names @param {boolean} hidden */
function setHidden(names, hidden) {
  for (const method of names) {
    if (hidden) view.hidden.add(method);
    else view.hidden.delete(method);
  }
  drawChart();
  drawTable();
  filterCrops();
}

/** The radio buttons that choose the axes. */
function wireAxes() {
  byId("error-switch").hidden = !hasReference;
  for (const input of document.querySelectorAll('#switches input[type="radio"]')) {
    input.checked = view[input.name] === input.value;
    input.addEventListener("change", () => {
      view[input.name] = input.value;
      explainChart();
      drawChart();
      drawTable();
    });
  }
}

/** Shows below the chart which error it has. */
function explainChart() {
  const errors = {
    sampling: `Sampling error, against many lens rays through the stack at ${entries[0]?.sampling.pixels ?? 0} pixels; whiskers are 95 % intervals.`,
    model: "Model error, against the reference render, over the whole picture.",
  };
  byId("chart-note").replaceChildren(
    `${errors[view.error]} Up and to the left is better. The stepped line is the Pareto front: the smallest error for each time.`,
    hint("Point at or focus a point for its figures; press it to show its picture below."),
  );
}
