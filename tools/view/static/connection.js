// The socket: what comes in, and what goes out with a proof that this page knows the token.

import { hmac } from "./hmac.js";

const BEAT_MS = 25;
const AGAIN_MS = 1000;
const LOOKS = new Set(["recover", "change", "acquire"]); // say which picture they were asked at

/**
 * Sends events "open", "closed", and one for each kind of message of the server ("hello", "frame",
 * "event", "log", "proved", "told", "changed"), whose `detail` is the message.
 */
export class Connection extends EventTarget {
  /** @param {string} token what the command line printed, or "" */
  constructor(token) {
    super();
    this.token = token;
    this.proved = false;
    this.beating = false;
    this.questions = new Map(); // id → what is to be called with the answer
    this.timer = new Worker("beat.js");
    this.timer.onmessage = () => this.beating && this.#signed("beat", "beat");
    this.#open();
  }

  #open() {
    const where = new URL("/socket", location.href);
    where.protocol = where.protocol === "https:" ? "wss:" : "ws:";
    where.hash = "";
    this.socket = new WebSocket(where);
    this.socket.onmessage = ({ data }) => this.#take(JSON.parse(data));
    this.frames = 0; // that came on this connection
    this.socket.onopen = () => this.#tell("open");
    this.socket.onclose = () => {
      this.proved = false;
      this.nonce = undefined;
      this.beat(false);
      this.#answerAll("the connection is lost");
      this.#tell("closed");
      setTimeout(() => this.#open(), AGAIN_MS);
    };
  }

  #tell(kind, detail) {
    this.dispatchEvent(new CustomEvent(kind, { detail }));
  }

  #take(message) {
    if (message.kind === "frame") {
      this.tick = message.tick;
      this.#count();
    } else if (message.kind === "hello") {
      this.tick = null;
      this.#meet(message);
    } else if (message.kind === "proved") {
      this.proved = message.ok;
    } else if (message.kind === "told") {
      this.questions.get(message.id)?.(message.error);
      this.questions.delete(message.id);
    }
    this.#tell(message.kind, message);
  }

  /** Says how many frames it has drawn: else a page that draws slowly would fall behind. */
  #count() {
    this.frames += 1;
    if (this.counting) return;
    this.counting = true;
    requestAnimationFrame(() => {
      this.counting = false;
      this.#send({ kind: "drawn", frames: this.frames });
    });
  }

  /** A greeting that comes again, of a controller that is new, has the nonce that we know. */
  #meet({ nonce, writes }) {
    if (nonce === this.nonce) return;
    this.nonce = nonce;
    this.id = 0;
    if (!this.token || !writes) return;
    this.#send({ kind: "prove", proof: hmac(this.token, nonce + location.origin) });
  }

  #answerAll(error) {
    for (const answer of this.questions.values()) answer(error);
    this.questions.clear();
  }

  #send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  /** Sends what is signed with the nonce of this connection and an id that rises. */
  #signed(kind, text, more = {}) {
    this.id += 1;
    const mac = hmac(this.token, `${this.nonce}\n${this.id}\n${text}`);
    this.#send({ kind, id: this.id, mac, ...more });
    return this.id;
  }

  /**
   * Asks the server to do something; without a proof nothing is sent.
   * @param {{verb: string}} what
   * @param {(error: string|null) => void} [answer]
   */
  act(what, answer) {
    if (!this.proved) return;
    const text = JSON.stringify(LOOKS.has(what.verb) ? { ...what, tick: this.tick } : what);
    const id = this.#signed("act", text, { do: text });
    if (answer) this.questions.set(id, answer);
  }

  /** Says each 25 ms that the page is alive, while it steers. */
  beat(on) {
    if (on === this.beating) return;
    this.beating = on && this.proved;
    this.timer.postMessage(this.beating ? BEAT_MS : 0);
    if (this.beating) this.#signed("beat", "beat");
  }

  /** Of a log: goes to a time. */
  seek(at_s) {
    this.#send({ kind: "seek", at_s });
  }

  /** Of a log: plays at a speed; 0 stands still. */
  play(speed) {
    this.#send({ kind: "play", speed });
  }
}
