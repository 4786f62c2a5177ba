// SPDX-License-Identifier: Apache-2.0
// "Drag the three transfers": Sections III and IV of the paper to the letter, in the reader's browser. What the text leaves
// open is decided as in grasptrack_bench.baselines.literal, against which tests/slow/test_transfers_page.py holds each answer.
"use strict";
(() => {
  const { camera, parts, colours } = TRANSFERS;
  const DEGREE = Math.PI / 180;
  const ROUNDING = 1e-10;  // of the highest curvature, see grasptrack_bench.baselines.literal
  const NAMES = { "rrp": "RRP", "grasp-line": "grasp line", "homography": "homography" };

  class Refusal extends Error {}

  // --- vectors, and homographies as rows ---------------------------------------------------------

  const minus = (p, q) => [p[0] - q[0], p[1] - q[1]];
  const along = (p, u, t) => [p[0] + t * u[0], p[1] + t * u[1]];
  const cross = (p, q) => p[0] * q[1] - p[1] * q[0];
  const dot = (p, q) => p[0] * q[0] + p[1] * q[1];
  const norm = p => Math.hypot(p[0], p[1]);
  const unit = a => [Math.cos(a), Math.sin(a)];
  const mod = (a, n) => ((a % n) + n) % n;
  const product = (A, B) => A.map(row => B[0].map((_, j) => row.reduce((sum, a, k) => sum + a * B[k][j], 0)));
  const cross3 = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const dot3 = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const depth = (H, p) => dot3(H[2], [...p, 1]);  // lambda of eq. (2)
  const carry = (H, p) => [dot3(H[0], [...p, 1]) / depth(H, p), dot3(H[1], [...p, 1]) / depth(H, p)];  // eq. (2)

  function rotation(axis, angle) {
    const [c, s] = unit(angle);
    return axis === "z" ? [[c, -s, 0], [s, c, 0], [0, 0, 1]] : [[1, 0, 0], [0, c, -s], [0, s, c]];
  }

  // From the table to the image: the camera looks at the table's origin, tilted about an axis of that azimuth, turned, nearer.
  function tableToImage({ tilt, azimuth, turn, scale }) {
    const lean = [["z", turn + azimuth], ["x", tilt], ["z", -azimuth]].map(([axis, a]) => rotation(axis, a * DEGREE));
    const R = lean.reduce(product);
    return product(camera.matrix, R.map((row, i) => [row[0], row[1], i < 2 ? 0 : camera.distance / scale]));
  }

  // --- closed contours as curves of their arc length ---------------------------------------------

  function arcLength(points) {
    const arc = [0];
    points.forEach((p, i) => arc.push(arc[i] + norm(minus(points[(i + 1) % points.length], p))));
    return arc;
  }

  // Side and px along it of a place so many px from the first point.
  function locate(arc, s) {
    const length = arc[arc.length - 1], rest = mod(s, length);
    let low = 0, high = arc.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (arc[middle] <= rest) low = middle; else high = middle;
    }
    return [low, rest - arc[low]];
  }

  function pointAt(points, arc, s) {
    const [i, d] = locate(arc, s), side = minus(points[(i + 1) % points.length], points[i]);
    return along(points[i], side, arc[i + 1] > arc[i] ? d / (arc[i + 1] - arc[i]) : 0);
  }

  // Closed polygons, the outer one first, in equal steps; the outer contour begins so many steps further on.
  function sample(polygons, start) {
    const arcs = polygons.map(arcLength), lengths = arcs.map(arc => arc[arc.length - 1]);
    return polygons.map((points, k) => {
      const share = TRANSFERS.points * lengths[k] / lengths[0];
      const count = k ? Math.max(TRANSFERS.leastPoints, Math.round(share)) : TRANSFERS.points;
      const step = lengths[k] / count;
      return Array.from({ length: count }, (_, i) => pointAt(points, arcs[k], (i + (k ? 0 : start)) * step));
    });
  }

  // Curvature in 1/px at each point, from the turn between means of the curve over one step (the paper leaves its scale open).
  function curvature(points) {
    const arc = arcLength(points), n = points.length, length = arc[n], step = TRANSFERS.smoothing * length;
    const start = points.map(p => minus(p, points[0])), sides = start.map((p, i) => minus(start[(i + 1) % n], p));
    const sums = [[0, 0]];
    sides.forEach((side, i) => sums.push(along(sums[i], along(start[i], side, 0.5), arc[i + 1] - arc[i])));
    const integral = s => {
      const [i, d] = locate(arc, s), part = along(start[i], sides[i], 0.5 * d / (arc[i + 1] - arc[i]));
      return along(along(sums[i], part, d), sums[n], Math.floor(s / length));
    };
    return points.map((_, i) => {
      const [a, b, c, d] = [-1.5, -0.5, 0.5, 1.5].map(k => integral(arc[i] + k * step));
      const before = minus(minus(c, b), minus(b, a)), after = minus(minus(d, c), minus(c, b));
      return Math.atan2(cross(before, after), dot(before, after)) / step;
    });
  }

  // Area, centroid and direction of I_min of the silhouette, from its moments of second order (Section III-B, [15]).
  function inertia(contours) {
    let m = [0, 0, 0, 0, 0, 0];
    const origin = contours[0][0];
    for (const points of contours) {
      points.forEach((p, i) => {
        const [x, y] = minus(p, origin), [X, Y] = minus(points[(i + 1) % points.length], origin), a = x * Y - X * y;
        const terms = [1 / 2, (x + X) / 6, (y + Y) / 6, (x * x + x * X + X * X) / 12, (y * y + y * Y + Y * Y) / 12,
                       (2 * x * y + x * Y + X * y + 2 * X * Y) / 24];
        m = m.map((sum, k) => sum + a * terms[k]);
      });
    }
    const [area, x, y, xx, yy, xy] = m.map((value, k) => k ? value / m[0] : value);
    return { area, centroid: along(origin, [x, y], 1), theta: 0.5 * Math.atan2(2 * (xy - x * y), xx - x * x - yy + y * y) };
  }

  // The crossings of a line with the contours that are nearest to places t1 and t2 along it (Fig. 11); null if it has none.
  function nearestCrossings(contours, from, u, wanted) {
    const found = [];
    for (const points of contours) {
      const n = points.length, t = points.map(p => dot(minus(p, from), u)), d = points.map(p => cross(u, minus(p, from)));
      const off = [...d.keys()].filter(i => d[i] !== 0);
      off.forEach((i, k) => {
        const j = off[(k + 1) % off.length];
        if ((d[i] > 0) === (d[j] > 0)) return;
        const first = (i + 1) % n, last = mod(j - 1, n);
        found.push(first === j ? t[i] + d[i] / (d[i] - d[j]) * (t[j] - t[i]) : Math.min(t[first], t[last]));
      });
    }
    found.sort((a, b) => a - b);
    const nearest = wanted.map(w => found.reduce((best, t) => Math.abs(t - w) < Math.abs(best - w) ? t : best, found[0]));
    return found.length && nearest[0] !== nearest[1] ? nearest.map(t => along(from, u, t)) : null;
  }

  // --- the three transfers (Fig. 6): each gives contacts, and keeps what it finds on its way --------

  // Sections III-A and IV-A, Fig. 7: (c, ref, interp) names a sample; the tracked contour has it at the same place.
  function transferRRP(first, contacts, tracked, way) {
    const places = contacts.map(contact => {
      const all = first.flatMap((points, c) => points.map((p, i) => ({ c, i, off: norm(minus(p, contact)) })));
      return all.reduce((best, one) => one.off < best.off ? one : best);
    });
    way.tracked = tracked;
    return places.map(({ c, i }) => tracked[c][i]);
  }

  // Sections III-B and IV-B, Fig. 8: (d_c, alpha_m, d_1, d_2), distances over the area.
  function transferGraspLine(first, contacts, second, way) {
    const one = inertia(first), other = inertia(second);
    const opening = norm(minus(contacts[1], contacts[0]));
    const u = minus(contacts[1], contacts[0]).map(v => v / opening), axis = unit(one.theta), sine = cross(axis, u);
    const centre = minus(one.centroid, contacts[0]), left = cross(centre, u);
    const meets = dot(centre, u) - left * dot(axis, u) / sine;  // where the line meets I_min
    const description = { d_c: left / one.area, alpha_m: Math.atan2(sine, dot(axis, u)),
                          d: [-meets / one.area, (opening - meets) / one.area] };
    // I_min has two directions: that which turns less from the first view
    const theta = other.theta + (dot(unit(other.theta), axis) > 0 ? 0 : Math.PI);
    const ahead = unit(theta + description.alpha_m);
    const shift = -description.d_c * other.area / Math.sin(description.alpha_m);
    const from = along(other.centroid, unit(theta), shift);
    Object.assign(way, { line: [from, ahead], centroid: other.centroid, axis: unit(theta) });
    const found = nearestCrossings(second, from, ahead, description.d.map(d => d * other.area));
    if (!found) throw new Refusal("the grasp line does not meet the outline twice");
    return found;
  }

  // Section IV-C, Figs. 9 to 11: four peaks, eq. (3), eq. (2), refinement.
  function transferHomography(first, contacts, second, way) {
    const v = curvature(first[0]), w = curvature(second[0]);
    const peaks = highestPeaks(v), alike = peaks.map(i => matches(v, i, w)), matched = alike.map(js => js[0]);
    Object.assign(way, { peaks, matched, tied: [...peaks.keys()].filter(k => alike[k].length > 1) });
    const H = homographyOf(peaks.map(i => first[0][i]), matched.map(j => second[0][j]));
    const depths = contacts.map(p => depth(H, p) * Math.sign(depth(H, contacts[0])));
    if (!(Math.min(...depths) > 1e-9)) throw new Refusal("the homography sends part of the object to infinity");
    const applied = contacts.map(p => carry(H, p));
    const opening = norm(minus(applied[1], applied[0]));
    const u = minus(applied[1], applied[0]).map(d => d / opening);
    const found = nearestCrossings(second, applied[0], u, [0, opening]);
    if (!found) throw new Refusal("the line through the transferred contacts does not meet the outline twice");
    return found;
  }

  const rounding = v => ROUNDING * Math.max(...v.map(Math.abs));

  // Indices of the four peaks with the highest curvature: of equal neighbours the last, of equal peaks the first.
  function highestPeaks(v) {
    const n = v.length, height = v.map(Math.abs), equal = rounding(v);
    const crest = [...v.keys()].filter(i => height[i] >= height[mod(i - 1, n)] - equal && height[i] > height[(i + 1) % n] + equal);
    if (crest.length < 4) throw new Refusal(`the outline has ${crest.length} peaks of curvature; a homography needs four`);
    const order = (i, j) => Math.abs(height[j] - height[i]) > equal ? height[j] - height[i] : i - j;
    return crest.sort(order).slice(0, 4).sort((i, j) => i - j);
  }

  // The j of least d(p_i, p'_j), eq. (3), within [i_c - kappa xi, i_c + kappa xi] about i_c = kappa i. Where a straight side
  // leaves nothing to match, several are least but for rounding; the text does not say which then, and the first is taken.
  function matches(v, i, w) {
    const n = v.length, m = w.length, kappa = m / n;
    const radius = Math.round(TRANSFERS.neighbourhood * n), reach = kappa * Math.round(TRANSFERS.search * n);
    const read = x => {
      const at = mod(x, m), low = Math.floor(at);
      return w[low] + (at - low) * (w[(low + 1) % m] - w[low]);
    };
    const found = [];
    for (let j = Math.ceil(kappa * i - reach); j <= Math.floor(kappa * i + reach); j++) {
      let error = 0;
      for (let k = -radius; k <= radius; k++) error += Math.abs(v[mod(i + k, n)] - read(j + kappa * k));
      found.push([mod(j, m), error]);
    }
    const least = Math.min(...found.map(([, error]) => error));
    const equal = (2 * radius + 1) * rounding(v);
    return found.filter(([, error]) => error <= least + equal).map(([j]) => j);
  }

  // H of eq. (1) from the linear system that four points make of eq. (2): each as a sum of the other three.
  function homographyOf(source, target) {
    const normalise = points => {
      const mean = [0, 1].map(k => points.reduce((sum, p) => sum + p[k], 0) / 4);
      const size = Math.sqrt(points.reduce((sum, p) => sum + dot(minus(p, mean), minus(p, mean)), 0) / 4);
      return { mean, size, points: points.map(p => [...minus(p, mean).map(x => x / size), 1]) };
    };
    const weights = p => {
      const crosses = [cross3(p[1], p[2]), cross3(p[2], p[0]), cross3(p[0], p[1])], found = crosses.map(c => dot3(c, p[3]));
      const least = Math.min(...found.map(Math.abs), Math.abs(dot3(crosses[0], p[0])));
      if (!(least > 1e-10)) throw new Refusal("the four correspondences give no homography");
      return found;
    };
    const p = normalise(source), q = normalise(target), [mu, lambda] = [weights(q.points), weights(p.points)];
    let H = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
    for (let i = 0; i < 3; i++) {
      const other = cross3(p.points[(i + 1) % 3], p.points[(i + 2) % 3]);
      H = H.map((row, r) => row.map((h, c) => h + mu[i] / lambda[i] * q.points[i][r] * other[c]));
    }
    const S = [[1 / p.size, 0, -p.mean[0] / p.size], [0, 1 / p.size, -p.mean[1] / p.size], [0, 0, 1]];
    H = product(product([[q.size, 0, q.mean[0]], [0, q.size, q.mean[1]], [0, 0, 1]], H), S);
    return H.map(row => row.map(h => h / H[2][2]));
  }

  // --- a setting: both views, and the three answers ----------------------------------------------

  // The contours moved by the similarity that comes nearest to the true motion: a perfect tracker of 4 DoF.
  function trackedContours(first, toImage) {
    const f = camera.matrix[0][0] / camera.distance, centre = [camera.matrix[0][2], camera.matrix[1][2]];
    const moved = first.map(points => points.map(p => carry(toImage, minus(p, centre).map(x => x / f))));
    const [from, to] = [first.flat(), moved.flat()];
    const [g, h] = [from, to].map(all => [0, 1].map(k => all.reduce((sum, p) => sum + p[k], 0) / all.length));
    let c = 0, s = 0, square = 0;
    from.forEach((p, i) => {
      const [a, b] = [minus(p, g), minus(to[i], h)];
      [c, s, square] = [c + dot(a, b), s + cross(a, b), square + dot(a, a)];
    });
    const turned = ([x, y]) => [(c * x - s * y) / square + h[0], (s * x + c * y) / square + h[1]];
    return first.map(points => points.map(p => turned(minus(p, g))));
  }

  // Normal deviates that are the same each time (Mulberry32, Box and Muller).
  function deviates(seed) {
    const uniform = () => {
      seed = (seed + 0x6D2B79F5) | 0;
      let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
      t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
      return (((t ^ (t >>> 14)) >>> 0) + 0.5) / 4294967296;
    };
    return () => Math.sqrt(-2 * Math.log(uniform())) * Math.cos(2 * Math.PI * uniform());
  }

  function solve(setting) {
    const part = parts[setting.part], toImage = tableToImage(setting);
    const front = tableToImage({ tilt: 0, azimuth: 0, turn: 0, scale: 1 });
    const seen = (H, points) => points.map(p => carry(H, p));
    const first = sample(part.curves.map(curve => seen(front, curve)), 0), contacts = seen(front, part.contacts);
    const normal = deviates(1);
    const second = sample(part.curves.map(curve => seen(toImage, curve)), setting.start)
      .map(points => points.map(p => p.map(x => x + setting.noise * normal())));
    const tracked = trackedContours(first, toImage), truth = seen(toImage, part.contacts);
    const transfers = { "rrp": way => transferRRP(first, contacts, tracked, way),
                        "grasp-line": way => transferGraspLine(first, contacts, second, way),
                        "homography": way => transferHomography(first, contacts, second, way) };
    const answers = {};
    for (const [name, transfer] of Object.entries(transfers)) {
      const answer = answers[name] = {};
      try {
        answer.contacts = transfer(answer);
        answer.errors = answer.contacts.map((p, i) => norm(minus(p, truth[i])));
      } catch (refusal) {
        if (!(refusal instanceof Refusal)) throw refusal;
        answer.reason = refusal.message;
      }
    }
    return { first, contacts, second, tracked, truth, answers };
  }

  // --- the page ----------------------------------------------------------------------------------

  const SLIDERS = {  // least, most, step, unit
    tilt: [0, 60, 1, "°"], azimuth: [-180, 180, 1, "°"], turn: [-180, 180, 1, "°"], scale: [0.5, 1.5, 0.01, "×"],
    start: [-150, 150, 0.5, " samples"], noise: [0, 2, 0.05, " px"],
  };
  const LABELS = { azimuth: "Azimuth of tilt", start: "Start of contour", noise: "Noise, not of RRP" };
  const setting = { part: "bracket", tilt: 20, azimuth: 30, turn: 10, scale: 1, start: 0, noise: 0 };
  const root = document.getElementById("transfers");
  let shown = "rrp", pixel = 1;  // of marks, in px of the image

  function make(parent, name, attributes = {}, text = "") {
    const made = document.createElementNS(parent.namespaceURI, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.textContent = text;
    return parent.appendChild(made);
  }

  function picture(title) {
    const figure = make(root.querySelector(".views"), "figure");
    const svg = figure.appendChild(document.createElementNS("http://www.w3.org/2000/svg", "svg"));
    svg.setAttribute("role", "img");
    svg.setAttribute("aria-label", title);
    make(figure, "figcaption", {}, title);
    return svg;
  }

  const path = contours => contours.map(points => `M${points.map(p => p.map(x => x.toFixed(2)).join()).join("L")}Z`).join("");
  const MARKS = {
    "truth": "M-16,0H16M0,-16V16", "rrp": "M-10,0a10,10 0 1 0 20,0a10,10 0 1 0 -20,0Z", "grasp-line": "M-10,-10H10V10H-10Z",
    "homography": "M0,-13L12,9H-12Z",
  };
  const mark = (svg, kind, [x, y]) => make(svg, "path", { d: MARKS[kind], class: `mark ${kind}`, transform: `translate(${x},${y}) scale(${pixel})` });

  function drawView(svg, contours, contacts, frame) {
    svg.replaceChildren();
    svg.setAttribute("viewBox", frame);
    make(svg, "path", { d: path(contours), class: "part" });
    const [p, q] = contours[0], ahead = minus(q, p), turned = Math.atan2(ahead[1], ahead[0]) / DEGREE;
    make(svg, "path", { d: "M-6,-10L14,0L-6,10Z", class: "start", transform: `translate(${p}) rotate(${turned}) scale(${pixel})` });
    contacts.forEach(contact => mark(svg, "truth", contact));
  }

  const numbered = (svg, points) => points.forEach((p, i) => {
    const place = make(svg, "g", { transform: `translate(${p}) scale(${pixel})` });
    make(place, "circle", { r: 5, class: "homography way" });
    make(place, "text", { x: 8, y: -8 }, String(i + 1));
  });

  function drawWay(answer, from, to) {  // how the chosen transfer came to its answer
    if (answer.tracked) make(second, "path", { d: path(answer.tracked), class: "rrp way" });
    if (answer.line) {
      const ends = (p, u, t) => path([[along(p, u, -t), along(p, u, t)]]);
      make(second, "path", { d: ends(...answer.line, 900), class: "grasp-line way" });
      make(second, "path", { d: ends(answer.centroid, answer.axis, 120), class: "axis" });
    }
    if (answer.peaks) {
      numbered(first, answer.peaks.map(i => from[i]));
      numbered(second, answer.matched.map(j => to[j]));
    }
  }

  function show(changed = {}) {
    Object.assign(setting, changed);
    const found = solve(setting);
    const middle = camera.size.map(x => x / 2), radius = Math.max(...found.first[0].map(p => norm(minus(p, middle))));
    const size = [3.8 * radius, 2.85 * radius], frame = [...minus(middle, size.map(x => x / 2)), ...size].join(" ");
    pixel = 0.7 * size[0] / second.clientWidth;
    drawView(first, found.first, found.contacts, frame);
    drawView(second, found.second, found.truth, frame);
    drawWay(found.answers[shown], found.first[0], found.second[0]);
    for (const [name, answer] of Object.entries(found.answers)) {
      (answer.contacts || []).forEach(contact => mark(second, name, contact));
      const row = root.querySelector(`tr.${name}`);
      while (row.cells.length > 1) row.deleteCell(1);
      if (answer.reason) make(row, "td", { colspan: 2 }, `refused: ${answer.reason}`);
      else answer.errors.forEach(error => make(row, "td", {}, `${error.toFixed(2)} px`));
      const tied = (answer.tied || []).map(k => k + 1).join(", ");
      if (tied) make(row.lastChild, "small", {}, `Eq. (3) is least at several places for peak ${tied}: the first is taken.`);
    }
    root.querySelector("select").value = setting.part;
    for (const [name, [, , step, sign]] of Object.entries(SLIDERS)) {
      const [input, output] = root.querySelectorAll(`[name=${name}]`);
      input.value = setting[name];
      output.value = `${setting[name].toFixed(step < 0.1 ? 2 : step < 1 ? 1 : 0)}${sign}`;
    }
    return found;
  }

  // --- dragging ----------------------------------------------------------------------------------

  const within = (low, high, x) => Math.min(high, Math.max(low, x));
  const around = (x, turn) => mod(x + turn / 2, turn) - turn / 2;
  const pointers = new Map();
  let atStart = false;

  function placeOf(event) {
    const p = new DOMPoint(event.clientX, event.clientY).matrixTransform(second.getScreenCTM().inverse());
    return [p.x, p.y];
  }

  function dragged(event) {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = placeOf(event), moved = minus(now, before), { tilt, azimuth, turn, scale } = setting;
    pointers.set(event.pointerId, now);
    if (pointers.size === 2) {  // two fingers turn and bring nearer
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1], [a, b] = [minus(before, other), minus(now, other)];
      const angle = Math.atan2(cross(a, b), dot(a, b)) / DEGREE;
      show({ turn: around(turn + angle, 360), scale: within(0.5, 1.5, scale * norm(b) / norm(a)) });
    } else if (atStart) {
      const points = solve({ ...setting, noise: 0 }).second[0];
      const nearest = points.reduce((best, p, i) => norm(minus(p, now)) < norm(minus(points[best], now)) ? i : best, 0);
      show({ start: around(setting.start + nearest, points.length) });
    } else {  // the axis lies across the way that is dragged
      const axis = unit((azimuth + turn) * DEGREE).map(x => x * tilt), [x, y] = [axis[0] - 0.2 * moved[1], axis[1] + 0.2 * moved[0]];
      show({ tilt: Math.min(60, Math.hypot(x, y)), azimuth: around(Math.atan2(y, x) / DEGREE - turn, 360) });
    }
  }

  make(root, "div", { class: "views" });
  const first = picture("First view, with the grasp"), second = picture("Second view: drag it, or the arrow where its contour starts");
  second.addEventListener("pointerdown", event => {
    second.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, placeOf(event));
    atStart = event.target.classList.contains("start");
  });
  second.addEventListener("pointermove", dragged);
  for (const end of ["pointerup", "pointercancel"]) second.addEventListener(end, event => pointers.delete(event.pointerId));

  const answersTable = make(make(root, "div", { class: "answers" }), "table");
  const head = make(answersTable, "tr");
  ["see how", "off at contact 1", "at contact 2"].forEach(text => make(head, "th", { scope: "col" }, text));
  for (const [name, text] of Object.entries(NAMES)) {
    root.style.setProperty(`--${name}`, colours[name]);
    const label = make(make(make(answersTable, "tr", { class: name }), "th", { scope: "row" }), "label");
    const radio = make(label, "input", { type: "radio", name: "shown" });
    radio.checked = name === shown;
    radio.addEventListener("change", () => { shown = name; show(); });
    const sign = label.appendChild(document.createElementNS("http://www.w3.org/2000/svg", "svg"));
    sign.setAttribute("viewBox", "-16 -16 32 32");
    make(sign, "path", { d: MARKS[name], class: "mark" });
    label.append(text);
  }

  const form = make(root, "form"), choice = make(form, "label", {}, "Outline"), select = make(choice, "select");
  Object.keys(parts).forEach(name => make(select, "option", { value: name }, name));
  select.addEventListener("change", () => show({ part: select.value }));
  for (const [name, [min, max, step]] of Object.entries(SLIDERS)) {
    const label = make(form, "label", {}, LABELS[name] || name[0].toUpperCase() + name.slice(1));
    const input = make(label, "input", { type: "range", name, min, max, step });
    make(label, "output", { name });
    input.addEventListener("input", () => show({ [name]: input.valueAsNumber }));
  }
  show();
  window.addEventListener("resize", () => show());
  window.showTransfers = show;
})();
