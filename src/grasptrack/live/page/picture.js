// SPDX-License-Identifier: Apache-2.0
// The image with what is known of it, drawn at the screen's own resolution; and a loupe.
// Places are px of the image, the centre of its top-left pixel at (0, 0).

export const NUMBER_COLOURS = ["#ffd23f", "#56b4e9", "#e07ab8"];
const DARK = "rgb(8 12 16 / 85%)";
const LOUPE = 8; // screen px per px of the image, at least
const FARTHEST = 24; // times the size at which the whole image is in view
const SNAPSHOT = 960; // px of a snapshot's width at least: what is drawn shall be legible

export class Picture {
  constructor(canvas, loupe) {
    Object.assign(this, { canvas, loupe, bitmap: null, moment: null, sketch: null, cursor: null, pointed: 0, tool: "object", tone: "searching" });
    this.style = getComputedStyle(document.body);
    this.scale = 1;
    this.left = this.top = 0;
    this.zoom = 1;
    this.centre = [0, 0]; // of the frame, px of the image from its upper left corner
  }

  show(moment, bitmap) {
    this.moment = moment;
    this.bitmap = bitmap;
    const aspect = bitmap ? `${bitmap.width} / ${bitmap.height}` : this.aspect;
    if (aspect !== this.aspect) this.zoom = 1;
    if (aspect !== this.aspect) this.canvas.parentElement.style.setProperty("--aspect", (this.aspect = aspect));
    this.draw();
  }

  layout() {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(this.canvas.clientWidth * ratio);
    const height = Math.round(this.canvas.clientHeight * ratio);
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    if (!this.bitmap) return;
    this.ratio = ratio;
    const rooms = [width, height];
    const sizes = [this.bitmap.width, this.bitmap.height];
    this.fit = Math.min(...rooms.map((room, k) => room / sizes[k]));
    this.scale = this.fit * this.zoom;
    // Where it is smaller than its frame the image lies in the middle; where it is larger it leaves nothing of the frame empty.
    [this.left, this.top] = rooms.map((room, k) => {
      const free = room - this.scale * sizes[k];
      const start = free >= 0 ? free / 2 : Math.min(Math.max(room / 2 - this.centre[k] * this.scale, free), 0);
      this.centre[k] = (room / 2 - start) / this.scale;
      return start;
    });
  }

  // A place of the window as px of the canvas.
  onCanvas(clientX, clientY) {
    const box = this.canvas.getBoundingClientRect();
    return [((clientX - box.left) * this.canvas.width) / box.width, ((clientY - box.top) * this.canvas.height) / box.height];
  }

  // Larger or smaller; what lies below a place of the window stays there.
  zoomAt(clientX, clientY, factor) {
    if (!this.bitmap) return;
    const at = this.onCanvas(clientX, clientY);
    const below = [(at[0] - this.left) / this.scale, (at[1] - this.top) / this.scale];
    this.zoom = Math.min(Math.max(this.zoom * factor, 1), FARTHEST);
    const scale = this.fit * this.zoom;
    this.centre = [this.canvas.width, this.canvas.height].map((room, k) => below[k] + (room / 2 - at[k]) / scale);
    this.draw();
  }

  panBy(dx, dy) {
    this.centre = [this.centre[0] - this.reach(dx), this.centre[1] - this.reach(dy)];
    this.draw();
  }

  showWhole() {
    this.zoom = 1;
    this.draw();
  }

  toScreen([x, y]) {
    return [this.left + (x + 0.5) * this.scale, this.top + (y + 0.5) * this.scale];
  }

  // px of the image at a place of the window; within the image, to a fraction of a px.
  toImage(clientX, clientY) {
    const [x, y] = this.onCanvas(clientX, clientY);
    return this.clamp([(x - this.left) / this.scale - 0.5, (y - this.top) / this.scale - 0.5]);
  }

  clamp([x, y]) {
    if (!this.bitmap) return [0, 0];
    const within = (v, most) => Math.min(Math.max(v, -0.5), most - 0.5);
    return [within(x, this.bitmap.width), within(y, this.bitmap.height)];
  }

  // px of the image that so many px of the window are.
  reach(px) {
    return (px * (this.ratio || 1)) / this.scale;
  }

  draw() {
    this.layout();
    const g = this.canvas.getContext("2d", { alpha: false }); // what is opaque need not be blended with the page below
    g.fillStyle = this.style.getPropertyValue("--stage");
    g.fillRect(0, 0, this.canvas.width, this.canvas.height);
    if (!this.bitmap || !this.moment) return;
    this.unit = Math.min(Math.max(this.canvas.clientWidth / 640, 0.75), 1.6) * (this.ratio || 1);
    this.paint(g);
  }

  // The whole image with what is drawn on it, however much of it the frame shows, as a canvas.
  snapshot() {
    const { scale, left, top, unit } = this;
    const times = Math.max(1, Math.ceil(SNAPSHOT / this.bitmap.width));
    const canvas = Object.assign(document.createElement("canvas"), { width: times * this.bitmap.width, height: times * this.bitmap.height });
    Object.assign(this, { scale: times, left: 0, top: 0, unit: canvas.width / 720 });
    this.paint(canvas.getContext("2d", { alpha: false }));
    Object.assign(this, { scale, left, top, unit });
    return canvas;
  }

  paint(g) {
    g.imageSmoothingEnabled = this.scale < 4;
    g.drawImage(this.bitmap, this.left, this.top, this.scale * this.bitmap.width, this.scale * this.bitmap.height);
    const { result, ghost, candidates, parts, chosen, phase, hover, meant, wire } = this.moment;
    const choosing = phase === "looking" || phase === "choosing";
    if (hover && hover.image === this.moment.image && hover.outline.length) this.area(g, hover.outline, "rgb(86 180 233 / 30%)", "#56b4e9");
    // Who draws by hand sees the image itself; who sets contacts sees the outlines that they go to.
    const drawing = this.tool === "outline" || this.tool === "fingertips";
    if (choosing && candidates.length && !drawing) this.candidates(g, candidates, this.tool !== "contacts");
    this.parts(g, parts, chosen);
    if (ghost && !drawing) this.ghost(g, ghost);
    else if (result && !drawing && !(choosing && this.tool === "contacts")) this.result(g, result, choosing);
    if (choosing && !drawing) this.marks(g, meant);
    if (wire && wire.image === this.moment.image) this.wire(g, wire);
    if (this.sketch) this.sketches(g, this.sketch);
    if (this.cursor) this.cross(g, this.toScreen(this.cursor), 12 * this.unit);
  }

  path(g, points, closed) {
    g.beginPath();
    points.forEach((point, i) => {
      const [x, y] = this.toScreen(point);
      if (i) g.lineTo(x, y);
      else g.moveTo(x, y);
    });
    if (closed) g.closePath();
  }

  line(g, points, colour, width, closed = false) {
    this.path(g, points, closed);
    g.lineJoin = g.lineCap = "round";
    g.strokeStyle = DARK;
    g.lineWidth = (width + 2) * this.unit;
    g.stroke();
    g.strokeStyle = colour;
    g.lineWidth = width * this.unit;
    g.stroke();
  }

  area(g, points, fill, colour) {
    this.path(g, points, true);
    g.fillStyle = fill;
    g.fill();
    this.line(g, points, colour, 1.5, true);
  }

  disc(g, [x, y], radius, colour) {
    g.beginPath();
    g.arc(x, y, radius, 0, 2 * Math.PI);
    g.fillStyle = colour;
    g.fill();
  }

  number(g, place, text, colour = DARK, ink = "#fff") {
    const radius = 10 * this.unit;
    const within = (v, most) => Math.min(Math.max(v, radius + 1), most - radius - 1);
    const x = within(place[0], g.canvas.width);
    const y = within(place[1], g.canvas.height);
    this.disc(g, [x, y], radius + 1.5 * this.unit, DARK);
    this.disc(g, [x, y], radius, colour);
    g.fillStyle = ink;
    g.font = `700 ${13 * this.unit}px system-ui, "DejaVu Sans", sans-serif`;
    g.textAlign = "center";
    g.textBaseline = "middle";
    g.fillText(text, x, y + 0.5 * this.unit);
  }

  candidates(g, candidates, numbered) {
    const pointed = candidates.filter((candidate) => candidate.number === this.pointed);
    const shown = pointed.length ? pointed : candidates;
    [...shown].reverse().forEach((candidate) => {
      const colour = NUMBER_COLOURS[candidate.number - 1];
      if (pointed.length) this.area(g, candidate.outline, `${colour}55`, colour);
      this.line(g, candidate.outline, colour, candidate.number === 1 ? 2.6 : 1.8, true);
    });
    const labels = [];
    shown.forEach((candidate) => {
      if (!numbered) return;
      const at = this.labelPlace(candidate.outline, labels);
      labels.push(at);
      this.number(g, at, String(candidate.number), NUMBER_COLOURS[candidate.number - 1], "#10141a");
    });
  }

  // Each in the colour of its status, with its number in its middle; the chosen one is drawn as a single object is, its number
  // above it.
  parts(g, parts, chosen) {
    const labels = [];
    for (const { number, status, outline } of parts) {
      if (!outline.length) continue;
      const colour = this.style.getPropertyValue(`--${status}`).trim();
      this.line(g, outline, colour, number === chosen ? 3 : 1.4, true);
      const middle = this.toScreen([0, 1].map((k) => outline.reduce((sum, p) => sum + p[k], 0) / outline.length));
      const at = number === chosen ? this.labelPlace(outline, labels) : middle;
      labels.push(at);
      this.number(g, at, String(number), colour, this.style.getPropertyValue("--card"));
    }
  }

  // Above the outline's highest point, else beside another of its points, where no other label is.
  labelPlace(outline, labels) {
    const room = 26 * this.unit;
    const middle = this.toScreen([0, 1].map((k) => outline.reduce((sum, p) => sum + p[k], 0) / outline.length));
    const highest = outline.reduce((best, p) => (p[1] < best[1] ? p : best));
    const [x, y] = this.toScreen(highest);
    let best = { place: [x, y - 16 * this.unit], free: -1 };
    for (const point of [null, ...outline]) {
      let place = best.place;
      if (point) {
        const at = this.toScreen(point);
        const far = Math.hypot(at[0] - middle[0], at[1] - middle[1]) || 1;
        place = [0, 1].map((k) => at[k] + (16 * this.unit * (at[k] - middle[k])) / far);
      }
      const free = Math.min(...labels.map((other) => Math.hypot(other[0] - place[0], other[1] - place[1])), 1e9);
      if (!point && free > room) return place;
      if (free > best.free) best = { place, free };
    }
    return best.place;
  }

  result(g, result, choosing) {
    if (!choosing) result.outlines.forEach((outline) => this.line(g, outline, "#fff", 1.4, true));
    if (!result.contacts) return;
    const colour = this.style.getPropertyValue(choosing ? "--searching" : `--${this.tone}`).trim();
    const contacts = result.contacts;
    const middle = [0, 1].map((k) => contacts.reduce((sum, c) => sum + c[k], 0) / contacts.length);
    (result.cones || []).forEach((cone) => {
      this.path(g, cone, true);
      g.globalAlpha = 0.45;
      g.fillStyle = colour;
      g.fill();
      g.globalAlpha = 1;
    });
    const spokes = contacts.length === 2 ? [contacts] : contacts.map((c) => [middle, c]);
    spokes.forEach((spoke) => this.line(g, spoke, colour, 2.4));
    contacts.forEach((contact, i) => {
      const at = this.toScreen(contact);
      const seen = !result.seen || result.seen[i] >= 0.5;
      this.disc(g, at, 8 * this.unit, DARK);
      this.disc(g, at, 6.4 * this.unit, "#fff");
      this.disc(g, at, 4.8 * this.unit, seen ? colour : "#333");
      if (choosing) return; // numbers are those of the candidates
      const centre = this.toScreen(middle);
      const far = Math.hypot(at[0] - centre[0], at[1] - centre[1]) || 1;
      const away = (22 * this.unit) / far;
      this.number(g, [at[0] + away * (at[0] - centre[0]), at[1] + away * (at[1] - centre[1])], String(i + 1));
    });
  }

  // Where a lost object was last: dashed, and dimmed.
  ghost(g, { outlines, contacts }) {
    const colour = "#ff8554"; // bright on the dark line below it, whatever the image shows
    g.globalAlpha = 0.8;
    g.setLineDash([7 * this.unit, 7 * this.unit]);
    outlines.forEach((outline) => this.line(g, outline, colour, 2, true));
    if (contacts.length === 2) this.line(g, contacts, colour, 2);
    g.setLineDash([]);
    for (const contact of contacts) {
      const at = this.toScreen(contact);
      this.disc(g, at, 7 * this.unit, DARK);
      this.disc(g, at, 5.4 * this.unit, colour);
      this.disc(g, at, 3.2 * this.unit, DARK);
    }
    g.globalAlpha = 1;
  }

  marks(g, meant) {
    meant.on.forEach((place) => this.sign(g, place, "#2fd6a4", true));
    meant.off.forEach((place) => this.sign(g, place, "#ff8554", false));
    if (meant.box) this.box(g, meant.box);
  }

  sign(g, place, colour, plus) {
    const [x, y] = this.toScreen(place);
    const r = 5 * this.unit;
    this.disc(g, [x, y], 9.5 * this.unit, "#fff");
    this.disc(g, [x, y], 8 * this.unit, colour);
    g.strokeStyle = "#08110d";
    g.lineWidth = 2.4 * this.unit;
    g.beginPath();
    g.moveTo(x - r, y);
    g.lineTo(x + r, y);
    if (plus) {
      g.moveTo(x, y - r);
      g.lineTo(x, y + r);
    }
    g.stroke();
  }

  box(g, [x, y, w, h]) {
    g.setLineDash([7 * this.unit, 5 * this.unit]);
    this.path(g, [[x, y], [x + w, y], [x + w, y + h], [x, y + h]], true);
    g.strokeStyle = "#ffd23f";
    g.lineWidth = 2 * this.unit;
    g.stroke();
    g.setLineDash([]);
  }

  wire(g, wire) {
    if (wire.hover.length && !wire.closed) this.line(g, wire.hover, "#9adcff", 1.6);
    if (wire.path.length) this.line(g, wire.path, "#ffd23f", 2, wire.closed);
    wire.points.forEach((point, i) => this.handle(g, point, i === 0 && !wire.closed ? "#2fd6a4" : "#ffd23f"));
  }

  handle(g, point, colour) {
    const at = this.toScreen(point);
    this.disc(g, at, 6.5 * this.unit, DARK);
    this.disc(g, at, 5 * this.unit, colour);
    this.disc(g, at, 1.6 * this.unit, "#10141a");
  }

  // What is being drawn: a box, or points that are not sent yet.
  sketches(g, sketch) {
    if (sketch.box) this.box(g, sketch.box);
    (sketch.pending || []).forEach((point) => this.handle(g, point, "#9adcff"));
    if (sketch.points) {
      if (sketch.points.length > 1) this.line(g, sketch.points, sketch.colour, 1.6, sketch.points.length > 2);
      sketch.points.forEach((point, i) => {
        const at = this.toScreen(point);
        this.cross(g, at, 14 * this.unit);
        this.number(g, [at[0] + 18 * this.unit, at[1] - 18 * this.unit], String(i + 1), sketch.colour, "#10141a");
      });
    }
    if (sketch.snap) this.handle(g, sketch.snap, sketch.colour);
  }

  cross(g, [x, y], arm) {
    for (const [colour, width] of [[DARK, 3.4], ["#fff", 1.4]]) {
      g.strokeStyle = colour;
      g.lineWidth = width * this.unit;
      g.beginPath();
      g.moveTo(x - arm, y);
      g.lineTo(x + arm, y);
      g.moveTo(x, y - arm);
      g.lineTo(x, y + arm);
      g.stroke();
    }
  }

  // The pixels round a place, enlarged, beside the pointer and never under it.
  magnify(place) {
    this.loupe.hidden = !place || !this.bitmap;
    if (this.loupe.hidden) return;
    const ratio = window.devicePixelRatio || 1;
    const side = 176;
    if (this.loupe.width !== side * ratio) this.loupe.width = this.loupe.height = side * ratio;
    const zoom = Math.max(LOUPE, (3 * this.scale) / ratio);
    const g = this.loupe.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.fillStyle = "#11161c";
    g.fillRect(0, 0, side, side);
    g.imageSmoothingEnabled = false;
    const [left, top] = [side / 2 - (place[0] + 0.5) * zoom, side / 2 - (place[1] + 0.5) * zoom];
    g.drawImage(this.bitmap, left, top, this.bitmap.width * zoom, this.bitmap.height * zoom);
    const outlines = this.outlines();
    g.strokeStyle = "#ffd23f";
    g.lineWidth = 1.2;
    outlines.forEach((outline) => {
      g.beginPath();
      outline.forEach(([x, y]) => g.lineTo(left + (x + 0.5) * zoom, top + (y + 0.5) * zoom));
      g.closePath();
      g.stroke();
    });
    for (const [colour, width] of [["rgb(0 0 0 / 70%)", 3], ["#fff", 1]]) {
      g.strokeStyle = colour;
      g.lineWidth = width;
      g.beginPath();
      for (const [a, b] of [[0, 0.42], [0.58, 1]]) {
        g.moveTo(side * a, side / 2);
        g.lineTo(side * b, side / 2);
        g.moveTo(side / 2, side * a);
        g.lineTo(side / 2, side * b);
      }
      g.stroke();
    }
    const [x, y] = this.toScreen(place).map((v) => v / ratio);
    const frame = this.canvas.getBoundingClientRect();
    const gap = 28;
    const goesLeft = x + gap + side > frame.width;
    this.loupe.style.left = `${Math.max(goesLeft ? x - gap - side : x + gap, 4)}px`;
    this.loupe.style.top = `${Math.min(Math.max(y - gap - side, 4), Math.max(frame.height - side - 4, 4))}px`;
  }

  // Outlines to which a contact is moved.
  outlines() {
    if (!this.moment) return [];
    const { candidates, result } = this.moment;
    if (candidates.length) return candidates.map((c) => c.outline);
    return result ? result.outlines : [];
  }

  // The nearest place on an outline within so many px of the image; else the place itself.
  snapped(place, most) {
    let best = null;
    let nearest = most;
    this.outlines().forEach((outline) => {
      outline.forEach((a, i) => {
        const b = outline[(i + 1) % outline.length];
        const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
        const along = ((place[0] - a[0]) * dx + (place[1] - a[1]) * dy) / (dx * dx + dy * dy || 1);
        const t = Math.min(Math.max(along, 0), 1);
        const at = [a[0] + t * dx, a[1] + t * dy];
        const away = Math.hypot(at[0] - place[0], at[1] - place[1]);
        if (away <= nearest) [best, nearest] = [at, away];
      });
    });
    return best || place;
  }
}
