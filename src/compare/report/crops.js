// The crops in which the pictures differ most, side by side, magnified without interpolation.

/** One picture of a crop. */
function tile(address, side, name, db, method) {
  const image = element("img", { src: address, width: 2 * side, height: 2 * side, alt: "" });
  const title = element("span", { class: "name" }, ...(method ? [inlineMark(method), " "] : []), ...broken(name));
  const caption = element("figcaption", {}, title, element("span", { class: "db" }, db));
  return element("figure", { class: "tile", "data-method": method ?? "" }, image, caption);
}

/** @param {Crop} crop @param {number} i */
function place(crop, i) {
  const pictures = assets.crops[i];
  const side = crop.side_px;
  const tiles = [
    ...(pictures.reference ? [tile(pictures.reference, side, "reference", "reference render", null)] : []),
    tile(pictures.pinhole, side, "pinhole", decibels(crop.pinhole_psnr_db), null),
    ...entries.map((entry, k) => tile(pictures.entries[k], side, entry.name, decibels(crop.psnr_db[k]), entry.method)),
  ];
  const heading = element("h3", {}, `Crop ${i + 1} `, element("small", {}, `${side} × ${side} pixels from column ${crop.x}, row ${crop.y}`));
  return element("section", { class: "place" }, heading, element("div", { class: "tiles" }, ...tiles));
}

/** A small whole picture with the crops marked. */
function locator() {
  const { width: w, height: h } = pictureSize();
  const image = element("img", { src: assets.reference ?? assets.pinhole, alt: "Positions of the crops in the picture" });
  const marks = svg("svg", { viewBox: `0 0 ${w} ${h}`, "aria-hidden": "true" });
  const size = Math.max(h / 18, 8);
  results.crops.forEach(({ x, y, side_px: side }, i) => {
    marks.append(svg("rect", { x, y, width: side, height: side }));
    marks.append(svg("text", { x: x + side / 2, y: y + side / 2 + size / 3, "text-anchor": "middle", "font-size": size }, i + 1));
  });
  byId("locator").append(image, marks);
}

/** Hides the pictures of hidden methods. */
function filterCrops() {
  for (const node of byId("crops").querySelectorAll(".tile")) node.hidden = view.hidden.has(node.dataset.method);
}

function drawCrops() {
  if (results.crops.length === 0) {
    byId("crops-section").hidden = true;
    return;
  }
  byId("crops-note").textContent = `The squares in which the pictures differ most from one another, at twice their size, without loss.`
    + ` Decibels are of the square alone, against ${baseline}.`;
  locator();
  byId("crops").append(...results.crops.map(place));
}
