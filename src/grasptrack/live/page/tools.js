// SPDX-License-Identifier: Apache-2.0
// What a pointer or the arrow keys mean on the image: the object, a box, contacts, a live wire, fingertips.

const DRAG = 6; // px of the window that make a drag of a click
const SNAP = 22; // px of the window within which a contact goes to an outline
const GRAB = 14; // px of the window within which a point is taken hold of
const WHEEL = 500; // px of scrolling for a factor of e
const LINE = 32; // px, where a wheel counts lines
const WIRE_MS = 33;
const HOVER_MS = 200;
const COLOURS = { contacts: "#ffd23f", fingertips: "#9adcff" };
const HELD = ["contacts", "outline", "fingertips"]; // tools that need an image that stands still

export class Tools {
  constructor({ picture, send, onChange }) {
    Object.assign(this, { picture, send, onChange, tool: "object", points: [], hover: false, moment: null });
    this.pending = []; // clicks of an outline that the session has not answered yet; it takes them one after another
    this.count = 0; // of its points that the session has told
    this.backs = 0; // of them, those that are taken back, which the session has not told yet
    this.redone = []; // what was taken back, the last first to be set again
    this.press = null;
    this.pointers = new Map(); // that are down, with their places in the window
    this.panning = false; // until all of them are up
    this.pausedHere = false;
    this.asked = 0;
    const canvas = picture.canvas;
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    canvas.addEventListener("pointercancel", (event) => this.release(event));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("pointerleave", () => this.press || this.leave());
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", (event) => {
      if (event.shiftKey) picture.showWhole(); // what a double click without it would choose is not meant
      else if (this.tool === "outline") this.closeWire();
    });
    canvas.addEventListener("blur", () => this.setCursor(null));
  }

  get image() {
    return this.moment ? this.moment.image : 0;
  }

  get wire() {
    const wire = this.moment && this.moment.wire;
    return wire && wire.image === this.image ? wire : null;
  }

  // How many points an outline has that is being drawn.
  get drawn() {
    return this.tool === "outline" ? this.count + this.pending.length : 0;
  }

  get wanted() {
    return this.moment ? this.moment.fingers : 2;
  }

  select(tool) {
    if (tool === this.tool) return;
    if (this.drawn) this.clearWire();
    this.tool = tool;
    this.points = [];
    this.redone = [];
    const moving = this.moment && this.moment.phase === "tracking" && !this.moment.paused;
    if (HELD.includes(tool) && moving) this.pausedHere = this.send("pause", { paused: true });
    else if (!HELD.includes(tool)) this.goOn();
    this.leave(); // with the loupe, which the next tool may not have
    this.refresh();
  }

  // The session goes on where it was only stopped for drawing.
  goOn() {
    if (this.pausedHere && this.moment && this.moment.phase === "tracking") this.send("pause", { paused: false });
    this.pausedHere = false;
  }

  undo() {
    if (this.press) this.release();
    else if (this.points.length) this.points.pop();
    else if (this.drawn) this.clearWire();
    else this.select("object");
    this.refresh();
  }

  // The last point is taken back; of a closed outline, that it was closed.
  takeBack() {
    if (this.drawn > this.backs) {
      if (this.send("wire", { image: this.image, step: "back" })) this.redone.push(this.pending.length ? this.pending.pop() : this.lastTold());
    } else if (this.points.length) this.redone.push(this.points.pop());
    this.refresh();
  }

  // The last step of the outline that the session has told and that is not taken back yet: a point, or that it was closed.
  lastTold() {
    this.backs += 1;
    const { closed, points } = this.wire;
    if (closed && this.backs === 1) return "closed";
    return points[points.length - this.backs + (closed ? 1 : 0)];
  }

  // What was taken back last is set again.
  setAgain() {
    const step = this.redone.pop();
    if (step === "closed") this.closeWire();
    else if (step && this.tool === "outline") this.addToWire(step);
    else if (step) this.points.push(step);
    this.refresh();
  }

  take(moment) {
    const other = this.moment && this.moment.image !== moment.image;
    this.moment = moment;
    if (other && this.tool === "contacts") this.points = [];
    const before = this.count;
    const closed = this.closed;
    this.count = this.wire ? this.wire.points.length : 0;
    this.closed = Boolean(this.wire && this.wire.closed);
    this.backs = Math.max(this.backs - Math.max(before - this.count, 0) - (closed && !this.closed ? 1 : 0), 0);
    if (other) [this.redone, this.backs] = [[], 0];
    if (other || (this.wire && this.wire.closed)) this.pending = [];
    else this.pending.splice(0, Math.max(this.count - before, 0));
    if (moment.phase === "tracking" && !moment.paused && this.tool !== "fingertips" && HELD.includes(this.tool) && !this.pausedHere) this.select("object");
    this.sketch();
  }

  // --- pointer ---

  down(event) {
    if (!this.picture.bitmap || event.button > 2) return;
    event.preventDefault();
    this.picture.canvas.focus({ preventScroll: true });
    this.setCursor(null);
    this.picture.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (event.shiftKey || event.button === 1 || this.pointers.size > 1) {
      this.panning = true;
      this.press = null;
      this.leave();
      return;
    }
    const at = this.picture.toImage(event.clientX, event.clientY);
    const against = event.button === 2 || event.altKey || this.tool === "not";
    this.press = { at, now: at, client: [event.clientX, event.clientY], against, dragged: false, grabbed: this.grab(at) };
    this.follow(at);
  }

  move(event) {
    if (!this.picture.bitmap) return;
    if (this.panning) return this.pan(event);
    const at = this.picture.toImage(event.clientX, event.clientY);
    const press = this.press;
    if (press) {
      const far = Math.hypot(event.clientX - press.client[0], event.clientY - press.client[1]);
      press.dragged ||= far > DRAG;
      press.now = at;
      if (press.dragged && press.grabbed !== null) this.drag(press.grabbed, at);
    } else if (this.tool === "outline" && this.wire && !this.wire.closed && this.wire.points.length) {
      this.ask("wire", { step: "hover", x: at[0], y: at[1] }, WIRE_MS);
    } else if (this.hover && this.tool === "object" && this.moment && (this.moment.phase === "choosing" || this.moment.paused)) {
      this.ask("hover", { x: at[0], y: at[1] }, HOVER_MS);
    }
    this.follow(at);
  }

  // One pointer moves the image, two enlarge it too.
  pan(event) {
    if (!this.pointers.has(event.pointerId)) return;
    const before = [...this.pointers.values()];
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    const after = [...this.pointers.values()];
    const middle = (places) => [0, 1].map((k) => places.reduce((sum, place) => sum + place[k], 0) / places.length);
    const apart = (places) => (places.length > 1 ? Math.max(Math.hypot(places[0][0] - places[1][0], places[0][1] - places[1][1]), 1) : 1);
    const [from, to] = [middle(before), middle(after)];
    this.picture.panBy(to[0] - from[0], to[1] - from[1]);
    this.picture.zoomAt(...to, apart(after) / apart(before));
    this.onChange();
  }

  wheel(event) {
    event.preventDefault();
    const px = event.deltaMode ? LINE * event.deltaY : event.deltaY;
    this.picture.zoomAt(event.clientX, event.clientY, Math.exp(-px / WHEEL));
    this.onChange();
  }

  // Whether what went up was a part of a pan.
  lifted(event) {
    const panned = this.panning;
    this.pointers.delete(event.pointerId);
    if (!this.pointers.size) this.panning = false;
    return panned;
  }

  up(event) {
    if (this.lifted(event)) return;
    const press = this.press;
    if (!press) return;
    const at = this.picture.toImage(event.clientX, event.clientY);
    this.press = null;
    const box = press.dragged && press.grabbed === null && this.tool === "object" && !press.against;
    if (box) this.sendBox(press.at, at);
    else if (press.grabbed === null) this.click(at, press.against);
    else if (press.dragged) this.drag(press.grabbed, at, 0); // where it was let go counts, however soon after the last move
    else if (this.tool === "outline" && press.grabbed === 0) this.closeWire();
    else if (this.tool === "outline" && this.farFrom(press.grabbed, at)) this.click(at, press.against);
    if (event.pointerType !== "mouse") this.leave();
    this.refresh();
  }

  release(event) {
    if (event) this.lifted(event);
    this.press = null;
    this.leave();
    this.refresh();
  }

  leave() {
    this.at = null;
    this.picture.magnify(null);
    this.sketch();
    this.picture.draw();
  }

  follow(at) {
    this.at = at;
    this.sketch();
    this.picture.draw();
    const near = HELD.includes(this.tool);
    this.picture.magnify(near ? this.aim(at) : null);
  }

  // Where a click goes: contacts go to the outline.
  aim(at) {
    return this.tool === "contacts" ? this.picture.snapped(at, this.picture.reach(SNAP)) : at;
  }

  get held() {
    return this.tool === "outline" ? [...(this.wire ? this.wire.points : []), ...this.pending] : this.points;
  }

  // Points may lie closer than a hand takes hold of them.
  farFrom(i, at) {
    const point = this.held[i];
    return point && Math.hypot(point[0] - at[0], point[1] - at[1]) > this.picture.reach(DRAG);
  }

  grab(at) {
    const points = this.held;
    const reach = this.picture.reach(GRAB);
    let best = null;
    points.forEach((point, i) => {
      const away = Math.hypot(point[0] - at[0], point[1] - at[1]);
      if (away <= reach && (best === null || away < best.away)) best = { i, away };
    });
    return best === null ? null : best.i;
  }

  drag(i, at, every = WIRE_MS) {
    if (this.tool !== "outline") this.points[i] = this.aim(at);
    else if (i < this.count) this.ask("wire", { step: "move", point: i, x: at[0], y: at[1] }, every);
  }

  click(at, against) {
    if (!this.moment || !this.image) return;
    const image = this.image;
    this.redone = [];
    if (this.tool === "object" || this.tool === "not") {
      this.send("pick", { image, x: at[0], y: at[1], on: !against });
    } else if (this.tool === "contacts") {
      this.points.push(this.aim(at));
      if (this.points.length === this.wanted) {
        this.pausedHere = false;
        this.send("contacts", { image, points: this.points });
        this.points = [];
        this.tool = "object";
      }
    } else if (this.tool === "fingertips") {
      if (this.points.length === 8) this.points = [];
      this.points.push(at);
    } else if (!(this.wire && this.wire.closed)) {
      this.addToWire(at);
    }
  }

  addToWire(at) {
    if (this.send("wire", { image: this.image, step: "add", x: at[0], y: at[1] })) this.pending.push(at);
  }

  // The session says where there are too few points: it knows of all clicks, and the page perhaps not yet.
  closeWire() {
    if (this.drawn && !(this.wire && this.wire.closed)) this.send("wire", { image: this.image, step: "close" });
  }

  clearWire() {
    this.send("wire", { image: this.image, step: "clear" });
    this.pending = [];
    this.backs = 0;
  }

  useWire() {
    const path = this.wire.path;
    const step = Math.max(1, Math.ceil(path.length / 1000));
    this.pausedHere = false;
    this.send("outline", { image: this.image, points: path.filter((_, i) => i % step === 0) });
    this.tool = "object";
    this.refresh();
  }

  sendBox(a, b) {
    const [x, y] = [Math.min(a[0], b[0]), Math.min(a[1], b[1])];
    const [width, height] = [Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1])];
    this.send("box", { image: this.image, x, y, width, height });
  }

  // Not more often than can be answered.
  ask(command, fields, every) {
    const now = performance.now();
    if (now - this.asked < every) return;
    this.asked = now;
    this.send(command, { image: this.image, ...fields });
  }

  // --- arrow keys ---

  setCursor(place) {
    this.picture.cursor = place;
    this.picture.draw();
  }

  key(event) {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const cursor = this.picture.cursor;
    const bitmap = this.picture.bitmap;
    if (!bitmap) return false;
    if (event.key in steps) {
      const far = event.shiftKey ? 10 : event.altKey ? 0.1 : 1;
      const [dx, dy] = steps[event.key];
      const from = cursor || [bitmap.width / 2, bitmap.height / 2];
      const to = cursor ? this.picture.clamp([from[0] + far * dx, from[1] + far * dy]) : from;
      this.setCursor(to);
      this.picture.magnify(this.aim(to));
      return true;
    }
    if (event.key === "Enter" && cursor) {
      const grabbed = this.tool === "outline" ? this.grab(cursor) : null;
      if (grabbed === 0) this.closeWire();
      else this.click(cursor, event.altKey || this.tool === "not");
      this.refresh();
      return true;
    }
    return false;
  }

  // --- what is drawn, and said ---

  sketch() {
    const sketch = {};
    this.picture.tool = this.tool;
    const press = this.press;
    if (press && press.dragged && press.grabbed === null && this.tool === "object" && !press.against) {
      const [a, b] = [press.at, press.now];
      sketch.box = [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1])];
    }
    if (this.tool === "outline") sketch.pending = this.pending;
    if (this.tool in COLOURS) {
      sketch.colour = COLOURS[this.tool];
      sketch.points = this.points;
      if (this.at && this.tool === "contacts") sketch.snap = this.aim(this.at);
    }
    this.picture.sketch = sketch;
  }

  refresh() {
    this.sketch();
    this.picture.draw();
    this.onChange();
  }

  // What a tool asks for, and that the images stand meanwhile.
  hint() {
    const told = this.wish();
    return told && this.pausedHere ? `Paused meanwhile. ${told}` : told;
  }

  wish() {
    const left = this.wanted - this.points.length;
    switch (this.tool) {
      case "not":
        return "Click what is not the object";
      case "contacts":
        return `Click ${left} contact${left === 1 ? "" : "s"} on the outline`;
      case "fingertips":
        return this.points.length < 2 ? "Click the fingertips of the open gripper" : "Drag to correct, then save";
      case "outline":
        if (this.wire && this.wire.closed) return "Drag points to correct, then use the outline";
        return this.drawn ? "Click along the edge; Enter closes it, Backspace takes a point back" : "Click a point on the object's edge";
      default:
        return "";
    }
  }
}
