// SPDX-License-Identifier: Apache-2.0
// The WebSocket: moments of the session come in with their images, commands go out; after a break it is opened again.

const FIRST_WAIT_MS = 300;
const LONGEST_WAIT_MS = 5000;

// Lines come as whole numbers, x and y by turns, in hundredths of a px.
function points(flat) {
  const out = new Array(flat.length / 2);
  for (let i = 0; i < out.length; i++) out[i] = [flat[2 * i] / 100, flat[2 * i + 1] / 100];
  return out;
}

function unpack(moment) {
  const { result, ghost, candidates, parts, wire, hover } = moment;
  if (result) {
    result.outlines = result.outlines.map(points);
    if (result.cones) result.cones = result.cones.map(points);
  }
  if (ghost) ghost.outlines = ghost.outlines.map(points);
  for (const each of [...candidates, ...parts]) each.outline = points(each.outline);
  if (wire) [wire.path, wire.hover] = [points(wire.path), points(wire.hover)];
  if (hover) hover.outline = points(hover.outline);
  return moment;
}

export class Connection {
  constructor({ onMoment, onError, onHello, onLink }) {
    this.handlers = { onMoment, onError, onHello, onLink };
    this.wait = FIRST_WAIT_MS;
    this.bitmap = null;
    this.image = 0;
    this.turn = Promise.resolve();
    this.open();
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(`${scheme}//${location.host}/socket`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.wait = FIRST_WAIT_MS;
      this.image = 0;
      this.handlers.onLink(true);
    };
    socket.onmessage = (event) => {
      if (typeof event.data === "string") {
        const said = JSON.parse(event.data);
        if (said.error) this.handlers.onError(said.error);
        if (said.hello) this.turn = this.turn.then(() => this.handlers.onHello(said.hello)); // after what came before a break
      } else {
        this.turn = this.turn.then(() => this.take(event.data, socket)).catch((error) => this.handlers.onError(String(error)));
      }
    };
    socket.onclose = () => {
      if (this.socket !== socket) return;
      this.handlers.onLink(false);
      this.askWhy();
      setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT_MS);
    };
    this.socket = socket;
  }

  // Another run at this address has another token; the WebSocket does not say so.
  async askWhy() {
    const answer = await fetch("/").catch(() => null);
    if (answer && answer.status === 403) this.handlers.onError(await answer.text());
  }

  // A moment and its image are shown together: what is drawn belongs to the image below it.
  async take(data, socket) {
    const length = new DataView(data).getUint32(0);
    const moment = unpack(JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length))));
    if (data.byteLength > 4 + length) {
      const bitmap = await createImageBitmap(new Blob([new Uint8Array(data, 4 + length)], { type: "image/jpeg" }));
      if (this.bitmap) this.bitmap.close();
      this.bitmap = bitmap;
    }
    if (document.hidden) await new Promise((shown) => document.addEventListener("visibilitychange", shown, { once: true }));
    this.handlers.onMoment(moment, this.bitmap);
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ do: "drawn", number: moment.number }));
  }

  send(command, fields = {}) {
    if (this.socket.readyState !== WebSocket.OPEN) {
      this.handlers.onError("not connected: the command was not sent");
      return false;
    }
    this.socket.send(JSON.stringify({ do: command, ...fields }));
    return true;
  }
}
