// Puts the page together.

/** The last part of a path. @param {string} path */
function fileName(path) {
  return path.split(/[\\/]/).slice(-2).join("/");
}

function drawHead() {
  const [first] = results.input;
  const count = `${entries.length} ${entries.length === 1 ? "setting" : "settings"} of ${taking.length} ${taking.length === 1 ? "method" : "methods"}`;
  const { peels, kind } = results.stack;
  const { width, height } = pictureSize();
  const title = first ? fileName(first) : "a stack";
  document.title = `thinlens compare: ${title}`;
  byId("title").textContent = title;
  const against = hasReference ? `the stack's own truth and a true render, ${fileName(results.reference)}` : "the stack's own truth";
  byId("subject").textContent = `${count} on a stack of ${peels} ${peels === 1 ? "peel" : "peels"} (${kind.replace("-", " ")}), ${width} × ${height}`
    + ` pixels, measured against ${against}. ${lensInWords()}`;
  byId("warnings").append(...results.warnings.map((text) => element("li", {}, text)));
  byId("warnings").hidden = results.warnings.length === 0;
}

function lensInWords() {
  const { focal_length_mm: focal, f_number: stop, focus_distance: focus, c_inf: far } = results.lens;
  const number = (value) => String(Number(value.toPrecision(4)));
  const aperture = stop.value === null ? "a pinhole" : `f/${number(stop.value)}`;
  return `${number(focal.value)} mm, ${aperture}, in focus at ${number(focus)} depth units; a point at infinity blurs to a radius of ${number(Math.abs(far))} px.`;
}

function drawErrors() {
  const term = (name, text) => [element("dt", {}, name), element("dd", {}, text)];
  const model = hasReference
    ? "what the whole picture is off from a true render of the scene with the lens on. It includes what the stack itself cannot say."
    : "not measured: it takes a true render with the lens on (--reference).";
  byId("errors").append(
    ...term("Sampling error", "what a method gets wrong about the stack: its picture against very many lens rays through the same stack, at a sample of pixels."),
    ...term("Model error", model),
  );
}

/** A command that can be copied; where the clipboard is closed, it is selected instead. @param {string} text */
function command(text) {
  const code = element("code", { tabindex: 0 }, text);
  const button = element("button", { type: "button", class: "quiet copy" }, "Copy");
  button.addEventListener("click", async () => {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "Copied";
    } catch {
      getSelection()?.selectAllChildren(code);
      button.textContent = "Selected";
    }
    setTimeout(() => { button.textContent = "Copy"; }, 2000);
  });
  return element("div", { class: "command" }, code, button);
}

function drawFacts() {
  const { machine, version, stack, input, reference, repeats, probes } = results;
  const fact = (name, text) => [element("dt", {}, name), element("dd", {}, text)];
  byId("facts").append(
    ...fact("Stack", input.join(", ")),
    ...(reference ? fact("Reference", reference) : []),
    ...fact("Read as", `${stack.width} × ${stack.height} samples, ${stack.peels} peels, ${stack.kind}, ${stack.precision}, depth ${stack.convention}`),
    ...fact("Lens", `${lensInWords()} ${originsInWords()}`),
    ...fact("Measured", `${repeats} ${repeats === 1 ? "run" : "runs"} each; sampling error at ${probes} pixels`),
    ...fact("Machine", `${machine.cpu}, ${machine.cores} logical cores, ${machine.threads} threads used, ${machine.os}`),
    ...fact("Program", `thinlens ${version}`),
  );
  byId("command").append(command(results.command));
  byId("commands").append(...entries.map((entry) => command(entry.command)));
}

/** Where the values of the lens came from. */
function originsInWords() {
  const sources = new Map();
  for (const [key, value] of Object.entries(results.lens)) {
    if (!value?.origin || value.origin.from === "default") continue;
    const name = value.origin.name ? `${value.origin.from} ${value.origin.name}` : value.origin.from;
    sources.set(name, [...(sources.get(name) ?? []), key.replaceAll("_", " ")]);
  }
  return [...sources].map(([name, keys]) => `From ${name}: ${keys.join(", ")}.`).join(" ");
}

function isDark() {
  const set = document.documentElement.dataset.theme;
  return set ? set === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}

function wireTheme() {
  const button = byId("theme");
  const say = () => {
    button.textContent = isDark() ? "Light" : "Dark";
    button.setAttribute("aria-label", `Show the page in ${isDark() ? "light" : "dark"} colours`);
  };
  button.addEventListener("click", () => {
    document.documentElement.dataset.theme = isDark() ? "light" : "dark";
    say();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", say);
  say();
}

function start() {
  wireTheme();
  drawHead();
  drawErrors();
  drawFacts();
  wireAxes();
  explainChart();
  drawLegend();
  drawTable();
  wirePictures();
  drawCrops();
  drawChart();
  new ResizeObserver(() => drawChart()).observe(byId("chart"));
  byId("figures").textContent = "Point at a mark for its figures.";
  byId("footer").textContent = `Made by thinlens ${results.version}. results.json and results.csv beside this file have all figures.`;
  addEventListener("beforeprint", () => drawChart(PAPER_PX));
  addEventListener("afterprint", () => drawChart());
}

start();
