// report.html in a real browser.
//
// Creates reports with the built program (THINLENS is its path; default: target/release/thinlens) from the fence sample,
// with and without a reference, and opens them in Chromium (CHROMIUM is its path).

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { copyFileSync, mkdirSync, mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join, resolve } from "node:path";
import { after, afterEach, before, beforeEach, describe, test } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const ROOT = resolve(dirname(fileURLToPath(import.meta.url)), "../..");
const PROGRAM = process.env.THINLENS ?? join(ROOT, "target/release/thinlens");
const BROWSER = process.env.CHROMIUM ?? "/usr/bin/chromium";
const SAMPLE = join(ROOT, "samples/fence");
const METHODS = ["shear:4", "shear:16", "gather:64", "opaque-blur"];
/** A folder and a file whose path would end the block of figures if it were not escaped. */
const NASTY = ["<", "script><!-- & ' \".exr"];

let folder;
let browser;
let context;
let page;
let problems;

function compare(name, extra) {
  execFileSync(PROGRAM, [
    "compare", join(SAMPLE, "stack.exr"), "--preset", join(SAMPLE, "preset.toml"),
    "--methods", METHODS.join(","), "--repeats", "1", "--probes", "60", "-o", join(folder, name), ...extra,
  ], { stdio: "pipe" });
  return JSON.parse(readFileSync(join(folder, name, "results.json"), "utf8"));
}

/** Opens a report, and records every error, warning and request. */
async function open(name, options = {}) {
  context = await browser.newContext({ viewport: { width: 1280, height: 900 }, colorScheme: "light", reducedMotion: "reduce", ...options });
  page = await context.newPage();
  const address = pathToFileURL(join(folder, name, "report.html")).href;
  page.on("console", (message) => { if (["error", "warning"].includes(message.type())) problems.push(message.text()); });
  page.on("pageerror", (error) => problems.push(String(error)));
  page.on("request", (request) => {
    if (request.url() !== address && !request.url().startsWith("data:")) problems.push(`requested ${request.url()}`);
  });
  await page.goto(address);
}

const names = () => page.locator("tbody th .name").allTextContents();
const column = (n) => page.locator(`tbody tr td:nth-child(${n})`).allTextContents();
const clip = () => page.locator("#over").evaluate((image) => getComputedStyle(image).clipPath);
const color = (selector, property = "backgroundColor") =>
  page.locator(selector).first().evaluate((node, key) => getComputedStyle(node)[key], property);
const overflows = () => page.evaluate(() => document.documentElement.scrollWidth > innerWidth);

before(async () => {
  folder = mkdtempSync(join(tmpdir(), "thinlens-report-"));
  mkdirSync(join(folder, NASTY[0]));
  copyFileSync(join(SAMPLE, "reference.exr"), join(folder, ...NASTY));
  browser = await chromium.launch({
    executablePath: BROWSER,
    args: ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
      "--disable-background-networking", "--disable-component-update", "--disable-sync"],
  });
});

after(async () => {
  await browser?.close();
  rmSync(folder, { recursive: true, force: true });
});

beforeEach(() => { problems = []; });

afterEach(async () => {
  await context?.close();
  assert.deepEqual(problems, [], "the page has no error and requests nothing");
});

describe("a report with a reference", () => {
  let results;
  before(() => { results = compare("with", ["--reference", join(folder, ...NASTY)]); });

  test("has a point, a row and a render command for every entry", async () => {
    await open("with");
    assert.equal(await page.locator("#chart .point").count(), METHODS.length);
    assert.deepEqual((await names()).sort(), [...METHODS].sort());
    assert.equal(await page.locator("#commands code").count(), METHODS.length);
    assert.equal(await page.locator("#commands code").first().textContent(), results.entries[0].command);
  });

  test("shows the name of a file as text, whatever it contains", async () => {
    await open("with");
    assert.ok((await page.locator("#facts").textContent()).includes(NASTY.join("/")));
  });

  test("shows a point's figures when it is focused or pointed at", async () => {
    await open("with");
    for (const [i, act] of [[0, "focus"], [2, "hover"]]) {
      const entry = results.entries[i];
      await page.locator(`.point[data-name="${entry.name}"]`)[act]();
      const text = await page.locator("#figures[role=status]").textContent();
      assert.ok(text.includes(`${entry.name}:`) && text.includes(`${entry.model.psnr_db.toFixed(2)} dB`), text);
    }
  });

  test("places points by their figures: faster to the left, more accurate upwards", async () => {
    await open("with");
    const place = async ({ name }) => page.locator(`.point[data-name="${name}"] .mark`).boundingBox();
    const [a, b] = [results.entries[1], results.entries[3]];
    const [boxA, boxB] = [await place(a), await place(b)];
    assert.equal(boxA.x < boxB.x, a.cpu_seconds < b.cpu_seconds);
    assert.equal(boxA.y < boxB.y, a.model.psnr_db > b.model.psnr_db);
  });

  test("hides a method in chart, table and crops, and shows it again", async () => {
    await open("with");
    const crops = page.locator("#crops .tile:visible");
    const all = await crops.count();
    await page.locator('#legend input[value="shear"]').uncheck();
    assert.equal(await page.locator("#chart .point").count(), 2);
    assert.deepEqual((await names()).sort(), ["gather:64", "opaque-blur"]);
    assert.equal(await crops.count(), all - 2 * results.crops.length);
    await page.getByRole("button", { name: "None", exact: true }).click();
    assert.equal(await page.locator("#chart .point").count(), 0);
    await page.getByRole("button", { name: "All", exact: true }).click();
    assert.equal(await page.locator("#chart .point").count(), METHODS.length);
  });

  test("switches between the two errors and the two times", async () => {
    await open("with");
    const places = () => page.locator("#chart .point").evaluateAll((nodes) => nodes.map((node) => node.getAttribute("transform")));
    const model = await places();
    assert.equal(await page.locator("#chart .whisker").count(), 0);
    await page.getByRole("radio", { name: "sampling" }).check();
    assert.equal(await page.locator("#chart .whisker").count(), METHODS.length);
    assert.match(await page.locator("#chart-note").textContent(), /^Sampling error/);
    const sampling = await places();
    assert.notDeepEqual(sampling, model);
    await page.getByRole("radio", { name: "wall" }).check();
    assert.notDeepEqual(await places(), sampling);
    assert.match(await page.locator("#chart .axes").textContent(), /wall seconds/);
  });

  test("cuts between two pictures by mouse and by arrow keys", async () => {
    await open("with");
    assert.equal(await clip(), "inset(0px 50% 0px 0px)");
    await page.locator("#stage").scrollIntoViewIfNeeded();
    const box = await page.locator("#stage").boundingBox();
    await page.mouse.move(box.x + box.width * 0.5, box.y + 20);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width * 0.25, box.y + 20, { steps: 3 });
    await page.mouse.up();
    assert.equal(await clip(), "inset(0px 75% 0px 0px)");
    await page.locator("#slider").focus();
    await page.keyboard.press("ArrowRight");
    assert.equal(await clip(), "inset(0px 74% 0px 0px)");
    assert.equal(await page.locator("#slider").inputValue(), "26");
  });

  test("shows any two of reference, pinhole and entries, and a point's picture when it is pressed", async () => {
    await open("with");
    const options = await page.locator("#left option").allTextContents();
    assert.equal(options.length, METHODS.length + 2);
    const before = await page.locator("#under").getAttribute("src");
    await page.locator("#right").selectOption({ label: "gather:64" });
    const gather = await page.locator("#under").getAttribute("src");
    assert.ok(gather.startsWith("data:image/jpeg") && gather !== before);
    await page.locator('.point[data-name="shear:4"]').focus();
    await page.keyboard.press("Enter");
    assert.equal(await page.locator("#right option:checked").textContent(), "shear:4");
    assert.notEqual(await page.locator("#under").getAttribute("src"), gather);
  });

  test("shows an entry's error map with the scale of its colours", async () => {
    await open("with");
    await page.getByRole("radio", { name: "error map" }).check();
    assert.equal(await page.locator("#over").isVisible(), false);
    assert.ok(await page.locator("#scale").isVisible());
    await page.locator("#map").selectOption({ label: "opaque-blur" });
    assert.match(await page.locator("#strip-note").textContent(), /opaque-blur .* against the reference/);
    assert.equal(await page.locator("#map option").count(), METHODS.length);
  });

  test("sorts its table by any column, up and down", async () => {
    await open("with");
    const sorted = (values) => [...values].sort((a, b) => a - b);
    const seconds = (await column(2)).map(Number);
    assert.deepEqual(seconds, sorted(seconds), "the fastest first");
    const header = page.locator("thead th", { hasText: "Model, dB" });
    await header.getByRole("button").click();
    const position = await header.evaluate((cell) => cell.cellIndex + 1);
    const up = (await column(position)).map(Number);
    assert.deepEqual(up, sorted(up));
    assert.equal(await header.getAttribute("aria-sort"), "ascending");
    await page.keyboard.press("Enter");
    assert.equal(await header.getAttribute("aria-sort"), "descending");
    assert.deepEqual((await column(position)).map(Number), sorted(up).reverse());
    assert.equal(await page.locator('thead th:not([aria-sort="none"])').count(), 1);
  });

  test("shows crops where the pictures differ, without loss", async () => {
    await open("with");
    assert.ok(results.crops.length >= 4 && results.crops.length <= 6);
    assert.equal(await page.locator("#crops .place").count(), results.crops.length);
    const images = page.locator("#crops .place").first().locator("img");
    assert.equal(await images.count(), METHODS.length + 2);
    const [image] = await images.evaluateAll((nodes) => nodes.map((node) => ({
      wide: node.naturalWidth, shown: node.clientWidth, style: getComputedStyle(node).imageRendering, png: node.src.startsWith("data:image/png"),
    })));
    const side = results.crops[0].side_px;
    assert.deepEqual(image, { wide: side, shown: 2 * side, style: "pixelated", png: true });
  });

  test("follows the colour scheme of the system, and its own button overrides it", async () => {
    await open("with");
    const light = [await color("body"), await color(".mark.m0", "fill")];
    await page.emulateMedia({ colorScheme: "dark" });
    const dark = [await color("body"), await color(".mark.m0", "fill")];
    assert.ok(light.every((value, i) => value !== dark[i]), `${light} ${dark}`);
    await page.locator("#theme").click();
    assert.deepEqual([await color("body"), await color(".mark.m0", "fill")], light);
  });

  test("fits a screen 360 pixels wide", async () => {
    await open("with", { viewport: { width: 360, height: 740 } });
    assert.equal(await overflows(), false);
    assert.ok(await page.locator(".scroll").evaluate((box) => box.scrollWidth > box.clientWidth), "the table scrolls in its own box");
    await page.getByRole("radio", { name: "error map" }).check();
    assert.equal(await overflows(), false);
  });

  test("prints light, without controls, with chart, table and crops", async () => {
    await open("with", { colorScheme: "dark" });
    await page.emulateMedia({ media: "print" });
    assert.equal(await color("body"), "rgb(255, 255, 255)");
    for (const hidden of [".controls", ".hint", "#theme", "#slider", ".copy", "#legend input"]) {
      assert.equal(await page.locator(hidden).first().isVisible(), false, hidden);
    }
    for (const visible of ["#chart svg", "#table", "#crops img", "#command code"]) {
      assert.ok(await page.locator(visible).first().isVisible(), visible);
    }
  });

  test("reaches every control with the Tab key, with a visible focus mark", async () => {
    await open("with");
    await page.locator("#commands summary").click();
    await page.evaluate(() => { document.activeElement.blur(); getSelection().removeAllRanges(); scrollTo(0, 0); });
    const expected = await page.evaluate(() => {
      const radios = new Set();
      const nodes = [...document.querySelectorAll("button, select, input, summary, .point, [role=region]")];
      const visible = nodes.filter((node) => node.getClientRects().length > 0);
      visible.forEach((node, i) => { node.dataset.stop = String(i); });
      // One Tab stop a group of radio buttons, as arrow keys move inside of it.
      return visible.filter((node) => node.type !== "radio" || (node.checked && radios.add(node.name))).map((node) => node.dataset.stop);
    });
    await page.locator("body").evaluate((body) => { body.tabIndex = -1; body.focus(); });
    const reached = new Map();
    for (let i = 0; i < 2 * expected.length + 20; i += 1) {
      await page.keyboard.press("Tab");
      const [stop, marked] = await page.evaluate(() => {
        const node = document.activeElement;
        const style = getComputedStyle(node.querySelector?.(".halo") ?? node);
        return [node.dataset.stop ?? null, style.outlineStyle !== "none" || Number.parseFloat(style.strokeWidth) > 2];
      });
      if (stop !== null) reached.set(stop, marked);
    }
    assert.deepEqual(expected.filter((stop) => !reached.get(stop)), [], "never reached, or reached without a mark");
  });

  test("copies a command, or selects it without access to the clipboard", async () => {
    await open("with");
    const button = page.locator("#command .copy");
    await button.click();
    await page.waitForFunction(() => document.querySelector("#command .copy").textContent !== "Copy");
    const text = await button.textContent();
    assert.ok(["Copied", "Selected"].includes(text), text);
    if (text === "Selected") assert.equal(await page.evaluate(() => String(getSelection())), results.command);
  });
});

describe("a report without a reference", () => {
  let results;
  before(() => { results = compare("without", []); });

  test("measures maps and crops against the best entry, and says so", async () => {
    await open("without");
    const best = results.entries.reduce((a, b) => (b.sampling.psnr_db > a.sampling.psnr_db ? b : a));
    assert.deepEqual(results.yardstick, { kind: "entry", name: best.name });
    assert.ok((await page.locator("#crops-note").textContent()).includes(`against ${best.name}`));
    assert.equal(await page.locator("#map option").count(), METHODS.length - 1);
    await page.getByRole("radio", { name: "error map" }).check();
    assert.ok((await page.locator("#strip-note").textContent()).includes(`against ${best.name}`));
  });

  test("has no switch between errors, and whiskers on every point", async () => {
    await open("without");
    assert.equal(await page.locator("#error-switch").isVisible(), false);
    assert.equal(await page.locator("#chart .whisker").count(), METHODS.length);
    assert.equal(await page.locator("thead th", { hasText: "Model" }).count(), 0);
    assert.equal(await page.locator("#left option").count(), METHODS.length + 1);
  });
});
