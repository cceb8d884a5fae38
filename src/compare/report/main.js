// Builds the page.

/** The last two parts of a path. @param {string} path */
function fileName(path) {
  return path.split(/[\\/]/).slice(-2).join("/");
}

function drawHead() {
  const [first] = results.input;
  const count = `${entries.length} ${entries.length === 1 ? "setting" : "settings"} of ${usedMethods.length} ${usedMethods.length === 1 ? "method" : "methods"}`;
  const { peels, kind } = results.stack;
  const { width, height } = pictureSize();
  const title = first ? fileName(first) : "a stack";
  document.title = `thinlens compare: ${title}`;
  byId("title").textContent = title;
  const against = hasReference ? `many lens rays through the stack and a reference render, ${fileName(results.reference)}` : "many lens rays through the stack";
  byId("subject").textContent = `${count} on a stack of ${peels} ${peels === 1 ? "peel" : "peels"} (${kind.replace("-", " ")}), ${width} × ${height}`
    + ` pixels, measured against ${against}. ${lensInWords()}`;
  byId("warnings").append(...results.warnings.map((text) => element("li", {}, text)));
  byId("warnings").hidden = results.warnings.length === 0;
}

function lensInWords() {
  const { focal_length_mm: focal, f_number: stop, focus_distance: focus, c_inf: far } = results.lens;
  const number = (value) => String(Number(value.toPrecision(4)));
  const aperture = stop.value === null ? "a pinhole" : `f/${number(stop.value)}`;
  return `${number(focal.value)} mm, ${aperture}, in focus at ${number(focus)} depth units; CoC radius at infinity ${number(Math.abs(far))} px.`;
}

function drawErrors() {
  const term = (name, text) => [element("dt", {}, name), element("dd", {}, text)];
  const model = hasReference
    ? "difference of the whole picture from a reference render of the scene with the lens on. It includes errors of the stack itself, such as missing surfaces."
    : "not measured: it requires a reference, a render of the scene with the lens on.";
  byId("errors").append(
    ...term("Sampling error", "difference of a method's picture from the mean of very many lens rays through the same stack, at randomly chosen pixels."),
    ...term("Model error", model),
  );
}

/** A command that can be copied; without access to the clipboard, it is selected instead. @param {string} text */
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

/** The origins of the lens settings. */
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
  const updateLabel = () => {
    button.textContent = isDark() ? "Light" : "Dark";
    button.setAttribute("aria-label", `Show the page in ${isDark() ? "light" : "dark"} colours`);
  };
  button.addEventListener("click", () => {
    document.documentElement.dataset.theme = isDark() ? "light" : "dark";
    updateLabel();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", updateLabel);
  updateLabel();
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
  byId("footer").textContent = `thinlens ${results.version}. All figures are also in results.json and results.csv beside this file.`;
  addEventListener("beforeprint", () => drawChart(PAPER_PX));
  addEventListener("afterprint", () => drawChart());
}

start();
