// The plots of the page, drawn as SVG in pixels of the page, so that letters are as large on a phone as on a desk.

const NS = "http://www.w3.org/2000/svg";
const MOST_SINGLE = 1500; // markers that are elements of their own; more are drawn as one path

export function svg(name, attributes = {}, ...children) {
  const element = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

const corners = (n, turn, inner = 1) =>
  Array.from({ length: inner < 1 ? 2 * n : n }, (_, i) => {
    const angle = turn + (2 * Math.PI * i) / (inner < 1 ? 2 * n : n);
    const radius = inner < 1 && i % 2 ? inner : 1;
    return [radius * Math.sin(angle), -radius * Math.cos(angle)];
  });
const plus = (turn) =>
  [[-1, -3], [1, -3], [1, -1], [3, -1], [3, 1], [1, 1], [1, 3], [-1, 3], [-1, 1], [-3, 1], [-3, -1], [-1, -1]].map(
    ([x, y]) => [(x * Math.cos(turn) - y * Math.sin(turn)) / 3, (x * Math.sin(turn) + y * Math.cos(turn)) / 3]);
const SHAPES = {
  o: corners(24, 0), s: corners(4, Math.PI / 4), D: corners(4, 0), "^": corners(3, 0), v: corners(3, Math.PI),
  "<": corners(3, -Math.PI / 2), ">": corners(3, Math.PI / 2), P: plus(0), X: plus(Math.PI / 4),
  "*": corners(5, 0, 0.45), p: corners(5, 0), h: corners(6, 0),
};

function markerPath(kind, x, y, size) {
  const places = SHAPES[kind].map(([dx, dy]) => `${(x + size * dx).toFixed(2)} ${(y + size * dy).toFixed(2)}`);
  return `M${places.join("L")}Z`;
}

export function legendMarker(kind, colour) {
  return svg("svg", { width: 14, height: 14, "aria-hidden": "true" },
    svg("path", { d: markerPath(kind, 7, 7, kind === "o" ? 4.5 : 5.5), fill: colour }));
}

const linear = ([low, high], from, to) => (value) => from + ((value - low) / (high - low)) * (to - from);
const logarithmic = (ends, from, to) => {
  const place = linear(ends.map(Math.log), from, to);
  return (value) => place(Math.log(value));
};
const ratio = (x, y, anchor, before, after) =>
  svg("text", { x, y, "text-anchor": anchor }, before, svg("tspan", { dy: 3, "font-size": 9 }, "max"),
    svg("tspan", { dy: -3 }, " / E"), svg("tspan", { dy: 3, "font-size": 9 }, "min"), svg("tspan", { dy: -3 }, after));

// Draw grid, axes and their labels, and return the drawing with its two scales.
function frame(width, height, box, x, y, scales) {
  const drawing = svg("svg", { width, height, role: "img" });
  const place = [scales[0](x.ends, box.left, width - box.right), scales[1](y.ends, height - box.bottom, box.top)];
  const foot = height - box.bottom;
  let last = -Infinity;
  for (const [value, label] of x.ticks) {
    const at = place[0](value);
    drawing.append(svg("line", { class: "grid", x1: at, x2: at, y1: box.top, y2: foot }));
    if (at - last < 6.5 * label.length + 8) continue; // no room for its label
    last = at;
    drawing.append(svg("text", { x: at, y: foot + 17, "text-anchor": "middle" }, label));
  }
  for (const [value, label] of y.ticks) {
    const at = place[1](value);
    drawing.append(svg("line", { class: "grid", x1: box.left, x2: width - box.right, y1: at, y2: at }),
      svg("text", { x: box.left - 7, y: at + 4, "text-anchor": "end" }, label));
  }
  drawing.append(svg("path", { class: "axis", d: `M${box.left} ${box.top}V${foot}H${width - box.right}` }),
    svg("text", { transform: `translate(13 ${(box.top + foot) / 2}) rotate(-90)`, "text-anchor": "middle" }, y.label));
  return [drawing, ...place];
}

function upperAxis(drawing, width, box, ticks, place) {
  drawing.append(svg("path", { class: "axis", d: `M${box.left} ${box.top}H${width - box.right}` }));
  let last = -Infinity;
  for (const [value, label] of ticks) {
    const at = place(value);
    if (at - last < 6.5 * label.length + 8) continue;
    last = at;
    drawing.append(svg("line", { class: "axis", x1: at, x2: at, y1: box.top, y2: box.top - 4 }),
      svg("text", { x: at, y: box.top - 8, "text-anchor": "middle" }, label));
  }
  drawing.append(ratio((box.left + width - box.right) / 2, box.top - 27, "middle", "linear contrast \u2002E", " − 1"));
}

export function responsePlot(width, family, panel) {
  const height = Math.max(300, Math.min(400, 0.72 * width)), box = { left: 48, right: 12, top: 62, bottom: 44 };
  const y = { ends: [-0.04, 1.04], ticks: [0, 0.2, 0.4, 0.6, 0.8, 1].map((v) => [v, v.toFixed(1)]),
    label: "response probability" };
  const [drawing, px, py] = frame(width, height, box, family.x, y, [linear, linear]);
  upperAxis(drawing, width, box, family.x.top, px);
  drawing.append(svg("text", { x: box.left, y: 14, class: "name" }, panel.polarity.toUpperCase()),
    ratio((box.left + width - box.right) / 2, height - 7, "middle", "log contrast \u2002ln(E", ")"));
  const single = panel.curves.reduce((sum, curve) => sum + curve.points.length, 0) <= MOST_SINGLE;
  for (const curve of panel.curves) drawing.append(...curveShapes(curve, px, py, single));
  drawing.setAttribute("aria-label", `${panel.polarity.toUpperCase()} response probability against log contrast`);
  return drawing;
}

function curveShapes(curve, px, py, single) {
  const points = curve.points.filter((point) => point[2] !== null);
  const bars = points.map(([, x, , low, high]) => `M${px(x).toFixed(2)} ${py(low).toFixed(2)}V${py(high).toFixed(2)}`);
  const shapes = [
    svg("polyline", { points: means(points).map(([x, p]) => `${px(x).toFixed(2)},${py(p).toFixed(2)}`).join(" "),
      fill: "none", stroke: curve.colour, "stroke-width": 1, "stroke-opacity": 0.55 }),
    svg("path", { d: bars.join(""), stroke: curve.colour, "stroke-width": 1.4, "stroke-opacity": 0.8 }),
  ];
  const size = points.length > 60 ? 2.6 : curve.marker === "o" ? 3.6 : 4.4;
  const paths = points.map(([, x, p]) => markerPath(curve.marker, px(x), py(p), size));
  if (!single) return [...shapes, svg("path", { d: paths.join(""), fill: curve.colour })];
  return [...shapes, ...paths.map((d, i) => svg("path", { d, fill: curve.colour, "data-point": points[i][0] }))];
}

// Points of one contrast, taken more than once, are joined by their mean.
function means(points) {
  const by = new Map();
  for (const [, x, p] of points) by.set(x, [...(by.get(x) ?? []), p]);
  return [...by].map(([x, all]) => [x, all.reduce((a, b) => a + b) / all.length]);
}

export function backgroundPlot(width, data) {
  const longest = Math.max(...data.y.ticks.map(([, label]) => label.length));
  const height = Math.max(260, Math.min(340, 0.6 * width)), box = { left: 34 + 7 * longest, right: 12, top: 12, bottom: 44 };
  const y = { ...data.y, label: "background rate per pixel (Hz)" };
  const [drawing, px, py] = frame(width, height, box, data.x, y, [logarithmic, logarithmic]);
  drawing.append(svg("text", { x: (box.left + width - box.right) / 2, y: height - 7, "text-anchor": "middle" },
    "illuminance on chip"));
  for (const rate of data.rates) {
    const x = px(rate.x), top = py(rate.high), foot = rate.limit ? top + 26 : py(Math.max(rate.low, data.y.ends[0]));
    const look = { fill: "none", stroke: rate.colour, "stroke-width": 1.5 };
    drawing.append(svg("path", { d: `M${x} ${top}V${foot}${rate.limit ? `m-4 -6l4 6l4 -6M${x - 5} ${top}h10` : ""}`, ...look }));
    const marker = rate.limit ? `M${x - 6} ${top}h12V${foot}h-12Z` : markerPath(rate.marker, x, py(rate.rate), 5.5);
    drawing.append(svg("path", { d: marker, fill: rate.colour, "fill-opacity": rate.limit ? 0 : 1, "data-point": rate.point }));
  }
  drawing.setAttribute("aria-label", "background rate per pixel against illuminance on chip");
  return drawing;
}
