// Two overlaid pictures with a slider between them, and the error maps.

/** Maximum width of whole pictures, which are shown at up to twice their size. */
const MAX_WIDTH_PX = 1280;

/** Every picture: [value in the lists, label, address]. @type {[string, string, string][]} */
const pictures = [
  ...(hasReference ? [["reference", "reference: render with the lens on", assets.reference]] : []),
  ["pinhole", "pinhole: no lens", assets.pinhole],
  ...entries.map((entry, i) => [`entry-${i}`, entry.name, assets.entries[i]]),
];

/** What error maps and crops are measured against, in words. */
const baseline = !results.yardstick ? "nothing"
  : results.yardstick.kind === "reference" ? "the reference render" : `${results.yardstick.name}, the setting with the smallest sampling error`;

/** @param {HTMLSelectElement} select @param {string[][]} items */
function fill(select, items) {
  select.replaceChildren(...items.map(([value, text]) => element("option", { value }, text)));
}

/** @param {string} id */
function picture(id) {
  return pictures.find(([name]) => name === id) ?? pictures[0];
}

/** Cuts the left picture at `percent` of the width. @param {number} percent */
function cut(percent) {
  byId("over").style.clipPath = `inset(0 ${100 - percent}% 0 0)`;
  byId("handle").style.left = `${percent}%`;
}

/** The selected mode. */
function mode() {
  return document.querySelector('input[name="mode"]:checked').value;
}

function drawPictures() {
  const split = mode() === "split";
  for (const node of document.querySelectorAll(".split-only")) node.hidden = !split;
  for (const node of document.querySelectorAll(".map-only")) node.hidden = split;
  byId("over").hidden = byId("handle").hidden = !split;
  byId("stage").classList.toggle("split", split);
  if (split) drawPair(); else drawMap();
}

function drawPair() {
  const [left, right] = ["left", "right"].map((id) => picture(byId(id).value));
  show(byId("over"), left[2], `Left: ${left[1]}`);
  show(byId("under"), right[2], `Right: ${right[1]}`);
  cut(Number(byId("slider").value));
  byId("strip-note").replaceChildren(
    `Left ${left[1]}, right ${right[1]}. Shown at most ${MAX_WIDTH_PX} pixels wide, as JPEG; the folder has the pictures at full size.`,
    hint("Drag across the picture, or move the slider with the arrow keys."),
  );
}

function drawMap() {
  const i = Number(byId("map").value);
  show(byId("under"), assets.maps[i], `Error map of ${entries[i].name}`);
  byId("strip-note").textContent = `FLIP of ${entries[i].name} at each pixel, against ${baseline}: 0 is no visible difference, 1 the largest.`
    + " The folder has the map at full size.";
}

/** @param {HTMLImageElement} image */
function show(image, address, text) {
  image.alt = text;
  image.width = Math.min(MAX_WIDTH_PX, 2 * pictureSize().width);
  if (image.getAttribute("src") !== address) image.src = address;
}

/** Shows the picture of an entry on the right, or its map. @param {Entry} entry */
function choose(entry) {
  const i = entries.indexOf(entry);
  byId("right").value = `entry-${i}`;
  if (assets.maps[i]) byId("map").value = String(i);
  drawPictures();
  showFigures(entry);
}

/** Moves the cut to the pointer. @param {PointerEvent} event */
function drag(event) {
  const box = byId("stage").getBoundingClientRect();
  const percent = Math.round((100 * (event.clientX - box.left)) / box.width);
  byId("slider").value = String(Math.min(100, Math.max(0, percent)));
  cut(Number(byId("slider").value));
}

function wirePointer() {
  const stage = byId("stage");
  stage.addEventListener("pointerdown", (event) => {
    if (mode() !== "split" || event.button !== 0) return;
    event.preventDefault();
    stage.setPointerCapture(event.pointerId);
    drag(event);
  });
  stage.addEventListener("pointermove", (event) => {
    if (stage.hasPointerCapture(event.pointerId)) drag(event);
  });
}

/** The colours of the maps from 0 to 1. */
function drawScale() {
  const bar = element("span", { class: "bar" });
  bar.style.backgroundImage = `linear-gradient(to right, ${scale.join(", ")})`;
  byId("scale").append("FLIP 0", bar, "1");
}

function wirePictures() {
  const maps = entries.flatMap((entry, i) => (assets.maps[i] ? [[String(i), entry.name]] : []));
  const best = front(entries).at(-1) ?? entries[0];
  for (const id of ["left", "right"]) fill(byId(id), pictures);
  fill(byId("map"), maps);
  byId("left").value = hasReference ? "reference" : "pinhole";
  byId("right").value = `entry-${entries.indexOf(best)}`;
  if (maps.length === 0) document.querySelector('input[value="map"]').closest("label").hidden = true;
  else byId("map").value = maps.some(([i]) => entries[i] === best) ? String(entries.indexOf(best)) : maps[0][0];
  for (const id of ["left", "right", "map"]) byId(id).addEventListener("change", drawPictures);
  for (const input of document.querySelectorAll('input[name="mode"]')) input.addEventListener("change", drawPictures);
  byId("slider").addEventListener("input", () => cut(Number(byId("slider").value)));
  wirePointer();
  drawScale();
  drawPictures();
}
