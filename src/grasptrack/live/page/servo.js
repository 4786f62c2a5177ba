// SPDX-License-Identifier: Apache-2.0
// The servo's panel and its button. The server decides: it asks whether the button is held, and this answers while it is.

const RETRY_MS = 500;

export class ServoPanel {
  constructor({ at, setText, say }) {
    this.parts = { at, setText, say };
    this.pressed = false;
    this.socket = null;
    const button = at("hold");
    button.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      button.setPointerCapture(event.pointerId);
      this.press();
    });
    for (const event of ["pointerup", "pointercancel", "lostpointercapture"]) button.addEventListener(event, () => this.release("released"));
    button.addEventListener("contextmenu", (event) => event.preventDefault()); // a long touch is no right click
    addEventListener("blur", () => this.release("blur"));
    addEventListener("pagehide", () => this.release("hidden"));
    document.addEventListener("visibilitychange", () => document.hidden && this.release("hidden"));
  }

  get there() {
    return !this.parts.at("servo").hidden;
  }

  open() {
    this.parts.at("servo").hidden = false;
    if (this.socket) return;
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss:" : "ws:"}//${location.host}/hold`);
    socket.onmessage = (event) => this.take(JSON.parse(event.data));
    socket.onclose = () => {
      this.socket = null;
      this.show(false);
      setTimeout(() => this.open(), RETRY_MS);
    };
    this.socket = socket;
  }

  take({ held, error }) {
    if (error) this.parts.say(error);
    if (error || !held) this.show(false);
    else if (this.pressed && !document.hidden && document.hasFocus()) this.send("keep", { number: held });
  }

  press() {
    if (this.pressed) return;
    if (this.send("press")) this.show(true);
    else this.parts.say("not connected: the arm stands");
  }

  release(why) {
    if (this.pressed) this.send("release", { why });
    this.show(false);
  }

  send(command, fields = {}) {
    if (!this.socket || this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify({ do: command, ...fields }));
    return true;
  }

  show(pressed) {
    this.pressed = pressed;
    this.parts.at("hold").setAttribute("aria-pressed", pressed);
  }

  // What the session says of the servo; without a connection nothing is known but that the arm stands.
  describe(moment, open) {
    const { at, setText } = this.parts;
    const servo = (moment && moment.servo) || { word: "Idle", tone: "searching", why: "", held: false };
    const other = servo.held && !this.pressed;
    setText(at("servo-word"), open ? servo.word : "Stopped");
    setText(at("servo-why"), !open ? "no connection to the server: the arm stands" : other ? `${servo.why} (another page holds the button)` : servo.why);
    at("servo").dataset.tone = open ? servo.tone : "lost";
    const figures = [servo.error_px && `${servo.error_px.toFixed(1)} px off`, servo.height_m && `${(1000 * servo.height_m).toFixed(0)} mm to go`];
    setText(at("servo-figures"), open ? figures.filter(Boolean).join(" · ") : "");
    at("hold").disabled = !open || servo.over || other || !servo.goal;
    at("anew").disabled = !open || !servo.over;
    at("teach").disabled = !open || !(moment && moment.phase === "tracking" && moment.result && moment.result.contacts);
  }
}
