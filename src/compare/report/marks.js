// A colour and a shape for every method; each alone distinguishes the methods.

/** Corners on a circle of radius 1, the first at `turn` of a full turn from the top. */
function corners(count, turn = 0, radius = () => 1) {
  return Array.from({ length: count }, (_, i) => {
    const angle = 2 * Math.PI * (i / count + turn) - Math.PI / 2;
    return [radius(i) * Math.cos(angle), radius(i) * Math.sin(angle)];
  });
}

/** @param {number[][]} points */
function outline(points) {
  return `M${points.map(([x, y]) => `${x.toFixed(3)} ${y.toFixed(3)}`).join("L")}Z`;
}

/** A bar cross with arms of half-width `w`, turned by `turn`. */
function cross(w, turn) {
  const corner = [[-w, -1], [w, -1], [w, -w], [1, -w], [1, w], [w, w], [w, 1], [-w, 1], [-w, w], [-1, w], [-1, -w], [-w, -w]];
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  return outline(corner.map(([x, y]) => [c * x - s * y, s * x + c * y]));
}

/** Outlines of about equal area, radius about 1; the index in this list is that of the method in the registry. */
const SHAPES = [
  "M1 0A1 1 0 1 1 -1 0A1 1 0 1 1 1 0Z",
  outline(corners(10, 0, (i) => (i % 2 ? 0.5 : 1.3))),
  outline([[-0.88, -0.88], [0.88, -0.88], [0.88, 0.88], [-0.88, 0.88]]),
  outline(corners(3, 0, () => 1.25)),
  outline(corners(3, 0.5, () => 1.25)),
  outline(corners(4, 0, () => 1.25)),
  cross(0.38, 0),
  cross(0.38, Math.PI / 4),
  outline(corners(6, 0, () => 1.1)),
  outline([[-1, -1], [1, -1], [-1, 1], [1, 1]]),
  outline(corners(5, 0, () => 1.15)),
];

/** @param {string} method */
function indexOf(method) {
  return Math.max(0, methods.indexOf(method)) % SHAPES.length;
}

/** The mark of a method at the origin, of radius `size`. @param {string} method @param {number} size */
function mark(method, size) {
  const index = indexOf(method);
  return svg("path", { d: SHAPES[index], class: `mark m${index}`, transform: `scale(${size})` });
}

/** The mark as a picture in a line of text. @param {string} method */
function inlineMark(method) {
  return svg("svg", { class: "key", viewBox: "-7 -7 14 14", width: 14, height: 14, "aria-hidden": "true" }, mark(method, 5));
}
